"""Evaders: each flees from the pursuers that it sees, and gives up once one has come near."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.state import Estimates, Intents, Knowledge, Senses
from swarmsim.operations.pursuit.seen import NEEDS, seen
from swarmsim.operations.steering import Steering

Positive = Annotated[float, Meta(gt=0.0)]


@dataclass(frozen=True, slots=True, eq=False)
class Surrender(MessageBatch):
    """The evaders' message: where they have given up; NaN before."""

    x: NDArray[np.float64]  # (t,): m
    y: NDArray[np.float64]  # (t,): m


@dataclass(frozen=True, slots=True, eq=False)
class Surrendered(Estimates):
    """The evaders' knowledge: whether each has given up."""

    given_up: NDArray[np.bool_]  # (n,)


class Flight(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An evader gives up, for good, once a pursuer is within reach, and from then on tells its position.

    The sensor `neighbours` with `groups = true` shows them.
    """

    within: Positive = 0.2  # m, centre to centre
    of: str = "pursuers"  # the group of robots that chase it

    def build(self, context: BuildContext) -> FlightComputation:
        """The computation. Raises InputError if there is no such group."""
        return FlightComputation(self.within, context.robots.number_of(self.of, "of"), len(context.ids))


class FlightComputation:
    """Remembers which evaders have given up."""

    requires = NEEDS
    knowledge_type: type[Knowledge] = Surrendered

    def __init__(self, within: float, group: int, robots: int) -> None:
        self._within, self._group, self._given_up = within, group, np.zeros(robots, np.bool_)
        self.codec = PlainCodec(Surrender(np.zeros(0), np.zeros(0)))

    def say(self, senses: Senses) -> Broadcast[Surrender]:
        """The positions of those that have given up."""
        place = np.where(self._given_up[:, None], senses.pose[:, :2], np.nan)
        return Broadcast.each(Surrender(place[:, 0].copy(), place[:, 1].copy()), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[Surrender]) -> Surrendered:
        """Whether a pursuer is within reach, or was."""
        pursuers = seen(senses, self._group)
        self._given_up[pursuers.seers[pursuers.distance <= self._within]] = True
        return Surrendered(self._given_up.copy())

    def reset(self, robots: NDArray[np.int64]) -> None:
        """They flee again."""
        self._given_up[robots] = False

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """They have given up if another has."""
        self._given_up[robots] = self._given_up[source]


class Evade(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot flees from the pursuers that it sees, the nearer the harder, and from walls; else it stands."""

    of: str = "pursuers"  # the group of robots that chase it
    speed: Positive | None = None  # m/s; default: two thirds of what wheels can
    clearance: Annotated[float, Meta(ge=0.0)] = 0.3  # m, from walls

    def build(self, context: BuildContext) -> Evasion:
        """The strategy. Raises InputError if there is no such group."""
        return Evasion(Steering(context, self.speed, self.clearance), context.robots.number_of(self.of, "of"))


class Evasion:
    """Flees from pursuers."""

    requires = NEEDS
    requires_knowledge: type[Knowledge] = Surrendered

    def __init__(self, steering: Steering, group: int) -> None:
        self._steering, self._group = steering, group

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Surrendered) -> Intents:
        """Flee at full speed, unless it has given up."""
        place, pursuers = senses.pose[:, :2], seen(senses, self._group)
        gap = place[pursuers.seers] - pursuers.place
        push = gap / np.maximum(pursuers.distance, 1e-3)[:, None] ** 2
        away = np.stack([np.bincount(pursuers.seers, one, minlength=len(place)) for one in push.T], axis=1)
        size = np.hypot(away[:, 0], away[:, 1])
        wanted = self._steering.speed * away / np.maximum(size, 1e-12)[:, None]
        moves = (size > 0.0) & ~knowledge.given_up & senses.alive
        fleeing = self._steering.intents(senses, wanted)
        twists = np.zeros((len(place), 2)) if fleeing.twists is None else fleeing.twists
        return Intents.twisting(np.where(moves[:, None], twists, 0.0))
