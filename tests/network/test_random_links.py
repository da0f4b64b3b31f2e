"""Random topologies: probabilities by counting, and draws that nothing but the definition shifts."""

import itertools

import networkx as nx
import numpy as np
import pytest
from scipy import stats
from test_topology import line, pairs, swarm, topology

ITERATIONS = 2000


def linked(net, count, iterations, alive=None):
    """Which links there are (iterations, receivers, senders)."""
    there = np.zeros((iterations, count, count), bool)
    for iteration in range(iterations):
        links = net.links(swarm(line(count), alive, iteration))
        there[iteration, links[:, 0], links[:, 1]] = True
    return there


def fits(observed, expected):
    """Whether counts are as probable as in all but one of a thousand experiments of pure chance."""
    return stats.chisquare(observed, expected).pvalue > 1e-3


# --- random --------------------------------------------------------------------------------------


@pytest.mark.parametrize("p", [0.05, 0.3, 0.9])
def test_every_ordered_pair_is_linked_with_the_same_probability(p):
    there = linked(topology("random", 9, p=p), 9, ITERATIONS)
    counts = there.sum(axis=0)[~np.eye(9, dtype=bool)]
    excess = (counts - ITERATIONS * p) / np.sqrt(ITERATIONS * p * (1.0 - p))
    assert 1e-3 < stats.chi2.sf((excess**2).sum(), len(counts)) < 1.0 - 1e-3


def test_the_two_directions_two_iterations_and_two_seeds_are_drawn_apart():
    p = 0.4
    there = linked(topology("random", 10, p=p), 10, ITERATIONS)
    others = linked(topology("random", 10, p=p, seed=2), 10, ITERATIONS)
    between = ~np.eye(10, dtype=bool)
    for one, two in (
        (there[:, *np.triu_indices(10, 1)], there.transpose(0, 2, 1)[:, *np.triu_indices(10, 1)]),
        (there[0::2, between], there[1::2, between]),
        (there[:, between], others[:, between]),
        (there[:, 0, 2:], there[:, 1, 2:]),  # two receivers, the same sender
        (there[:, 2:, 0], there[:, 2:, 1]),
    ):
        both, draws = (one & two).sum(), one.size
        assert abs(both - draws * p * p) < 4.0 * np.sqrt(draws * p * p * (1.0 - p * p))


def test_a_probability_of_0_links_nobody_and_of_1_everybody():
    assert pairs("random", [True] * 6, p=0.0) == []
    assert pairs("random", [True] * 6, p=1.0) == pairs("full", [True] * 6)


def test_random_links_of_hardly_any_robots():
    for alive in ([False], [True], [False, True], [False] * 5):
        assert pairs("random", alive, p=1.0) == []


def test_one_more_robot_shifts_no_link_among_the_others():
    few, more = linked(topology("random", 8), 8, 50), linked(topology("random", 9), 9, 50)
    assert (few == more[:, :8, :8]).all()


# --- k-random ------------------------------------------------------------------------------------


def test_k_random_draws_every_set_of_senders_equally_often():
    there = linked(topology("k-random", 5, k=2), 5, ITERATIONS)
    for receiver in range(5):
        sets = list(itertools.combinations([robot for robot in range(5) if robot != receiver], 2))
        counts = [int(there[:, receiver, list(pair)].all(axis=1).sum()) for pair in sets]
        assert sum(counts) == ITERATIONS
        assert fits(counts, np.full(6, ITERATIONS / 6))


def test_k_random_is_drawn_anew_in_every_iteration_and_for_every_seed():
    there = linked(topology("k-random", 15, k=3), 15, 300)
    other = linked(topology("k-random", 15, k=3, seed=2), 15, 300)
    for one, two in ((there[:-1], there[1:]), (there, other), (there[:, :-1], there[:, 1:])):
        shared = (one & two).sum() / one.sum()
        assert abs(shared - 3 / 14) < 0.02


def test_a_death_among_k_random_robots_changes_the_links_of_its_hearers_alone():
    net = topology("k-random", 12, k=4)
    before = linked(net, 12, 100)
    after = linked(net, 12, 100, np.arange(12) != 7)
    for iteration, receiver in itertools.product(range(100), range(12)):
        was, is_ = before[iteration, receiver], after[iteration, receiver]
        if receiver == 7:
            assert not is_.any()
        elif was[7]:
            assert is_.sum() == 4
            assert (was & ~is_).nonzero()[0].tolist() == [7]
        else:
            assert (was == is_).all()


def test_one_more_robot_takes_one_place_in_k_random_links_or_none():
    few, more = linked(topology("k-random", 11, k=4), 11, 100), linked(topology("k-random", 12, k=4), 12, 100)
    lost = (few & ~more[:, :11, :11]).sum(axis=2)
    assert (lost == more[:, :11, 11]).all()
    assert (more[:, :11, :11] & ~few).sum() == 0


# --- small-world ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "k"), [(3, 2), (10, 2), (10, 4), (11, 6)])
def test_a_small_world_without_rewiring_is_the_ring_lattice_of_networkx(count, k):
    lattice = nx.watts_strogatz_graph(count, k, 0.0).to_directed()
    assert set(pairs("small-world", [True] * count, k=k, p=0.0)) == set(lattice.edges)


def test_with_an_odd_number_of_senders_the_next_higher_ids_come_first():
    assert pairs("small-world", [True] * 4, k=1, p=0.0) == [(0, 1), (1, 2), (2, 3), (3, 0)]
    assert [sender for receiver, sender in pairs("small-world", [True] * 9, k=3, p=0.0) if receiver == 4] == [3, 5, 6]


@pytest.mark.parametrize("p", [0.0, 0.1, 0.5, 1.0])
def test_everybody_in_a_small_world_hears_exactly_k(p):
    for k in (0, 1, 4, 7, 11):
        links = topology("small-world", 12, k=k, p=p).links(swarm(line(12)))
        assert np.bincount(links[:, 0], minlength=12).tolist() == [k] * 12


@pytest.mark.parametrize("p", [0.1, 0.5, 1.0])
def test_senders_of_a_small_world_are_redrawn_with_the_given_probability(p):
    count, k, seeds = 60, 4, 25
    lattice = set(pairs("small-world", [True] * count, k=k, p=0.0))
    redrawn = 0
    for seed in range(seeds):
        links = topology("small-world", count, seed=seed, k=k, p=p).links(swarm(line(count)))
        redrawn += len({tuple(link) for link in links.tolist()} - lattice)
    draws = count * k * seeds
    back = p * (k - 1) / 2 / (count - k)  # a redrawn sender is, rarely, one that a redraw before had given up
    wanted = p * (1.0 - back)
    assert abs(redrawn / draws - wanted) < 4.0 * np.sqrt(wanted * (1.0 - wanted) / draws)


def test_redrawn_senders_of_a_small_world_are_anybody():
    count, seeds = 12, 400
    offsets = np.zeros(count, int)
    for seed in range(seeds):
        links = topology("small-world", count, seed=seed, k=1, p=1.0).links(swarm(line(count)))
        offsets += np.bincount((links[:, 1] - links[:, 0]) % count, minlength=count)
    assert offsets[0] == offsets[1] == 0  # neither itself nor the sender it had
    assert fits(offsets[2:], np.full(count - 2, count * seeds / (count - 2)))


def test_a_small_world_is_drawn_from_the_seed():
    nets = [pairs("small-world", [True] * 20, k=2, p=0.5, seed=seed) for seed in (1, 1, 2)]
    assert nets[0] == nets[1] != nets[2]
