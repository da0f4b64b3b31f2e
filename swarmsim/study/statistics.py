"""What many runs say together: estimates with their uncertainty, comparisons, trends, and how many runs it takes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

RESAMPLES: Final = 9999  # of the bootstrap
Interval = tuple[float, float]  # low, high
EFFICIENCY: Final = 3.0 / math.pi  # of Mann-Whitney's test relative to Student's, for normal data


@dataclass(frozen=True, slots=True)
class Survival:
    """Kaplan and Meier's estimate of the share of runs not yet finished; row j is the j-th time of an end."""

    times: NDArray[np.float64]  # (j,): times at which runs finished, rising
    shares: NDArray[np.float64]  # (j,): the share of runs unfinished after each
    at_risk: NDArray[np.int64]  # (j,): runs that had neither finished nor been cut off before
    events: NDArray[np.int64]  # (j,): runs that finished then

    def quantile(self, share: float) -> float | None:
        """The first time by which this share (0 to 1) of the runs had finished, or None if it never had."""
        hits = np.flatnonzero(self.shares <= 1.0 - share + 1e-12)  # shares are products, exact up to rounding
        return float(self.times[hits[0]]) if len(hits) else None


@dataclass(frozen=True, slots=True)
class RestrictedMean:
    """The mean of min(time, horizon): what a run takes on average when it is cut off at the horizon."""

    mean: float
    error: float | None  # standard error; None for fewer than two runs or if none finished by then
    interval: Interval | None
    horizon: float


@dataclass(frozen=True, slots=True)
class Description:
    """One condition of a study, as a row of a table.

    If some runs did not finish, what needs all times is None, and the quartiles are Kaplan and Meier's.
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
    prediction: Interval | None  # of one more run


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two conditions compared by rank."""

    first: str
    second: str
    u: float  # Mann and Whitney's, of the first
    p: float  # two-sided
    adjusted: float  # p after Holm's correction for the whole family
    a12: float  # the chance that a run of the first takes longer than one of the second


class Outcome(NamedTuple):
    """The outcome of a test."""

    statistic: float
    p: float  # two-sided


@dataclass(frozen=True, slots=True)
class Scaling:
    """The fit T(N) = serial + parallel / N: what more robots cannot shorten, and what they share out."""

    serial: float
    parallel: float
    serial_interval: Interval | None  # None for two runs, which any line fits
    parallel_interval: Interval | None
    r2: float  # share of the variance explained; 0 if there is none


class SpeedUp(NamedTuple):
    """How a swarm of N does against a reference of N0, with p = N / N0."""

    speed_up: float  # S = T(N0) / T(N)
    efficiency: float  # S / p
    serial_share: float | None  # Karp and Flatt's e; None for p = 1


def _sample(times: ArrayLike, finished: ArrayLike | None = None) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    values = np.asarray(times, np.float64)
    ended = np.ones(values.shape, np.bool_) if finished is None else np.asarray(finished, np.bool_)
    if values.ndim != 1 or len(values) == 0 or values.shape != ended.shape:
        raise ValueError(f"expected times (n,) and as many flags, n > 0, got shapes {values.shape} and {ended.shape}")
    if not np.isfinite(values).all():
        raise ValueError("times: expected finite numbers; an unfinished run's time is that at which it was cut off")
    return values, ended


def describe(
    times: ArrayLike, finished: ArrayLike | None = None, horizon: float | None = None, seed: int = 0
) -> Description:
    """The estimates of one condition, at 95 %, from its runs' times (n,) and whether each finished (default: all).

    Raises ValueError for no runs, and as `restricted_mean`.
    """
    values, ended = _sample(times, finished)
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
        prediction=prediction_interval(values) if whole else None,
    )


def bootstrap_mean(values: ArrayLike, confidence: float = 0.95, seed: int = 0) -> Interval | None:
    """The bias-corrected and accelerated (BCa) bootstrap interval of the mean (Efron 1987).

    The same values and seed give the same interval. One value is no sample: None; equal ones have no width.
    """
    sample, _ = _sample(values)
    if len(sample) < 2:
        return None
    if np.ptp(sample) == 0.0:
        return float(sample[0]), float(sample[0])
    settings = {"n_resamples": RESAMPLES, "confidence_level": confidence, "method": "BCa", "batch": 1000}
    found = stats.bootstrap((sample,), np.mean, rng=np.random.default_rng(seed), **settings).confidence_interval
    return float(found.low), float(found.high)


def prediction_interval(
    values: ArrayLike, confidence: float = 0.95, scale: Literal["linear", "log"] = "linear"
) -> Interval | None:
    """Where one more run will lie: mean +- t(n - 1) sd sqrt(1 + 1/n), for normal data (Hahn and Meeker 1991).

    On the "log" scale it is taken of the logarithms, for positive data with a long upper tail. None for
    fewer than two values. Raises ValueError for values that have no logarithm.
    """
    sample, _ = _sample(values)
    if scale == "log" and sample.min() <= 0.0:
        raise ValueError(f"values: expected positive numbers for the log scale, got {sample.min():g}")
    if len(sample) < 2:
        return None
    scaled = np.log(sample) if scale == "log" else sample
    reach = stats.t.ppf(0.5 + confidence / 2.0, len(scaled) - 1) * scaled.std(ddof=1) * math.sqrt(1 + 1 / len(scaled))
    ends = np.array([scaled.mean() - reach, scaled.mean() + reach])
    low, high = np.exp(ends) if scale == "log" else ends
    return float(low), float(high)


def kaplan_meier(times: ArrayLike, finished: ArrayLike | None = None) -> Survival:
    """The product-limit estimate S(t) = prod over t_j <= t of 1 - d_j / n_j (Kaplan and Meier 1958).

    A run cut off at the very time at which another finishes still counts as at risk then.
    """
    values, ended = _sample(times, finished)
    when, events = np.unique(values[ended], return_counts=True)
    at_risk = len(values) - np.searchsorted(np.sort(values), when, side="left")
    return Survival(when, np.cumprod(1.0 - events / at_risk, dtype=np.float64), at_risk, events)


def restricted_mean(
    times: ArrayLike, finished: ArrayLike | None = None, horizon: float | None = None, confidence: float = 0.95
) -> RestrictedMean:
    """The area under Kaplan and Meier's curve up to `horizon` (default: the longest time); Irwin 1949.

    Its variance is the sum over ends of A_j^2 d_j / (n_j (n_j - d_j)), A_j being the area right of the end
    (Klein and Moeschberger 2003, section 4.5); the interval is the normal one, within 0 and the horizon.
    Raises ValueError if the horizon lies beyond the last time of a run that did not finish.
    """
    values, ended = _sample(times, finished)
    survival = kaplan_meier(values, ended)
    limit = float(values.max()) if horizon is None else float(horizon)
    last = survival.shares[-1] if len(survival.shares) else 1.0
    if limit > values.max() and last > 0.0:
        raise ValueError(f"horizon: expected at most {values.max():g}, where the last run was cut off, got {limit:g}")
    inside = survival.times < limit
    steps = np.diff(np.concatenate([[0.0], survival.times[inside], [limit]]))
    areas = steps * np.concatenate([[1.0], survival.shares[inside]])
    mean = float(areas.sum())
    if len(values) < 2 or not (survival.times <= limit).any():
        return RestrictedMean(mean, None, None, limit)
    right = areas[::-1].cumsum()[::-1][1:]
    events, at_risk = survival.events[inside], survival.at_risk[inside]
    error = math.sqrt(float((right**2 * events / (at_risk * np.maximum(at_risk - events, 1))).sum()))
    reach = float(stats.norm.ppf(0.5 + confidence / 2.0)) * error
    return RestrictedMean(mean, error, (max(0.0, mean - reach), min(limit, mean + reach)), limit)


def log_rank(first: tuple[ArrayLike, ArrayLike], second: tuple[ArrayLike, ArrayLike]) -> Outcome:
    """Whether two conditions, each given as its times and whether each finished, finish alike (Mantel 1966).

    The statistic is a standard normal deviate, positive where the first has finished more often than
    expected; its square is the chi-squared one. Where nothing can differ, as when no run finished, it is 0.
    """
    samples = [_sample(*first), _sample(*second)]
    if not any(ended.any() for _, ended in samples):
        return Outcome(0.0, 1.0)
    censored = [stats.CensoredData(uncensored=times[ended], right=times[~ended]) for times, ended in samples]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = stats.logrank(censored[0], censored[1])
    return Outcome(float(found.statistic), float(found.pvalue)) if np.isfinite(found.statistic) else Outcome(0.0, 1.0)


def ranked(times: ArrayLike, finished: ArrayLike) -> NDArray[np.float64]:
    """Times (n,) for tests by rank: inf for a run that did not finish, which supposes one limit for all."""
    values, ended = _sample(times, finished)
    return np.where(ended, values, np.inf)


def compare(groups: Mapping[str, ArrayLike], against: str | None = None) -> list[Comparison]:
    """Every two conditions, or every other one with `against`, by Mann and Whitney's test (1947).

    Times may be infinite (`ranked`). All p-values given make one family for Holm's correction. Raises
    KeyError for an unknown `against`.
    """
    samples = {name: np.asarray(times, np.float64) for name, times in groups.items()}
    if against is not None and against not in samples:
        raise KeyError(f"no condition {against!r}; there are {', '.join(samples)}")
    pairs = list(combinations(samples, 2)) if against is None else [(n, against) for n in samples if n != against]
    tests = [_mann_whitney(samples[first], samples[second]) for first, second in pairs]
    return [
        Comparison(first, second, test.statistic, test.p, float(adjusted), a12(samples[first], samples[second]))
        for (first, second), test, adjusted in zip(pairs, tests, holm([test.p for test in tests]), strict=True)
    ]


def _mann_whitney(first: NDArray[np.float64], second: NDArray[np.float64]) -> Outcome:
    if (np.concatenate([first, second]) == first[0]).all():
        return Outcome(len(first) * len(second) / 2.0, 1.0)  # all tied: scipy would divide by 0
    found = stats.mannwhitneyu(first, second, alternative="two-sided")
    return Outcome(float(found.statistic), float(found.pvalue))


def a12(first: ArrayLike, second: ArrayLike) -> float:
    """P(X > Y) + P(X = Y) / 2 for X of the first and Y of the second sample (Vargha and Delaney 2000).

    0.5 is no difference. Of times, below 0.5 means that the first is faster. As far from 0.5 as 0.56, 0.64
    and 0.71 are small, medium and large differences.
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

    It is computed as Kendall's tau-b between the condition's rank and the time, to which it is equivalent,
    ties included. The statistic is tau: negative where times fall.
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

    The form is Amdahl's (1967). The intervals are Student's with m - 2 degrees of freedom; they suppose
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
    """How many runs each of two conditions needs for a difference of their means to be found.

    n = 2 (z(1 - alpha/2) + z(power))^2 (sd / difference)^2, the normal approximation (Cohen 1988); the test by
    rank needs pi / 3 times as many if the data are normal (Hodges and Lehmann 1956). Raises ValueError
    for no difference.
    """
    if difference == 0.0:
        raise ValueError("difference: expected other than 0, which no number of runs can show")
    z = float(stats.norm.ppf(1.0 - alpha / 2.0) + stats.norm.ppf(power))
    n = 2.0 * (z * sd / difference) ** 2
    return max(2, math.ceil(n if test == "student" else n / EFFICIENCY))
