"""Faults that strike processes: a crash is a kill, a frozen mind a stop, who joins late is started late."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, final

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core.events import Begins, Ends, Event, Lost, Regained
from swarmsim.core.parts import Fault, Parts, Tick
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import State
from swarmsim.faults.body import Crash, Join, Remove
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.mind import MindFault
from swarmsim.fleet import logbook
from swarmsim.fleet.free import FreeEnd
from swarmsim.fleet.logbook import Logbook, ProcessesSeen
from swarmsim.fleet.processes import Processes


@final
class RealFaults:
    """The faults of a run that are carried out on processes, and what becomes of processes otherwise."""

    def __init__(self) -> None:
        """The processes, and what looks at them, come later, before the first iteration."""
        self.processes: Processes | None = None
        self.seen: Callable[[int], ProcessesSeen] | None = None
        #: Called with robots that have gone.
        self.forget: Callable[[Sequence[int]], None] = lambda robots: None
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

    def look(self, now: int) -> ProcessesSeen:
        """What is to be seen of the processes; it is logged."""
        if self.seen is not None:
            return self.seen(now)
        return ProcessesSeen(now, gone=tuple(sorted(self.late)))


@final
class ProcessWatch:
    """Looks at processes on this machine, or at who is there on the link, and logs what it sees."""

    def __init__(self, crew: FreeEnd, processes: Processes | None, log: Logbook | None) -> None:
        """Without `processes` the transport tells who is there."""
        self._crew, self._processes, self._log = crew, processes, log

    def __call__(self, now: int) -> ProcessesSeen:
        """What is to be seen."""
        lines, processes = self._crew.lines, self._processes
        robots = range(len(lines.charges))
        if processes is None:
            present = lines.present()
            self._crew.regain(present)
            silent = filter(self._crew.is_silent, robots)
            gone, paused = [one for one in silent if one not in present], list[int]()
        else:
            gone, paused = list(filter(processes.is_gone, robots)), list(filter(processes.is_paused, robots))
        seen = ProcessesSeen(now, tuple(gone), tuple(paused), tuple(sorted(self._crew.ready)))
        if self._log is not None:
            self._log.note(logbook.SEEN, msgspec.msgpack.encode(seen))
        return seen


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
        seen = real.look(now.iteration)
        back = self._ended(state, seen)
        there = set(seen.gone if fault.how == "gone" else seen.paused)
        struck = sorted((self._planned - self._has) & there)
        if struck:
            fault.planned.effect.begin(np.array(struck), state)
            if fault.how == "gone":
                real.forget(struck)
        self._has |= set(struck)
        real.struck |= set(struck)
        events: list[Event] = [Ends(now.iteration, number, tuple(back))] if back else []
        return [*events, Begins(now.iteration, number, tuple(struck))] if struck else events

    def _ended(self, state: State, seen: ProcessesSeen) -> list[int]:
        """End the fault on the robots that are there again, where possible."""
        fault, real = self._fault, self._fault.real
        gone = fault.how == "gone"
        absent = {*seen.gone} if gone else {*seen.paused}
        come = sorted(one for one in self._has - self._planned - absent if not gone or one in seen.ready)
        if not come:
            return []
        if gone and not fault.recalls:
            self._parts.computation.reset(np.array(come))
        back: list[int] = fault.planned.effect.end(np.array(come), state).tolist()
        self._has -= set(back)
        real.struck -= set(back)
        return back


@final
class Losses:
    """Robots lost through no fault of the scenario's: their bodies stay where they are until they are back."""

    def __init__(self, parts: Parts, real: RealFaults) -> None:
        self._parts, self._real = parts, real
        self._lost: set[int] = set()

    def advance(self, now: Tick) -> Sequence[Event]:
        """Crash the bodies of robots that are lost, and let those go on that are back, with an empty memory."""
        if self._real.seen is None:
            return ()
        bodies, seen = self._parts.bodies, self._real.look(now.iteration)
        state = bodies.state()
        alive = set(np.flatnonzero(state.alive).tolist())
        lost = sorted((alive & set(seen.gone)) - self._real.struck)
        back = sorted((self._lost & set(seen.ready)) - set(seen.gone))
        events: list[Event] = []
        if back:
            self._parts.computation.reset(np.array(back))
            bodies.place(np.array(back), state.pose[back])
            events.append(Regained(now.iteration, tuple(back)))
        if lost:
            bodies.crash(np.array(lost))
            self._real.forget(lost)
            events.append(Lost(now.iteration, tuple(lost)))
        self._lost = (self._lost | set(lost)) - set(back)
        return events
