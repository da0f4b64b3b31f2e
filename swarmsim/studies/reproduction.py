"""A paper's experiments repeated: its numbers beside ours, and its claims tested."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from swarmsim.core.errors import InputError
from swarmsim.studies.claims import Runs, judge
from swarmsim.studies.engine import Job
from swarmsim.studies.fit import Fit, fit, sentences
from swarmsim.studies.paper import Claim, Listing, Paper, Reading
from swarmsim.studies.plan import Plan
from swarmsim.studies.results import Result, digest, gather, missing
from swarmsim.studies.statistics import Description, fit_scaling, speed_up
from swarmsim.studies.store import Store
from swarmsim.studies.survival import Interval

FEW: Final = 10  # runs of a condition below which claims about it are not tested


@dataclass(frozen=True, slots=True)
class Number:
    """A published number and our runs of the same condition."""

    study: str
    condition: str
    published: float
    ours: Description
    calibrated: bool  # whether open choices were fitted to it
    values: Mapping[int, float]  # of our runs, by seed

    @property
    def ratio(self) -> float | None:
        """Our mean over the published number."""
        return None if self.ours.mean is None else self.ours.mean / self.published

    @property
    def inside(self) -> bool:
        """Whether it lies where 95 % of our single runs are expected."""
        interval = self.ours.prediction
        return interval is not None and interval[0] <= self.published <= interval[1]

    @property
    def log_ratio(self) -> float:
        """The logarithm of the ratio; infinite without a mean."""
        return math.inf if self.ratio is None else math.log(self.ratio)


class Decided(NamedTuple):
    """A claim, our runs' verdict on it, and its tests."""

    claim: Claim
    verdict: str  # "holds", "does not hold", "undecided" or "too few runs"
    test: str


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Everything in a report about one reading."""

    paper: Paper
    reading: Reading
    plans: dict[str, Plan]
    results: dict[str, dict[str, Result]]  # by study, then condition
    numbers: tuple[Number, ...]
    claims: tuple[Decided, ...]
    digest: str

    @property
    def error(self) -> float:
        """Root mean square of the log-ratios; infinite where a mean is missing."""
        return root_mean_square(self.numbers)

    @property
    def fit(self) -> Fit | None:
        """How well the numbers agree with ours; None for fewer than FEW joint seeds, or rows without a spread."""
        rows = distinct(self.numbers)
        seeds = sorted(set.intersection(*(set(number.values) for number in rows)))
        times = np.array([[number.values[seed] for number in rows] for seed in seeds])
        if len(seeds) < FEW or not math.isfinite(self.error) or times.min() <= 0.0 or not np.ptp(times, axis=0).all():
            return None
        return fit(np.array([number.published for number in rows]), times)

    def error_sentences(self, found: Fit | None) -> str:
        """The errors of predicted and of fitted numbers, and what the fit says; three sentences at most."""
        told = []
        for kind, calibrated in (("predicted", False), ("fitted", True)):
            numbers = distinct([number for number in self.numbers if number.calibrated == calibrated])
            if numbers:
                error = root_mean_square(numbers)
                told.append(f"{kind} numbers: {len(numbers)}, root-mean-square log-ratio {error:.3f}")
            elif not calibrated and self.reading.calibration is not None:
                told.append("predicted numbers: none but those that --calibrate leaves out in turn")
        errors = "; ".join(told)
        more = "Too few finished runs to say more." if found is None else sentences(found)
        return f"{errors[:1].upper()}{errors[1:]}. {more}"

    @property
    def seed_count(self) -> str:
        """The number of seeds of each condition, such as "30", or "20 to 30" if studies differ."""
        return _from_to(len(plan.seeds) for plan in self.plans.values())

    @property
    def seeds(self) -> str:
        """The range of seeds, such as "1 to 30"."""
        return _from_to(seed for plan in self.plans.values() for seed in plan.seeds)


def _from_to(numbers: Iterable[int]) -> str:
    found = sorted(numbers)
    return str(found[0]) if found[0] == found[-1] else f"{found[0]} to {found[-1]}"


def distinct(numbers: Sequence[Number]) -> list[Number]:
    """The same without repetitions: a number of the same runs in two tables counts once."""
    return list({(number.published, *number.values.items()): number for number in numbers}.values())


def root_mean_square(numbers: Sequence[Number]) -> float:
    """Of the log-ratios of different numbers; infinite where a mean is missing."""
    logs = [number.log_ratio for number in distinct(numbers)]
    return math.sqrt(sum(log * log for log in logs) / len(logs))


def reproduce(
    paper: Paper,
    store: Store,
    run_jobs: Callable[[Sequence[Job]], None],
    seeds: int | None = None,
    readings: Sequence[str] = (),
) -> list[Reproduction]:
    """Do the runs of a paper's studies that the store lacks, and compare: one reproduction per reading.

    `run_jobs` does jobs and keeps their rows in the store. `seeds` replaces the studies' numbers of seeds; `readings`
    are names, by default all. Raises InputError for errors in the folder, and for failed runs.
    """
    read = paper.read(readings)
    plans = [paper.plans(one, seeds) for one in read]
    # A run shared by two tables or readings is done once.
    opened = [plan for of_reading in plans for plan in of_reading.values()]
    run_jobs(list({job.identity: job for plan in opened for job in missing(plan, store)}.values()))
    return [evaluate(paper, one, of, store) for one, of in zip(read, plans, strict=True)]


def evaluate(paper: Paper, reading: Reading, plans: dict[str, Plan], store: Store) -> Reproduction:
    """Compare the runs in the store with the published numbers. Raises InputError if any are missing or failed."""
    results = {name: gather(plan, store) for name, plan in plans.items()}
    for name, found in results.items():
        for condition, result in found.items():
            if result.missing or result.failed:
                why = result.failed[0].message if result.failed else f"{result.missing} runs are missing"
                raise InputError(f"{store.path}: {name}, {condition}: {why}")
    runs = {name: Runs(of, reading.conditions) for name, of in results.items()}
    numbers = []
    for number in paper.published:
        ours = runs[number.study].describe(number.condition, paper.about.published)
        known = number.condition in reading.calibrated or "all" in reading.calibrated
        values = runs[number.study].by_seed(number.condition, paper.about.published)
        numbers.append(Number(number.study, number.condition, number.value, ours, known, values))
    decided = tuple(decide(claim, runs) for claim in paper.claims)
    every = [result for found in results.values() for result in found.values()]
    return Reproduction(paper, reading, plans, results, tuple(numbers), decided, digest(every))


def decide(claim: Claim, runs: Mapping[str, Runs]) -> Decided:
    """Test a claim on the runs of each study: it holds if all its tests hold, and fails if one fails."""
    if min(len(one.rows) for check in claim.test for one in runs[check.study].results.values()) < FEW:
        return Decided(claim, "too few runs", f"expected {FEW} of each condition")
    judged = [judge(check, runs[check.study]) for check in claim.test]
    fails = "does not hold" if any(one.fails for one in judged) else "undecided"
    words = [one.words for one in judged]
    if claim.margin_chosen:
        words.append(f"the margin was chosen {claim.margin_chosen}")
    return Decided(claim, "holds" if all(one.holds for one in judged) else fails, "; ".join(words))


HEAD: Final = ("condition", "published", "ours", "95 % interval", "sd", "n", "ratio", "one run: 95 %", "inside", "")
LISTED: Final = ("condition", "mean", "95 % interval", "n")
CLAIMED: Final = ("claim", "", "test")


def lines(found: Reproduction) -> list[tuple[str, ...]]:
    """The published numbers beside ours, one per line, under HEAD."""
    rows: list[tuple[str, ...]] = []
    form = ".0f" if found.paper.about.published == "iterations" else ".4g"
    for number in found.numbers:
        d, few = number.ours, number.ours.n < FEW
        interval, prediction = ("too few" if few else _between(ends, form) for ends in (d.interval, d.prediction))
        inside = "-" if few else "yes" if number.inside else "no"
        kind = "calibrated" if number.calibrated else "predicted"
        ours = (_one(d.mean, form), interval, _one(d.sd, form), _count(d), _one(number.ratio, ".2f"))
        rows.append((number.condition, _one(number.published, form), *ours, prediction, inside, kind))
    return rows


def side_by_side(found: Sequence[Reproduction]) -> list[tuple[str, ...]]:
    """The published numbers with each reading's mean and ratio, one per line."""
    rows: list[tuple[str, ...]] = []
    form = ".0f" if found[0].paper.about.published == "iterations" else ".4g"
    for place, number in enumerate(found[0].numbers):
        ours = [one.numbers[place] for one in found]
        cells = [cell for one in ours for cell in (_one(one.ours.mean, form), _one(one.ratio, ".2f"))]
        rows.append((number.condition, _one(number.published, form), *cells))
    return [*rows, *(_errors(found, kind, calibrated) for kind, calibrated in (("predicted", False), ("fitted", True)))]


def _errors(found: Sequence[Reproduction], kind: str, calibrated: bool) -> tuple[str, ...]:
    """The line of each reading's error over its predicted or its fitted numbers."""
    cells = []
    for one in found:
        numbers = [number for number in one.numbers if number.calibrated == calibrated]
        cells += ["", f"{root_mean_square(numbers):.3f}" if numbers else "-"]
    return (f"rms log-ratio, {kind}", "", *cells)


def listed(found: Reproduction, listing: Listing) -> list[tuple[str, ...]]:
    """A paper's table of one measure, one line per condition, under LISTED."""
    runs = Runs(found.results[listing.study], {})
    described = {name: runs.describe(name, listing.measure) for name in runs.results}
    return [(name, _one(d.mean, ".4g"), _between(d.interval, ".4g"), _count(d)) for name, d in described.items()]


def _one(value: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}}"


def _between(ends: Interval | None, form: str) -> str:
    return "-" if ends is None else f"{ends[0]:{form}} to {ends[1]:{form}}"


def _count(d: Description) -> str:
    return str(d.n) if d.finished == d.n else f"{d.finished} of {d.n}"


def scaling_lines(results: Mapping[str, Result]) -> list[tuple[str, ...]]:
    """Speed-up, efficiency and Karp and Flatt's serial share against the first swarm, one line per swarm.

    Swarms with unfinished runs have no mean time, and no line.
    """
    sizes = [(name, _robots(result), float(result.times.mean())) for name, result in _whole(results).items()]
    rows: list[tuple[str, ...]] = []
    for name, robots, time in sizes:
        s = speed_up(time, robots, sizes[0][2], sizes[0][1])
        rows.append((name, f"{s.speed_up:.2f}", f"{s.efficiency:.2f}", _one(s.serial_share, ".2f")))
    return rows


def scaling_fit(results: Mapping[str, Result]) -> tuple[float, float]:
    """The a and b of T = a + b / N, over all runs of swarms of several sizes that finish. Raises ValueError for one."""
    whole = _whole(results).values()
    robots = np.array([_robots(result) for result in whole for _ in result.rows])
    fit = fit_scaling(robots, [time for result in whole for time in result.times.tolist()])
    return fit.serial, fit.parallel


def _whole(results: Mapping[str, Result]) -> dict[str, Result]:
    """The conditions whose runs all finished."""
    return {name: result for name, result in results.items() if result.endings.whole}


def _robots(result: Result) -> float:
    return float(result.condition.scenario.robots.count)
