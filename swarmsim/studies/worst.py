"""Finds the smallest timelines of faults that make a swarm fail, by random search and shrinking.

A timeline fails if no tried seed does the task within a given multiple of the iterations without faults. Its size is
the number of robots struck, with ties decided by the number of robot-iterations with a fault. The search starts with
faults of one kind that strike all robots, early or late, briefly or for good, then tries random timelines. Failing ones
are shrunk by delta debugging (Zeller and Hildebrandt 2002): entries are dropped, robots halved and times cut as long as
they still fail. The result is small, but not proven to be the smallest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
import tomli_w

from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.parts import Fault
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, Stop, table_of
from swarmsim.core.scenario.files import Table
from swarmsim.core.scenario.identity import code_of
from swarmsim.core.scenario.part import Part
from swarmsim.studies.engine import Job
from swarmsim.studies.store import Row

#: The faults of entries, by their names in tables.
KINDS: Final[Mapping[str, Table]] = {
    "crash": {"use": "crash"},
    "remove, map lost": {"use": "remove", "map": "lost"},
    "motor off": {"use": "motor", "failure": "off"},
    "sensor off": {"use": "sensor", "failure": "off"},
    "sensor sees walls": {"use": "sensor", "failure": "stuck", "value": "occupied"},
    "radio off": {"use": "radio", "failure": "off"},
    "mind frozen": {"use": "mind", "failure": "frozen"},
    "byzantine occupied": {"use": "byzantine", "failure": "occupied"},
    "byzantine free": {"use": "byzantine", "failure": "free"},
    "byzantine inverted": {"use": "byzantine", "failure": "inverted"},
}
TRIES: Final = 10_000  # draws before giving up on a smaller timeline
BATCH: Final = 8  # timelines tried at a time, independent of the number of workers, so that it never changes the answer


@dataclass(frozen=True, slots=True)
class Entry:
    """One fault of a timeline."""

    kind: str  # among KINDS
    count: int  # robots, drawn at random
    first: int  # iteration with it
    duration: int | None  # iterations; None: for good

    def part(self) -> Part[Fault]:
        """The fault as a part of a scenario."""
        lasts = {} if self.duration is None else {"duration": self.duration}
        return Part("fault", {**KINDS[self.kind], "at": self.first, "count": self.count, "min_alive": 0, **lasts})

    def size(self, limit: int) -> int:
        """Robot-iterations with the fault in a run of this many iterations."""
        left = max(limit - self.first, 0)
        return self.count * (left if self.duration is None else min(self.duration, left))

    def words(self) -> str:
        """The entry in a few words."""
        until = "for good" if self.duration is None else f"for {self.duration}"
        return f"{self.kind}: {self.count} robot{'s' * (self.count > 1)} from iteration {self.first} on, {until}"


Timeline = tuple[Entry, ...]


@dataclass(frozen=True, slots=True)
class Failure:
    """A timeline that makes the swarm fail with every seed tried."""

    timeline: Timeline
    robots: int  # struck, counted once per entry
    size: int  # robot-iterations with a fault
    share: float  # `size` as a share of the run's robot-iterations


@dataclass(frozen=True, slots=True)
class Findings:
    """The results, and the effort."""

    sound: tuple[int, ...]  # iterations without faults, by seed
    limit: tuple[int, ...]  # iterations after which a run fails, by seed
    by_kind: dict[str, Failure | None]  # the smallest with one entry, for each kind
    smallest: Failure | None  # of all tried
    timelines: int  # tried
    runs: int  # done


class Search:
    """The search for one scenario; `perform` does runs and gives their rows in any order."""

    def __init__(
        self,
        scenario: Scenario,
        world: str,
        run_jobs: Callable[[Sequence[Job]], Iterator[Row]],
        seeds: int = 3,
        factor: float = 2.0,
        tell: Callable[[str], None] = lambda words: None,
    ) -> None:
        """`seeds` start at the scenario's; `tell` gets results on the way."""
        self._scenario, self._world, self._perform, self._tell = scenario, world, run_jobs, tell
        self._seeds, self._factor = [scenario.seed + number for number in range(seeds)], factor
        self.timelines = self.runs = 0
        self.sound: tuple[int, ...] = ()
        self.limit: tuple[int, ...] = ()

    def run(self, budget: int, entries: int = 3, seed: int = 1) -> Findings:
        """Search with this many timelines, of at most `entries` entries.

        Raises InputError if a run without faults does not finish.
        """
        sound = self._rows([((), seed, self._scenario.limit) for seed in self._seeds])
        if any(row.status != "finished" for row in sound):
            raise InputError("study worst: the task is not done without faults; expected a scenario that finishes")
        self.sound = tuple(int(row.iterations or 0) for row in sound)
        self.limit = tuple(math.ceil(self._factor * took) for took in self.sound)
        robots, generator = self._scenario.robots.count, np.random.default_rng(seed)
        by_kind: dict[str, Failure | None] = {}
        half, late = min(self.sound) // 2, min(self.sound) * 9 // 10
        for kind in self._kinds():
            everybody = [
                (Entry(kind, robots, first, lasts),)
                for first, lasts in ((late, 1), (half, 1), (0, 1), (late, None), (half, None), (0, None))
            ]
            fatal = [timeline for timeline, fails in zip(everybody, self._failing(everybody), strict=True) if fails]
            ends = {min(fatal, key=self._size), max(fatal, key=self._size)} if fatal else set()
            of_kind = min(
                (self._shrunk(timeline) for timeline in sorted(ends, key=self._size)), key=_order, default=None
            )
            by_kind[kind] = of_kind
            self._tell(f"{kind}: never fails" if of_kind is None else described(of_kind))
        found = [failure for failure in by_kind.values() if failure is not None]
        smallest = min(found, key=_order, default=None)
        while self.timelines < budget:
            drawn = [
                timeline for timeline in (self._drawn(generator, entries, smallest) for _ in range(BATCH)) if timeline
            ]
            if not drawn:
                break
            for timeline, failing in zip(drawn, self._failing(drawn), strict=True):
                if failing and (smallest is None or self._size(timeline) < (smallest.robots, smallest.size)):
                    smallest = min([self._shrunk(timeline), *([smallest] if smallest else [])], key=_order)
                    self._tell(f"smaller: {described(smallest)}")
        return Findings(self.sound, self.limit, by_kind, smallest, self.timelines, self.runs)

    def _kinds(self) -> list[str]:
        known = registry.known("fault")
        return [kind for kind, table in KINDS.items() if table["use"] in known]

    def _drawn(self, generator: np.random.Generator, most: int, smallest: Failure | None) -> Timeline:
        """A random timeline smaller than the smallest known to fail; an empty one if none is found."""
        kinds, robots, limit = self._kinds(), self._scenario.robots.count, min(self.limit)
        room = (most * robots + 1, 0) if smallest is None else (smallest.robots, smallest.size)
        for _ in range(TRIES):
            chosen = generator.integers(1, most + 1)
            timeline = []
            for _ in range(chosen):
                first = int(generator.integers(0, max(1, min(self.sound))))
                lasts = int(np.ceil(np.exp(generator.uniform(0.0, np.log(limit - first)))))
                timeline.append(
                    Entry(str(generator.choice(kinds)), int(generator.integers(1, robots + 1)), first, lasts)
                )
            found = tuple(sorted(timeline, key=lambda entry: (entry.first, entry.kind)))
            if self._size(found) < room:
                return found
        return ()

    def _size(self, timeline: Timeline) -> tuple[int, int]:
        """Robots struck, and robot-iterations with a fault."""
        return sum(entry.count for entry in timeline), sum(entry.size(min(self.limit)) for entry in timeline)

    def _failing(self, timelines: Sequence[Timeline]) -> list[bool]:
        """Whether each fails with every seed; a seed is only tried on those that failed with the seeds before."""
        self.timelines += len(timelines)
        failing = dict.fromkeys(range(len(timelines)), True)
        for seed, limit in zip(self._seeds, self.limit, strict=True):
            waiting = [place for place, still in failing.items() if still]
            for place, row in zip(waiting, self._rows([(timelines[p], seed, limit) for p in waiting]), strict=True):
                failing[place] = row.status == "not finished"
        return list(failing.values())

    def _shrunk(self, timeline: Timeline) -> Failure:
        """The timeline, shrunk in steps as long as it still fails."""
        while True:
            smaller = sorted(self._steps(timeline), key=self._size)
            for start in range(0, len(smaller), BATCH):
                batch = smaller[start : start + BATCH]
                failing = self._failing(batch)
                if any(failing):
                    timeline = batch[failing.index(True)]
                    break
            else:
                robots, size = self._size(timeline)
                return Failure(timeline, robots, size, size / (self._scenario.robots.count * min(self.limit)))

    def _steps(self, timeline: Timeline) -> set[Timeline]:
        """Timelines one step smaller."""
        steps: set[Timeline] = set()
        for place, entry in enumerate(timeline):
            before, after = timeline[:place], timeline[place + 1 :]
            if before or after:
                steps.add((*before, *after))
            limit = min(self.limit)
            lasts = limit - entry.first if entry.duration is None else entry.duration
            others = [
                replace(entry, count=count) for count in {entry.count // 2, entry.count * 3 // 4, entry.count - 1}
            ]
            others += [replace(entry, duration=length) for length in {lasts // 2, lasts * 7 // 8}]
            others += [
                replace(entry, first=entry.first + cut, duration=None if entry.duration is None else lasts - cut)
                for cut in {lasts // 2, lasts // 8}
            ]
            steps |= {
                (*before, other, *after)
                for other in others
                if other.count > 0
                and (other.duration is None or other.duration > 0)
                and other.size(limit) < entry.size(limit)
            }
        return steps

    def _rows(self, wanted: Sequence[tuple[Timeline, int, int]]) -> list[Row]:
        """The rows of these timelines, seeds and limits, in order."""
        tasks = []
        for number, (timeline, seed, limit) in enumerate(wanted):
            stop = Stop(when_done=self._scenario.stop.when_done, iterations=limit)
            faults = (*self._scenario.faults, *(entry.part() for entry in timeline))
            scenario = msgspec.structs.replace(self._scenario, seed=seed, stop=stop, faults=faults)
            name = "; ".join(entry.words() for entry in timeline) or "no faults"
            tasks.append(
                Job(
                    str(number),
                    name,
                    seed,
                    scenario,
                    self._world,
                    False,
                    None,
                    name,
                    registry.own_code_is_allowed(),
                    code=code_of(scenario),
                )
            )
        rows = {row.identity: row for row in self._perform(tasks)}
        self.runs += len(rows)
        for row in rows.values():
            if row.status == "failed":
                raise InputError(f"study worst: {row.condition}, seed {row.seed}: {row.message}")
        return [rows[task.identity] for task in tasks]


def _order(failure: Failure) -> tuple[int, int, int]:
    return failure.robots, failure.size, len(failure.timeline)


def described(failure: Failure) -> str:
    """A failing timeline in words."""
    return f"{'; '.join(entry.words() for entry in failure.timeline)} ({100.0 * failure.share:.1f} %)"


def write(scenario: Scenario, timeline: Timeline, limit: int, path: Path) -> None:
    """Write the scenario with a failing timeline, stopped at its limit. Raises InputError."""
    stop = Stop(when_done=scenario.stop.when_done, iterations=limit)
    faults = (*scenario.faults, *(entry.part() for entry in timeline))
    world = scenario.world
    if world.file:
        world = msgspec.structs.replace(world, file=str(Path(world.file).resolve()))
    table = table_of(msgspec.structs.replace(scenario, stop=stop, faults=faults, world=world))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
    except OSError as problem:
        raise unwritten(path, problem) from problem


HEAD: Final = ("fault", "the smallest that makes the swarm fail", "robots", "robot-iterations", "of all")


def lines(answer: Findings) -> list[tuple[str, ...]]:
    """One line per kind of fault, then the smallest of all, under HEAD."""
    found = [*answer.by_kind.items(), ("smallest of all tried", answer.smallest)]
    return [
        (name, "-", "-", "-", "-")
        if failure is None
        else (
            name,
            "; ".join(entry.words() for entry in failure.timeline),
            str(failure.robots),
            str(failure.size),
            f"{100.0 * failure.share:.1f} %",
        )
        for name, failure in found
    ]
