"""Conditions of a study tested against one: by rank, or seed by seed where that pays."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmsim.studies.results import Result
from swarmsim.studies.statistics import Paired, compare, holm, runs_needed
from swarmsim.studies.survival import Endings, Interval, common_horizon

FEWEST: Final = 10  # pairs, from which a correlation has an interval worth the name
PAYS: Final = 0.1  # correlation: with less, pairs save less than a tenth of the runs


@dataclass(frozen=True, slots=True)
class BySeed:
    """Runs of two conditions with equal seeds, which share their random streams, compared pair by pair."""

    pairs: int
    correlation: float  # of the logarithms of times
    interval: Interval  # 95 %, Fisher's (1921)
    p: float  # two-sided, Wilcoxon's signed-rank test (1945) of the logarithms' differences

    @property
    def pays(self) -> bool:
        """Whether the correlation is shown to be above PAYS: then pairs tell conditions apart with fewer runs."""
        return self.interval[0] > PAYS


@dataclass(frozen=True, slots=True)
class Contrast:
    """A condition against another, by rank and, with enough pairs of seeds, by seed."""

    name: str
    ranked: Paired  # without regard to seeds; its `adjusted` is of this pair alone
    by_seed: BySeed | None
    adjusted: float  # the p of the test that counts, after Holm's correction over all conditions
    needed: int | None  # seeds of each that would show this difference with that test; None where runs are unfinished

    @property
    def paired(self) -> bool:
        """Whether the test by seed counts."""
        return self.by_seed is not None and self.by_seed.pays


def contrasts(results: Mapping[str, Result], against: str) -> list[Contrast]:
    """Every other condition against one, as far as both have two runs or more, in seconds.

    Unfinished runs count up to the shorter limit of both: as equals, behind all that finished by then. The test by
    seed counts if its correlation `pays`, a fixed rule that looks at no difference between the two.
    """
    base, found = results[against], list[tuple[str, Paired, BySeed | None, int | None]]()
    for name, result in results.items():
        if name == against or min(len(result.rows), len(base.rows)) < 2:
            continue
        horizon = common_horizon((result.seconds, base.seconds))
        ours, theirs = (one.seconds.within(horizon) for one in (result, base))
        (ranked,) = compare({name: ours.ranks, against: theirs.ranks}, against)
        x, y = _pairs(result, base, horizon)
        by_seed = _by_seed(x, y) if len(x) >= FEWEST else None
        pairs = (x, y) if by_seed is not None and by_seed.pays else None
        found.append((name, ranked, by_seed, _needed(ours, theirs, pairs)))
    ps = [by_seed.p if by_seed is not None and by_seed.pays else ranked.p for _, ranked, by_seed, _ in found]
    return [
        Contrast(name, ranked, by_seed, float(adjusted), needed)
        for (name, ranked, by_seed, needed), adjusted in zip(found, holm(ps), strict=True)
    ]


def _pairs(first: Result, second: Result, horizon: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The times of runs with equal seeds, up to a horizon: two arrays (n,), by seed."""
    sides = [
        dict(zip((row.seed for row in one.rows), one.seconds.within(horizon).times.tolist(), strict=True))
        for one in (first, second)
    ]
    seeds = sorted(sides[0].keys() & sides[1].keys())
    return np.array([sides[0][seed] for seed in seeds]), np.array([sides[1][seed] for seed in seeds])


def _by_seed(first: NDArray[np.float64], second: NDArray[np.float64]) -> BySeed:
    x, y = np.log(first), np.log(second)
    n, varies = len(x), np.ptp(x) > 0.0 and np.ptp(y) > 0.0
    r = float(np.clip(np.corrcoef(x, y)[0, 1], -1.0, 1.0)) if varies else 0.0
    reach = float(stats.norm.ppf(0.975)) / math.sqrt(n - 3)
    with np.errstate(divide="ignore"):
        low, high = np.tanh(np.arctanh(r) + np.array([-reach, reach]))
    differs = bool((first != second).any())
    return BySeed(n, r, (float(low), float(high)), float(stats.wilcoxon(x - y).pvalue) if differs else 1.0)


def _needed(
    ours: Endings, theirs: Endings, pairs: tuple[NDArray[np.float64], NDArray[np.float64]] | None
) -> int | None:
    """Seeds of each condition that would show a difference as large as the one found."""
    difference = float(ours.times.mean() - theirs.times.mean())
    if pairs is not None:  # the variance of differences stands for twice that of either condition
        sd = float((pairs[0] - pairs[1]).std(ddof=1)) / math.sqrt(2.0)
    else:
        sd = float(np.sqrt((ours.times.var(ddof=1) + theirs.times.var(ddof=1)) / 2.0))
    if not (ours.whole and theirs.whole and difference and sd):
        return None
    return runs_needed(difference, sd, test="mann-whitney")


COMPARED: Final = (
    "condition", "A12", "p by rank", "correlation by seed", "p by seed", "counts", "p after Holm",
    "seeds to tell apart",
)  # fmt: skip


def compared(results: Mapping[str, Result], against: str) -> list[tuple[str, ...]]:
    """Every other condition against one, one per line, under COMPARED."""
    return [
        (
            one.name,
            f"{one.ranked.a12:.2f}",
            f"{one.ranked.p:.2g}",
            *_seeded(one.by_seed),
            "by seed" if one.paired else "by rank",
            f"{one.adjusted:.2g}",
            "-" if one.needed is None else str(one.needed),
        )
        for one in contrasts(results, against)
    ]


def _seeded(one: BySeed | None) -> tuple[str, str]:
    if one is None:
        return "-", "-"
    return f"{one.correlation:.2f} ({one.interval[0]:.2f} to {one.interval[1]:.2f})", f"{one.p:.2g}"
