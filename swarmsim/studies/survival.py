"""Survival analysis: the one account of runs, finished or cut off, and the estimates that it allows.

An unfinished run took longer than it was watched, and nothing more is known of it. So what is known of several
conditions with different limits can be compared up to the shortest limit: the common horizon.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Interval = tuple[float, float]  # low, high
ROUNDING: Final = 1e-9  # share by which times may differ that are equal but for their floating point


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


class Chance(NamedTuple):
    """The chance of being done by a time."""

    value: float | None  # None where runs were cut off before: then only `interval` is known
    interval: Interval


class Quantile(NamedTuple):
    """The time by which a share of runs is done, and its interval."""

    value: float | None  # None where fewer runs finished
    low: float
    high: float | None  # None where too few runs, or too few finished ones, bound it


@dataclass(frozen=True, slots=True)
class Endings:
    """How the runs of a condition ended. All times are in one unit, iterations or seconds."""

    times: NDArray[np.float64]  # (n,): until each run finished or, if it did not, was cut off
    finished: NDArray[np.bool_]  # (n,)
    limit: float  # at which a run that does not finish is cut off

    @property
    def done(self) -> int:
        """The number of finished runs."""
        return int(self.finished.sum())

    @property
    def whole(self) -> bool:
        """Whether all runs finished."""
        return bool(self.finished.all())

    @property
    def ranks(self) -> NDArray[np.float64]:
        """Times (n,) for tests by rank: infinite for unfinished runs, which assumes one limit for all."""
        return np.where(self.finished, self.times, np.inf)

    def scaled(self, factor: float) -> Endings:
        """The same in another unit."""
        return Endings(self.times * factor, self.finished, self.limit * factor)

    def within(self, horizon: float) -> Endings:
        """The same runs as if all of them had been cut off at a horizon. Raises ValueError for one not reached."""
        cut = self.times[~self.finished]
        if cut.min(initial=math.inf) < horizon * (1.0 - ROUNDING):
            raise ValueError(f"horizon: expected at most {cut.min():g}, where a run was cut off, got {horizon:g}")
        ended = self.finished & (self.times <= horizon * (1.0 + ROUNDING))
        return Endings(np.minimum(self.times, horizon), ended, horizon)

    def by(self, time: float, confidence: float = 0.95) -> Chance:
        """The chance of being done by a time.

        Where no run was cut off before, it is a share with Clopper and Pearson's interval (1934); between cuts it is
        Kaplan and Meier's estimate with Greenwood's interval on the log-log scale (Kalbfleisch and Prentice 2002).
        Beyond the last time only the lower end is known: runs cut off before may or may not be done.
        """
        time *= 1.0 + ROUNDING
        done, n = int((self.finished & (self.times <= time)).sum()), len(self.times)
        exact = stats.binomtest(done, n).proportion_ci(confidence, method="exact")
        cut = ~self.finished & (self.times < time * (1.0 - 2.0 * ROUNDING))
        if not cut.any():
            return Chance(done / n, (float(exact.low), float(exact.high)))
        if time > self.times.max() * (1.0 + 2.0 * ROUNDING):
            return Chance(None, (float(exact.low), 1.0))
        when, shares, ends = self._curve(confidence)
        at = np.searchsorted(when, time, side="right") - 1
        if at < 0:
            return Chance(0.0, (0.0, 1.0))
        return Chance(1.0 - float(shares[at]), (1.0 - float(ends[1, at]), 1.0 - float(ends[0, at])))

    def quantile(self, share: float, confidence: float = 0.95) -> Quantile:
        """The time by which a share of runs, between 0 and 1, is done, with an interval that supposes no distribution.

        With one limit its ends are order statistics (Conover 1999, section 3.2); else they are the times at which
        the interval of Kaplan and Meier's curve meets the share (Brookmeyer and Crowley 1982).
        """
        value = kaplan_meier(self.times, self.finished).quantile(share)
        cut, last = self.times[~self.finished], self.times[self.finished].max(initial=0.0)
        if cut.min(initial=math.inf) >= last:
            found = stats.quantile_test(self.ranks, p=share).confidence_interval(confidence)
            low = min(float(np.nan_to_num(found.low, posinf=np.inf)), float(cut.min(initial=np.inf)))
            return Quantile(value, low, float(found.high) if np.isfinite(found.high) else None)
        when, _, ends = self._curve(confidence)
        met = [np.flatnonzero(end <= 1.0 - share) for end in ends]
        first, upper = (float(when[places[0]]) if len(places) else None for places in met)
        return Quantile(value, float(self.times.max()) if first is None else first, upper)

    def _curve(self, confidence: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Times (j,), shares of unfinished runs after each, and the ends (2, j) of the shares' intervals.

        Before any run finished the lower end is that of none in so many, since Greenwood's formula has none there;
        after all finished the upper end stays what it was.
        """
        runs = stats.CensoredData(uncensored=self.times[self.finished], right=self.times[~self.finished])
        curve = stats.ecdf(runs).sf
        with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)
            found = curve.confidence_interval(confidence, method="log-log")
        when, shares = curve.quantiles, curve.probabilities
        low, high = found.low.probabilities.copy(), found.high.probabilities.copy()
        at_risk = (self.times >= when[:, None]).sum(axis=1)
        start, end = shares >= 1.0, shares <= 0.0
        low[start], high[start] = ((1.0 - confidence) / 2.0) ** (1.0 / at_risk[start]), 1.0
        low[end], high[end] = 0.0, high[~end][-1] if (~end).any() else 1.0
        return when, shares, np.array([low, high])


def common_horizon(several: Iterable[Endings]) -> float:
    """The time up to which conditions can be compared: the shortest of their limits."""
    return min(one.limit for one in several)


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
