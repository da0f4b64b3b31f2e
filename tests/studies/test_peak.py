"""The best value on an axis, found in made-up runs whose best is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from swarmsim.core.errors import InputError
from swarmsim.studies.peak import peaks, sentences
from swarmsim.studies.results import Result
from swarmsim.studies.store import Row


def results(table: np.ndarray, axis: tuple[float | None, ...], series: str = "") -> dict[str, Result]:
    """Runs whose measure `heard` is a table (seeds, values of the axis); NaN for an undefined one."""

    def row(seed: int, value: float) -> Row:
        measures = {"heard": None if np.isnan(value) else value}
        return Row(f"{seed}", "one", seed, "finished", 9, measures, None, "", {}, 0.0, None)

    conditions = [SimpleNamespace(name=f"k={x}{series}", x=x, series=series) for x in axis]
    rows = [tuple(row(seed, float(value)) for seed, value in enumerate(column)) for column in table.T]
    return {of.name: Result(of, made, (), 0) for of, made in zip(conditions, rows, strict=True)}


def noisy(means: list[float], noise: float, seeds: int = 20, seed: int = 0) -> np.ndarray:
    """A table (seeds, m) of values about means; each seed is off by the same at all values, and a little by its own."""
    generator = np.random.default_rng(seed)
    return (
        np.array(means) + generator.standard_normal((seeds, 1)) + noise * generator.standard_normal((seeds, len(means)))
    )


def test_a_clear_peak_is_found_though_seeds_differ_by_more() -> None:
    (high,) = peaks(results(noisy([1.0, 2.0, 1.2], 0.1), (1, 4, 8)), "heard", "highest")
    assert (high.best, high.interval, high.level, high.at_end, high.seeds) == (4.0, (4.0, 4.0), (), False, 20)
    (low,) = peaks(results(noisy([1.0, 2.0, 1.2], 0.1), (1, 4, 8)), "heard", "lowest")
    assert (low.best, low.at_end) == (1.0, True)


def test_values_that_the_seeds_do_not_tell_apart_are_named() -> None:
    (found,) = peaks(results(noisy([1.0, 2.0, 2.0, 0.0], 0.3), (1, 2, 3, 4)), "heard", "highest")
    assert {found.best, *found.level} == {2.0, 3.0}
    assert found.interval == (2.0, 3.0)
    (sentence,) = sentences([found], "heard", "k", "highest")
    assert sentence.startswith(f"heard is highest at k = {found.best:g}: mean ")
    assert f"the best is 2 to 3; not shown to be worse: {found.level[0]:g}" in sentence


def test_the_best_of_equal_values_is_seldom_shown_to_be_better() -> None:
    """With five equal values, any is called worse in about 5 % of studies."""
    found = [peaks(results(noisy([1.0] * 5, 0.5, seed=n), (1, 2, 3, 4, 5)), "heard", "highest")[0] for n in range(30)]
    assert sum(len(one.level) == 4 for one in found) >= 24
    assert sum(one.interval[0] < one.interval[1] for one in found) == 30


def test_each_series_has_its_best_over_the_seeds_that_all_its_values_have() -> None:
    rising, falling = noisy([1.0, 2.0], 0.1), noisy([2.0, 1.0], 0.1)
    rising[3, 1] = np.nan
    both = results(rising, (1, 2), "slow") | results(falling, (1, 2), "fast")
    assert [(one.series, one.best, one.seeds) for one in peaks(both, "heard", "highest")] == [
        ("slow", 2, 19),
        ("fast", 1, 20),
    ]


def test_what_has_no_best_is_refused() -> None:
    with pytest.raises(InputError, match="no axis along which heard could be best"):
        peaks(results(noisy([1.0], 0.1), (None,)), "heard", "highest")
    with pytest.raises(InputError, match="no seed has heard all along the axis"):
        peaks(results(np.full((2, 2), np.nan), (1, 2)), "heard", "highest")
    with pytest.raises(InputError, match="'told' is not a measure"):
        peaks(results(noisy([1.0, 2.0], 0.1), (1, 2)), "told", "highest")
