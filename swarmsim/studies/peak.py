"""The best value on a study's axis for a measure, and the values that its seeds do not tell apart from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.studies.results import Result
from swarmsim.studies.statistics import RESAMPLES
from swarmsim.studies.survival import Interval

ALPHA: Final = 0.05
Extreme = Literal["highest", "lowest"]


@dataclass(frozen=True, slots=True)
class Peak:
    """The best value on the axis in one series of conditions."""

    series: str  # of the study's plot; empty if there is one
    best: float  # value with the best mean
    mean: float  # of the measure there
    seeds: int  # that every value of the series has
    interval: Interval  # of the best value: 2.5 to 97.5 % of resamples of the seeds
    level: tuple[float, ...]  # other values that are not shown to be worse
    at_end: bool  # whether the best is the first or last value, so that it may lie beyond


def peaks(results: Mapping[str, Result], measure: str, which: Extreme) -> list[Peak]:
    """The best value of the axis, by the mean of a measure, in each series of a study.

    Equal seeds are resampled together (bootstrap, Efron 1979), as they share starts. Another value is shown to be worse
    if its mean is worse than the best in all resamples but 5 %, shared by the other values (Bonferroni).
    Raises InputError for a study without an axis, an unknown measure, or no seed with the measure at all values.
    """
    series: dict[str, dict[float, dict[int, float]]] = {}
    for result in results.values():
        if result.condition.x is not None:
            seeds = (row.seed for row in result.rows)
            found = dict(zip(seeds, result.measure(measure).tolist(), strict=True))
            series.setdefault(result.condition.series, {})[result.condition.x] = found
    if not series:
        raise InputError(f"no axis along which {measure} could be best; expected numbers varied, or 'x' of conditions")
    return [_peak(name, dict(sorted(of.items())), measure, which) for name, of in series.items()]


def _peak(name: str, of: Mapping[float, Mapping[int, float]], measure: str, which: Extreme) -> Peak:
    common = sorted(set.intersection(*(set(values) for values in of.values())))
    table = np.array([[values[seed] for values in of.values()] for seed in common], np.float64).reshape(-1, len(of))
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) == 0:
        raise InputError(f"{name or 'the study'}: no seed has {measure} all along the axis; expected 'study run' first")
    return peak(name, list(of), table, which)


def peak(name: str, axis: Sequence[float], table: NDArray[np.float64], which: Extreme) -> Peak:
    """The best of the values (m,) on an axis by a table (seeds, m) of a measure; as `peaks`."""
    places, sign = np.array(axis), 1.0 if which == "highest" else -1.0
    best = int((sign * table.mean(axis=0)).argmax())
    means = sign * _resampled(table)
    low, high = np.quantile(places[means.argmax(axis=1)], [ALPHA / 2.0, 1.0 - ALPHA / 2.0], method="nearest")
    least = np.quantile(means[:, [best]] - means, ALPHA / max(len(axis) - 1, 1), axis=0)
    level = tuple(float(place) for at, place in enumerate(places) if at != best and least[at] <= 0.0)
    at_end = best in (0, len(places) - 1)
    mean = float(table[:, best].mean())
    return Peak(name, float(places[best]), mean, len(table), (float(low), float(high)), level, at_end)


def _resampled(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means (RESAMPLES, m) of a table (seeds, m) whose rows are drawn with replacement."""
    seeds = len(table)
    counts = np.random.default_rng(0).multinomial(seeds, np.full(seeds, 1.0 / seeds), RESAMPLES)
    return np.asarray(counts @ table / seeds)


def sentences(found: list[Peak], measure: str, axis: str, which: str) -> list[str]:
    """One sentence for each series."""
    return [
        f"{one.series + ': ' if one.series else ''}{measure} is {which} at {axis} = {one.best:g}{_end(one)}: mean "
        f"{one.mean:.3g} of {one.seeds} seeds; in 95 % of resamples of the seeds the best is {_between(one.interval)}; "
        f"not shown to be worse: {', '.join(f'{value:g}' for value in one.level) or 'none'}"
        for one in found
    ]


def _end(one: Peak) -> str:
    return ", an end of the axis" if one.at_end else ""


def _between(interval: Interval) -> str:
    low, high = (f"{end:g}" for end in interval)
    return low if low == high else f"{low} to {high}"
