"""The account of finished and unfinished runs: chances, quantiles and horizons against known survival curves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from swarmsim.studies.survival import Endings, common_horizon, kaplan_meier

INF = math.inf


def endings(times, limit: float = 100.0, cut=()) -> Endings:
    """Runs with these times, cut at the limit, and others cut at `cut`."""
    values = np.array([*times, *cut], np.float64)
    finished = (values <= limit) & (np.arange(len(values)) < len(times))
    return Endings(np.minimum(values, limit), finished, limit)


def test_an_account_says_what_is_known_and_no_more() -> None:
    found = endings([20, 100, 150, INF])
    assert (found.done, found.whole) == (2, False)
    assert found.times.tolist() == [20, 100, 100, 100]
    assert found.ranks.tolist() == [20, 100, INF, INF]
    shorter = found.within(50.0)
    assert (shorter.times.tolist(), shorter.finished.tolist()) == ([20, 50, 50, 50], [True, False, False, False])
    assert shorter.limit == 50.0
    with pytest.raises(ValueError, match="at most 100, where a run was cut off, got 200"):
        found.within(200.0)
    assert endings([20, 30]).within(200.0).whole  # all is known of runs that finished
    assert common_horizon([found, shorter]) == 50.0
    tenths = endings([3, INF]).scaled(0.1)  # 0.30000000000000004
    assert (tenths.limit, tenths.by(0.3).value, tenths.within(0.3).done) == (10.0, 0.5, 1)


def test_a_chance_before_every_cut_is_a_share_with_the_exact_interval() -> None:
    found = endings([10, 20, 30, 100, INF, INF])
    for time, done in ((5, 0), (10, 1), (99.9, 3), (100, 4)):
        exact = stats.binomtest(done, 6).proportion_ci(0.95, method="exact")
        assert found.by(time).value == done / 6
        assert found.by(time).interval == pytest.approx((exact.low, exact.high))


def test_a_chance_beyond_the_limit_is_unknown_but_for_its_lower_end() -> None:
    found = endings([10, 20, 30, INF]).by(101)
    assert found.value is None
    assert found.interval == (pytest.approx(stats.beta.ppf(0.025, 3, 2)), 1.0)
    assert endings([10, 20]).by(1000).value == 1.0  # all finished: nothing is unknown


def test_a_chance_between_cuts_is_kaplan_and_meiers() -> None:
    """The textbook's children (Freireich et al. 1963), and Greenwood's interval on the log-log scale by hand."""
    times = np.array([6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35], np.float64)
    ended = np.array([1, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0], np.bool_)
    found = Endings(times, ended, 40.0).by(10)
    left = kaplan_meier(times, ended).shares[2]
    assert found.value == pytest.approx(1 - left)
    spread = math.sqrt(3 / (21 * 18) + 1 / (17 * 16) + 1 / (15 * 14)) / math.log(left)
    ends = [1 - left ** math.exp(sign * 1.959964 * spread) for sign in (1, -1)]
    assert found.interval == pytest.approx(sorted(ends), abs=1e-6)
    assert Endings(times, ended, 40.0).by(36).value is None


@pytest.mark.thorough
@pytest.mark.parametrize(("chance", "scale", "shape"), [(1.0, 60.0, 1.0), (0.8, 40.0, 3.0), (1.0, 90.0, 0.6)])
@pytest.mark.parametrize("early", [False, True], ids=["one limit", "cut at any time"])
def test_intervals_hold_the_truth_of_known_curves(chance: float, scale: float, shape: float, early: bool) -> None:
    rng, repeats, n = np.random.default_rng(11), 200, 40
    truth_by = chance * (1 - math.exp(-((50 / scale) ** shape)))
    at = 0.4  # a quantile that is reached before most cuts
    truth_at = scale * (-math.log(1 - at / chance)) ** (1 / shape)
    held = {"by": 0, "at": 0}
    for _ in range(repeats):
        times = np.where(rng.random(n) < chance, scale * rng.weibull(shape, n), INF)
        cuts = rng.uniform(20, 200, n) if early else np.full(n, 100.0)
        found = Endings(np.minimum(times, cuts), times <= cuts, 100.0)
        low, high = found.by(50).interval
        held["by"] += low <= truth_by <= high
        quantile = found.quantile(at)
        held["at"] += quantile.low <= truth_at <= (INF if quantile.high is None else quantile.high)
    assert min(held.values()) >= 181  # of 200 at 95 %: fewer by chance in 1 of 200 tests; at 90 % in 1 of 2


def test_quantiles_of_one_limit_lie_between_order_statistics() -> None:
    """Of 20 runs, the median lies between the 6th and the 15th with 95.9 % (Conover 1999, section 3.2)."""
    found = endings(range(1, 21)).quantile(0.5)
    assert (found.value, found.low, found.high) == (10, 6, 15)
    cut = endings([*range(1, 13), *[INF] * 8]).quantile(0.5)
    assert (cut.value, cut.low, cut.high) == (10, 6, None)


def test_a_quantile_that_is_not_reached_is_only_bounded_from_below() -> None:
    assert endings([10] * 5 + [INF] * 15).quantile(0.9) == (None, 100.0, None)
    assert endings([10, 20]).quantile(0.5) == (10.0, 0.0, None)  # two runs bound nothing


def test_without_any_finished_run_nothing_is_known_but_that_it_takes_longer() -> None:
    found = endings([INF] * 8)
    assert found.by(100).value == 0.0
    assert found.by(100).interval[1] == pytest.approx(1 - 0.025 ** (1 / 8))
    assert found.by(101) == (None, (0.0, 1.0))
    assert found.quantile(0.5) == (None, 100.0, None)
    cut = endings([], cut=[20, 30, 40])
    assert cut.by(25).value == 0.0
    assert cut.by(25).interval == (0.0, pytest.approx(1 - 0.025 ** (1 / 3)))  # all three went on beyond 20
    assert cut.by(10).value == 0.0
