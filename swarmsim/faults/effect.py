"""What a fault does to a part, and the clock that makes it begin and end."""

from __future__ import annotations

from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.events import Begins, Ends, Event
from swarmsim.core.parts import Parts, Tick
from swarmsim.core.state import State
from swarmsim.faults.timeline import Robots


class Effect(Protocol):
    """What one kind of fault does."""

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts, one wrapped; `active` (n,): a live view of the robots with the fault. Raises InputError."""
        ...

    def begin(self, robots: Robots, state: State) -> None:
        """Start the fault on these robots, before the iteration of `state`."""
        ...

    def end(self, robots: Robots, state: State) -> Robots:
        """End the fault on these robots, where possible; gives those on which it ended; the others wait."""
        ...


class StatelessEffect(ABC):
    """An effect without work at its start or end: its wrapper reads which robots are affected."""

    def begin(self, robots: Robots, state: State) -> None:
        """Nothing."""

    def end(self, robots: Robots, state: State) -> Robots:
        """Nothing."""
        return robots


class ActivitySchedule(Protocol):
    """Says, between two iterations, which robots have a fault in the next one."""

    active: NDArray[np.bool_]  # (n,): a live view; only the clock writes it

    def advance(self, state: State, progress: float, parts: Parts) -> tuple[Robots, Robots]:
        """Move on to the iteration of `state`; gives the robots that get the fault, and those that lose it.

        `progress` (0 to 1) is how much of the task was done in the iteration before.
        """
        ...


@dataclass(frozen=True, slots=True)
class TimedFault:
    """An effect on a timeline: one part is wrapped by the effect, and the calendar has its clock."""

    course: ActivitySchedule
    effect: Effect
    number: int  # the fault's place in the scenario

    def install(self, parts: Parts) -> Parts:
        """The parts, wrapped. Raises InputError for parts that cannot have this fault."""
        wrapped = self.effect.wrap(parts, self.course.active)
        parts.schedule.enter(FaultDriver(wrapped, self))
        return wrapped


@dataclass(frozen=True, slots=True)
class FaultDriver:
    """Moves a fault's timeline forward between two iterations."""

    parts: Parts
    fault: TimedFault

    def advance(self, now: Tick) -> Sequence[Event]:
        """Begin and end the fault where it is due."""
        state, course, effect = self.parts.bodies.state(), self.fault.course, self.fault.effect
        begins, ends = course.advance(state, now.progress, self.parts)
        if len(begins) == len(ends) == 0:
            return ()
        ended = effect.end(ends, state)
        course.active[np.setdiff1d(ends, ended)] = True
        effect.begin(begins, state)
        events: list[Event] = []
        if len(ended):
            events.append(Ends(now.iteration, self.fault.number, _ids(ended)))
        if len(begins):
            events.append(Begins(now.iteration, self.fault.number, _ids(begins)))
        return events


def _ids(robots: Robots) -> tuple[int, ...]:
    """The robot, for an event; none for the -1 of a fault of the whole network."""
    return tuple(int(robot) for robot in robots if robot >= 0)
