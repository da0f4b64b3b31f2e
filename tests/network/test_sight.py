"""Who has a wall between: the walk through the squares of the grid against shapely, over all walls."""

import itertools

import numpy as np
import pytest
import shapely
from conftest import building
from numpy.testing import assert_array_equal
from test_topology import swarm, topology

from swarmsim.core.building import Building, Survey


def seen(positions, walls, radius=np.inf):
    """Links between all pairs whose line meets no wall, by shapely's exact predicates."""
    links = []
    walls = shapely.linestrings(np.asarray(walls, float).reshape(-1, 2, 2))
    for i, j in itertools.permutations(range(len(positions)), 2):
        between = shapely.linestrings([positions[i], positions[j]])
        if np.hypot(*(positions[i] - positions[j])) <= radius and not shapely.intersects(between, walls).any():
            links.append([i, j])
    return np.array(links, np.int32).reshape(-1, 2)


@pytest.mark.parametrize("spread", ["anywhere", "on a lattice"])
def test_links_are_those_that_no_wall_crosses_or_touches(spread):
    rng = np.random.default_rng(1)
    blocked = 0
    for _ in range(250):
        positions = rng.uniform(-1.0, 7.0, (rng.integers(2, 7), 2))
        walls = rng.uniform(0.0, 6.0, (rng.integers(0, 9), 4))
        if spread == "on a lattice":
            positions, walls = np.round(positions), np.round(walls)
            walls = walls[(walls[:, :2] != walls[:, 2:]).any(axis=1)]
            positions = np.unique(positions, axis=0)
        links = topology("line-of-sight", len(positions), place=building(walls)).links(swarm(positions))
        wanted = seen(positions, walls)
        assert_array_equal(links, wanted)
        blocked += len(positions) * (len(positions) - 1) - len(wanted)
    assert blocked > 1000


def test_a_radius_limits_the_sight():
    rng = np.random.default_rng(2)
    walls = rng.uniform(0.0, 6.0, (5, 4))
    positions = rng.uniform(0.0, 6.0, (30, 2))
    links = topology("line-of-sight", 30, place=building(walls), radius=2.0).links(swarm(positions))
    assert_array_equal(links, seen(positions, walls, 2.0))


def test_without_walls_the_sight_is_the_radius():
    positions = np.random.default_rng(3).uniform(0.0, 6.0, (30, 2))
    state = swarm(positions)
    assert_array_equal(
        topology("line-of-sight", 30, radius=2.0).links(state), topology("radius", 30, radius=2.0).links(state)
    )
    assert_array_equal(topology("line-of-sight", 30).links(state), topology("full", 30).links(state))


def test_no_line_slips_through_the_corner_of_two_walls():
    rng = np.random.default_rng(4)
    for _ in range(500):
        corner = rng.uniform(2.0, 4.0, 2)
        walls = [[*corner, 0.0, 6.0], [*corner, 6.0, 0.0]]  # from the corner to opposite corners of the room
        aim = rng.uniform(0.1, 1.9, 2)
        positions = np.array([aim, corner + (corner - aim) * rng.uniform(0.5, 0.9)])  # straight through it
        assert len(topology("line-of-sight", 2, place=building(walls)).links(swarm(positions))) == 0


def test_sight_follows_a_wall_that_comes_and_goes():
    nothing = np.zeros((0, 0), bool)
    wall = np.array([[1.0, -1.0, 1.0, 1.0]])

    def survey(boxes):
        return Survey(wall if boxes else np.zeros((0, 4)), nothing, np.zeros((0, 2)), lambda: nothing)

    place = Building(survey(()), survey)
    net = topology("line-of-sight", 2, place=place)
    state = swarm([[0.0, 0.0], [2.0, 0.0]])
    assert net.links(state).tolist() == [[0, 1], [1, 0]]
    place.rebuild(((0.9, -1.0, 1.1, 1.0),))
    assert net.links(state).tolist() == []
    place.rebuild(())
    assert net.links(state).tolist() == [[0, 1], [1, 0]]
