"""Conditions tested by seed where that pays, and by rank elsewhere."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from swarmsim.studies.pairing import COMPARED, PAYS, compared, contrasts
from swarmsim.studies.statistics import holm
from swarmsim.studies.survival import Endings

LIMIT = 1000.0


def result(times, seeds=None, limit: float = LIMIT):
    """The runs of a condition with these seeds, by default 1 to n."""
    values = np.asarray(times, np.float64)
    numbers = range(1, len(values) + 1) if seeds is None else seeds
    ends = Endings(np.minimum(values, limit), values <= limit, limit)
    return SimpleNamespace(seconds=ends, rows=[SimpleNamespace(seed=seed) for seed in numbers])


def alike(rng: np.random.Generator, n: int, share: float, ratio: float = 1.0):
    """Two samples (n,) of log-normal times whose logarithms correlate by `share`, the first longer by a ratio."""
    x, y = rng.multivariate_normal([0, 0], [[1, share], [share, 1]], n).T
    return ratio * np.exp(5 + 0.3 * x), np.exp(5 + 0.3 * y)


def test_pairs_count_where_seeds_make_times_alike() -> None:
    first, second = alike(np.random.default_rng(1), 40, 0.9, 1.1)
    (found,) = contrasts({"a": result(first), "b": result(second)}, "b")
    assert found.paired
    assert found.by_seed.correlation == pytest.approx(np.corrcoef(np.log(first), np.log(second))[0, 1])
    assert found.adjusted == found.by_seed.p == stats.wilcoxon(np.log(first) - np.log(second)).pvalue
    assert found.by_seed.p < 0.001 < found.ranked.p  # that is the gain
    assert found.ranked.p == stats.mannwhitneyu(first, second).pvalue  # the old number is there
    (line,) = compared({"a": result(first), "b": result(second)}, "b")
    assert line[COMPARED.index("counts")] == "by seed"


def test_ranks_count_where_seeds_do_not_matter() -> None:
    first, second = alike(np.random.default_rng(2), 40, 0.1, 1.1)
    (found,) = contrasts({"a": result(first), "b": result(second)}, "b")
    assert found.by_seed.interval[0] < PAYS
    assert not found.paired
    assert found.adjusted == found.ranked.p


def test_pairs_are_of_equal_seeds_whatever_their_order_and_are_at_least_ten() -> None:
    first, second = alike(np.random.default_rng(3), 40, 0.9)
    turned = result(first[::-1], range(40, 0, -1))
    (found,) = contrasts({"a": turned, "b": result(second)}, "b")
    assert found.by_seed.correlation == pytest.approx(np.corrcoef(np.log(first), np.log(second))[0, 1])
    (few,) = contrasts({"a": result(first[:20], range(12, 32)), "b": result(second[:20])}, "b")
    assert few.by_seed is None  # nine in common
    (line,) = compared({"a": result(first[:9]), "b": result(second[:9])}, "b")
    assert line[3:6] == ("-", "-", "by rank")


def test_p_values_of_both_tests_are_one_family() -> None:
    rng = np.random.default_rng(4)
    first, second = alike(rng, 40, 0.9, 1.1)
    other, _ = alike(rng, 40, 0.0, 1.2)
    one, two = contrasts({"a": result(first), "b": result(second), "c": result(other)}, "b")
    assert [one.paired, two.paired] == [True, False]
    assert [one.adjusted, two.adjusted] == holm([one.by_seed.p, two.ranked.p]).tolist()


def test_unfinished_runs_count_as_equals_up_to_the_shorter_limit() -> None:
    """Beyond 500 nothing can be compared: a run of 600 is no better than one that was cut at 500."""
    a = result([100, 200, 600, 700])
    (found,) = contrasts({"a": a, "b": result([100, 200, 900, 900], limit=500)}, "b")
    assert (found.ranked.a12, found.ranked.p, found.needed) == (0.5, 1.0, None)


def test_equal_runs_do_not_differ() -> None:
    times = np.linspace(100, 200, 12)
    (found,) = contrasts({"a": result(times), "b": result(times)}, "b")
    assert (found.by_seed.correlation, found.by_seed.p, found.needed) == (1.0, 1.0, None)
    (found,) = contrasts({"a": result([LIMIT + 1] * 12), "b": result([LIMIT + 1] * 12)}, "b")
    assert (found.by_seed.correlation, found.adjusted) == (0.0, 1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("share", [0.0, 0.35, 0.9])
@pytest.mark.parametrize("cut", [False, True], ids=["all finished", "a quarter cut"])
def test_the_choice_of_the_test_makes_no_difference_where_there_is_none(share: float, cut: bool) -> None:
    """Of 400 pairs of equal conditions at most as many are told apart as 5 % allow."""
    rng, told, limit = np.random.default_rng(5), 0, 180.0 if cut else LIMIT
    for _ in range(400):
        first, second = alike(rng, 25, share)
        (found,) = contrasts({"a": result(first, limit=limit), "b": result(second, limit=limit)}, "b")
        told += found.adjusted < 0.05
    assert told <= 33  # 20 are expected, and more than 33 by chance in 2 of 1000 tests
