"""What every topology promises, and what each of those with fixed or nearest robots does."""

import re

import networkx as nx
import numpy as np
import pytest
from conftest import ROOT, building
from numpy.testing import assert_array_equal

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import State
from swarmsim.core.streams import Streams
from swarmsim.kernels import graph

TOPOLOGIES = sorted(registry.known("topology"))
GEOMETRIC = ["knn", "farthest-k", "radius", "line-of-sight", "delaunay", "gabriel", "relative-neighbourhood"]
FIXED = ["none", "chain", "ring", "star", "edges", "small-world"]
DEGREE = ["knn", "k-random", "farthest-k", "small-world"]  # those with a k that must be less than the robots


def needed(use, count):
    """The parameters without a default."""
    k = {"k": min(3, count - 1)}
    pairs = [[i, (i * 7 + 3) % count] for i in range(count) if i != (i * 7 + 3) % count]
    return {
        "knn": k, "farthest-k": k, "k-random": k, "small-world": {**k, "p": 0.3}, "random": {"p": 0.3},
        "radius": {"radius": 1.5}, "edges": {"links": pairs},
    }.get(use, {})  # fmt: skip


def topology(use, count, place=None, seed=1, **parameters):
    context = BuildContext.of(
        Robots(count=count, spawn="room"),
        Lattice(0.0, 0.0, 0.15, 30, 30),
        1.0,
        Streams(seed),
        building() if place is None else place,
    )
    table = {"use": use, **needed(use, count), **parameters}
    return Part("topology", table).build(context)


def swarm(positions, alive=None, iteration=0):
    count = len(positions)
    pose = np.column_stack([positions, np.zeros(count)])
    alive = np.ones(count, bool) if alive is None else np.array(alive, bool)
    return State(iteration, pose, np.zeros((count, 3)), np.zeros((count, 2)), alive)


def line(count):
    return np.column_stack([np.arange(count, dtype=float), np.zeros(count)])


def pairs(use, alive, **parameters):
    links = topology(use, len(alive), **parameters).links(swarm(line(len(alive)), alive))
    return [tuple(link) for link in links.tolist()]


def assert_sound(links, state):
    assert links.dtype == np.int32
    assert links.shape == (len(links), 2)
    as_pairs = [tuple(link) for link in links.tolist()]
    assert as_pairs == sorted(set(as_pairs))
    for receiver, sender in as_pairs:
        assert receiver != sender
        assert min(receiver, sender) >= 0
        assert max(receiver, sender) < state.robots
        assert state.alive[receiver]
        assert state.alive[sender]


# --- every topology ------------------------------------------------------------------------------


def test_nearest_on_a_page_without_edges_are_those_of_nine_copies_of_it() -> None:
    rng = np.random.default_rng(3)
    pose = np.column_stack([rng.uniform(0.0, 3.0, 70), rng.uniform(0.0, 2.0, 70), np.zeros(70)])
    alive = rng.random(70) > 0.1
    found = graph.nearest_around(pose, alive, 5, 3.0, 2.0)
    assert (np.diff(found[:, 0].astype(int) * 70 + found[:, 1]) > 0).all()
    shifts = np.array([(x, y) for x in (-3.0, 0.0, 3.0) for y in (-2.0, 0.0, 2.0)])
    for i in np.flatnonzero(alive):
        gaps = pose[None, :, :2] + shifts[:, None] - pose[i, :2]
        apart = np.hypot(gaps[..., 0], gaps[..., 1]).min(axis=0)
        apart[~alive] = np.inf
        apart[i] = np.inf
        assert set(found[found[:, 0] == i, 1].tolist()) == set(np.argsort(apart)[:5].tolist())


def test_our_own_topologies_are_all_registered():
    assert {*GEOMETRIC, *FIXED, "full", "random", "k-random"} <= set(TOPOLOGIES)


def test_the_page_on_topologies_lists_every_one():
    page = (ROOT / "docs" / "topologies.md").read_text()
    assert sorted(re.findall(r"^\| `([\w-]+)` \|", page, flags=re.MULTILINE)) == TOPOLOGIES


@pytest.mark.parametrize("use", TOPOLOGIES)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 1.0])
def test_links_are_sorted_unique_pairs_of_different_live_robots(use, share):
    rng = np.random.default_rng(9)
    for count in (4, 5, 9, 20, 20, 20):
        state = swarm(rng.uniform(0.0, 4.0, (count, 2)), rng.random(count) < share)
        assert_sound(topology(use, count).links(state), state)


@pytest.mark.parametrize("use", TOPOLOGIES)
@pytest.mark.parametrize("spread", ["in one place", "in line", "on a lattice"])
def test_links_are_sound_where_robots_stand_badly(use, spread):
    rng = np.random.default_rng(20)
    for count in (3, 4, 5, 9, 60):
        positions = np.floor(rng.uniform(0.0, 4.0, (count, 2)))
        if spread == "in one place":
            positions[:] = 0.3
        elif spread == "in line":
            positions = positions[:, :1] * [1.0, 2.0] + 0.1
        state = swarm(positions)
        assert_sound(topology(use, count).links(state), state)


@pytest.mark.parametrize("use", TOPOLOGIES)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_smallest_swarms_are_linked_and_so_are_their_remains(use, count):
    net = topology(use, count)
    for living in range(2**count):
        state = swarm(line(count), [bool(living >> robot & 1) for robot in range(count)])
        links = net.links(state)
        assert_sound(links, state)
        if state.alive.sum() < 2:
            assert len(links) == 0


@pytest.mark.parametrize("use", TOPOLOGIES)
def test_links_follow_from_seed_and_state_alone(use):
    rng = np.random.default_rng(10)
    states = [swarm(rng.uniform(0.0, 4.0, (15, 2)), rng.random(15) < 0.8, iteration) for iteration in range(10)]
    one, other = topology(use, 15), topology(use, 15)
    first = [one.links(state) for state in states]
    for links, state in zip(first[::-1], states[::-1], strict=True):
        assert_array_equal(links, other.links(state))
        assert_array_equal(links, one.links(state))


@pytest.mark.parametrize("use", TOPOLOGIES)
def test_links_leave_the_state_untouched(use):
    state = swarm(np.random.default_rng(12).uniform(0.0, 4.0, (9, 2)), np.arange(9) != 4)
    before = [values.copy() for values in (state.pose, state.velocity, state.wheels, state.alive)]
    topology(use, 9).links(state)
    for was, now in zip(before, (state.pose, state.velocity, state.wheels, state.alive), strict=True):
        assert_array_equal(was, now)


@pytest.mark.parametrize("use", TOPOLOGIES)
def test_writing_to_links_changes_none_of_later(use):
    net, state = topology(use, 9), swarm(np.random.default_rng(12).uniform(0.0, 4.0, (9, 2)))
    links = net.links(state)
    kept = links.copy()
    links[:] = -1
    assert_array_equal(net.links(state), kept)


@pytest.mark.parametrize("use", GEOMETRIC)
def test_permuted_ids_permute_the_links(use):
    rng = np.random.default_rng(6)
    place = building(rng.uniform(0.0, 4.0, (4, 4)))
    for _ in range(50):
        positions, alive = rng.uniform(0.0, 4.0, (14, 2)), rng.random(14) < 0.8
        new = rng.permutation(14)  # robot i is called new[i]
        moved, moved_alive = np.empty_like(positions), np.empty_like(alive)
        moved[new], moved_alive[new] = positions, alive
        links = topology(use, 14, place).links(swarm(positions, alive))
        renamed = topology(use, 14, place).links(swarm(moved, moved_alive))
        assert {tuple(link) for link in new[links].tolist()} == {tuple(link) for link in renamed.tolist()}


@pytest.mark.parametrize("use", ["radius", "line-of-sight", "delaunay", "gabriel", "relative-neighbourhood"])
def test_permuted_ids_permute_the_links_even_of_robots_on_a_lattice(use):
    rng = np.random.default_rng(21)
    for _ in range(50):
        positions = 0.15 * np.floor(rng.uniform(0.0, 5.0, (14, 2)))
        new = rng.permutation(14)
        moved = np.empty_like(positions)
        moved[new] = positions
        links, renamed = (topology(use, 14).links(swarm(where)) for where in (positions, moved))
        assert {tuple(link) for link in new[links].tolist()} == {tuple(link) for link in renamed.tolist()}


@pytest.mark.parametrize("use", ["radius", "line-of-sight", "full", "random", *FIXED])
def test_with_the_dead_go_their_links_and_no_others(use):
    rng = np.random.default_rng(22)
    net = topology(use, 12)
    for iteration in range(20):
        positions, alive = rng.uniform(0.0, 4.0, (12, 2)), rng.random(12) < 0.7
        all_links = net.links(swarm(positions, iteration=iteration))
        left = net.links(swarm(positions, alive, iteration))
        assert_array_equal(left, all_links[alive[all_links].all(axis=1)])


@pytest.mark.parametrize("use", FIXED)
def test_static_links_do_not_move_with_the_robots(use):
    rng = np.random.default_rng(13)
    net = topology(use, 8)
    first = net.links(swarm(rng.uniform(0.0, 4.0, (8, 2))))
    assert (len(first) == 0) == (use == "none")
    assert_array_equal(first, net.links(swarm(rng.uniform(0.0, 4.0, (8, 2)), iteration=5)))


@pytest.mark.parametrize("use", DEGREE)
@pytest.mark.parametrize("k", [5, 6])
def test_more_neighbours_than_others_are_refused(use, k):
    with pytest.raises(InputError, match=rf"^k: {k} neighbours asked of 5 robots; expected at most 4$"):
        topology(use, 5, k=k)


@pytest.mark.parametrize("use", ["knn", "k-random", "farthest-k"])
@pytest.mark.parametrize("k", [0, 1, 2, 9])
def test_every_live_robot_hears_k_others_or_all_there_are(use, k):
    rng = np.random.default_rng(7)
    for living in range(11):
        alive = np.zeros(10, bool)
        alive[rng.permutation(10)[:living]] = True
        links = topology(use, 10, k=k).links(swarm(rng.uniform(0.0, 4.0, (10, 2)), alive))
        heard = np.bincount(links[:, 0], minlength=10)
        assert_array_equal(heard, np.where(alive, min(k, max(living - 1, 0)), 0))


# --- knn, farthest-k, radius ---------------------------------------------------------------------


def test_knn_moves_with_the_robots():
    net = topology("knn", 3, k=1)
    assert net.links(swarm([[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]])).tolist() == [[0, 1], [1, 0], [2, 1]]
    assert net.links(swarm([[0.0, 0.0], [4.0, 0.0], [5.0, 0.0]])).tolist() == [[0, 1], [1, 2], [2, 1]]


def test_mutual_knn_keeps_the_links_that_both_ends_chose():
    state = swarm([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [3.5, 0.0], [9.0, 0.0]])
    assert topology("knn", 5, k=1, mutual=True).links(state).tolist() == [[0, 1], [1, 0], [2, 3], [3, 2]]
    assert topology("knn", 5, k=4, mutual=True).links(state).tolist() == topology("full", 5).links(state).tolist()


def test_mutual_knn_chooses_anew_when_robots_die():
    state = swarm([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]], [True, False, True])
    assert topology("knn", 3, k=1, mutual=True).links(state).tolist() == [[0, 2], [2, 0]]


def test_farthest_k_are_the_last_of_the_nearest():
    rng = np.random.default_rng(23)
    state = swarm(rng.uniform(0.0, 4.0, (20, 2)), rng.random(20) < 0.8)
    others = int(state.alive.sum()) - 1
    near, far = topology("knn", 20, k=others - 4).links(state), topology("farthest-k", 20, k=4).links(state)
    both = sorted(near.tolist() + far.tolist())
    assert both == topology("full", 20).links(state).tolist()


def test_radius_includes_its_rim():
    state = swarm([[0.0, 0.0], [3.0, 4.0], [-5.1, 0.0]])
    assert topology("radius", 3, radius=5.0).links(state).tolist() == [[0, 1], [1, 0]]


@pytest.mark.parametrize("use", ["radius", "line-of-sight"])
def test_a_radius_of_nothing_is_refused(use):
    with pytest.raises(InputError, match=r"^radius: .*> 0"):
        topology(use, 5, radius=0.0)


# --- none, chain, ring, star, full ---------------------------------------------------------------


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


@pytest.mark.parametrize(
    ("use", "other"),
    [
        ("chain", nx.path_graph(7)),
        ("ring", nx.cycle_graph(7)),
        ("star", nx.star_graph(6)),
        ("full", nx.complete_graph(7)),
        ("none", nx.empty_graph(7)),
    ],
)
def test_static_topologies_are_those_of_networkx(use, other):
    assert set(pairs(use, [True] * 7)) == set(other.to_directed().edges)


def test_the_hub_of_a_star_hears_all_and_is_heard_by_all():
    assert pairs("star", [True] * 4, hub=2) == [(0, 2), (1, 2), (2, 0), (2, 1), (2, 3), (3, 2)]


def test_a_star_dies_with_its_hub_alone():
    assert pairs("star", [True, False, True]) == [(0, 2), (2, 0)]
    assert pairs("star", [False, True, True]) == []


def test_a_hub_that_there_is_not_is_refused():
    with pytest.raises(InputError, match=r"^hub: there is no robot 4; expected an id from 0 to 3$"):
        topology("star", 4, hub=4)


def test_on_a_periodic_page_that_begins_anywhere_the_nearest_may_be_around_the_edge():
    place = building()
    place.bounds = (2.0, -1.0, 6.0, 2.0)  # 4 m wide, 3 m high
    links = topology("knn", 4, place, k=1, periodic=True).links(
        swarm(np.array([[2.1, 0.0], [5.8, 0.0], [3.0, 0.0], [3.0, 1.9]]))
    )
    assert links.tolist() == [[0, 1], [1, 0], [2, 0], [3, 2]]
    high = topology("knn", 3, place, k=1, periodic=True).links(swarm(np.array([[3.0, -0.9], [3.0, 1.9], [3.0, 0.5]])))
    assert high.tolist() == [[0, 1], [1, 0], [2, 0]]
