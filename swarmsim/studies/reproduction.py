"""The experiments of Kit, Mateo and Bouffanais (2018): their numbers beside ours, and their claims put to the test."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swarmsim.core import shipped
from swarmsim.core.errors import InputError
from swarmsim.studies.plan import Plan, open_study
from swarmsim.studies.results import Result, digest, gather
from swarmsim.studies.statistics import Description, compare, fit_scaling, ranked, speed_up, trend
from swarmsim.studies.store import Store

STUDIES = ("scalability", "network", "robustness")
CALIBRATED = ("1NN", "5NN")  # and N=15, which is 1NN again; all else is predicted
ALPHA = 0.05


@dataclass(frozen=True, slots=True)
class Number:
    """A published number and our runs of the same condition."""

    study: str
    condition: str
    published: float
    ours: Description
    calibrated: bool  # whether the open choices were made by it

    @property
    def ratio(self) -> float | None:
        """Our mean over the published number."""
        return None if self.ours.mean is None else self.ours.mean / self.published

    @property
    def inside(self) -> bool:
        """Whether it lies where 95 % of single runs of ours are expected."""
        interval = self.ours.prediction
        return interval is not None and interval[0] <= self.published <= interval[1]


@dataclass(frozen=True, slots=True)
class Claim:
    """What the paper says, whether our runs agree, and by which test."""

    text: str
    holds: bool
    test: str

    @property
    def line(self) -> tuple[str, str, str]:
        """A line of a table under CLAIMED."""
        return self.text, "holds" if self.holds else "does not hold", self.test


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Everything that a report tells."""

    plans: dict[str, Plan]
    results: dict[str, dict[str, Result]]  # by study, then condition
    numbers: tuple[Number, ...]
    claims: tuple[Claim, ...]
    digest: str

    @property
    def error(self) -> float:
        """Root mean square of the logarithms of the ratios; infinite where a mean is missing."""
        logs = [math.inf if number.ratio is None else math.log(number.ratio) for number in self.numbers]
        return math.sqrt(sum(log * log for log in logs) / len(logs))

    @property
    def error_sentence(self) -> str:
        """The error, and how many published numbers lie where single runs of ours are expected."""
        inside = sum(number.inside for number in self.numbers)
        outside = ", ".join(number.condition for number in self.numbers if not number.inside)
        return (
            f"root-mean-square log-ratio over {len(self.numbers)} numbers: {self.error:.3f}; {inside} of "
            f"{len(self.numbers)} inside the 95 % prediction interval of a single run"
            + (f", outside: {outside}" if outside else "")
        )


def plans(seeds: int) -> dict[str, Plan]:
    """The paper's three studies with so many seeds. Raises InputError if they are not installed."""
    return {name: open_study(_folder() / f"{name}.toml", seeds) for name in STUDIES}


def calibration_plan() -> Plan:
    """The study by which the open choices were made."""
    return open_study(_folder() / "calibration.toml")


def _folder() -> Path:
    return shipped.root() / "scenarios" / "studies" / "kit2018"


def evaluate(studies: dict[str, Plan], store: Store) -> Reproduction:
    """Compare the runs in the store with what was published. Raises InputError if any are missing."""
    results = {name: gather(plan, store) for name, plan in studies.items()}
    for name, found in results.items():
        for condition, result in found.items():
            if result.missing or result.failed:
                why = result.failed[0].message if result.failed else f"{result.missing} runs are missing"
                raise InputError(f"{store.path}: {name}, {condition}: {why}")
    with (_folder() / "published.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    numbers = tuple(
        Number(
            row["experiment"],
            row["condition"],
            float(row["iterations"]),
            results[row["experiment"]][row["condition"]].describe(),
            row["condition"] in (*CALIBRATED, "N=15"),
        )
        for row in rows
    )
    runs = [result for found in results.values() for result in found.values()]
    return Reproduction(studies, results, numbers, _claims(results), digest(runs))


HEAD = ("condition", "published", "ours", "95 % interval", "sd", "n", "ratio", "one run: 95 %", "inside", "")


def lines(found: Reproduction) -> list[tuple[str, ...]]:
    """The published numbers beside ours, one line each, under HEAD."""
    rows: list[tuple[str, ...]] = []
    for number in found.numbers:
        d = number.ours
        rows.append(
            (
                number.condition,
                f"{number.published:.0f}",
                "-" if d.mean is None else f"{d.mean:.0f}",
                "-" if d.interval is None else f"{d.interval[0]:.0f} to {d.interval[1]:.0f}",
                "-" if d.sd is None else f"{d.sd:.0f}",
                str(d.n) if d.finished == d.n else f"{d.finished} of {d.n}",
                "-" if number.ratio is None else f"{number.ratio:.2f}",
                "-" if d.prediction is None else f"{d.prediction[0]:.0f} to {d.prediction[1]:.0f}",
                "yes" if number.inside else "no",
                "calibrated" if number.calibrated else "predicted",
            )
        )
    return rows


CLAIMED = ("claim", "", "test")


def _claims(results: dict[str, dict[str, Result]]) -> tuple[Claim, ...]:
    size = {name: ranked(r.times, r.finished) for name, r in results["scalability"].items()}
    net = {name: ranked(r.times, r.finished) for name, r in results["network"].items()}
    swarm = {name: ranked(r.times, r.finished) for name, r in results["robustness"].items()}
    by_size = trend(list(size.values()))
    by_degree = trend([net[f"{k}NN"] for k in range(1, 6)])
    alone = compare({name: net[name] for name in ("0NN", "1NN")})[0]
    gain = _gain(size)
    dynamic = compare({name: times for name, times in net.items() if name != "0NN"}, "chain")
    flat = compare({name: net[name] for name in ("5NN", "6NN")})[0]
    early, late = (_coverages(results["robustness"], at) for at in (50, 100))
    apart = compare({"shrinking": late["20-15-10-5 units"], "20": late["20 units"]})[0]
    same = compare({"shrinking": early["20-15-10-5 units"], "20": early["20 units"]})[0]
    shrunk, few = swarm["20-15-10-5 units"], swarm["5 units"]
    difference = _bootstrap(lambda a, b: a.mean() / b.mean(), shrunk, few)
    slower = [found for found in dynamic if found.a12 < 0.5 and found.adjusted < ALPHA]
    return (
        Claim(
            "more robots map faster",
            by_size.statistic < 0.0 and by_size.p < ALPHA,
            f"Jonckheere-Terpstra over N = 5 to 20: tau {by_size.statistic:.2f}, p {by_size.p:.1g}",
        ),
        Claim(
            "the gain from 15 to 20 robots is smaller than that from 10 to 15",
            gain[0] > 0.0,
            f"bootstrap of the difference of the gains: 95 % {gain[0]:.0f} to {gain[1]:.0f} iterations",
        ),
        Claim(
            "hearing one neighbour instead of none is a drastic gain",
            alone.p < ALPHA and alone.a12 > 0.71,
            f"Mann-Whitney, 0NN against 1NN: p {alone.p:.1g}, A12 {alone.a12:.2f}",
        ),
        Claim(
            "dynamic networks beat the static chain",
            {found.first for found in slower} >= {f"{k}NN" for k in range(2, 7)},
            "Mann-Whitney with Holm, significantly faster than the chain: "
            + (", ".join(found.first for found in slower) or "none"),
        ),
        Claim(
            "more neighbours help up to about five",
            by_degree.statistic < 0.0 and by_degree.p < ALPHA and flat.p >= ALPHA,
            f"Jonckheere-Terpstra over k = 1 to 5: tau {by_degree.statistic:.2f}, p {by_degree.p:.1g}; 5NN against "
            f"6NN: p {flat.p:.2g}, A12 {flat.a12:.2f}",
        ),
        Claim(
            "the shrinking swarm leaves the curve of 20 robots right after iteration 50",
            same.p >= ALPHA and apart.p < ALPHA and apart.a12 < 0.5,
            f"Mann-Whitney of the coverage after 50 iterations: p {same.p:.2g}; after 100: p {apart.p:.1g}, "
            f"A12 {apart.a12:.2f}",
        ),
        Claim(
            "the shrinking swarm ends close to the swarm of 5: within a fifth",
            difference[0] >= 1.0 / 1.2 and difference[1] <= 1.2,
            f"bootstrap of the ratio of the means: 95 % {difference[0]:.2f} to {difference[1]:.2f} lies in 0.83 to 1.2",
        ),
        Claim(
            "with 75 % of the robots lost the map is still completed",
            bool(np.isfinite(shrunk).all()),
            f"{int(np.isfinite(shrunk).sum())} of {len(shrunk)} runs finished",
        ),
    )


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
