"""The robots of a fleet as their logs have them: a world that hears them again goes the same way again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

import msgspec

from swarmsim.core.errors import InputError
from swarmsim.core.readings import Channels
from swarmsim.core.robot import Deed, Sensed
from swarmsim.fleet import logbook, wire
from swarmsim.fleet.free import heard_by
from swarmsim.fleet.logbook import Came, ProcessesSeen, WorldTold
from swarmsim.fleet.watchdog import Watchdog
from swarmsim.fleet.wire import Ears, Telegram


class MissingError(Exception):
    """A log does not hold what is needed next; the message says which, and from which iteration on."""


@dataclass(frozen=True, slots=True)
class Kept:
    """What a robot's log holds, by iteration."""

    path: Path
    said: dict[int, bytes] = field(default_factory=dict)  # telegrams
    deeds: dict[int, bytes] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path) -> Kept:
        """Read a log. Raises InputError."""
        found = cls(path)
        for entry in logbook.entries(path):
            if entry.kind in (wire.SAID, wire.DEED):
                held = found.said if entry.kind == wire.SAID else found.deeds
                held[entry.telegram(path).iteration] = entry.data
        return found


@final
class WorldLog:
    """A world's log."""

    def __init__(self, path: Path) -> None:
        """Read it. Raises InputError for a file that is none."""
        self._came, self._seen = list[Came](), list[ProcessesSeen]()
        told = None
        try:
            for entry in logbook.entries(path):
                if entry.kind == logbook.SCENARIO:
                    told = msgspec.msgpack.decode(entry.data, type=WorldTold)
                elif entry.kind == logbook.CAME:
                    self._came.append(msgspec.msgpack.decode(entry.data, type=Came))
                elif entry.kind == logbook.SEEN:
                    self._seen.append(msgspec.msgpack.decode(entry.data, type=ProcessesSeen))
        except msgspec.DecodeError as problem:
            raise InputError(f"{path}: {problem}; expected the log of a fleet's world") from problem
        if told is None:
            raise InputError(f"{path}: begins without a scenario; expected the log of a fleet's world")
        #: Its scenario and terms.
        self.told = told

    def came(self) -> Iterator[Came]:
        """What had come, in order."""
        return iter(self._came)

    def seen(self) -> Iterator[ProcessesSeen]:
        """What was seen of processes, in order."""
        return iter(self._seen)


@final
class LoggedEnd:
    """The robots of a fleet at a free pace, or in lockstep without a `watchdog`, from logs."""

    def __init__(
        self,
        robots: Sequence[Kept | None],
        actuators: Channels,
        came: Iterator[Came],
        looks: Iterator[ProcessesSeen],
        watchdog: Watchdog | None,
    ) -> None:
        """`came` tells, twice an iteration, what had come from robots; `looks` what was seen of their processes."""
        self._robots, self._actuators, self._dog = robots, actuators, watchdog
        self._came, self._looks = came, looks
        self._sensed: Sequence[Sensed] = ()
        self._deeds: list[list[Deed]] = [[] for _ in robots]

    def forget(self, robots: Sequence[int]) -> None:
        """Nothing: the log tells who joins again."""

    def look(self, now: int) -> ProcessesSeen:
        """What was seen of processes then. Raises MissingError at the end of the log."""
        found = next(self._looks, None)
        if found is None or found.iteration != now:
            raise MissingError(f"the world's log lacks what was seen in iteration {now}")
        return found

    def sense(self, sensed: Sequence[Sensed]) -> list[bytes]:
        """What each robot said in time."""
        self._sensed, now = sensed, sensed[0].iteration
        said = range(len(self._robots)) if self._dog is None else self._next(now).said
        read = {robot: Telegram.read(self._of(robot, now, "said")) for robot in said}
        return [next(iter(wire.frames_in(read[robot])), b"") if robot in read else b"" for robot in range(len(sensed))]

    def hear(self, ears: Sequence[Ears]) -> list[Deed]:
        """What each robot did."""
        now = self._sensed[0].iteration
        if self._dog is None:
            return [self._deed(robot, now) for robot in range(len(ears))]
        self._next(now)
        came, self._deeds = self._deeds, [[] for _ in self._deeds]
        return self._dog.taken(now, [one.pose for one in self._sensed], came)

    @property
    def heard(self) -> list[tuple[int, int, int]]:
        """Who heard whom, as the deeds tell."""
        return heard_by(self._deeds, self._sensed[0].iteration)

    def _next(self, now: int) -> Came:
        """What had come when the world went on."""
        found = next(self._came, None)
        if found is None or found.iteration != now:
            raise MissingError(f"the world's log ends before iteration {now} does")
        if self._dog is not None:
            for robot in found.ready:
                self._dog.forget(robot)
        for robot, iteration in found.deeds:
            self._deeds[robot].append(self._deed(robot, iteration))
        return found

    def _deed(self, robot: int, iteration: int) -> Deed:
        return wire.deed_of(Telegram.read(self._of(robot, iteration, "deeds")), self._actuators)

    def _of(self, robot: int, iteration: int, what: str) -> bytes:
        kept = self._robots[robot]
        found: dict[int, bytes] = {} if kept is None else getattr(kept, what)
        if iteration not in found:
            whole = max(found, default=-1) + 1
            raise MissingError(
                f"robot {robot} has no log"
                if kept is None
                else f"{kept.path} holds {whole} iterations, not {iteration}"
            )
        return found[iteration]
