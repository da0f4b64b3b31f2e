"""Survival analysis: estimates of durations that include runs stopped before they finished."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Interval = tuple[float, float]  # low, high


@dataclass(frozen=True, slots=True)
class Survival:
    """Kaplan and Meier's estimate of the share of unfinished runs; row j is the j-th time at which runs finished."""

    times: NDArray[np.float64]  # (j,): times at which runs finished, ascending
    shares: NDArray[np.float64]  # (j,): the share of unfinished runs after each
    at_risk: NDArray[np.int64]  # (j,): runs neither finished nor cut off before
    events: NDArray[np.int64]  # (j,): runs that finished then

    def quantile(self, share: float) -> float | None:
        """The first time by which this share (0 to 1) of the runs had finished, or None if it never had."""
        hits = np.flatnonzero(self.shares <= 1.0 - share + 1e-12)  # shares are products, exact up to rounding
        return float(self.times[hits[0]]) if len(hits) else None


@dataclass(frozen=True, slots=True)
class RestrictedMean:
    """The mean of min(time, horizon): the average duration of runs cut off at the horizon."""

    mean: float
    error: float | None  # standard error; None for fewer than two runs or if none finished by then
    interval: Interval | None
    horizon: float


class Outcome(NamedTuple):
    """The outcome of a test."""

    statistic: float
    p: float  # two-sided


def sample_of(times: ArrayLike, finished: ArrayLike | None = None) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Times (n,) and whether each run finished (n,; default: all), checked. Raises ValueError."""
    values = np.asarray(times, np.float64)
    ended = np.ones(values.shape, np.bool_) if finished is None else np.asarray(finished, np.bool_)
    if values.ndim != 1 or len(values) == 0 or values.shape != ended.shape:
        raise ValueError(f"expected times (n,) and as many flags, n > 0, got shapes {values.shape} and {ended.shape}")
    if not np.isfinite(values).all():
        raise ValueError("times: expected finite numbers; an unfinished run's time is that at which it was cut off")
    return values, ended


def kaplan_meier(times: ArrayLike, finished: ArrayLike | None = None) -> Survival:
    """The product-limit estimate S(t) = prod over t_j <= t of 1 - d_j / n_j (Kaplan and Meier 1958).

    A run cut off when another finishes still counts as at risk then.
    """
    values, ended = sample_of(times, finished)
    when, events = np.unique(values[ended], return_counts=True)
    at_risk = len(values) - np.searchsorted(np.sort(values), when, side="left")
    return Survival(when, np.cumprod(1.0 - events / at_risk, dtype=np.float64), at_risk, events)


def restricted_mean(
    times: ArrayLike, finished: ArrayLike | None = None, horizon: float | None = None, confidence: float = 0.95
) -> RestrictedMean:
    """The area under Kaplan and Meier's curve up to `horizon` (default: the longest time); Irwin 1949.

    Its variance is the sum over finish times of A_j^2 d_j / (n_j (n_j - d_j)), A_j being the area right of each
    (Klein and Moeschberger 2003, section 4.5); the interval is the normal one, within 0 and the horizon.
    Raises ValueError for a horizon beyond the last time of an unfinished run.
    """
    values, ended = sample_of(times, finished)
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
    """The log-rank test of two conditions, each given as times and finished flags (Mantel 1966).

    The statistic is a standard normal deviate, positive if the first finished more often than expected; its square
    is the chi-squared statistic. It is 0 where nothing can differ, as when no run finished.
    """
    samples = [sample_of(*first), sample_of(*second)]
    if not any(ended.any() for _, ended in samples):
        return Outcome(0.0, 1.0)
    censored = [stats.CensoredData(uncensored=times[ended], right=times[~ended]) for times, ended in samples]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = stats.logrank(censored[0], censored[1])
    return Outcome(float(found.statistic), float(found.pvalue)) if np.isfinite(found.statistic) else Outcome(0.0, 1.0)
