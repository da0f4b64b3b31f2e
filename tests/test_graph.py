"""Who hears whom: the nearest by a plain sort, and what every topology promises."""

import math

import numpy as np
import pytest
from conftest import building
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from swarmsim.core import registry
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Setting
from swarmsim.core.scenario import Robots
from swarmsim.core.state import State
from swarmsim.core.streams import Streams
from swarmsim.kernels import graph

NEEDED = {"knn": {"k": 3}}  # parameters without a default
TOPOLOGIES = sorted(registry.known("topology"))


def sorted_nearest(positions, alive, k):
    links = []
    for i in np.flatnonzero(alive):
        others = sorted((math.dist(positions[i], positions[j]), j) for j in np.flatnonzero(alive) if j != i)
        links += sorted((i, j) for _, j in others[:k])
    return np.array(links, np.int32).reshape(-1, 2)


def topology(use, count, **parameters):
    setting = Setting(Robots(count=count, spawn="room"), Lattice(0.0, 0.0, 0.15, 30, 30), 1.0, Streams(1))
    table = {"use": use, **NEEDED.get(use, {}), **parameters}
    return registry.part("topology", table).build(setting, building())


def swarm(positions, alive=None, iteration=0):
    count = len(positions)
    pose = np.column_stack([positions, np.zeros(count)])
    alive = np.ones(count, bool) if alive is None else np.array(alive, bool)
    return State(iteration, pose, np.zeros((count, 3)), np.zeros((count, 2)), alive)


def line(count):
    return np.column_stack([np.arange(count, dtype=float), np.zeros(count)])


def pairs(use, alive, **parameters):
    links = topology(use, len(alive), **parameters).links(swarm(line(len(alive)), alive))
    return [tuple(int(robot) for robot in link) for link in links]


@pytest.mark.parametrize("spread", ["anywhere", "on a lattice", "on one point"])
def test_nearest_equals_a_plain_sort_by_distance_and_id(spread):
    rng = np.random.default_rng(len(spread))
    ties = 0
    for _ in range(200):
        robots = rng.integers(1, 25)
        positions = rng.uniform(-5.0, 5.0, (robots, 2))
        if spread == "on a lattice":
            positions = np.floor(positions / 2.0)
        elif spread == "on one point":
            positions[:] = 1.5
        alive = rng.random(robots) < rng.choice([0.2, 0.8, 1.0])
        k = int(rng.integers(0, 30))
        links = graph.nearest(positions, alive, k)
        assert_array_equal(links, sorted_nearest(positions, alive, k))
        ties += len(np.unique(positions, axis=0)) < robots
    assert (ties > 100) == (spread != "anywhere")


@settings(derandomize=True, deadline=None, max_examples=300)
@given(
    st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3), st.booleans()), min_size=1, max_size=12),
    st.integers(0, 14),
)
def test_nearest_equals_a_plain_sort_whatever_the_swarm(robots, k):
    positions = np.array([[x, y] for x, y, _ in robots], float)
    alive = np.array([living for _, _, living in robots])
    assert_array_equal(graph.nearest(positions, alive, k), sorted_nearest(positions, alive, k))


@pytest.mark.parametrize(("robots", "links"), [(0, []), (1, []), (2, [[0, 1], [1, 0]])])
def test_nearest_of_hardly_any_robots(robots, links):
    found = graph.nearest(line(robots).reshape(-1, 2), np.ones(robots, bool), 3)
    assert found.shape == (len(links), 2)
    assert found.dtype == np.int32
    assert found.tolist() == links


def test_of_neighbours_equally_far_the_lower_ids_are_heard():
    around = np.array([[0.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]])
    assert graph.nearest(around, np.ones(5, bool), 2)[:2].tolist() == [[0, 1], [0, 2]]
    assert graph.nearest(around, np.array([True, False, True, True, True]), 2)[:2].tolist() == [[0, 2], [0, 3]]


def test_the_position_is_all_that_counts_of_a_pose():
    positions = np.random.default_rng(4).uniform(0.0, 5.0, (12, 2))
    pose = np.column_stack([positions, np.linspace(-300.0, 300.0, 12)])
    assert_array_equal(graph.nearest(pose, np.ones(12, bool), 3), graph.nearest(positions, np.ones(12, bool), 3))


def test_hearing_the_nearest_is_not_mutual():
    positions = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    assert graph.nearest(positions, np.ones(3, bool), 1).tolist() == [[0, 1], [1, 0], [2, 1]]


# --- every topology ------------------------------------------------------------------------------


def test_our_own_topologies_are_all_registered():
    assert {"knn", "none", "chain", "ring"} <= set(TOPOLOGIES)


@pytest.mark.parametrize("use", TOPOLOGIES)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 1.0])
def test_links_are_sorted_unique_pairs_of_different_live_robots(use, share):
    rng = np.random.default_rng(9)
    for count in (4, 5, 9, 20, 20, 20):
        state = swarm(rng.uniform(0.0, 4.0, (count, 2)), rng.random(count) < share)
        links = topology(use, count).links(state)
        assert links.dtype == np.int32
        assert links.shape == (len(links), 2)
        as_pairs = [tuple(link) for link in links.tolist()]
        assert as_pairs == sorted(set(as_pairs))
        for receiver, sender in as_pairs:
            assert receiver != sender
            assert 0 <= receiver < count
            assert 0 <= sender < count
            assert state.alive[receiver]
            assert state.alive[sender]


@pytest.mark.parametrize("use", TOPOLOGIES)
def test_two_topologies_from_the_same_seed_give_the_same_links(use):
    rng = np.random.default_rng(10)
    states = [swarm(rng.uniform(0.0, 4.0, (15, 2)), rng.random(15) < 0.8, iteration) for iteration in range(10)]
    one, other = topology(use, 15), topology(use, 15)
    for state in states:
        assert_array_equal(one.links(state), other.links(state))


@pytest.mark.parametrize("use", TOPOLOGIES)
def test_links_leave_the_state_untouched(use):
    state = swarm(np.random.default_rng(12).uniform(0.0, 4.0, (9, 2)))
    before = [values.copy() for values in (state.pose, state.velocity, state.wheels, state.alive)]
    topology(use, 9).links(state)
    for was, now in zip(before, (state.pose, state.velocity, state.wheels, state.alive), strict=True):
        assert_array_equal(was, now)


@pytest.mark.parametrize("use", sorted(set(TOPOLOGIES) - {"knn"}))
@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_smallest_swarms_are_linked_without_links_to_oneself(use, count):
    for receiver, sender in topology(use, count).links(swarm(line(count))):
        assert receiver != sender


# --- knn -----------------------------------------------------------------------------------------


def test_knn_permuted_ids_permute_the_links():
    rng = np.random.default_rng(6)
    for _ in range(50):
        positions, alive = rng.uniform(0.0, 4.0, (14, 2)), rng.random(14) < 0.8
        new = rng.permutation(14)  # robot i is called new[i]
        moved, moved_alive = np.empty_like(positions), np.empty_like(alive)
        moved[new], moved_alive[new] = positions, alive
        links = topology("knn", 14).links(swarm(positions, alive))
        renamed = topology("knn", 14).links(swarm(moved, moved_alive))
        assert {tuple(link) for link in new[links]} == {tuple(link) for link in renamed}


@pytest.mark.parametrize("k", [0, 1, 2, 9])
def test_knn_gives_every_live_robot_k_senders_or_all_there_are(k):
    rng = np.random.default_rng(7)
    for living in range(11):
        alive = np.zeros(10, bool)
        alive[rng.permutation(10)[:living]] = True
        links = topology("knn", 10, k=k).links(swarm(rng.uniform(0.0, 4.0, (10, 2)), alive))
        heard = np.bincount(links[:, 0], minlength=10)
        assert_array_equal(heard, np.where(alive, min(k, max(living - 1, 0)), 0))


def test_knn_moves_with_the_robots():
    net = topology("knn", 3, k=1)
    assert net.links(swarm([[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]])).tolist() == [[0, 1], [1, 0], [2, 1]]
    assert net.links(swarm([[0.0, 0.0], [4.0, 0.0], [5.0, 0.0]])).tolist() == [[0, 1], [1, 2], [2, 1]]


@pytest.mark.parametrize("k", [5, 6])
def test_knn_refuses_more_neighbours_than_others(k):
    with pytest.raises(InputError, match=rf"^k: {k} neighbours asked of 5 robots; expected at most 4$"):
        topology("knn", 5, k=k)


# --- none, chain, ring ---------------------------------------------------------------------------


def test_none_has_no_links():
    assert pairs("none", [True] * 6) == []


def test_chain_links_neighbouring_ids_and_leaves_the_ends_with_one():
    assert pairs("chain", [True] * 4) == [(0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 2)]


def test_a_dead_robot_cuts_the_chain_in_two():
    assert pairs("chain", [True, True, False, True, True]) == [(0, 1), (1, 0), (3, 4), (4, 3)]


def test_ring_is_the_chain_with_its_ends_linked():
    assert pairs("ring", [True] * 4) == [(0, 1), (0, 3), (1, 0), (1, 2), (2, 1), (2, 3), (3, 0), (3, 2)]


def test_a_dead_robot_opens_the_ring():
    assert pairs("ring", [True, True, False, True]) == [(0, 1), (0, 3), (1, 0), (3, 0)]
    assert pairs("ring", [False, True, True, True]) == [(1, 2), (2, 1), (2, 3), (3, 2)]


def test_a_ring_of_two_hears_each_other_once():
    assert pairs("ring", [True, True]) == pairs("chain", [True, True]) == [(0, 1), (1, 0)]


@pytest.mark.parametrize("use", ["chain", "ring"])
def test_static_links_do_not_move_with_the_robots(use):
    rng = np.random.default_rng(13)
    net = topology(use, 8)
    first = net.links(swarm(rng.uniform(0.0, 4.0, (8, 2))))
    assert len(first) > 0
    assert_array_equal(first, net.links(swarm(rng.uniform(0.0, 4.0, (8, 2)))))
