"""Delaunay, Gabriel and relative neighbourhood graphs against their definitions, in exact arithmetic."""

import itertools
import math
from fractions import Fraction

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_topology import swarm, topology

NAMES = ["delaunay", "gabriel", "relative-neighbourhood"]


def linked(use, positions, alive=None):
    positions = np.asarray(positions, float).reshape(-1, 2)
    links = topology(use, max(len(positions), 1)).links(swarm(positions, alive))
    there = {tuple(link) for link in links.tolist()}
    assert there == {(j, i) for i, j in there}
    return {(i, j) for i, j in there if i < j}


def squared(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2


def has_empty_circle(a, b, others):
    """Whether the centre of a circle through a and b can be moved along their bisector such that all others are out."""
    middle = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
    normal = (a[1] - b[1], b[0] - a[0])
    low, high = -math.inf, math.inf
    for other in others:
        lever = 2 * (normal[0] * (other[0] - middle[0]) + normal[1] * (other[1] - middle[1]))
        power = squared(other, middle) - squared(a, middle)  # out of the circle centred at middle + t normal
        if lever > 0:  # exactly if t lever < power
            high = min(high, power / lever)
        elif lever < 0:
            low = max(low, power / lever)
        elif power <= 0:
            return False
    return low < high


def has_empty_disc(a, b, others):
    return all(squared(a, other) + squared(b, other) > squared(a, b) for other in others)


def has_empty_lune(a, b, others):
    return all(max(squared(a, other), squared(b, other)) >= squared(a, b) for other in others)


RULES = dict(zip(NAMES, [has_empty_circle, has_empty_disc, has_empty_lune], strict=True))


def by_definition(use, positions):
    points = [(Fraction(x), Fraction(y)) for x, y in np.asarray(positions, float).tolist()]
    places = sorted(set(points))
    near = {
        frozenset((a, b))
        for a, b in itertools.combinations(places, 2)
        if RULES[use](a, b, [other for other in places if other not in (a, b)])
    }
    return {
        (i, j)
        for i, j in itertools.combinations(range(len(points)), 2)
        if points[i] == points[j] or frozenset((points[i], points[j])) in near
    }


@pytest.mark.parametrize("use", NAMES)
@pytest.mark.parametrize("lattice", [None, 3, 5, 9])
def test_the_links_are_those_of_the_definition(use, lattice):
    rng = np.random.default_rng(14)
    for _ in range(130):
        positions = rng.uniform(0.0, 1.0, (rng.integers(1, 11), 2))
        if lattice is not None:
            positions = np.floor(positions * lattice)
        assert linked(use, positions) == by_definition(use, positions)


@pytest.mark.parametrize("use", NAMES)
def test_whole_lattices_are_linked_as_defined(use):
    for rows, columns in ((2, 2), (2, 5), (4, 4), (5, 6)):
        positions = [(x, y) for x in range(columns) for y in range(rows)]
        assert linked(use, positions) == by_definition(use, positions)
        grid = nx.grid_2d_graph(columns, rows)
        assert linked(use, positions) == {
            tuple(sorted((positions.index(a), positions.index(b)))) for a, b in grid.edges
        }


@pytest.mark.parametrize("use", NAMES)
def test_rounding_does_not_decide_on_robots_that_start_on_a_lattice(use):
    rng = np.random.default_rng(15)
    for _ in range(150):
        lattice = np.floor(rng.uniform(0.0, 5.0, (rng.integers(2, 14), 2)))
        turn = rng.uniform(0.0, 2.0 * np.pi)
        turned = lattice @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        expected = by_definition(use, lattice)
        assert linked(use, 0.15 * lattice + rng.uniform(0.0, 30.0, 2)) == expected
        apart = len(np.unique(lattice, axis=0)) == len(lattice)
        if apart:  # where two coincide, turning may part them by a rounding error
            assert linked(use, 0.15 * turned + rng.uniform(-500.0, 500.0, 2)) == expected


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4), st.booleans()), min_size=1, max_size=16))
def test_each_graph_contains_the_next(robots):
    positions = [(x, y) for x, y, _ in robots]
    alive = [living for _, _, living in robots]
    delaunay, gabriel, relative = (linked(use, positions, alive) for use in NAMES)
    assert relative <= gabriel <= delaunay


@pytest.mark.parametrize("spread", ["anywhere", "clustered", "on a circle", "almost in line"])
def test_each_graph_contains_the_next_and_connects_all_in_large_swarms(spread):
    rng = np.random.default_rng(16)
    for _ in range(20):
        positions = rng.uniform(0.0, 10.0, (200, 2))
        if spread == "clustered":
            positions = rng.integers(0, 4, (200, 2)) + 0.001 * positions
        elif spread == "on a circle":
            angle = rng.uniform(0.0, 2.0 * np.pi, 200)
            positions = np.column_stack([np.cos(angle), np.sin(angle)])
        elif spread == "almost in line":
            positions[:, 1] *= 10.0 ** -rng.uniform(3.0, 14.0)
        delaunay, gabriel, relative = (linked(use, positions) for use in NAMES)
        assert relative <= gabriel <= delaunay
        net = nx.Graph(list(relative))
        assert len(net) == 200
        assert nx.is_connected(net)


@pytest.mark.parametrize("use", NAMES)
def test_few_coincident_and_collinear_robots_are_linked_as_documented(use):
    assert linked(use, [[1.0, 1.0]]) == set()
    assert linked(use, [[1.0, 1.0], [4.0, 2.0]]) == {(0, 1)}
    assert linked(use, [[2.0, 2.0]] * 3) == {(0, 1), (0, 2), (1, 2)}
    assert linked(use, [[3.0, 3.0], [0.0, 0.0], [1.0, 1.0], [7.0, 7.0]]) == {(1, 2), (0, 2), (0, 3)}
    assert linked(use, [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]]) == {(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)}


def test_of_four_robots_on_one_circle_opposite_ones_do_not_hear_each_other():
    square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    for use in NAMES:
        assert linked(use, square) == {(0, 1), (1, 2), (2, 3), (0, 3)}


def test_three_robots_equally_far_apart_all_hear_each_other():
    triangle = [[0.0, 0.0], [1.0, 0.0], [0.5, math.sqrt(0.75)]]
    for use in NAMES:
        assert linked(use, triangle) == {(0, 1), (0, 2), (1, 2)}


@pytest.mark.parametrize("use", NAMES)
def test_around_a_dead_robot_the_graph_closes(use):
    rng = np.random.default_rng(18)
    for _ in range(50):
        positions = rng.uniform(0.0, 1.0, (9, 2))
        alive = np.arange(9) != rng.integers(9)
        live = np.flatnonzero(alive)
        others = {(int(live[i]), int(live[j])) for i, j in linked(use, positions[alive])}
        assert linked(use, positions, alive) == others
