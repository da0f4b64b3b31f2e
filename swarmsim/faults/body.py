"""Faults of bodies: robots that vanish, crash, come back or come late."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.capabilities import QUANTIFIED
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Parts
from swarmsim.core.state import State
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.timeline import Duration, Mark, Robots, Timed, Timeline


class Remove(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots vanish from the building and the network; when it ends, they return to the spawn area."""

    map: Literal["kept", "lost"] = "kept"  # whether what they mapped stays, in the collective map and with them

    @property
    def mark(self) -> Mark:
        return "removed"

    def build(self, context: BuildContext) -> TimedFault:
        effect = Removal(context, self.map)
        return TimedFault(Timeline(self, context), effect, context.number)


class Crash(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots die where they are and stay in the way; when it ends, they go on from there."""

    map: Literal["kept", "lost"] = "kept"  # whether what they mapped stays, in the collective map and with them

    @property
    def mark(self) -> Mark:
        """They are drawn as dead."""
        return ""

    def build(self, context: BuildContext) -> TimedFault:
        return TimedFault(Timeline(self, context), Crashing(self.map), context.number)


class Push(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots get one blow that adds a velocity; the friction of their wheels brakes it.

    By default the fault lasts one iteration, so that it can strike the same robot again.
    """

    velocity: tuple[float, float]  # m/s, to the right and up

    def build(self, context: BuildContext) -> TimedFault:
        """The fault. Raises InputError for a velocity that is too high."""
        if not all(-10.0 <= one <= 10.0 for one in self.velocity):
            raise InputError(f"velocity: {list(self.velocity)} m/s; expected at most 10 m/s either way")
        once = self if self.duration or self.between else msgspec.structs.replace(self, duration=1)
        return TimedFault(Timeline(once, context), Blow(self.velocity), context.number)


class Blow(StatelessEffect):
    """Pushes bodies once."""

    def __init__(self, velocity: tuple[float, float]) -> None:
        self._velocity = velocity

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The same parts. Raises InputError for bodies that cannot be pushed."""
        self._bodies = parts.bodies
        self._bodies.push(np.empty(0, np.int64), self._velocity)
        return parts

    def begin(self, robots: Robots, state: State) -> None:
        self._bodies.push(robots, self._velocity)


class Join(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The robots with the highest ids are not there at the start; they enter at the spawn area, with an empty map."""

    at: Duration  # the first iteration with the first of them
    every: Duration | None = None  # iterations until the next enter; default: all at once
    count: Annotated[int, Meta(ge=1)] = 1  # robots at a time
    times: Annotated[int, Meta(ge=1)] = 1  # how often robots enter
    map: Literal["empty", "copied"] = "empty"  # copied: from the live robot that knows most

    @property
    def mark(self) -> Mark:
        """They are not there yet."""
        return "late"

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError unless at least one robot is there at the start."""
        late = self.count * self.times
        if late >= context.swarm:
            raise InputError(f"count: {late} of {context.swarm} robots are late; expected one at the start at least")
        if self.times > 1 and self.every is None:
            raise InputError(f"every: required key is missing; expected iterations between {self.times} times")
        effect = Joining(context, self.map)
        return TimedFault(Lateness(self, context.swarm), effect, context.number)


class Lateness:
    """The robots still to come: the highest ids, lowest first."""

    def __init__(self, fault: Join, robots: int) -> None:
        late = fault.count * fault.times
        self._due = np.zeros(robots, np.int64)
        self._due[robots - late :] = fault.at + np.arange(late) // fault.count * (fault.every or 0)
        #: Which robots are not there (n,); a live view.
        self.active: NDArray[np.bool_] = np.zeros(robots, np.bool_)

    def advance(self, state: State, progress: float, parts: Parts) -> tuple[Robots, Robots]:
        """Move on to the iteration of `state`; gives the robots that are late from now on, and those that come."""
        late = self._due > state.iteration
        begins, ends = np.flatnonzero(late & ~self.active), np.flatnonzero(self.active & ~late)
        self.active[:] = late
        return begins, ends


class Removal:
    """Takes bodies out of the world, and puts them back at its entrance."""

    def __init__(self, context: BuildContext, memory: Literal["kept", "lost"]) -> None:
        self._context, self._memory, self._number = context, memory, context.number
        self._streams: dict[int, np.random.Generator] = {}  # of returned robots

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The same parts: bodies can be taken out as they are."""
        self._bodies, self._computation, self._building = parts.bodies, parts.computation, parts.building
        return parts

    def begin(self, robots: Robots, state: State) -> None:
        self._bodies.remove(robots)
        if self._memory == "lost":
            self._computation.reset(robots)

    def end(self, robots: Robots, state: State) -> Robots:
        """They return to random places of the spawn area; while it is full, they wait."""
        centres, radius, entered = self._building.entrance, self._context.robots.radius, []
        for robot in robots.tolist():
            bodies = self._bodies.state().pose[self._bodies.solid, :2]
            there = np.vstack([np.column_stack([bodies, np.full(len(bodies), radius)]), self._building.walkers()])
            apart = np.hypot(*(centres[:, None] - there[:, :2]).transpose(2, 0, 1))
            free = np.flatnonzero((apart >= there[:, 2] + radius).all(axis=1))
            if len(free):
                stream = self._stream(robot)
                pose = np.array([[*centres[stream.choice(free)], stream.uniform(-np.pi, np.pi)]])
                self._bodies.place(np.array([robot]), pose)
                entered.append(robot)
        return np.array(entered, np.int64)

    def _stream(self, robot: int) -> np.random.Generator:
        if robot not in self._streams:
            self._streams[robot] = self._context.streams.open(f"fault {self._number} entrance", robot)
        return self._streams[robot]


class Joining:
    """Keeps latecomers out of the world until they enter, with the map they are given."""

    def __init__(self, context: BuildContext, memory: Literal["empty", "copied"]) -> None:
        self._absence = Removal(context, "kept")
        self._memory = memory

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The same parts: bodies can be taken out as they are."""
        self._computation = parts.computation
        self._known = QUANTIFIED.needed(parts.computation, "map: 'copied'") if self._memory == "copied" else None
        return self._absence.wrap(parts, active)

    def begin(self, robots: Robots, state: State) -> None:
        """They are not there yet. Raises InputError if some are gone already."""
        if not state.alive[robots].all():
            gone = ", ".join(map(str, robots[~state.alive[robots]]))
            raise InputError(f"count: robots {gone} are dead at the start already; expected this fault before that one")
        self._absence.begin(robots, state)

    def end(self, robots: Robots, state: State) -> Robots:
        """As many enter as there is room for."""
        entered = self._absence.end(robots, state)
        if self._known is not None and len(entered):
            best = int(np.where(state.alive, self._known.amounts(), -1).argmax())
            if state.alive[best]:
                self._computation.copy_from(entered, best)
        return entered


class Crashing:
    """Stops bodies for good, or until they are repaired."""

    def __init__(self, memory: Literal["kept", "lost"]) -> None:
        self._memory = memory

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The same parts: bodies can be stopped as they are."""
        self._bodies, self._computation = parts.bodies, parts.computation
        return parts

    def begin(self, robots: Robots, state: State) -> None:
        self._bodies.crash(robots)
        if self._memory == "lost":
            self._computation.reset(robots)

    def end(self, robots: Robots, state: State) -> Robots:
        """They go on from their present place."""
        self._bodies.place(robots, state.pose[robots])
        return robots
