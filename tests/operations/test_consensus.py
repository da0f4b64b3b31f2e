"""Consensus on a heading and on an average, against models written out in numpy and the theory of both."""

from __future__ import annotations

from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from conftest import made, moments_of
from linear_consensus import linear_response, linear_responses
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from swarmsim.core.errors import InputError
from swarmsim.operations.consensus.alignment import correlation_length, following, order
from swarmsim.operations.steering import wrapped

FREE, AVERAGE = "operations/heading-consensus-free", "operations/average-consensus"
SIDE = 8.0  # m, of the periodic page


def oracle(pose: np.ndarray, speed: float, iterations: int) -> list[float]:
    """The order parameter of Eq. 1 with everybody heard, dt = 1 s and no noise."""
    heading, orders = pose[:, 2].copy(), []
    for _ in range(iterations):
        difference = (heading[None, :] - heading[:, None] + np.pi) % (2 * np.pi) - np.pi
        heading = (heading + difference.sum(axis=1) / (len(heading) - 1) + np.pi) % (2 * np.pi) - np.pi
        orders.append(abs(np.exp(1j * heading).mean()))
    return orders


def test_order_is_that_of_the_equation_written_out() -> None:
    keys = ("robots.count=40", 'network.topology={use="full"}', "stop.iterations=12", 'stop.when_done="continue"')
    run = made(*keys, scenario=FREE)
    start = run.simulation.state.pose.copy()
    ours = [moment.measured.values["order"] for moment in moments_of(run)]
    assert_allclose(ours, oracle(start, 0.05, 12), atol=1e-12)


def test_headings_follow_the_equation_on_any_network() -> None:
    run = made("robots.count=30", "stop.iterations=60", 'stop.when_done="continue"', scenario=FREE)
    heading = run.simulation.state.pose[:, 2].copy()
    for moment in moments_of(run):
        turned = heading.copy()
        for robot in range(30):
            senders = moment.links[moment.links[:, 0] == robot, 1]
            turned[robot] += sum(wrapped(heading[senders] - heading[robot])) / len(senders)
        heading = wrapped(turned)
        assert_allclose(wrapped(moment.knowledge.heading - heading), 0.0, atol=1e-12)


def test_particles_move_as_far_as_they_should_and_leave_at_one_edge_to_enter_at_the_other() -> None:
    run = made("robots.count=30", "stop.iterations=200", 'stop.when_done="continue"', scenario=FREE)
    moments = moments_of(run)
    for before, after in pairwise(moments):
        step = after.state.pose[:, :2] - before.state.pose[:, :2]
        step = (step + SIDE / 2) % SIDE - SIDE / 2
        assert (np.hypot(*step.T) <= 0.05 + 1e-12).all()  # an arc is longer than its chord
        assert (after.state.pose[:, :2] >= 0.0).all()
        assert (after.state.pose[:, :2] < SIDE).all()
    crossed = np.abs(np.diff([moment.state.pose[:, :2] for moment in moments], axis=0)).max(axis=(0, 2)) > SIDE / 2
    assert crossed.any()


def late_order(noise: float, seed: int) -> float:
    keys = (f"mind.computation.noise={noise}", f"seed={seed}", "robots.count=50", "stop.iterations=80")
    moments = moments_of(made(*keys, 'stop.when_done="continue"', scenario=FREE))
    return float(np.mean([moment.measured.values["order"] for moment in moments[40:]]))


def test_order_falls_with_noise() -> None:
    noises = (0.0, 0.2, 0.4, 0.6, 0.8)
    orders = [(noise, late_order(noise, seed)) for noise in noises for seed in range(1, 7)]
    tau = stats.kendalltau(*zip(*orders, strict=True), alternative="less")
    assert tau.pvalue < 1e-6
    assert late_order(0.0, 1) > 0.9


def test_consensus_without_noise_is_reached_and_sooner_with_more_neighbours() -> None:
    times, half = [], ("mind.computation.spread=3.14", "stop.iterations=5000")
    for k in (3, 5, 12, 29):
        for seed in range(1, 7):
            run = made(f"network.topology.k={k}", f"seed={seed}", "robots.count=30", *half, scenario=FREE)
            assert run.simulation.run(), (k, seed)
            times.append((k, run.simulation.finished_after))
    tau = stats.kendalltau(*zip(*times, strict=True), alternative="less")
    assert tau.pvalue < 1e-4


def test_headings_spread_evenly_round_the_circle_never_agree() -> None:
    """Wrapped differences cancel: the equation has other fixed points than consensus, and they are stable."""
    run = made("robots.count=3", "stop.iterations=50", 'network.topology={use="full"}', scenario=FREE)
    computation = run.simulation.parts.computation
    computation._heading[:], computation._known[:] = (-2.1, 0.0, 2.1), True
    last = moments_of(run)[-1].knowledge.heading
    assert_allclose(np.diff(np.sort(last)), 2 * np.pi / 3, atol=1e-9)


def test_the_swarm_follows_two_informed_robots_that_turn() -> None:
    moments = moments_of(made("stop.iterations=500", scenario="operations/turn"))
    before, after = moments[149], moments[-1]
    turn = wrapped(after.knowledge.heading[:2] - before.knowledge.heading[:2])
    assert_allclose(turn, 1.5708, atol=1e-9)
    assert before.measured.values["order"] > 0.99
    assert after.measured.values["following"] > 0.9
    assert moments[151].measured.values["following"] < 0.5


RESPONSE = "operations/response"


def responses(
    k: int, frequency: float, seed: int, turns: int, robots: int = 100, period: float = 0.5
) -> tuple[float, float]:
    """H^2 of a run, and that of the linear equation solved for the run's own network."""
    iterations = round(turns / (frequency * period))
    run = made(
        f"network.topology.k={k}", f"mind.computation.frequency={frequency}", f"task.frequency={frequency}",
        f"seed={seed}", f"robots.count={robots}", f"period={period}",
        f"stop.iterations={iterations}", scenario=RESPONSE,
    )  # fmt: skip
    links = run.simulation.parts.topology.links(run.simulation.state)
    summary = run.simulation.parts.task.summaries()[0]
    run.simulation.run([summary])
    hears = np.zeros((robots, robots))
    hears[tuple(links.T)] = 1.0 / k
    return summary.summary()["response"], linear_response(hears, frequency, period)


def worse_by(table: np.ndarray, best: int) -> np.ndarray:
    """How many standard errors each column's mean is below that of the best one, pairing rows."""
    fall = np.delete(table[:, [best]] - table, best, axis=1)
    return fall.mean(axis=0) / (fall.std(axis=0, ddof=1) / np.sqrt(len(fall)))


def test_by_the_linear_equation_one_neighbour_is_best_for_a_fast_drive() -> None:
    table = linear_responses((1, 2, 3, 4, 6, 12), 0.1, 0.5)
    assert_allclose(table.mean(axis=0), [1.23, 0.83, 0.62, 0.48, 0.31, 0.16], rtol=0.12)
    assert (worse_by(table, 0) > 5.0).all()
    assert (np.diff(table.mean(axis=0)) < 0.0).all()


@pytest.mark.parametrize("robots", [50, 100])
def test_by_the_linear_equation_two_to_four_are_best_at_a_fiftieth_hertz_whatever_the_size(robots: int) -> None:
    ks = (1, 2, 3, 4, 6, 8)
    table = linear_responses(ks, 0.02, 0.5, robots)
    best = int(table.mean(axis=0).argmax())
    assert ks[best] in (2, 3, 4)
    assert (worse_by(table[:, [0, best, 4, 5]], 1) > 3.0).all()


def test_by_the_linear_equation_hearing_all_is_best_for_a_slow_drive() -> None:
    table = linear_responses((6, 12, 24, 48, 99), 0.002, 1.0, networks=100)
    assert (np.diff(table.mean(axis=0)) > 0.0).all()
    assert (worse_by(table[:, [0, 1, 4]], 2) > 5.0).all()


@pytest.mark.parametrize(("k", "frequency"), [(1, 0.1), (2, 0.1), (4, 0.1), (8, 0.05), (20, 0.02)])
def test_the_response_is_that_of_the_linear_equation(k: int, frequency: float) -> None:
    measured, expected = responses(k, frequency, 1, 20)
    assert measured == pytest.approx(expected, rel=0.02)


@pytest.mark.thorough
def test_the_response_to_a_slow_drive_rises_with_neighbours_and_to_a_fast_one_falls() -> None:
    """Page's test of trends in blocks: each seed places its robots alike for every k."""

    def table(frequency: float, ks: tuple[int, ...]) -> list[list[float]]:
        return [[responses(k, frequency, seed, 5, 50, 1.0)[0] for k in ks] for seed in range(1, 5)]

    assert stats.page_trend_test(table(0.002, (4, 8, 16, 32))).pvalue < 1e-3
    assert stats.page_trend_test(table(0.1, (32, 16, 8, 4))).pvalue < 1e-3


def test_consensus_with_ten_neighbours_takes_about_as_long_in_small_swarms_as_in_large() -> None:
    """Of the way from hearing five to hearing all, ten go most, whatever N."""
    for robots in (30, 100):
        keys = (f"robots.count={robots}", "mind.computation.spread=3.14", "task.order=0.99", "stop.iterations=3000")
        means = []
        for k in (5, 10, robots - 1):
            runs = [made(f"network.topology.k={k}", f"seed={seed}", *keys, scenario=FREE) for seed in range(1, 9)]
            assert all(run.simulation.run() for run in runs)
            means.append(np.mean([run.simulation.finished_after for run in runs]))
        five, ten, everybody = means
        assert (five - ten) / (five - everybody) > 0.6, (robots, means)


def test_the_network_of_nearest_neighbours_is_a_homogeneous_clustered_small_world() -> None:
    links = made("robots.count=200", "network.topology.k=7", scenario=FREE)
    links = links.simulation.parts.topology.links(links.simulation.state)
    graph = nx.Graph(links.tolist())
    likewise = [nx.gnm_random_graph(200, graph.number_of_edges(), seed=seed) for seed in range(5)]
    clustering = np.mean([nx.average_clustering(other) for other in likewise])
    paths = np.mean([nx.average_shortest_path_length(other) for other in likewise])
    assert nx.average_clustering(graph) > 5 * clustering  # clustered
    assert nx.average_shortest_path_length(graph) < 3 * paths  # small
    heard_by = np.bincount(links[:, 1], minlength=200)
    assert heard_by.max() <= 3 * 7  # homogeneous: no hubs
    assert heard_by.std() < 0.5 * 7


def test_robots_in_walls_align_and_never_pass_them() -> None:
    moments = moments_of(made("stop.iterations=150", scenario="operations/heading-consensus"))
    places = np.array([moment.state.pose[:, :2] for moment in moments])
    assert (places > 0.2 + 0.05).all()
    assert (places < 7.8 - 0.05).all()
    assert max(moment.measured.values["order"] for moment in moments) > 0.95


def test_measures_of_alignment_are_what_they_say() -> None:
    assert order(np.array([0.3, 0.3, 0.3])) == pytest.approx(1.0)
    assert order(np.array([0.0, np.pi])) == pytest.approx(0.0, abs=1e-15)
    assert following(np.array([0.1, -0.1]), np.array([0.0])) == pytest.approx(np.cos(0.1))
    line = np.stack([np.linspace(0.0, 1.0, 60), np.zeros(60)], axis=1)
    halves = np.where(line[:, 0] < 0.5, 0.2, -0.2)  # of pairs at r, r / (1 - r) are of two halves: half of them at 1/3
    assert correlation_length(line, halves) == pytest.approx(1 / 3, abs=0.05)
    assert correlation_length(line, np.zeros(60)) is None


def test_a_leader_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match=r"mind\.computation\.leaders: there is no robot 200; expected ids from 0 to"):
        made("mind.computation.leaders=[200]", scenario=FREE)


# --- averages ------------------------------------------------------------------------------------


def graph_of(run) -> np.ndarray:
    state = run.simulation.parts.bodies.state()
    links = run.simulation.parts.topology.links(state)
    adjacency = np.zeros((state.robots, state.robots))
    adjacency[tuple(links.T)] = 1.0
    return adjacency


@pytest.mark.parametrize("topology", ['{use="ring"}', '{use="chain"}', '{use="full"}', '{use="delaunay"}'])
def test_everybody_comes_to_the_true_mean(topology: str) -> None:
    run = made(f"network.topology={topology}", scenario=AVERAGE)
    moments = moments_of(run)
    assert run.simulation.finished
    last = moments[-1].knowledge
    assert np.abs(last.value - last.measured.mean()).max() <= 1e-6
    for moment in moments:  # where weights are symmetric the mean of all estimates stays
        assert moment.knowledge.value.mean() == pytest.approx(last.measured.mean(), abs=1e-12)


@pytest.mark.parametrize("topology", ['{use="ring"}', '{use="chain"}', '{use="star"}'])
def test_errors_shrink_at_the_rate_of_the_second_eigenvalue(topology: str) -> None:
    gain = 0.05
    keys = (
        f"network.topology={topology}",
        f'mind.computation={{use="average-consensus", weights="constant", gain={gain}}}',
    )
    run = made(*keys, "robots.count=8", "stop.iterations=5000", scenario=AVERAGE)
    adjacency = graph_of(run)
    update = np.eye(8) - gain * (np.diag(adjacency.sum(axis=1)) - adjacency)
    second = np.sort(np.abs(np.linalg.eigvalsh(update)))[-2]
    errors = np.array([moment.measured.values["error"] for moment in moments_of(run)])
    tail = np.log(errors[len(errors) // 2 :])
    rate = np.exp(np.polyfit(np.arange(len(tail)), tail, 1)[0])
    assert np.log(rate) == pytest.approx(np.log(second), rel=0.1)


def test_what_is_lost_or_dead_moves_the_mean_that_is_agreed_on() -> None:
    lossy = made('network.channel={use="bernoulli", loss=0.3}', "stop.iterations=600", scenario=AVERAGE)
    moments = moments_of(lossy)
    assert moments[-1].measured.values["spread"] < 1e-6 < moments[-1].measured.values["error"]
    values = made(f"mind.computation.values={list(range(16))}", scenario=AVERAGE)
    first = moments_of(values)[0].knowledge
    assert_array_equal(first.measured, np.arange(16.0))


def test_values_and_gains_that_cannot_be_are_refused() -> None:
    for key, words in (
        ("mind.computation.values=[1.0]", "values: 1 for 16 robots"),
        ("mind.computation.gain=0.2", "gain: expected one with weights = 'constant' alone"),
        ('mind.computation.weights="constant"', "gain: expected one"),
    ):
        with pytest.raises(InputError, match=words):
            made(key, scenario=AVERAGE)


def test_a_turn_is_told_by_how_far_how_fast_and_how_faithfully_it_travels() -> None:
    run = made("mind.computation.spread=3.14", "stop.iterations=500", scenario="operations/turn")
    (summary,) = run.simulation.parts.task.summaries()
    moments = []

    class Keep:
        def sample(self, moment) -> None:
            moments.append(moment)

    run.simulation.run([summary, Keep()])
    found = summary.summary()
    follows = np.array([moment.measured.values["following"] for moment in moments])
    assert np.isnan(follows[:150]).all()
    assert found["following_late"] == pytest.approx(follows[150 + 175 :].mean())
    assert found["followed_after"] == np.flatnonzero(follows >= np.cos(np.pi / 8))[0] - 149
    last = moments[-1].knowledge
    close = np.abs(wrapped(last.heading[2:] - last.heading[0])) < np.pi / 8
    assert found["reach"] == pytest.approx(close.mean())
