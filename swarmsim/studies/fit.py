"""How well our runs fit published averages: the error beside that of a perfect model, and where the numbers lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmsim.studies.survival import Interval

RUNS: Final = (1, 2, 3, 5, 10)  #: averaged runs that a table lists
MOST: Final = 30  # averaged runs that are tried for the likeliest
PAPERS: Final = 1000  # simulated for each number of averaged runs
DRAWS: Final = 200  # of several seeds that are left out together
SHRINKAGES: Final = (0.25, 0.5, 0.75, 1.0)  # of covariances towards their diagonal
TELLING: Final = 2.0  # difference of log-likelihoods from which on they tell two models apart
Reals = NDArray[np.float64]


class Averaged(NamedTuple):
    """What to expect if each published number is the mean of so many runs of ours."""

    runs: int
    floor: float  # the median root-mean-square log-ratio that a perfect model would show
    floor_interval: Interval  # 5 to 95 % of them
    log_likelihood: float
    chi_square: float
    p: float  # of a chi-square as large or larger
    farther: Interval | None  # the share of simulated papers farther from the other runs; the range over SHRINKAGES


@dataclass(frozen=True, slots=True)
class Fit:
    """Published numbers against our runs of equal seeds, whose robots have equal starts, on the log scale."""

    error: float  # root mean square of log(ours / published)
    seeds: int
    averaged: tuple[Averaged, ...]  # by RUNS
    likeliest: int  # averaged runs, of 1 to MOST
    not_refuted: tuple[int, ...]  # numbers of averaged runs with a p of 5 % or more
    correlation: float | None  # of two rows over seeds, on average; None for one row, or one without spread
    one_set: Interval | None  # log-likelihood of one set of starts for all rows less that of new ones for each


def fit(published: Reals, times: Reals) -> Fit:
    """Compare published numbers (p,) with our runs' (seeds, p), all above 0; a row of `times` has one seed."""
    logs, several = np.log(times), len(published) > 1 and bool(np.ptp(times, axis=0).all())
    found = profile(published, times)
    likeliest = 1 + int(np.argmax([one.log_likelihood for one in found]))
    correlations = np.corrcoef(logs, rowvar=False)[np.triu_indices(len(published), 1)] if several else np.zeros(0)
    return Fit(
        error=float(np.sqrt((np.log(published / times.mean(axis=0)) ** 2).mean())),
        seeds=len(times),
        averaged=tuple(_averaged(published, times, runs, found[runs - 1]) for runs in RUNS),
        likeliest=likeliest,
        not_refuted=tuple(runs for runs, one in enumerate(found, 1) if one.p >= 0.05),
        correlation=float(correlations.mean()) if several else None,
        one_set=_one_set(published, times) if several else None,
    )


class Likelihood(NamedTuple):
    """How well the published numbers agree with ours if each is the mean of so many runs."""

    log_likelihood: float
    chi_square: float
    p: float


def profile(published: Reals, times: Reals) -> list[Likelihood]:
    """The agreement with published numbers (p,) that are means of 1, 2, ... MOST runs of ours (seeds, p).

    The log-ratio of a published mean of M runs to our mean of n is taken as normal with mean -s^2 / 2 (1/M - 1/n) and
    variance s^2 (1/M + 1/n), s being the standard deviation of our runs' logarithms: the delta method, to second order.
    """
    ratios, found = np.log(published / times.mean(axis=0)), []
    for runs in range(1, MOST + 1):
        mean, variance = _moments(np.log(times).var(axis=0, ddof=1), runs, len(times))
        chi_square = float(((ratios - mean) ** 2 / variance).sum())
        log_likelihood = float(stats.norm.logpdf(ratios, mean, np.sqrt(variance)).sum())
        found.append(Likelihood(log_likelihood, chi_square, float(stats.chi2.sf(chi_square, len(ratios)))))
    return found


def _moments(variances: Reals, runs: int, seeds: int) -> tuple[Reals, Reals]:
    """The mean and the variance of each log-ratio (p,)."""
    return -variances / 2.0 * (1.0 / runs - 1.0 / seeds), variances * (1.0 / runs + 1.0 / seeds)


def _averaged(published: Reals, times: Reals, runs: int, found: Likelihood) -> Averaged:
    errors = floor(times, runs)
    low, middle, high = (float(value) for value in np.quantile(errors, [0.05, 0.5, 0.95]))
    shares = farther(published, times, runs)
    span = None if shares is None else (float(shares.min()), float(shares.max()))
    return Averaged(runs, middle, (low, high), *found, span)


def floor(times: Reals, runs: int) -> Reals:
    """The errors (PAPERS,) of a perfect model: means of `runs` runs against means of as many as `times` has rows.

    Both are drawn from `times` (seeds, p), column by column, with replacement.
    """
    generator, (seeds, rows) = np.random.default_rng(0), times.shape
    theirs, ours = (
        np.stack([generator.choice(column, (PAPERS, size)).mean(axis=1) for column in times.T], axis=1)
        for size in (runs, seeds)
    )
    return np.asarray(np.sqrt((np.log(theirs / ours) ** 2).sum(axis=1) / rows))


def farther(published: Reals, times: Reals, runs: int) -> Reals | None:
    """The share of simulated papers that lie farther from the other seeds than the published one, by SHRINKAGES.

    A simulated paper is the mean over `runs` seeds, the same for all its rows; each is left out of the mean and the
    covariance that its distance (Mahalanobis 1936) and the published one are measured by. The covariance is shrunk
    towards its diagonal, since one of 14 rows from a few tens of seeds is nearly singular. None where the
    seeds that are left have no spread in some row, and for fewer than three seeds: then there is no such distance.
    """
    if len(times) < 3:
        return None
    left_out = _chosen(len(times), runs, np.random.default_rng(0))
    if not all(np.ptp(np.delete(times, chosen, axis=0), axis=0).all() for chosen in left_out):
        return None
    return np.asarray(np.mean([_shares(published, times, chosen) for chosen in left_out], axis=0))


def _shares(published: Reals, times: Reals, chosen: NDArray[np.int64]) -> list[bool]:
    """Whether the mean of the chosen seeds lies farther from the others than the published numbers, by SHRINKAGES."""
    rest = np.delete(times, chosen, axis=0)
    theirs, simulated = (np.log(one / rest.mean(axis=0)) for one in (published, times[chosen].mean(axis=0)))
    covariance = np.cov(np.log(rest), rowvar=False)
    inverses = [np.linalg.inv(shrunk(covariance, shrinkage)) for shrinkage in SHRINKAGES]
    return [bool(theirs @ inverse @ theirs <= simulated @ inverse @ simulated) for inverse in inverses]


def _chosen(seeds: int, runs: int, generator: np.random.Generator) -> Sequence[NDArray[np.int64]]:
    """The seeds to leave out: each alone, or DRAWS of several."""
    if runs == 1:
        return [np.array([seed]) for seed in range(seeds)]
    return [generator.choice(seeds, min(runs, seeds - 2), replace=False) for _ in range(DRAWS)]


def shrunk(covariance: Reals, shrinkage: float) -> Reals:
    """A covariance (p, p) with its other entries than the diagonal's reduced by a share."""
    square = np.atleast_2d(covariance)
    return (1.0 - shrinkage) * square + shrinkage * np.diag(np.diag(square))


def _one_set(published: Reals, times: Reals) -> Interval:
    """The log-likelihood of one set of starts for all rows, less that of new ones for each; over SHRINKAGES.

    Each is that of its own likeliest number of averaged runs.
    """
    covariance, seeds = np.cov(np.log(times), rowvar=False), len(times)
    ratios = np.log(published / times.mean(axis=0))

    def best(shrinkage: float) -> float:
        square = shrunk(covariance, shrinkage)
        means = [_moments(np.diag(covariance), runs, seeds)[0] for runs in range(1, MOST + 1)]
        scales = [1.0 / runs + 1.0 / seeds for runs in range(1, MOST + 1)]
        told = zip(means, scales, strict=True)
        return max(float(stats.multivariate_normal.logpdf(ratios, mean, scale * square)) for mean, scale in told)

    anew = best(1.0)
    found = [best(shrinkage) - anew for shrinkage in SHRINKAGES if shrinkage < 1.0]
    return min(found), max(found)


TITLE: Final = "If each published number is the mean of so many runs"
MEANING: Final = (
    "The error of a perfect model is the root-mean-square log-ratio of such means of our runs to our own; `p` is that "
    "of the chi-square over all numbers; `farther` is the share of such means, over runs of equal seeds, that lie "
    "farther from our other runs than the published numbers do, for covariances shrunk by a quarter to the whole (`-`: "
    "the other runs of some number are all alike, so nothing lies at a distance from them)."
)
HEAD: Final = (
    "averaged runs", "error of a perfect model", "5 to 95 %", "log-likelihood", "chi-square", "p", "farther",
)  # fmt: skip


def lines(found: Fit) -> list[tuple[str, ...]]:
    """One line for each number of averaged runs, under HEAD."""
    return [
        (
            str(one.runs), f"{one.floor:.3f}", f"{one.floor_interval[0]:.3f} to {one.floor_interval[1]:.3f}",
            f"{one.log_likelihood:.1f}", f"{one.chi_square:.1f}", f"{one.p:.2g}",
            "-" if one.farther is None else _range(one.farther, ".0%"),
        )
        for one in found.averaged
    ]  # fmt: skip


def sentences(found: Fit) -> str:
    """What the fit says of the number of averaged runs and, with several rows, of their starts."""
    floors, counts = (
        ", ".join(texts)
        for texts in ([f"{one.floor:.3f}" for one in found.averaged], [str(one.runs) for one in found.averaged])
    )
    told = "no number of averaged runs agrees with ours (chi-square, 5 %)"
    if found.not_refuted:
        agree = f"{_counts(found.not_refuted)} agree with ours (chi-square, 5 %)"
        told = f"the likeliest number of averaged runs is {found.likeliest}, and {agree}"
    starts = "" if found.correlation is None or found.one_set is None else _starts(found.correlation, found.one_set)
    return f"A perfect model would show {floors} for means of {counts} runs; {told}.{starts}"


def _starts(correlation: float, one_set: Interval) -> str:
    likelier = "likelier" if one_set[0] >= TELLING else "less likely" if one_set[1] <= -TELLING else ""
    verdict = "one set of starts for all rows and new ones for each cannot be told apart"
    if likelier:
        verdict = f"one set of starts for all rows is {likelier} than new ones for each"
    by = f"Rows of equal seeds correlate by {correlation:.2f}"
    return f" {by}; {verdict} (difference of log-likelihoods {_range(one_set, '.1f')})."


def _counts(runs: Sequence[int]) -> str:
    ends = f"{runs[0]} to {runs[-1]}" if runs[0] < runs[-1] else str(runs[0])
    return f"{ends}{' or more' if runs[-1] == MOST else ''}"


def _range(ends: Interval, form: str) -> str:
    low, high = (f"{end:{form}}" for end in ends)
    return low if low == high else f"{low} to {high}"
