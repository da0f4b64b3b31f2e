from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from swarmsim.studies.statistics import (
    a12,
    bootstrap_mean,
    compare,
    describe,
    fit_scaling,
    holm,
    prediction_interval,
    runs_needed,
    speed_up,
    trend,
)
from swarmsim.studies.survival import Endings, kaplan_meier, log_rank, restricted_mean

# Weeks of remission of 42 children (Freireich et al. 1963), the textbooks' example of censored times.
DRUG = [6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35]
RELAPSED = [1, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0]
PLACEBO = [1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23]

runs = st.lists(st.tuples(st.integers(1, 12), st.booleans()), min_size=1, max_size=12)


def split(pairs) -> tuple[list[int], list[bool]]:
    return [time for time, _ in pairs], [flag for _, flag in pairs]


def test_kaplan_meier_of_the_textbook():
    found = kaplan_meier(DRUG, RELAPSED)
    assert found.times.tolist() == [6, 7, 10, 13, 16, 22, 23]
    assert found.at_risk.tolist() == [21, 17, 15, 12, 11, 7, 6]
    assert found.events.tolist() == [3, 1, 1, 1, 1, 1, 1]
    np.testing.assert_allclose(found.shares, [0.857, 0.807, 0.753, 0.690, 0.627, 0.538, 0.448], atol=5e-4)
    assert [found.quantile(share) for share in (0.25, 0.5, 0.75)] == [13.0, 23.0, None]


@given(runs)
def test_kaplan_meier_equals_scipy(pairs):
    times, finished = split(pairs)
    found = kaplan_meier(times, finished)
    ended = [time for time, flag in pairs if flag]
    cut = [time for time, flag in pairs if not flag]
    reference = stats.ecdf(stats.CensoredData(uncensored=ended, right=cut)).sf
    assert reference.evaluate(found.times) == pytest.approx(found.shares)


def test_restricted_mean_of_the_textbook():
    found = restricted_mean(DRUG, RELAPSED)
    assert found.mean == pytest.approx(23.29, abs=5e-3)
    assert found.error == pytest.approx(2.83, abs=5e-3)
    assert found.horizon == 35.0
    assert found.interval == pytest.approx((found.mean - 1.95996 * found.error, found.mean + 1.95996 * found.error))


@given(st.lists(st.integers(1, 50), min_size=2, max_size=20))
def test_restricted_mean_of_whole_data_is_the_mean(times):
    found = restricted_mean(times)
    assert found.mean == pytest.approx(np.mean(times))
    assert found.error == pytest.approx(np.std(times) / math.sqrt(len(times)))


def test_restricted_mean_at_a_horizon():
    assert restricted_mean([10, 20, 30, 40], horizon=25).mean == (10 + 20 + 25 + 25) / 4
    assert restricted_mean([10, 20], horizon=100).mean == 15.0  # all finished: nothing is left to come
    with pytest.raises(ValueError, match="at most 20"):
        restricted_mean([10, 20], [True, False], horizon=100)


def test_log_rank_of_the_textbook():
    found = log_rank((DRUG, RELAPSED), (PLACEBO, np.ones(21)))
    assert found.statistic**2 == pytest.approx(16.79, abs=5e-3)
    assert found.statistic < 0.0  # fewer relapses than expected
    assert found.p == pytest.approx(4.17e-5, abs=5e-8)


def test_log_rank_by_hand():
    # At 1, 2, 3 and 4 the first has 2, 1, 1 and 0 of the 4, 3, 2 and 1 at risk.
    expected = (2 - (1 / 2 + 1 / 3 + 1 / 2)) / math.sqrt(1 / 4 + 2 / 9 + 1 / 4)
    assert log_rank(([1, 3], [1, 1]), ([2, 4], [1, 1])).statistic == pytest.approx(expected)


def test_log_rank_where_nothing_can_differ():
    assert log_rank(([9, 9], [0, 0]), ([9], [0])) == (0.0, 1.0)
    assert log_rank(([5, 5], [1, 1]), ([5], [1])) == (0.0, 1.0)


def test_description_of_finished_runs():
    found = describe(PLACEBO)
    assert (found.n, found.finished, found.median, found.lower, found.upper) == (21, 21, 8.0, 4.0, 12.0)
    assert found.mean == pytest.approx(182 / 21)
    assert found.sd == pytest.approx(6.467870)
    assert found.restricted.mean == pytest.approx(found.mean)
    assert found.restricted.error == pytest.approx(1.38, abs=5e-3)
    low, high = found.interval
    assert low < found.mean < high
    assert found.mean - low < high - found.mean  # BCa leans towards the long tail
    assert found.prediction == prediction_interval(PLACEBO, scale="log")


def test_description_of_censored_runs():
    found = describe(DRUG, RELAPSED)
    assert (found.n, found.finished, found.lower, found.median, found.upper) == (21, 9, 13.0, 23.0, None)
    assert (found.mean, found.sd, found.interval, found.prediction) == (None, None, None, None)
    assert found.restricted.mean == pytest.approx(23.29, abs=5e-3)


def test_description_where_no_run_finished():
    found = describe([500, 500, 500], [False, False, False])
    assert (found.finished, found.mean, found.lower, found.median, found.upper) == (0, None, None, None, None)
    assert found.restricted.mean == 500.0
    assert (found.restricted.error, found.restricted.interval) == (None, None)


def test_description_of_one_run_and_of_equal_ones():
    one = describe([40])
    assert (one.mean, one.sd, one.interval, one.median, one.prediction) == (40.0, None, None, 40.0, None)
    equal = describe([40, 40, 40])
    assert (equal.sd, equal.interval, equal.prediction) == (0.0, (40.0, 40.0), (40.0, 40.0))
    assert equal.restricted.interval == (40.0, 40.0)


@pytest.mark.parametrize(
    ("times", "finished", "message"),
    [
        ([], None, "n > 0"),
        ([1, 2], [True], "as many flags"),
        ([[1, 2]], None, r"shapes \(1, 2\)"),
        ([1, math.inf], None, "finite"),
        ([1, math.nan], None, "finite"),
    ],
)
def test_what_is_no_sample_is_refused(times, finished, message):
    with pytest.raises(ValueError, match=message):
        describe(times, finished)


def test_bootstrap_is_repeatable_and_equals_scipy():
    found = bootstrap_mean(DRUG, 0.9, seed=3)
    assert found == bootstrap_mean(DRUG, 0.9, seed=3)
    assert found != bootstrap_mean(DRUG, 0.9, seed=4)
    reference = stats.bootstrap(
        (DRUG,), np.mean, confidence_level=0.9, method="BCa", batch=1000, rng=np.random.default_rng(3)
    )
    assert found == tuple(reference.confidence_interval)


def test_prediction_interval_by_hand():
    reach = 4.30265273 * 2.0 * math.sqrt(4 / 3)  # Student's t with 2 degrees of freedom
    assert prediction_interval([8, 10, 12]) == pytest.approx((10 - reach, 10 + reach))
    low, high = prediction_interval([1, 10, 100], scale="log")
    assert math.sqrt(low * high) == pytest.approx(10.0)
    assert math.log(high / 10) == pytest.approx(reach * math.log(10) / 2)
    with pytest.raises(ValueError, match="positive"):
        prediction_interval([0, 1], scale="log")


def test_prediction_interval_holds_one_more_run_as_often_as_it_says():
    rng = np.random.default_rng(1)
    draws = rng.normal(100.0, 10.0, (4000, 9))
    intervals = [prediction_interval(row[:8]) for row in draws]
    held = np.mean([low <= row[8] <= high for row, (low, high) in zip(draws, intervals, strict=True)])
    assert held == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 4000))


def test_a12_by_hand():
    assert a12([1, 2, 3], [4, 5]) == 0.0
    assert a12([1, 4], [2, 4]) == (0 + 1 + 0.5) / 4
    assert a12([7, 7], [7]) == 0.5


@given(st.lists(st.integers(0, 6), min_size=1, max_size=9), st.lists(st.integers(0, 6), min_size=1, max_size=9))
def test_a12_is_the_share_of_pairs(first, second):
    wins = sum((x > y) + 0.5 * (x == y) for x in first for y in second)
    assert a12(first, second) == pytest.approx(wins / (len(first) * len(second)))


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == pytest.approx([1.0, 1.0])
    assert holm([]).shape == (0,)


def test_comparison_of_all_pairs():
    groups = {"1NN": [580, 600, 620, 610], "2NN": [460, 470, 480, 475], "3NN": [340, 480, 350, 345]}
    found = compare(groups)
    assert [(each.first, each.second) for each in found] == [("1NN", "2NN"), ("1NN", "3NN"), ("2NN", "3NN")]
    assert [each.a12 for each in found] == [1.0, 1.0, 12.5 / 16]
    reference = [stats.mannwhitneyu(groups[each.first], groups[each.second]) for each in found]
    assert [(each.u, each.p) for each in found] == [tuple(each) for each in reference]
    assert [each.adjusted for each in found] == pytest.approx(holm([each.p for each in found]))


def test_comparison_with_one_reference():
    groups = {"a": [1, 2, 3], "b": [2, 3, 4], "c": [5, 6, 7]}
    assert [(each.first, each.second) for each in compare(groups, against="b")] == [("a", "b"), ("c", "b")]
    with pytest.raises(KeyError, match="there are a, b, c"):
        compare(groups, against="d")


def test_unfinished_runs_rank_last():
    times = Endings(np.array([10.0, 500, 20]), np.array([True, False, True]), 500.0).ranks
    assert times.tolist() == [10.0, math.inf, 20.0]
    (found,) = compare({"a": times, "b": Endings(np.array([500.0, 500]), np.array([False, False]), 500.0).ranks})
    assert (found.u, found.a12) == (1.0, 1 / 6)  # the one unfinished run ties with two
    (found,) = compare({"a": [math.inf, math.inf], "b": [math.inf]})
    assert (found.u, found.p, found.a12) == (1.0, 1.0, 0.5)


def jonckheere(groups) -> tuple[float, float]:
    """The statistic J and its normal deviate, with the correction for ties (Hollander and Wolfe 1999)."""
    pairs = [(x, y) for i, low in enumerate(groups) for high in groups[i + 1 :] for x in low for y in high]
    j = sum((y > x) + 0.5 * (y == x) for x, y in pairs)
    sizes = np.array([len(group) for group in groups])
    ties = np.unique(np.concatenate(groups), return_counts=True)[1]
    n = sizes.sum()
    variance = (
        (n * (n - 1) * (2 * n + 5) - sum((k * (k - 1) * (2 * k + 5)).sum() for k in (sizes, ties))) / 72
        + math.prod((k * (k - 1) * (k - 2)).sum() for k in (sizes, ties)) / (36 * n * (n - 1) * (n - 2))
        + math.prod((k * (k - 1)).sum() for k in (sizes, ties)) / (8 * n * (n - 1))
    )
    return j, (j - (n**2 - (sizes**2).sum()) / 4) / math.sqrt(variance)


def test_trend_of_the_textbook():
    # Pieces made by workers told nothing, a little or all of their output (Hollander and Wolfe 1999, example 6.2).
    groups = [[40, 35, 38, 43, 44, 41], [38, 40, 47, 44, 40, 42], [48, 40, 45, 43, 46, 44]]
    j, deviate = jonckheere(groups)
    assert j == 79.0
    found = trend(groups)
    assert found.statistic > 0.0
    assert found.p == pytest.approx(2 * stats.norm.sf(deviate))
    assert found.p / 2 == pytest.approx(0.0207, abs=5e-5)


@settings(deadline=None)
@given(st.lists(st.lists(st.integers(0, 9), min_size=2, max_size=6), min_size=2, max_size=5))
def test_trend_equals_jonckheere(groups):
    if len(set().union(*groups)) == 1:
        assert trend(groups) == (0.0, 1.0)
        return
    _, deviate = jonckheere(groups)
    found = trend(groups)
    assert found.p == pytest.approx(2 * stats.norm.sf(abs(deviate)))
    assert np.sign(found.statistic) == pytest.approx(np.sign(deviate))


def test_scaling_of_exact_data():
    found = fit_scaling([1, 2, 4, 4], [110, 60, 35, 35])
    assert (found.serial, found.parallel, found.r2) == pytest.approx((10.0, 100.0, 1.0))
    assert found.serial_interval == pytest.approx((10.0, 10.0))


def test_scaling_by_hand():
    # x = 1, 1, 1/2, 1/2 and y = 9, 11, 5, 7: slope 8, intercept 2, residuals of 1, so s^2 = 4 / 2.
    found = fit_scaling([1, 1, 2, 2], [9, 11, 5, 7])
    assert (found.serial, found.parallel) == pytest.approx((2.0, 8.0))
    t = 4.302653
    slope_error = math.sqrt(2.0 / 0.25)
    assert found.parallel_interval == pytest.approx((8 - t * slope_error, 8 + t * slope_error))
    error = math.sqrt(2.0 * (1 / 4 + 0.75**2 / 0.25))
    assert found.serial_interval == pytest.approx((2 - t * error, 2 + t * error))
    assert found.r2 == pytest.approx(16 / 20)


def test_scaling_at_its_edges():
    assert fit_scaling([1, 2], [10, 6]).serial_interval is None
    flat = fit_scaling([1, 2, 4], [5, 5, 5])
    assert (flat.serial, flat.parallel, flat.serial_interval, flat.r2) == (5.0, 0.0, (5.0, 5.0), 0.0)
    with pytest.raises(ValueError, match=r"\[3\.0\]"):
        fit_scaling([3, 3], [1, 2])


def test_speed_up_by_hand():
    assert speed_up(50.0, 4, 100.0) == pytest.approx((2.0, 0.5, 1 / 3))  # (1/2 - 1/4) / (1 - 1/4)
    assert speed_up(25.0, 20, 100.0, 5) == pytest.approx((4.0, 1.0, 0.0))
    assert speed_up(100.0, 5, 100.0, 5) == (1.0, 1.0, None)


def test_runs_needed_to_tell_two_conditions_apart():
    assert runs_needed(8, 37) == 336  # 2 (1.95996 + 0.84162)^2 (37 / 8)^2 = 335.8
    assert runs_needed(-8, 37) == 336
    assert runs_needed(8, 37, test="mann-whitney") == 352  # pi / 3 times as many
    assert runs_needed(1000, 1) == 2
    with pytest.raises(ValueError, match="other than 0"):
        runs_needed(0, 37)
