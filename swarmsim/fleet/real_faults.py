"""Faults that strike processes: a crash is a kill, a frozen mind a stop, who joins late is started late."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.events import Begins, Ends, Event, Lost, Regained
from swarmsim.core.parts import Fault, Parts, Tick
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import State
from swarmsim.faults.body import Crash, Join, Remove
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.mind import MindFault
from swarmsim.fleet.free import FreeEnd
from swarmsim.fleet.processes import Processes


@final
class RealFaults:
    """The faults of a run that are carried out on processes, and what becomes of processes otherwise."""

    def __init__(self) -> None:
        """The processes and the world's end come later, before the first iteration."""
        self.processes: Processes | None = None
        self.crew: FreeEnd | None = None
        #: The robots that are not to be there at the start.
        self.late: set[int] = set()
        #: The robots that a fault has struck.
        self.struck: set[int] = set()

    def carried(self, part: Part[Fault], fault: Fault) -> Fault:
        """The same fault, carried out on processes if it means something there."""
        keys = part.parameters
        if not isinstance(fault, TimedFault):
            return fault
        if isinstance(keys, Crash | Remove | Join):
            return _Carried(self, fault, "gone", getattr(keys, "map", "kept") == "kept" and not isinstance(keys, Join))
        if isinstance(keys, MindFault) and keys.failure == "frozen":
            return _Carried(self, TimedFault(fault.course, _Stopped(), fault.number), "paused", True)
        return fault

    def strike(self, robots: Sequence[int], how: Literal["gone", "paused"]) -> None:
        """Kill or stop processes. Before the start: they are not started."""
        if self.processes is None:
            self.late |= set(robots)
        elif how == "gone":
            self.processes.kill(robots)
        else:
            self.processes.pause(robots)

    def restore(self, robots: Sequence[int], how: Literal["gone", "paused"], recalls: bool) -> None:
        """Start them again, or let them go on."""
        if self.processes is not None and how == "gone":
            self.processes.start(robots, recalls)
        elif self.processes is not None:
            self.processes.pause(robots, False)

    def is_struck(self, robot: int, how: Literal["gone", "paused"]) -> bool:
        """Whether its process is gone or stopped."""
        if self.processes is None:
            return robot in self.late
        return self.processes.is_gone(robot) if how == "gone" else self.processes.is_paused(robot)

    def is_ready(self, robot: int) -> bool:
        """Whether it has joined."""
        return self.crew is not None and robot in self.crew.ready


@final
class _Stopped(StatelessEffect):
    """What a paused process does to the swarm: nothing that its silence does not."""

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        return parts


@dataclass(frozen=True, slots=True)
class _Carried:
    """A fault that strikes processes on its timeline; its effect and its events follow when they have been struck."""

    real: RealFaults
    planned: TimedFault
    how: Literal["gone", "paused"]
    recalls: bool  # whether robots that come back know what they knew

    def install(self, parts: Parts) -> Parts:
        """The parts, wrapped as by the fault itself."""
        wrapped = self.planned.effect.wrap(parts, self.planned.course.active)
        parts.schedule.enter(_Driver(wrapped, self))
        return wrapped


@final
class _Driver:
    """Strikes processes when it is time, and tells of it once they are seen to be struck."""

    def __init__(self, parts: Parts, fault: _Carried) -> None:
        self._parts, self._fault = parts, fault
        self._planned: set[int] = set()
        self._has: set[int] = set()

    def advance(self, now: Tick) -> Sequence[Event]:
        fault, real, number = self._fault, self._fault.real, self._fault.planned.number
        state = self._parts.bodies.state()
        begins, ends = fault.planned.course.advance(state, now.progress, self._parts)
        if len(begins):
            real.strike(begins.tolist(), fault.how)
        if len(ends):
            real.restore(ends.tolist(), fault.how, fault.recalls)
        self._planned = (self._planned | set(begins.tolist())) - set(ends.tolist())
        back = self._ended(state)
        struck = [one for one in sorted(self._planned - self._has) if real.is_struck(one, fault.how)]
        if struck:
            fault.planned.effect.begin(np.array(struck), state)
            if real.crew is not None and fault.how == "gone":
                real.crew.forget(struck)
        self._has |= set(struck)
        real.struck |= set(struck)
        events: list[Event] = [Ends(now.iteration, number, tuple(back))] if back else []
        return [*events, Begins(now.iteration, number, tuple(struck))] if struck else events

    def _ended(self, state: State) -> list[int]:
        """End the fault on the robots that are there again, where possible."""
        fault, real = self._fault, self._fault.real
        come = sorted(
            one
            for one in self._has - self._planned
            if not real.is_struck(one, fault.how) and (fault.how == "paused" or real.is_ready(one))
        )
        if not come:
            return []
        if fault.how == "gone" and not fault.recalls:
            self._parts.computation.reset(np.array(come))
        back: list[int] = fault.planned.effect.end(np.array(come), state).tolist()
        self._has -= set(back)
        real.struck -= set(back)
        return back


@final
class Losses:
    """Robots lost through no fault of the scenario's: their bodies stay where they are until they are back."""

    def __init__(self, parts: Parts, real: RealFaults, is_there: Callable[[int], bool]) -> None:
        """`is_there` tells whether a robot's process is."""
        self._parts, self._real, self._is_there = parts, real, is_there
        self._lost: set[int] = set()

    def advance(self, now: Tick) -> Sequence[Event]:
        """Crash the bodies of robots that are lost, and let those go on that are back, with an empty memory."""
        bodies, crew = self._parts.bodies, self._real.crew
        if crew is None:
            return ()
        state = bodies.state()
        lost = [
            robot
            for robot in np.flatnonzero(state.alive).tolist()
            if robot not in self._real.struck and not self._is_there(robot)
        ]
        back = [robot for robot in sorted(self._lost) if robot in crew.ready and self._is_there(robot)]
        events: list[Event] = []
        if back:
            self._parts.computation.reset(np.array(back))
            bodies.place(np.array(back), state.pose[back])
            events.append(Regained(now.iteration, tuple(back)))
        if lost:
            bodies.crash(np.array(lost))
            crew.forget(lost)
            events.append(Lost(now.iteration, tuple(lost)))
        self._lost = (self._lost | set(lost)) - set(back)
        return events
