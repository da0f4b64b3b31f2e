"""A topology, showers that lose messages, wheels on ice, and lightning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.events import Begins, Event
from swarmsim.core.kinematics import Kinematics
from swarmsim.core.messages import Delivery
from swarmsim.core.parts import Links, Parts, Tick
from swarmsim.core.state import State
from swarmsim.robots.kinematics import Differential
from swarmsim.robots.motion import PurePursuit, WaypointFollower

Floats = NDArray[np.float64]


class NextAlive(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A ring that closes over the dead: each live robot hears the next live one."""

    def build(self, context: BuildContext) -> NextAlive:
        """The parameters are the topology."""
        return self

    def links(self, state: State) -> Links:
        """One link for each live robot, if there are at least two."""
        live = np.flatnonzero(state.alive)
        links: Links = np.stack([live, np.roll(live, -1)], axis=1).astype(np.int32)
        return links if len(live) > 1 else links[:0]


class Showers(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """In some iterations rain loses all messages."""

    chance: float = 0.3  # probability of rain in an iteration

    def build(self, context: BuildContext) -> RainyChannel:
        salt = int(context.streams.open("showers").integers(0, 2**63))
        return RainyChannel(self.chance, salt)


class RainyChannel:
    """Delivers all messages or none."""

    def __init__(self, probability: float, salt: int) -> None:
        self._probability, self._salt = probability, salt

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """All messages arrive, or the rain loses them."""
        sent = np.full(len(links), state.iteration)
        letters = np.column_stack([links, sent, sizes[links[:, 1]]]).astype(np.int32)
        rains = chance.uniform(self._salt, state.iteration)[0] < self._probability
        heard, lost = (letters[:0], letters) if rains else (letters, letters[:0])
        return Delivery(heard, (("rain", lost),), state.iteration)


class AgainstIce(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Pure pursuit at reduced speed, since ice is slippery."""

    share: float = 0.5  # of the speed

    def build(self, context: BuildContext) -> Careful:
        return Careful(PurePursuit().build(context), self.share)


class Careful:
    """Slower wheels."""

    def __init__(self, inner: WaypointFollower, share: float) -> None:
        self._inner, self._share, self.follow = inner, share, inner.follow

    def command(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """A share of the usual wheel speeds."""
        return self._share * self._inner.command(pose)


class OnIce(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two wheels with a share of their grip."""

    grip: float = 0.3

    def build(self, context: BuildContext) -> Skidding:
        """The kinematics."""
        return Skidding(Differential().build(context), self.grip)


class Skidding:
    """Wheels that turn as usual."""

    def __init__(self, inner: Kinematics, grip: float) -> None:
        self._inner, self._grip = inner, grip
        self.columns, self.command, self.approach = inner.columns, inner.command, inner.approach

    def forces(self, moving: Floats, wheels: Floats, wanted: Floats, dt: float) -> tuple[Floats, Floats]:
        """The wheels' usual motion, with reduced forces."""
        wheels, push = self._inner.forces(moving, wheels, wanted, dt)
        return wheels, self._grip * push


class Lightning(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """At an iteration lightning strikes the leftmost robot, which stands still from then on."""

    at: int = 10  # iteration

    def build(self, context: BuildContext) -> Storm:
        return Storm(self.at, context.number)


class Storm:
    """Strikes once."""

    def __init__(self, at: int, number: int) -> None:
        self._at, self._number = at, number

    def install(self, parts: Parts) -> Parts:
        self._bodies = parts.bodies
        parts.schedule.enter(self)
        return parts

    def advance(self, now: Tick) -> Sequence[Event]:
        """Strike at its iteration."""
        live = np.flatnonzero(now.after.alive)
        if now.iteration != self._at or len(live) == 0:
            return ()
        struck = live[now.after.pose[live, 0].argmin()]
        self._bodies.crash(np.array([struck]))
        return (Begins(now.iteration, self._number, (int(struck),)),)
