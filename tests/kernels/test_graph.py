"""Who is near whom: kernels against plain sorts and plain loops."""

import math

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from swarmsim.kernels import graph

SPREADS = ["anywhere", "on a lattice", "on one point", "along a corridor"]


def placed(rng, robots, spread):
    positions = rng.uniform(-5.0, 5.0, (robots, 2))
    if spread == "on a lattice":
        positions = np.floor(positions / 2.0)
    elif spread == "on one point":
        positions[:] = 1.5
    elif spread == "along a corridor":
        positions[:, 0] = np.round(positions[:, 0] / 20.0)
    return positions


def sorted_nearest(positions, alive, k, sign=1):
    links = []
    for i in np.flatnonzero(alive):
        others = sorted((sign * math.dist(positions[i], positions[j]), j) for j in np.flatnonzero(alive) if j != i)
        links += sorted((i, j) for _, j in others[:k])
    return np.array(links, np.int32).reshape(-1, 2)


def line(count):
    return np.column_stack([np.arange(count, dtype=float), np.zeros(count)])


@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize(("kernel", "sign"), [(graph.nearest, 1), (graph.farthest, -1)], ids=["nearest", "farthest"])
def test_nearest_and_farthest_equal_a_plain_sort_by_distance_and_id(kernel, sign, spread):
    rng = np.random.default_rng(len(spread))
    for _ in range(150):
        robots = rng.integers(1, 25)
        positions = placed(rng, robots, spread)
        alive = rng.random(robots) < rng.choice([0.2, 0.8, 1.0])
        k = int(rng.integers(0, 30))
        assert_array_equal(kernel(positions, alive, k), sorted_nearest(positions, alive, k, sign))


@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize(("kernel", "sign"), [(graph.nearest, 1), (graph.farthest, -1)], ids=["nearest", "farthest"])
def test_nearest_and_farthest_equal_a_plain_sort_in_large_swarms(kernel, sign, spread):
    rng = np.random.default_rng(17)
    for robots in (graph.FEW, graph.FEW + 1, graph.FEW + 2, 120):
        for k in (1, 3, 9):
            positions = placed(rng, robots, spread)
            alive = rng.random(robots) < rng.choice([0.8, 1.0])
            assert_array_equal(kernel(positions, alive, k), sorted_nearest(positions, alive, k, sign))


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
@pytest.mark.parametrize("kernel", [graph.nearest, graph.farthest], ids=["nearest", "farthest"])
def test_nearest_and_farthest_of_hardly_any_robots(kernel, robots, links):
    found = kernel(line(robots).reshape(-1, 2), np.ones(robots, bool), 3)
    assert found.shape == (len(links), 2)
    assert found.dtype == np.int32
    assert found.tolist() == links


def test_of_neighbours_equally_far_the_lower_ids_are_heard():
    around = np.array([[0.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]])
    assert graph.nearest(around, np.ones(5, bool), 2)[:2].tolist() == [[0, 1], [0, 2]]
    assert graph.nearest(around, np.array([True, False, True, True, True]), 2)[:2].tolist() == [[0, 2], [0, 3]]
    assert graph.farthest(around, np.ones(5, bool), 2)[:2].tolist() == [[0, 1], [0, 2]]


def test_the_position_is_all_that_counts_of_a_pose():
    positions = np.random.default_rng(4).uniform(0.0, 5.0, (12, 2))
    pose = np.column_stack([positions, np.linspace(-300.0, 300.0, 12)])
    assert_array_equal(graph.nearest(pose, np.ones(12, bool), 3), graph.nearest(positions, np.ones(12, bool), 3))


def test_hearing_the_nearest_is_not_mutual():
    positions = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    assert graph.nearest(positions, np.ones(3, bool), 1).tolist() == [[0, 1], [1, 0], [2, 1]]


def test_mutual_keeps_the_links_that_run_both_ways():
    rng = np.random.default_rng(5)
    for _ in range(300):
        robots = int(rng.integers(1, 9))
        links = np.argwhere((rng.random((robots, robots)) < rng.random()) & ~np.eye(robots, dtype=bool))
        links = links.astype(np.int32)
        there = {tuple(link) for link in links.tolist()}
        wanted = [[i, j] for i, j in links.tolist() if (j, i) in there]
        assert graph.mutual(links).tolist() == wanted


@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0, 2.5, 100.0, math.inf])
def test_within_finds_each_pair_at_most_so_far_apart_once(spread, radius):
    rng = np.random.default_rng(8)
    for _ in range(20):
        robots = int(rng.integers(0, 25))
        positions = placed(rng, robots, spread)
        alive = rng.random(robots) < 0.8
        found = [tuple(sorted(pair)) for pair in graph.within(positions, alive, radius).tolist()]
        wanted = {
            (i, j)
            for i in range(robots)
            for j in range(i + 1, robots)
            if alive[i] and alive[j] and math.dist(positions[i], positions[j]) <= radius
        }
        assert len(found) == len(set(found))
        assert set(found) == wanted


def test_within_is_the_geometric_graph_of_networkx():
    positions = np.random.default_rng(3).uniform(0.0, 1.0, (200, 2))
    other = nx.random_geometric_graph(200, 0.125, pos=dict(enumerate(positions.tolist())))
    found = {tuple(sorted(pair)) for pair in graph.within(positions, np.ones(200, bool), 0.125).tolist()}
    assert found == {tuple(sorted(pair)) for pair in other.edges}


def test_edges_become_sorted_links_both_ways():
    rng = np.random.default_rng(11)
    for robots in (0, 1, 2, 7, 30):
        edges = np.argwhere(np.triu(rng.random((robots, robots)) < 0.4, 1)).astype(np.int32)
        edges = rng.permuted(rng.permutation(edges), axis=1) if len(edges) else edges
        wanted = sorted([[i, j] for i, j in edges.tolist()] + [[j, i] for i, j in edges.tolist()])
        links = graph.both_ways(edges, robots)
        assert links.shape == (len(wanted), 2)
        assert links.dtype == np.int32
        assert links.tolist() == wanted
