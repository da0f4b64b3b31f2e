"""What a fault does to a part, and the clock that makes it begin and end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.parts import Bodies, Motion, Parts
from swarmsim.core.state import Event, State
from swarmsim.faults.timeline import Robots


class Effect(Protocol):
    """What one kind of fault does."""

    @property
    def words(self) -> tuple[str, str]:
        """What the events say when it begins and when it ends."""
        ...

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts, one of them wrapped; `active` (n,) is a live view of who has the fault. Raises InputError."""
        ...

    def begin(self, robots: Robots, state: State) -> None:
        """The fault begins with these robots, before the iteration of `state`."""
        ...

    def end(self, robots: Robots, state: State) -> Robots:
        """The fault ends with these robots, as far as it can; gives those with whom it did, the others wait."""
        ...


class Lasting:
    """An effect that needs nothing done when it begins or ends: its wrapper looks at who is affected."""

    def begin(self, robots: Robots, state: State) -> None:
        """Nothing."""

    def end(self, robots: Robots, state: State) -> Robots:
        """Nothing."""
        return robots


class Course(Protocol):
    """Says, between two iterations, who has a fault in the next one."""

    active: NDArray[np.bool_]  # (n,): a live view; for the clock alone to write

    def advance(self, state: State, parts: Parts) -> tuple[Robots, Robots]:
        """Move on to the iteration of `state`; gives those with whom the fault begins, and with whom it ends."""
        ...


@dataclass(frozen=True, slots=True)
class TimedFault:
    """An effect on a timeline: one part is wrapped by the effect, and the bodies by a clock."""

    course: Course
    effect: Effect
    cause: str  # what the events give as their cause

    def install(self, parts: Parts) -> Parts:
        """The parts, wrapped. Raises InputError for parts that cannot have this fault."""
        wrapped = self.effect.wrap(parts, self.course.active)
        clock = Clock(wrapped, self.course, self.effect, self.cause)
        clock.advance(clock.state())
        return replace(wrapped, bodies=clock)


class WrappedBodies(ABC):
    """Bodies around others, which do all but what a fault changes."""

    _inner: Bodies

    @abstractmethod
    def drive(self, motion: Motion, period: float) -> State:
        """The state one period (s) later."""

    def state(self) -> State:
        """The state now."""
        return self._inner.state()

    @property
    def solid(self) -> NDArray[np.bool_]:
        """Whose bodies (n,) are in the world."""
        return self._inner.solid

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots out of the world."""
        self._inner.remove(robots)

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Let robots stand as obstacles."""
        self._inner.crash(robots)

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put robots back into the world."""
        self._inner.place(robots, pose)


class Clock(WrappedBodies):
    """Bodies that move a fault's timeline forward whenever they have been driven."""

    def __init__(self, parts: Parts, course: Course, effect: Effect, cause: str) -> None:
        self._inner, self._parts, self._course, self._effect, self._cause = parts.bodies, parts, course, effect, cause

    def advance(self, state: State) -> State:
        """Let the fault begin and end where its time has come, and report it; gives the state after that."""
        begins, ends = self._course.advance(state, self._parts)
        if len(begins) == len(ends) == 0:
            return state
        ended = self._effect.end(ends, state)
        self._course.active[np.setdiff1d(ends, ended)] = True
        self._effect.begin(begins, state)
        for robots, word in zip((ended, begins), self._effect.words[::-1], strict=True):
            self._parts.report.events.extend(Event(state.iteration, int(i), word, self._cause) for i in robots)
        return self._inner.state()

    def drive(self, motion: Motion, period: float) -> State:
        """The state one period later, after what has begun and ended."""
        return self.advance(self._inner.drive(motion, period))
