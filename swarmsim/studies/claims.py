"""A paper's claims, as tests on runs that repeat its experiments: each holds, fails or stays undecided."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.studies.results import Result
from swarmsim.studies.statistics import RESAMPLES, Description, compare, describe, trend

ALPHA: Final = 0.05
Reals = NDArray[np.float64]
#: For each kind of test: the least and most conditions, and the key of its limit.
TAKES: Final[Mapping[str, tuple[int, float, str]]] = {
    "trend": (2, math.inf, ""), "less-gain": (3, 3, "limit"), "ratio-above": (2, 2, "limit"),
    "ratio-within": (2, 2, "limit"), "faster": (2, math.inf, ""), "same": (2, 2, "after"), "behind": (2, 2, "after"),
    "finished": (1, math.inf, ""),
}  # fmt: skip


class ClaimTest(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One test. A claim may have several: it holds if all hold, and fails if one fails."""

    kind: Literal["trend", "less-gain", "ratio-above", "ratio-within", "faster", "same", "behind", "finished"]
    study: str
    conditions: tuple[str, ...]
    measure: str = "iterations"  # of a trend and ratios; see `Runs.values`
    limit: Annotated[float, Meta(gt=0.0)] | None = None
    after: Annotated[int, Meta(ge=1)] | None = None  # iterations
    rises: bool = False  # whether the trend must rise instead of fall
    but: tuple[str, ...] = ()  # conditions that need not be faster
    label: str = ""  # what is compared, in words
    note: str = ""  # text after the numbers

    def __post_init__(self) -> None:
        least, most, key = TAKES[self.kind]
        if not least <= len(self.conditions) <= most:
            expected = f"{least}{'' if most == least else ' or more'}"
            raise ValueError(f"{self.kind!r} takes {expected} conditions, got {len(self.conditions)}")
        for name, value in (("limit", self.limit), ("after", self.after)):
            if (value is None) == (name == key):
                raise ValueError(f"{self.kind!r} takes {key or 'neither limit nor after'}")


class Judged(NamedTuple):
    """Whether runs confirm or contradict a test; neither if they are too few to tell."""

    holds: bool
    fails: bool
    words: str  # the test and its numbers


@dataclass(frozen=True, slots=True)
class Runs:
    """The runs of one study by condition, under the paper's names."""

    results: Mapping[str, Result]
    names: Mapping[str, str]  # of the study's conditions, where the paper's names differ

    def of(self, name: str) -> Result:
        """The runs of a condition."""
        return self.results[self.names.get(name, name)]

    def values(self, name: str, measure: str) -> Reals:
        """`iterations` of each run (n,), `speed` (1 / iterations), or another measure.

        For an unfinished run, iterations are infinite and the speed is 0. Raises InputError for an unknown
        measure, and for one that is not defined in every run.
        """
        result = self.of(name)
        if measure in ("iterations", "speed"):
            times = result.endings.ranks
            return times if measure == "iterations" else 1.0 / times
        values = result.measure(measure)
        if not np.isfinite(values).all():
            raise InputError(f"{measure!r} is not defined in every run of {name!r}; expected a measure that is")
        return values

    def by_seed(self, name: str, measure: str) -> dict[int, float]:
        """The same by the seed of each run. Raises InputError as `values`."""
        seeds = (row.seed for row in self.of(name).rows)
        return dict(zip(seeds, self.values(name, measure).tolist(), strict=True))

    def describe(self, name: str, measure: str) -> Description:
        """The statistics of a measure of a condition's runs. Raises InputError as `values`."""
        return self.of(name).describe() if measure == "iterations" else describe(self.values(name, measure))

    def curve(self, name: str, iteration: int) -> Reals:
        """The task's measure of each run after an iteration (n,), or at its end if that came earlier."""
        return np.array([curve[min(iteration, len(curve)) - 1] for curve in self.of(name).curves])


def judge(check: ClaimTest, runs: Runs) -> Judged:
    """Test the runs. Raises InputError as `Runs.values`, and for runs without kept curves."""
    if check.after is not None:
        if not all(len(runs.of(name).curves) for name in check.conditions):
            raise InputError(f"the study {check.study!r} keeps no curves, which {check.kind!r} compares")
        return _at(check, runs, check.after)
    samples = {runs.of(name).condition.name: runs.values(name, check.measure) for name in check.conditions}
    ended = np.concatenate([runs.of(name).finished for name in check.conditions])
    if check.kind == "finished":
        return Judged(bool(ended.all()), not ended.all(), f"{int(ended.sum())} of {len(ended)} runs finished")
    if check.kind == "trend":
        return _trend(check, samples)
    if check.kind == "faster":
        return _faster(check, samples, {runs.of(name).condition.name for name in check.but})
    if not all(np.isfinite(sample).all() for sample in samples.values()):
        return Judged(False, False, f"no mean: {int((~ended).sum())} of {len(ended)} runs did not finish")
    limit = check.limit or math.nan
    return (_less_gain if check.kind == "less-gain" else _ratio)(check, samples, limit)


def _trend(check: ClaimTest, samples: Mapping[str, Reals]) -> Judged:
    """The Jonckheere-Terpstra test along the conditions in their order."""
    found = trend(list(samples.values()))
    along, shown = found.statistic if check.rises else -found.statistic, found.p < ALPHA
    label = check.label or " to ".join([next(iter(samples)), list(samples)[-1]])
    words = f"Jonckheere-Terpstra over {label}: tau {found.statistic:.2f}, p {found.p:.1g}"
    return Judged(shown and along > 0.0, shown and along < 0.0, words)


def _less_gain(check: ClaimTest, samples: Mapping[str, Reals], limit: float) -> Judged:
    """Whether the step to the third condition gains less than the step to the second.

    It fails if the gain falls by less than the share `limit` of the second condition's mean.
    """

    def fall(first: Reals, second: Reals, third: Reals) -> float:
        return float((first.mean() - second.mean()) - (second.mean() - third.mean()))

    low, high = bootstrap(fall, *samples.values())
    matters = limit * float(list(samples.values())[1].mean())
    interval = f"95 % {low:.0f} to {high:.0f} iterations"
    words = f"bootstrap of the difference of the gains: {interval}; it matters from {matters:.0f} on"
    return Judged(low > 0.0, high < matters, _noted(words, check))


def _ratio(check: ClaimTest, samples: Mapping[str, Reals], limit: float) -> Judged:
    """Whether the ratio of the first mean to the second is above a limit, or between its inverse and itself."""
    low, high = bootstrap(lambda first, second: float(first.mean() / second.mean()), *samples.values())
    words = f"bootstrap of the ratio of {check.label or ' to '.join(samples)}: 95 % {low:.2f} to {high:.2f}"
    if check.kind == "ratio-within":
        holds, fails = low >= 1.0 / limit and high <= limit, high < 1.0 / limit or low > limit
        return Judged(holds, fails, _noted(words, check))
    (ranks,) = compare(samples, list(samples)[1])
    return Judged(low > limit, high < limit, _noted(f"{words}; A12 {ranks.a12:.2f}", check))


def _faster(check: ClaimTest, samples: Mapping[str, Reals], but: set[str]) -> Judged:
    """Whether all conditions need fewer iterations than the first; fails if one needs more."""
    against, *others = samples
    told = [found for found in compare(samples, against) if found.adjusted < ALPHA]
    faster, slower = ([found.first for found in told if (found.a12 < 0.5) == less] for less in (True, False))
    words = (
        f"Mann-Whitney with Holm, against the {against}: significantly faster {', '.join(faster) or 'none'}; "
        f"slower {', '.join(slower) or 'none'}"
    )
    return Judged(set(faster) >= set(others) - but, bool(slower), words)


def _at(check: ClaimTest, runs: Runs, after: int) -> Judged:
    """Whether two conditions measure the same, or the first one less, after some iterations."""
    first, second = (runs.curve(name, after) for name in check.conditions)
    if check.kind == "same":
        same = np.array_equal(first, second)
        measure = runs.of(check.conditions[0]).condition.curve.name
        return Judged(same, not same, f"{measure} after {after} iterations is {'the same' if same else 'different'}")
    (found,) = compare({"first": first, "second": second}, "second")
    shown, words = found.p < ALPHA, f"Mann-Whitney after {after}: p {found.p:.1g}, A12 {found.a12:.2f}"
    return Judged(shown and found.a12 < 0.5, shown and found.a12 > 0.5, words)


def _noted(words: str, check: ClaimTest) -> str:
    return f"{words}, {check.note}" if check.note else words


def bootstrap(statistic: Callable[..., float], *samples: Reals) -> tuple[float, float]:
    """The 95 % percentile bootstrap interval of a statistic of independent samples (Efron 1979)."""
    generator = np.random.default_rng(0)
    drawn = [
        statistic(*(sample[generator.integers(0, len(sample), len(sample))] for sample in samples))
        for _ in range(RESAMPLES)
    ]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)
