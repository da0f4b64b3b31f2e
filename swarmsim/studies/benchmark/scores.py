"""Scores of entries: times in units of a tour with the map known, compared world by world.

The unit of a task is the time in which the best tour found with the map known, replayed by the simulator from the same
starts, shows 99 % of the domain. All times of a task are divided by it: of an entry's run its T50, T90, T99 and T100.
Where a set has no references, the unit is the best T99 of the entries at hand (Dolan and More 2002).

A run that never reached a share is *not finished*: its time is not known, only that it lies beyond the limit. So scores
are means of ln min(T / unit, c) with the same c for all entries, at most the limit over the unit: these are known of
every run, finished or not (a restricted mean, on the log scale). Profiles count such a run at no ratio.

Tasks of one world are not independent, so intervals resample worlds, and tests take one number a world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmsim.core.errors import InputError
from swarmsim.studies.benchmark.entries import EntryRun, MethodEntry
from swarmsim.studies.benchmark.sets import SetTask, TaskSet
from swarmsim.studies.prices import amounts
from swarmsim.studies.statistics import holm
from swarmsim.studies.survival import Interval

SHARES: Final = ("t50", "t90", "t99", "t100")
RESAMPLES: Final = 4000  # of worlds
FLIPS: Final = 20_000
LEAST: Final = 6  # worlds, for an interval: of fewer, no test of signs can be below 5 % either
ALPHA: Final = 0.05  # of all pairs together
TAUS: Final = np.geomspace(0.5, 16.0, 101)  # ratios at which profiles are taken
Values = NDArray[np.float64]
K = TypeVar("K", int, str, bool)
Estimate = tuple[float, Interval]  # with its 95 % interval; NaN for fewer worlds than LEAST


@dataclass(frozen=True, slots=True)
class Joules:
    """What a robot spends: J for each metre that it drives, second of the run, and kilobyte that it hears."""

    metre: float = 0.0
    second: float = 0.0
    kilobyte: float = 0.0


def joules_of(asked: Mapping[str, float] | str) -> Joules:
    """Costs by name. Raises InputError."""
    names = ("metre", "second", "kilobyte")
    return Joules(**amounts(asked, names, "--energy", "expected name=number, as in metre=2,second=0.5"))


@dataclass(frozen=True, slots=True)
class EntryScore:
    """One entry's scores over a part's tasks."""

    name: str
    oracle: bool
    runs: int
    reached: Mapping[str, int]  # runs that reached each of SHARES
    times: Mapping[str, Estimate]  # in units, a restricted geometric mean, by share
    of_robots: Mapping[int, Estimate]  # of T99, by the number of robots
    of_regime: Mapping[str, Estimate]  # ... by the regime of communication
    of_struck: Mapping[bool, Estimate]  # ... by whether something went wrong
    overlap: Estimate  # mean of what several robots sensed
    way: Estimate  # m, driven by each robot
    kilobytes: Estimate  # that arrived, for each robot
    energy: Estimate | None  # J, spent by each robot, if it is said what costs how much
    profiles: Mapping[int, Values]  # (len(TAUS),): share of runs whose T99 is within each ratio, by robots; 0 for all


@dataclass(frozen=True, slots=True)
class EntryPair:
    """Two entries compared on the same worlds."""

    first: str
    second: str
    ratio: Estimate  # of their T99, restricted
    adjusted: float  # p of `sign_flip` over worlds, after Holm's correction for all pairs

    @property
    def different(self) -> bool:
        """Whether the two are shown to differ, all pairs taken together."""
        return self.adjusted < ALPHA


@dataclass(frozen=True, slots=True)
class Standings:
    """All entries on one part of a set; the fastest first."""

    unit: str  # what times are divided by, in words
    cap: float  # the largest ratio that is told apart
    worlds: int
    bound: float | None  # the proved lower bound of T99 in units, a geometric mean
    tour: float | None  # the planned length of the best tour found, in the same way
    scores: tuple[EntryScore, ...]
    pairs: tuple[EntryPair, ...]


@dataclass(frozen=True, slots=True)
class _Frame:
    """The runs of a part, in one order for all entries."""

    keys: Sequence[tuple[SetTask, int]]  # task and seed
    unit: Values  # (r,): iterations
    cap: Values  # (r,): the largest ratio known of every run
    world: NDArray[np.int64]  # (r,): its world's row
    size: int  # worlds

    def apart(self, of: Callable[[SetTask], K]) -> dict[K, NDArray[np.bool_]]:
        """Which runs belong to tasks with each value of a property (r,), in the order of the values."""
        values = [of(task) for task, _ in self.keys]
        return {value: np.array([one == value for one in values]) for value in sorted(set(values))}

    def per_world(self, values: Values, which: NDArray[np.bool_]) -> Values:
        """The mean of some runs' values in each world (w,); NaN where it has none."""
        count = np.bincount(self.world[which], minlength=self.size)
        total = np.bincount(self.world[which], values[which], minlength=self.size)
        with np.errstate(invalid="ignore"):
            return np.asarray(total / count)

    def mean(self, values: Values, which: NDArray[np.bool_] | None = None) -> Estimate:
        """The mean over worlds of their runs' means, with the interval of worlds drawn anew."""
        rows = self.per_world(values, np.ones(len(values), np.bool_) if which is None else which)
        rows = rows[np.isfinite(rows)]
        if len(rows) < LEAST:
            return float(rows.mean()), (np.nan, np.nan)
        draws = np.random.default_rng(0).integers(0, len(rows), (RESAMPLES, len(rows)))
        low, high = np.quantile(rows[draws].mean(axis=1), [0.025, 0.975])
        return float(rows.mean()), (float(low), float(high))

    def ratio(self, logs: Values, which: NDArray[np.bool_] | None = None) -> Estimate:
        """The same of logarithms, as a geometric mean."""
        value, (low, high) = self.mean(logs, which)
        return float(np.exp(value)), (float(np.exp(low)), float(np.exp(high)))


def standings(
    tasks: TaskSet, entries: Sequence[MethodEntry], part: str = "public", joules: Joules | None = None
) -> Standings:
    """Score entries on one part of a set, the fastest first. Raises InputError for two entries with one name."""
    names = [entry.method.name for entry in entries]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{twice}: two entries have this name; expected a name of its own for each method")
    runs = [_runs(tasks, entry, part) for entry in entries]
    frame, known = _frame(tasks, runs, part)
    scored = [_score(entry, frame, mine, tasks.period, joules) for entry, mine in zip(entries, runs, strict=True)]
    order = sorted(range(len(scored)), key=lambda at: scored[at].times["t99"][0])
    logs = [_logs(frame, mine, "t99") for mine in runs]
    references = [tasks.references[task.name, seed] for task, seed in frame.keys] if known else []

    def over(lengths: Sequence[float]) -> float | None:
        return float(np.exp(np.mean(np.log(np.array(lengths) / frame.unit)))) if lengths else None

    return Standings(
        unit="T99 of the tour with the map known, replayed" if known else "the best T99 of these entries",
        cap=tasks.about.cap,
        worlds=frame.size,
        bound=over([max(one.bound99, 1) for one in references]),
        tour=over([one.tour for one in references]),
        scores=tuple(scored[at] for at in order),
        pairs=_pairs([scored[at].name for at in order], [logs[at] for at in order], frame),
    )


Runs = list[EntryRun]


def _keys(tasks: TaskSet, part: str) -> list[tuple[SetTask, int]]:
    return [(task, seed) for task in tasks.of_part(part) for seed in tasks.about.seeds]


def _runs(tasks: TaskSet, entry: MethodEntry, part: str) -> Runs:
    """An entry's runs of a part, in the set's order. Raises InputError if it has not run it."""
    found = {(run.task, run.seed): run for run in entry.runs}
    try:
        return [found[task.name, seed] for task, seed in _keys(tasks, part)]
    except KeyError:
        raise InputError(f"{entry.method.name}: its entry has no {part} runs") from None


def _frame(tasks: TaskSet, runs: Sequence[Runs], part: str) -> tuple[_Frame, bool]:
    """The frame of a part, and whether its unit is the set's reference."""
    keys = _keys(tasks, part)
    found = [tasks.references.get((task.name, seed)) for task, seed in keys]
    times = [one.t99 for one in found if one is not None and one.t99 is not None]
    known = len(times) == len(keys)
    if known:
        unit = np.array(times, np.float64)
    else:
        unit = np.array([[run.t99 or tasks.limit for run in mine] for mine in runs], np.float64).min(axis=0)
    rows = {name: row for row, name in enumerate(dict.fromkeys(task.world.world for task, _ in keys))}
    world = np.array([rows[task.world.world] for task, _ in keys])
    return _Frame(keys, unit, np.minimum(tasks.about.cap, tasks.limit / unit), world, len(rows)), known


def _ratios(frame: _Frame, runs: Runs, share: str) -> Values:
    """Each run's time to a share in units (r,); infinite where it never got there."""
    times = [getattr(run, share) for run in runs]
    return np.array([np.inf if time is None else time for time in times], np.float64) / frame.unit


def _logs(frame: _Frame, runs: Runs, share: str) -> Values:
    """The logarithm of each run's restricted ratio (r,)."""
    return np.asarray(np.log(np.minimum(_ratios(frame, runs, share), frame.cap)))


def _score(entry: MethodEntry, frame: _Frame, runs: Runs, period: float, joules: Joules | None) -> EntryScore:
    logs = _logs(frame, runs, "t99")
    reached = _ratios(frame, runs, "t99")
    counts = frame.apart(lambda task: task.robots)

    def split(which: dict[K, NDArray[np.bool_]]) -> dict[K, Estimate]:
        return {value: frame.ratio(logs, those) for value, those in which.items()}

    robots = np.array([task.robots for task, _ in frame.keys])
    way = np.array([run.way for run in runs]) / robots
    kilobytes = np.array([run.bytes for run in runs]) / robots / 1000.0
    seconds = period * np.array([run.iterations for run in runs])
    spent = None if joules is None else joules.metre * way + joules.second * seconds + joules.kilobyte * kilobytes
    return EntryScore(
        name=entry.method.name,
        oracle=entry.method.oracle,
        runs=len(runs),
        reached={share: sum(getattr(run, share) is not None for run in runs) for share in SHARES},
        times={share: frame.ratio(_logs(frame, runs, share)) for share in SHARES},
        of_robots=split(counts),
        of_regime=split(frame.apart(lambda task: task.world.regime)),
        of_struck=split(frame.apart(lambda task: task.world.struck)),
        overlap=frame.mean(np.array([run.overlap or 0.0 for run in runs])),
        way=frame.mean(way),
        kilobytes=frame.mean(kilobytes),
        energy=None if spent is None else frame.mean(spent),
        profiles={0: _profile(reached), **{count: _profile(reached[which]) for count, which in counts.items()}},
    )


def _profile(ratios: Values) -> Values:
    return np.asarray((ratios[:, None] <= TAUS).mean(axis=0))


def _pairs(names: Sequence[str], logs: Sequence[Values], frame: _Frame) -> tuple[EntryPair, ...]:
    every = np.ones(len(frame.keys), np.bool_)
    found = []
    for one, other in combinations(range(len(names)), 2):
        difference = logs[one] - logs[other]
        found.append((one, other, frame.ratio(difference), sign_flip(frame.per_world(difference, every))))
    adjusted: Sequence[float] = holm([p for *_, p in found]).tolist() if found else []
    return tuple(
        EntryPair(names[one], names[other], ratio, float(p))
        for (one, other, ratio, _), p in zip(found, adjusted, strict=True)
    )


def sign_flip(differences: Values) -> float:
    """The two-sided p of Fisher's randomisation test (1935): the mean of differences whose signs are drawn anew.

    It tests the mean that the ratio shows, so that both always point the same way. All signs are tried for up to
    FLIPS ways to set them, else FLIPS are drawn.
    """
    if len(differences) < 2 or not differences.any():
        return 1.0
    found = stats.permutation_test(
        (differences,), np.mean, permutation_type="samples", n_resamples=FLIPS, rng=np.random.default_rng(0)
    )
    return float(found.pvalue)


def kept_order(public: Standings, held_out: Standings) -> tuple[int, list[EntryPair]]:
    """How many pairs the public part calls different, and those of them whose order is another on the held-out part."""
    place = {one.name: one.times["t99"][0] for one in held_out.scores}
    called = [pair for pair in public.pairs if pair.different]
    return len(called), [pair for pair in called if (pair.ratio[0] < 1.0) != (place[pair.first] < place[pair.second])]
