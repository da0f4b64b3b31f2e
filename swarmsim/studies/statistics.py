"""Statistics of many runs: estimates with their uncertainty, comparisons, trends, and the runs needed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from swarmsim.studies.survival import Interval, Outcome, RestrictedMean, kaplan_meier, restricted_mean, sample_of

RESAMPLES: Final = 9999  # of the bootstrap
EFFICIENCY: Final = 3.0 / math.pi  # of Mann-Whitney's test relative to Student's, for normal data


@dataclass(frozen=True, slots=True)
class Description:
    """One condition of a study, as a row of a table.

    If some runs did not finish, estimates that need all times are None, and the quartiles are Kaplan and Meier's.
    """

    n: int
    finished: int
    mean: float | None
    sd: float | None  # with n - 1
    interval: Interval | None  # of the mean, BCa bootstrap
    median: float | None
    lower: float | None  # quartile
    upper: float | None
    restricted: RestrictedMean
    prediction: Interval | None  # for one more run, on the log scale if all values are above 0


@dataclass(frozen=True, slots=True)
class Paired:
    """Two conditions compared by rank."""

    first: str
    second: str
    u: float  # Mann and Whitney's, of the first
    p: float  # two-sided
    adjusted: float  # p after Holm's correction for the whole family
    a12: float  # the probability that a run of the first takes longer than one of the second


@dataclass(frozen=True, slots=True)
class Scaling:
    """The fit T(N) = serial + parallel / N: the time that more robots cannot shorten, and the work that they share."""

    serial: float
    parallel: float
    serial_interval: Interval | None  # None for two runs, which any line fits
    parallel_interval: Interval | None
    r2: float  # share of the variance explained; 0 if there is none


class SpeedUp(NamedTuple):
    """A swarm of N against a reference of N0, with p = N / N0."""

    speed_up: float  # S = T(N0) / T(N)
    efficiency: float  # S / p
    serial_share: float | None  # Karp and Flatt's e; None for p = 1


def describe(
    times: ArrayLike, finished: ArrayLike | None = None, horizon: float | None = None, seed: int = 0
) -> Description:
    """The estimates of one condition, at 95 %, from its runs' times (n,) and whether each finished (default: all).

    Raises ValueError without runs, and as `restricted_mean`.
    """
    values, ended = sample_of(times, finished)
    whole = bool(ended.all())
    survival = kaplan_meier(values, ended)
    quartiles = [float(np.quantile(values, q)) if whole else survival.quantile(q) for q in (0.25, 0.5, 0.75)]
    return Description(
        n=len(values),
        finished=int(ended.sum()),
        mean=float(values.mean()) if whole else None,
        sd=float(values.std(ddof=1)) if whole and len(values) > 1 else None,
        interval=bootstrap_mean(values, seed=seed) if whole else None,
        lower=quartiles[0],
        median=quartiles[1],
        upper=quartiles[2],
        restricted=restricted_mean(values, ended, horizon),
        prediction=prediction_interval(values, scale="log" if values.min() > 0.0 else "linear") if whole else None,
    )


def bootstrap_mean(values: ArrayLike, confidence: float = 0.95, seed: int = 0) -> Interval | None:
    """The bias-corrected and accelerated (BCa) bootstrap interval of the mean (Efron 1987).

    The same values and seed give the same interval: None for a single value, of no width for equal ones.
    """
    sample, _ = sample_of(values)
    if len(sample) < 2:
        return None
    if np.ptp(sample) <= 1e-12 * abs(sample[0]):
        return float(sample[0]), float(sample[0])
    settings = {"n_resamples": RESAMPLES, "confidence_level": confidence, "method": "BCa", "batch": 1000}
    found = stats.bootstrap((sample,), np.mean, rng=np.random.default_rng(seed), **settings).confidence_interval
    return float(found.low), float(found.high)


def prediction_interval(
    values: ArrayLike, confidence: float = 0.95, scale: Literal["linear", "log"] = "linear"
) -> Interval | None:
    """The interval for one more run: mean +- t(n - 1) sd sqrt(1 + 1/n), for normal data (Hahn and Meeker 1991).

    On the "log" scale it is computed from the logarithms, for positive data with a long upper tail. None for
    fewer than two values. Raises ValueError for values without a logarithm.
    """
    sample, _ = sample_of(values)
    if scale == "log" and sample.min() <= 0.0:
        raise ValueError(f"values: expected positive numbers for the log scale, got {sample.min():g}")
    if len(sample) < 2:
        return None
    scaled = np.log(sample) if scale == "log" else sample
    reach = stats.t.ppf(0.5 + confidence / 2.0, len(scaled) - 1) * scaled.std(ddof=1) * math.sqrt(1 + 1 / len(scaled))
    ends = np.array([scaled.mean() - reach, scaled.mean() + reach])
    low, high = np.exp(ends) if scale == "log" else ends
    return float(low), float(high)


def compare(groups: Mapping[str, ArrayLike], against: str | None = None) -> list[Paired]:
    """Mann and Whitney's test (1947) of every two conditions, or of `against` with every other one.

    Times may be infinite, as `Endings.ranks` of unfinished runs are. All returned p-values form one family for Holm's
    correction. Raises KeyError for an unknown `against`.
    """
    samples = {name: np.asarray(times, np.float64) for name, times in groups.items()}
    if against is not None and against not in samples:
        raise KeyError(f"no condition {against!r}; there are {', '.join(samples)}")
    pairs = list(combinations(samples, 2)) if against is None else [(n, against) for n in samples if n != against]
    tests = [_mann_whitney(samples[first], samples[second]) for first, second in pairs]
    return [
        Paired(first, second, test.statistic, test.p, float(adjusted), a12(samples[first], samples[second]))
        for (first, second), test, adjusted in zip(pairs, tests, holm([test.p for test in tests]), strict=True)
    ]


def _mann_whitney(first: NDArray[np.float64], second: NDArray[np.float64]) -> Outcome:
    if (np.concatenate([first, second]) == first[0]).all():
        return Outcome(len(first) * len(second) / 2.0, 1.0)  # all tied: scipy would divide by 0
    found = stats.mannwhitneyu(first, second, alternative="two-sided")
    return Outcome(float(found.statistic), float(found.pvalue))


def a12(first: ArrayLike, second: ArrayLike) -> float:
    """P(X > Y) + P(X = Y) / 2 for X of the first and Y of the second sample (Vargha and Delaney 2000).

    0.5 is no difference. For times, below 0.5 means that the first is faster. 0.56, 0.64 and 0.71, or as far below
    0.5, are small, medium and large differences.
    """
    x, y = np.asarray(first, np.float64), np.sort(np.asarray(second, np.float64))
    below = np.searchsorted(y, x, side="left") + np.searchsorted(y, x, side="right")
    return float(below.mean() / (2.0 * len(y)))


def holm(p: ArrayLike) -> NDArray[np.float64]:
    """The p-values (m,) of a family, adjusted so that one below alpha is significant at alpha (Holm 1979)."""
    values = np.asarray(p, np.float64)
    order = np.argsort(values, kind="stable")
    adjusted = np.empty_like(values)
    adjusted[order] = np.minimum(np.maximum.accumulate(values[order] * np.arange(len(values), 0, -1)), 1.0)
    return adjusted


def trend(groups: Sequence[ArrayLike]) -> Outcome:
    """Whether times rise or fall along ordered conditions: Jonckheere (1954) and Terpstra's (1952) test.

    It is computed as the equivalent Kendall's tau-b between the condition's rank and the time, ties included. The
    statistic is tau: negative where times fall.
    """
    samples = [np.asarray(times, np.float64) for times in groups]
    rank = np.repeat(np.arange(len(samples)), [len(sample) for sample in samples])
    times = np.concatenate(samples)
    if (times == times[0]).all():
        return Outcome(0.0, 1.0)
    found = stats.kendalltau(rank, times, method="asymptotic")
    return Outcome(float(found.statistic), float(found.pvalue))


def fit_scaling(robots: ArrayLike, times: ArrayLike, confidence: float = 0.95) -> Scaling:
    """The least-squares fit of times (m,) to serial + parallel / robots (m,), one row per run.

    The form is Amdahl's (1967). The intervals are Student's with m - 2 degrees of freedom; they assume
    equal variances. Raises ValueError for fewer than two sizes of swarm.
    """
    sizes, values = np.asarray(robots, np.float64), np.asarray(times, np.float64)
    if len(np.unique(sizes)) < 2:
        raise ValueError(f"robots: expected at least two sizes of swarm, got {sorted(set(sizes.tolist()))}")
    line, varies = stats.linregress(1.0 / sizes, values), bool(np.ptp(values) > 0.0)
    intervals: list[Interval | None] = [None, None]
    if len(values) > 2:
        reach = float(stats.t.ppf(0.5 + confidence / 2.0, len(values) - 2))
        errors = (line.intercept_stderr, line.stderr) if varies else (0.0, 0.0)
        estimates = zip((line.intercept, line.slope), errors, strict=True)
        intervals = [(float(at - reach * error), float(at + reach * error)) for at, error in estimates]
    r2 = float(line.rvalue) ** 2 if varies else 0.0
    return Scaling(float(line.intercept), float(line.slope), intervals[0], intervals[1], r2)


def speed_up(time: float, robots: float, reference: float, reference_robots: float = 1.0) -> SpeedUp:
    """Speed-up, efficiency and the serial share e = (1/S - 1/p) / (1 - 1/p) (Karp and Flatt 1990).

    `time` is that of a swarm of `robots`, `reference` that of `reference_robots`, in the same unit.
    """
    p, s = robots / reference_robots, reference / time
    return SpeedUp(s, s / p, None if p == 1.0 else (1.0 / s - 1.0 / p) / (1.0 - 1.0 / p))


def runs_needed(
    difference: float,
    sd: float,
    power: float = 0.8,
    alpha: float = 0.05,
    test: Literal["student", "mann-whitney"] = "student",
) -> int:
    """The number of runs that each of two conditions needs to detect a difference of their means.

    n = 2 (z(1 - alpha/2) + z(power))^2 (sd / difference)^2, the normal approximation (Cohen 1988); the rank
    test needs pi / 3 times as many for normal data (Hodges and Lehmann 1956). Raises ValueError for no
    difference.
    """
    if difference == 0.0:
        raise ValueError("difference: expected other than 0, which no number of runs can show")
    z = float(stats.norm.ppf(1.0 - alpha / 2.0) + stats.norm.ppf(power))
    n = 2.0 * (z * sd / difference) ** 2
    return max(2, math.ceil(n if test == "student" else n / EFFICIENCY))
