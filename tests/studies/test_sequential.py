"""Tests of a chance: closed forms against quadrature, error rates, and numbers of runs known from elsewhere."""

import math

import numpy as np
import pytest
from scipy import integrate

from swarmsim.studies.sequential import bounds, evidence, interval, judge

ALPHA = 0.025


def shown(goods: np.ndarray, bound: float, alpha: float) -> int | None:
    """The run, from 1, after which P > bound is shown; None if never."""
    good = np.cumsum(goods)
    hits = np.flatnonzero(evidence(good, np.arange(1, len(goods) + 1) - good, bound) >= -math.log(alpha))
    return int(hits[0]) + 1 if len(hits) else None


@pytest.mark.parametrize(("s", "f", "b"), [(1, 0, 0.93), (0, 1, 0.93), (92, 0, 0.93), (10, 6, 0.5), (30, 4, 0.7)])
def test_evidence_is_the_mixture_of_likelihood_ratios(s: int, f: int, b: float) -> None:
    mixed, _ = integrate.quad(lambda p: (p / b) ** s * ((1 - p) / (1 - b)) ** f, b, 1.0)
    assert evidence(s, f, b) == pytest.approx(math.log(mixed / (1 - b)))


def test_it_reaches_what_other_work_found() -> None:
    needed = -math.log(0.05 / 6)
    assert next(n for n in range(1, 200) if evidence(n, 0, 0.93) >= needed) == 92
    assert evidence([389, 393], [11, 7], [0.93, 0.95]) == pytest.approx([5.88, 4.77], abs=0.01)
    draw = np.random.default_rng(1)
    runs = [shown(draw.random(1500) < 0.97, 0.93, 0.05 / 6) for _ in range(100)]
    assert 260 <= np.median([1500 if one is None else one for one in runs]) <= 350


@pytest.mark.parametrize("bound", [0.5, 0.93])
def test_a_chance_at_the_bound_is_rarely_shown_to_be_above_it(bound: float) -> None:
    draw = np.random.default_rng(2)
    wrong = sum(shown(draw.random(1000) < bound, bound, 0.1) is not None for _ in range(300))
    assert 0 < wrong <= 30  # 0.1 of 300; a test that is never wrong would waste runs


def test_a_mixture_over_all_above_the_bound_has_no_blind_zone() -> None:
    draw = np.random.default_rng(3)
    found = judge(draw.random(20_000) < 0.945, 0.95, 0.02, ALPHA)
    assert found.above
    assert found.below
    assert 0.93 <= found.interval[0] < 0.945 < found.interval[1] <= 0.97


def test_what_was_shown_once_stays_shown() -> None:
    outcomes = np.concatenate([np.ones(120, bool), np.zeros(20, bool)])
    assert judge(outcomes, 0.95, 0.02, ALPHA).above
    assert not judge(outcomes[::-1], 0.95, 0.02, ALPHA).above  # the order of seeds is part of the evidence


def test_without_runs_nothing_is_known() -> None:
    found = judge([], 0.95, 0.02, ALPHA)
    assert (found.above, found.below, found.runs, found.interval) == (False, False, 0, (0.0, 1.0))


@pytest.mark.parametrize(("chance", "slack", "found"), [
    (0.95, 0.02, (0.93, 0.97)), (0.99, 0.02, (0.97, 0.995)), (0.5, 0.1, (0.4, 0.6)),
])  # fmt: skip
def test_bounds_leave_room_below_certainty(chance: float, slack: float, found: tuple[float, float]) -> None:
    assert bounds(chance, slack) == found


@pytest.mark.parametrize(("chance", "slack"), [(0.95, 0.95), (1.0, 0.02), (0.95, 0.0), (0.5, 0.6)])
def test_bad_bounds_are_refused(chance: float, slack: float) -> None:
    with pytest.raises(ValueError, match="expected 0 < slack < chance < 1"):
        judge([True], chance, slack, ALPHA)


def test_near_certainty_a_swarm_that_never_fails_is_not_shown_to_be_below() -> None:
    found = judge(np.ones(3000, bool), 0.99, 0.02, ALPHA)
    assert found.above
    assert not found.below


def test_an_interval_ends_where_the_evidence_does() -> None:
    low, high = interval(45, 50, 0.05)
    assert evidence([45, 5], [5, 45], [low, 1 - high]) == pytest.approx([-math.log(0.025)] * 2, abs=1e-6)
    assert interval(0, 10, 0.05)[0] == 0.0
    assert interval(10, 10, 0.05)[1] == 1.0


@pytest.mark.parametrize("chance", [0.1, 0.5, 0.95])
def test_intervals_hold_the_chance_after_every_run(chance: float) -> None:
    draw = np.random.default_rng(4)
    missed = 0
    for _ in range(300):
        good = np.cumsum(draw.random(600) < chance)
        other = np.arange(1, 601) - good
        ends = evidence(good, other, chance).max(), evidence(other, good, 1 - chance).max()
        missed += max(ends) >= -math.log(0.025)  # the interval's ends pass the chance exactly then
    assert missed <= 15
