"""Fits of made-up papers, whose model and whose numbers of averaged runs are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmsim.studies.fit import farther, fit, floor, lines, profile, sentences, shrunk

ROWS, SEEDS = 14, 60


def runs(generator: np.random.Generator, count: int, correlation: float = 0.0) -> np.ndarray:
    """Times (count, ROWS): logarithms with standard deviations of 0.15 to 0.32, correlated by a common factor."""
    common, own = generator.standard_normal((count, 1)), generator.standard_normal((count, ROWS))
    noise = np.sqrt(correlation) * common + np.sqrt(1.0 - correlation) * own
    return np.linspace(300.0, 1200.0, ROWS) * np.exp(np.linspace(0.15, 0.32, ROWS) * noise)


def paper(generator: np.random.Generator, averaged: int, correlation: float = 0.0) -> np.ndarray:
    """The published numbers (ROWS,) of a perfect model: means of so many runs."""
    return runs(generator, averaged, correlation).mean(axis=0)


@pytest.mark.parametrize("averaged", [1, 3, 10])
def test_a_perfect_model_is_refuted_as_often_as_p_says_and_shows_the_error_of_the_floor(averaged: int) -> None:
    generator = np.random.default_rng(averaged)
    papers = [(paper(generator, averaged), runs(generator, SEEDS)) for _ in range(100)]
    found = [profile(published, ours) for published, ours in papers]
    p = np.array([one[averaged - 1].p for one in found])
    assert np.mean(p < 0.2) == pytest.approx(0.2, abs=0.12)  # three standard errors
    likeliest = [1 + np.argmax([one.log_likelihood for one in of]) for of in found]
    assert averaged / 2 <= np.median(likeliest) <= 2 * averaged
    errors = np.array([np.sqrt((np.log(published / ours.mean(axis=0)) ** 2).mean()) for published, ours in papers])
    expected = floor(papers[0][1], averaged)
    assert np.median(errors) == pytest.approx(np.median(expected), rel=0.12)
    low, high = np.quantile(expected, [0.05, 0.95])
    assert np.mean((errors >= low) & (errors <= high)) > 0.8  # 90 % expected


def test_the_floor_is_the_noise_of_means() -> None:
    """With a standard deviation of 0.1 of every logarithm, the error is about 0.1 sqrt(1 / M + 1 / n)."""
    times = 500.0 * np.exp(0.1 * np.random.default_rng(0).standard_normal((200, ROWS)))
    for averaged in (1, 4):
        expected = 0.1 * np.sqrt(1 / averaged + 1 / 200)
        assert np.sqrt((floor(times, averaged) ** 2).mean()) == pytest.approx(expected, rel=0.03)


def test_a_wrong_model_is_found_whatever_was_averaged() -> None:
    generator = np.random.default_rng(1)
    wrong = paper(generator, 1) * np.exp(0.8 * (-1.0) ** np.arange(ROWS))
    found = fit(wrong, runs(generator, SEEDS))
    assert all(one.p < 1e-6 and one.farther[1] < 0.05 and one.floor_interval[1] < found.error for one in found.averaged)
    assert found.not_refuted == ()
    assert "no number of averaged runs agrees with ours" in sentences(found)


def test_means_of_many_runs_refute_few_and_single_runs_refute_many() -> None:
    generator = np.random.default_rng(2)
    ours = runs(generator, SEEDS)
    exact, single = fit(ours.mean(axis=0), ours), fit(paper(generator, 1), ours)
    assert exact.averaged[0].p > 0.999
    assert exact.averaged[0].farther[0] == 1.0  # every run is farther from the mean than the mean itself
    assert exact.likeliest == 30
    assert single.averaged[-1].p < 1e-6
    assert single.likeliest <= 2


def test_ranks_of_perfect_papers_are_spread_evenly_for_every_shrinkage() -> None:
    """A paper of 14 numbers is as near as any other, though its covariance is from a few tens of seeds."""
    generator = np.random.default_rng(3)
    drawn = [(paper(generator, 1, 0.3), runs(generator, 34, 0.3)) for _ in range(50)]
    ranks = np.array([farther(published, ours, 1) for published, ours in drawn])
    assert_allclose(ranks.mean(axis=0), 0.5, atol=0.13)  # three standard errors
    assert_allclose((ranks < 0.25).mean(axis=0), 0.25, atol=0.19)


def test_one_set_of_starts_is_told_from_new_ones_only_if_rows_correlate() -> None:
    generator = np.random.default_rng(4)
    ours = runs(generator, SEEDS, 0.9)
    slow = runs(generator, 1000, 0.9)
    slow = slow[np.argsort(slow.prod(axis=1))[950]]  # a set of starts that is slower than 95 % of sets
    one, anew = fit(slow, ours), fit(paper(generator, 1), ours)
    assert one.one_set[1] > 2.0
    assert one.correlation == pytest.approx(0.9, abs=0.05)
    assert anew.one_set[0] < -2.0
    assert "one set of starts for all rows is likelier than new ones for each" in sentences(one)
    alike = fit(paper(generator, 1), runs(generator, SEEDS))
    assert abs(alike.correlation) < 0.1
    assert "cannot be told apart" in sentences(alike)


def test_one_number_has_a_fit_without_starts() -> None:
    """One number off by 0.1, a standard deviation of 0.2 and 400 runs: the delta method by hand."""
    logs = np.random.default_rng(5).standard_normal((400, 1))
    times = 300.0 * np.exp(0.2 * (logs - logs.mean()) / logs.std(ddof=1))
    found = fit(times.mean(axis=0) * np.exp(0.1), times)
    assert found.averaged[0].chi_square == pytest.approx((0.1 + 0.02 * (1 - 1 / 400)) ** 2 / (0.04 * (1 + 1 / 400)))
    assert found.correlation is None
    assert "Rows" not in sentences(found)
    assert [line[0] for line in lines(found)] == ["1", "2", "3", "5", "10"]


@pytest.mark.parametrize(("apart", "told"), [(1, "-"), (2, "0%")])
def test_runs_that_are_alike_once_some_are_left_out_are_at_no_distance(apart: int, told: str) -> None:
    """One of two rows has so many seeds that differ from the rest; left out alone, one of two leaves a spread."""
    times = np.column_stack([np.linspace(300.0, 400.0, 12), np.full(12, 500.0)])
    times[:apart, 1] = 600.0
    found = fit(np.array([900.0, 2000.0]), times)
    assert [line[-1] for line in lines(found)] == [told, "-", "-", "-", "-"]
    assert (found.averaged[0].farther is None) == (told == "-")
    assert farther(np.array([900.0, 2000.0]), times[:2], 1) is None  # one seed that is left has no spread
    assert "A perfect model would show" in sentences(found)


def test_a_shrunk_covariance_keeps_its_diagonal() -> None:
    assert shrunk(np.array([[4.0, 2.0], [2.0, 9.0]]), 0.25).tolist() == [[4.0, 1.5], [1.5, 9.0]]
    assert shrunk(np.array(4.0), 0.5).tolist() == [[4.0]]
