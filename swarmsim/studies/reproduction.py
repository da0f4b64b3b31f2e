"""The experiments of Kit, Mateo and Bouffanais (2018): their numbers beside ours, and their claims put to the test."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy import stats

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import shipped
from swarmsim.studies import calibration
from swarmsim.studies.plan import Plan, open_study
from swarmsim.studies.results import Result, digest, gather
from swarmsim.studies.statistics import Description, compare, fit_scaling, ranked, speed_up, trend
from swarmsim.studies.store import Store

STUDIES = ("scalability", "network", "robustness")
ALPHA = 0.05
FEW = 10  # runs of a condition below which nothing is said of it
CLOSE = 1.2  # means whose ratio is within this, or its inverse, are close to each other
MATTERS = 0.25  # of the time of 15 robots, by which a gain has to fall for it to matter; as published it is 0.65
FLAT = 1.15  # the same of means that make no difference that matters


@dataclass(frozen=True, slots=True)
class Reading:
    """One way to read what the paper says and what it leaves open."""

    name: str
    title: str
    given: tuple[tuple[str, str], ...]  # sentences of the paper, and how they are read
    changes: dict[str, object]  # of the studies' scenario, by dotted key
    chain: str  # the condition that stands for the published chain
    calibrated: tuple[str, ...]  # the published numbers by which the open choices were made
    calibration: str  # the study in which they were made


READINGS: Final = {
    reading.name: reading
    for reading in (
        Reading(
            name="letter",
            title="by the letter",
            given=(
                (
                    "Algorithm 1 gets target and path in every call",
                    "robots choose their target and plan their path anew in every iteration",
                ),
                (
                    "Chain is a static network where each robot is connected to two other particular robots",
                    "a ring: in a chain the two at the ends are connected to one",
                ),
                ("the union of all the robots' local maps", "the maps of removed robots stay in the union"),
                ("a frontier exploration algorithm [Yamauchi]", "the nearest frontier, by the length of the way"),
            ),
            changes={
                "mind.strategy.replan": "every-iteration", "world.scale": 0.9, "robots.spawn": "floor",
                "mind.strategy.ties": "row-order", "mind.strategy.neighbours": 4,
            },
            chain="ring",
            calibrated=("all",),
            calibration="letter.toml",
        ),
        Reading(
            name="arrival",
            title="replanning on arrival",
            given=(("the robot runs A* to reach the target location", "it keeps the target until it is there"),),
            changes={},
            chain="chain",
            calibrated=("1NN", "5NN", "N=15"),
            calibration="calibration.toml",
        ),
    )
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Number:
    """A published number and our runs of the same condition."""

    study: str
    condition: str
    published: float
    ours: Description
    calibrated: bool  # whether the open choices were made by it
    spread: float  # standard deviation of the logarithms of our runs

    @property
    def ratio(self) -> float | None:
        """Our mean over the published number."""
        return None if self.ours.mean is None else self.ours.mean / self.published

    @property
    def inside(self) -> bool:
        """Whether it lies where 95 % of single runs of ours are expected."""
        interval = self.ours.prediction
        return interval is not None and interval[0] <= self.published <= interval[1]

    @property
    def log_ratio(self) -> float:
        """The logarithm of the ratio; infinite where a mean is missing."""
        return math.inf if self.ratio is None else math.log(self.ratio)


@dataclass(frozen=True, slots=True)
class Claim:
    """What the paper says, whether our runs hold or refute it, and by which test."""

    text: str
    verdict: str  # "holds", "does not hold", "undecided" or "too few runs"
    test: str

    @property
    def line(self) -> tuple[str, str, str]:
        """A line of a table under CLAIMED."""
        return self.text, self.verdict, self.test


def _verdict(holds: bool, fails: bool) -> str:
    return "holds" if holds else "does not hold" if fails else "undecided"


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Everything that a report tells of one reading."""

    reading: Reading
    plans: dict[str, Plan]
    results: dict[str, dict[str, Result]]  # by study, then condition
    numbers: tuple[Number, ...]
    claims: tuple[Claim, ...]
    digest: str

    @property
    def error(self) -> float:
        """Root mean square of the logarithms of the ratios; infinite where a mean is missing."""
        return math.sqrt(sum(number.log_ratio**2 for number in self.numbers) / len(self.numbers))

    @property
    def error_sentence(self) -> str:
        """The error, and what the published numbers would have to be for ours to agree with them."""
        few = self.numbers[0].ours.n < FEW
        told = f"root-mean-square log-ratio over {len(self.numbers)} numbers: {self.error:.3f}"
        if few or not math.isfinite(self.error):
            return f"{told}; too few runs to say more"
        return f"{told}; {agreement(self.numbers).sentence}"


@dataclass(frozen=True, slots=True)
class Agreement:
    """For how many averaged runs behind each published number ours agree with all of them."""

    statistics: dict[int, float]  # chi-square by M
    freedom: int
    most: int | None  # the largest M at which they agree; None: not even single runs would

    @property
    def sentence(self) -> str:
        """In words."""
        shown = ", ".join(f"{value:.1f} for {runs}" for runs, value in list(self.statistics.items())[:4])
        if self.most is None:
            return (
                f"no agreement even if each published number were a single run (chi-square {shown} of {self.freedom})"
            )
        return (
            f"published numbers agree with ours if each is the mean of {self.most} run{'s' * (self.most > 1)} or fewer "
            f"(chi-square with {self.freedom} degrees of freedom: {shown} averaged runs)"
        )


def agreement(numbers: Sequence[Number], most: int = 100) -> Agreement:
    """The chi-square of published against our means on the log scale, if each published number is the mean of M runs.

    Its terms are log(published / ours)^2 / (s^2 / M + s^2 / n), s the standard deviation of the logarithms of our n
    runs; they agree where it is below the 95 % point. A number that stands in two tables counts once.
    """
    seen = {(number.published, number.ours.mean): number for number in numbers}.values()
    statistics = {}
    for runs in range(1, most + 1):
        variances = [number.spread**2 * (1.0 / runs + 1.0 / number.ours.n) for number in seen]
        statistics[runs] = sum(n.log_ratio**2 / v for n, v in zip(seen, variances, strict=True))
    bound = float(stats.chi2.ppf(0.95, len(seen)))
    agreeing = [runs for runs, value in statistics.items() if value <= bound]
    return Agreement(statistics, len(seen), max(agreeing, default=None))


def plans(seeds: int, reading: Reading) -> dict[str, Plan]:
    """The paper's three studies with so many seeds. Raises InputError if they are not installed."""
    return {name: open_study(_folder() / f"{name}.toml", seeds, reading.changes) for name in STUDIES}


def calibration_plan(reading: Reading) -> Plan:
    """The study by which the open choices were made."""
    return open_study(_folder() / reading.calibration)


def published_numbers() -> dict[calibration.Row, float]:
    """The published iterations, for a calibration."""
    return calibration.published(_folder() / "published.csv")


def _folder() -> Path:
    return shipped.root() / "scenarios" / "studies" / "kit2018"


def evaluate(reading: Reading, studies: dict[str, Plan], store: Store) -> Reproduction:
    """Compare the runs in the store with what was published. Raises InputError if any are missing."""
    results = {name: gather(plan, store) for name, plan in studies.items()}
    for name, found in results.items():
        for condition, result in found.items():
            if result.missing or result.failed:
                why = result.failed[0].message if result.failed else f"{result.missing} runs are missing"
                raise InputError(f"{store.path}: {name}, {condition}: {why}")
    with (_folder() / "published.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    numbers = []
    for row in rows:
        of, condition = results[row["experiment"]], row["condition"]
        result = of[reading.chain if condition == "chain" else condition]
        known = condition in reading.calibrated or "all" in reading.calibrated
        spread = float(np.log(result.times).std(ddof=1)) if len(result.times) > 1 else math.inf
        numbers.append(Number(row["experiment"], condition, float(row["iterations"]), result.describe(), known, spread))
    runs = [result for found in results.values() for result in found.values()]
    return Reproduction(reading, studies, results, tuple(numbers), _claims(results, reading), digest(runs))


HEAD = ("condition", "published", "ours", "95 % interval", "sd", "n", "ratio", "one run: 95 %", "inside", "")


def lines(found: Reproduction) -> list[tuple[str, ...]]:
    """The published numbers beside ours, one line each, under HEAD."""
    rows: list[tuple[str, ...]] = []
    for number in found.numbers:
        d = number.ours
        few = d.n < FEW
        rows.append(
            (
                number.condition,
                f"{number.published:.0f}",
                "-" if d.mean is None else f"{d.mean:.0f}",
                "too few" if few else "-" if d.interval is None else f"{d.interval[0]:.0f} to {d.interval[1]:.0f}",
                "-" if d.sd is None else f"{d.sd:.0f}",
                str(d.n) if d.finished == d.n else f"{d.finished} of {d.n}",
                "-" if number.ratio is None else f"{number.ratio:.2f}",
                "too few"
                if few
                else "-"
                if d.prediction is None
                else f"{d.prediction[0]:.0f} to {d.prediction[1]:.0f}",
                "-" if few else "yes" if number.inside else "no",
                "calibrated" if number.calibrated else "predicted",
            )
        )
    return rows


def side_by_side(found: Sequence[Reproduction]) -> list[tuple[str, ...]]:
    """The published numbers, and mean and ratio of each reading, one line each."""
    rows = []
    for place, number in enumerate(found[0].numbers):
        cells = []
        for one in found:
            ours = one.numbers[place]
            cells += ["-", "-"] if ours.ratio is None else [f"{ours.ours.mean:.0f}", f"{ours.ratio:.2f}"]
        rows.append((number.condition, f"{number.published:.0f}", *cells))
    rows.append(("rms log-ratio", "", *(cell for one in found for cell in ("", f"{one.error:.3f}"))))
    return rows


CLAIMED = ("claim", "", "test")
CLAIMS: Final = (
    "more robots map faster",
    "the gain from 15 to 20 robots is smaller than that from 10 to 15",
    "hearing one neighbour instead of none is a drastic gain: by more than half of the time with one",
    "dynamic networks of two neighbours and more beat the static chain",
    "more neighbours help from one to five, and a sixth makes no difference of 15 %",
    "the shrinking swarm leaves the curve of 20 robots right after iteration 50",
    "the shrinking swarm ends close to the swarm of 5: within a fifth",
    "with 75 % of the robots lost the map is still completed",
)


def _claims(results: dict[str, dict[str, Result]], reading: Reading) -> tuple[Claim, ...]:
    size = {name: ranked(r.times, r.finished) for name, r in results["scalability"].items()}
    net = {name: ranked(r.times, r.finished) for name, r in results["network"].items()}
    swarm = {name: ranked(r.times, r.finished) for name, r in results["robustness"].items()}
    if min(len(times) for of in (size, net, swarm) for times in of.values()) < FEW:
        return tuple(Claim(text, "too few runs", f"expected {FEW} of each condition") for text in CLAIMS)
    by_size = trend(list(size.values()))
    by_degree = trend([net[f"{k}NN"] for k in range(1, 6)])
    alone = compare({name: net[name] for name in ("0NN", "1NN")})[0]
    times_alone = _bootstrap(lambda a, b: a.mean() / b.mean(), net["0NN"], net["1NN"])
    gain, matters = _gain(size), MATTERS * float(size["N=15"].mean())
    nearest = {name: net[name] for name in (reading.chain, *(f"{k}NN" for k in range(1, 7)))}
    dynamic = compare(nearest, reading.chain)
    flat = _bootstrap(lambda a, b: a.mean() / b.mean(), net["6NN"], net["5NN"])
    early, late = (_coverages(results["robustness"], at) for at in (50, 100))
    apart = compare({"shrinking": late["20-15-10-5 units"], "20": late["20 units"]})[0]
    same = np.array_equal(early["20-15-10-5 units"], early["20 units"])
    shrunk, few = swarm["20-15-10-5 units"], swarm["5 units"]
    difference = _bootstrap(lambda a, b: a.mean() / b.mean(), shrunk, few)
    faster = [found.first for found in dynamic if found.a12 < 0.5 and found.adjusted < ALPHA]
    slower = [found.first for found in dynamic if found.a12 > 0.5 and found.adjusted < ALPHA]
    tests = (
        (
            _verdict(by_size.statistic < 0.0 and by_size.p < ALPHA, by_size.statistic > 0.0 and by_size.p < ALPHA),
            f"Jonckheere-Terpstra over N = 5 to 20: tau {by_size.statistic:.2f}, p {by_size.p:.1g}",
        ),
        (
            _verdict(gain[0] > 0.0, gain[1] < matters),
            f"bootstrap of the difference of the gains: 95 % {gain[0]:.0f} to {gain[1]:.0f} iterations; it matters "
            f"from {matters:.0f} on, a quarter of the time of 15 robots (published: 378)",
        ),
        (
            _verdict(times_alone[0] > 1.5, times_alone[1] < 1.5),
            f"bootstrap of the ratio of 0NN to 1NN: 95 % {times_alone[0]:.2f} to {times_alone[1]:.2f}; "
            f"A12 {alone.a12:.2f}",
        ),
        (
            _verdict(set(faster) >= {f"{k}NN" for k in range(2, 7)}, bool(slower)),
            f"Mann-Whitney with Holm, against the {reading.chain}: significantly faster {', '.join(faster) or 'none'}; "
            f"slower {', '.join(slower) or 'none'}",
        ),
        (
            _verdict(
                by_degree.statistic < 0.0 and by_degree.p < ALPHA and flat[0] >= 1.0 / FLAT and flat[1] <= FLAT,
                flat[1] < 1.0 / FLAT or flat[0] > FLAT or (by_degree.statistic > 0.0 and by_degree.p < ALPHA),
            ),
            f"Jonckheere-Terpstra over k = 1 to 5: tau {by_degree.statistic:.2f}, p {by_degree.p:.1g}; bootstrap of "
            f"the ratio of 6NN to 5NN: 95 % {flat[0]:.2f} to {flat[1]:.2f}",
        ),
        (
            _verdict(same and apart.p < ALPHA and apart.a12 < 0.5, not same or (apart.p < ALPHA and apart.a12 > 0.5)),
            f"coverage after 50 iterations is {'the same' if same else 'different'}; Mann-Whitney after 100: "
            f"p {apart.p:.1g}, A12 {apart.a12:.2f}",
        ),
        (
            _verdict(
                difference[0] >= 1.0 / CLOSE and difference[1] <= CLOSE,
                difference[1] < 1.0 / CLOSE or difference[0] > CLOSE,
            ),
            f"bootstrap of the ratio of the means: 95 % {difference[0]:.2f} to {difference[1]:.2f}, of 0.83 to 1.2",
        ),
        (
            _verdict(bool(np.isfinite(shrunk).all()), not np.isfinite(shrunk).all()),
            f"{int(np.isfinite(shrunk).sum())} of {len(shrunk)} runs finished",
        ),
    )
    return tuple(Claim(text, verdict, test) for text, (verdict, test) in zip(CLAIMS, tests, strict=True))


def _coverages(results: dict[str, Result], iteration: int) -> dict[str, np.ndarray]:
    return {
        name: np.array([curve[min(iteration, len(curve)) - 1] for curve in result.curves])
        for name, result in results.items()
    }


def _gain(size: dict[str, np.ndarray]) -> tuple[float, float]:
    """Interval of the gain from 10 to 15 robots less that from 15 to 20."""

    def less(ten: np.ndarray, fifteen: np.ndarray, twenty: np.ndarray) -> float:
        return float((ten.mean() - fifteen.mean()) - (fifteen.mean() - twenty.mean()))

    return _bootstrap(less, size["N=10"], size["N=15"], size["N=20"])


def _bootstrap(statistic: Callable[..., float], *samples: np.ndarray, resamples: int = 9999) -> tuple[float, float]:
    """The 95 % percentile bootstrap interval of a statistic of independent samples (Efron 1979)."""
    generator = np.random.default_rng(0)
    drawn = [
        statistic(*(sample[generator.integers(0, len(sample), len(sample))] for sample in samples))
        for _ in range(resamples)
    ]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)


def scaling_lines(found: Reproduction) -> list[tuple[str, ...]]:
    """Speed-up, efficiency and Karp and Flatt's serial share against 5 robots, one line for each swarm."""
    results = found.results["scalability"]
    base = results["N=5"].times.mean()
    rows: list[tuple[str, ...]] = []
    for name, result in results.items():
        robots = float(result.condition.scenario.robots.count)
        s = speed_up(float(result.times.mean()), robots, float(base), 5.0)
        serial = "-" if s.serial_share is None else f"{s.serial_share:.2f}"
        rows.append((name, f"{s.speed_up:.2f}", f"{s.efficiency:.2f}", serial))
    return rows


def scaling_fit(found: Reproduction) -> tuple[float, float]:
    """The a and b of T = a + b / N, over all runs of Table I."""
    results = found.results["scalability"].values()
    robots = np.concatenate([np.full(len(r.times), r.condition.scenario.robots.count) for r in results])
    fit = fit_scaling(robots, np.concatenate([r.times for r in results]))
    return fit.serial, fit.parallel
