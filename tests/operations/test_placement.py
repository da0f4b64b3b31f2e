"""Operations of placement, each against the property that defines it, on robots with bodies."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
import shapely
from conftest import made, moments_of
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import distance

from swarmsim.core.errors import InputError
from swarmsim.operations.placement.covering import centroid
from swarmsim.operations.placement.positions import Positions
from swarmsim.operations.placement.rendezvous import centres

GO_ON = 'stop.when_done="continue"'
SQUARE = shapely.LinearRing([(1.5, 1.5), (6.5, 1.5), (6.5, 6.5), (1.5, 6.5)])


def places_of(moments) -> np.ndarray:
    return np.array([moment.state.pose[:, :2] for moment in moments])


def test_only_the_newest_of_each_sender_is_known() -> None:
    keys = (
        'network.channel={use="latency", delay=2.0, law="geometric"}',
        "stop.iterations=12",
        "seed=3",
        "robots.count=6",
    )
    several = 0
    for moment in moments_of(made(*keys, scenario="operations/rendezvous")):
        knowledge, inbox = moment.knowledge, moment.inbox
        pairs = np.stack([knowledge.receivers, knowledge.senders], axis=1)
        assert len(np.unique(pairs, axis=0)) == len(pairs)
        several += len(inbox) - len(pairs)
        for (receiver, sender), place in zip(pairs, knowledge.place, strict=True):
            rows = np.flatnonzero((inbox.receivers == receiver) & (inbox.senders == sender))
            last = rows[inbox.sent[rows].argmax()]
            assert_array_equal(place, [inbox.content.x[last], inbox.content.y[last]])
        assert_array_equal(knowledge.of(2).senders, knowledge.senders[knowledge.receivers == 2])
    assert several > 0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_robots_that_meet_lose_nobody_and_all_come_together(seed: int) -> None:
    run = made(f"seed={seed}", 'robots.spawn="floor"', "robots.count=25", scenario="operations/rendezvous")
    moments = moments_of(run)
    assert run.simulation.finished
    first = nx.Graph(moments[0].links.tolist())
    assert nx.is_connected(first)
    assert len(first) == 25
    for moment in moments:
        graph = nx.Graph(moment.links.tolist())
        assert len(graph) == 25
        assert nx.is_connected(graph)
    diameters = [moment.measured.values["diameter"] for moment in moments]
    assert (np.diff(diameters) < 0.01).all()  # it never grows, but for the arcs on which robots turn


def test_centres_are_those_of_the_smallest_circles() -> None:
    place = np.array([(0.0, 0.0), (5.0, 5.0)])
    knowledge = Positions(np.zeros(3, np.int32), np.array([1, 2, 3]), np.array([(4.0, 0.0), (2.0, 1.0), (2.0, -1.5)]))
    assert_allclose(centres(place, knowledge), [(2.0, 0.0), (5.0, 5.0)], atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_robots_that_disperse_come_no_nearer_than_wanted_and_pass_no_wall(seed: int) -> None:
    run = made(f"seed={seed}", scenario="operations/dispersion")
    moments = moments_of(run)
    assert run.simulation.finished
    places = places_of(moments)
    assert distance.pdist(places[-1]).min() >= 1.0 > distance.pdist(places[0]).min()
    assert (places > 0.2 + 0.05).all()
    assert (places < 7.8 - 0.05).all()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_area_coverage_descends_to_a_centroidal_tessellation(seed: int) -> None:
    run = made(f"seed={seed}", "stop.iterations=200", GO_ON, scenario="operations/area-coverage")
    moments = moments_of(run)
    assert run.simulation.finished
    cost = np.array([moment.measured.values["cost"] for moment in moments])
    assert (np.diff(cost) < 0.005 * cost[0]).all()
    assert cost[-1] < 0.5 * cost[0]
    # Against the cells of another library: each robot is at the centroid of its own.
    place = moments[-1].state.pose[:, :2]
    floor = shapely.box(0.2, 0.2, 7.8, 7.8)
    cells = shapely.voronoi_polygons(shapely.multipoints(place), extend_to=floor)
    for robot in place:
        cell = next(c for c in cells.geoms if c.covers(shapely.Point(robot))).intersection(floor)
        assert np.hypot(cell.centroid.x - robot[0], cell.centroid.y - robot[1]) < 0.12


def test_a_centroid_is_that_of_the_exact_cell() -> None:
    rng = np.random.default_rng(4)
    x = (np.arange(200) + 0.5) / 200
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    place = rng.random((8, 2))
    cells = shapely.voronoi_polygons(shapely.multipoints(place), extend_to=shapely.box(0, 0, 1, 1))
    cell = next(c for c in cells.geoms if c.covers(shapely.Point(place[0]))).intersection(shapely.box(0, 0, 1, 1))
    assert_allclose(centroid(place[0], place[1:], points), [cell.centroid.x, cell.centroid.y], atol=2e-3)
    assert_array_equal(centroid(np.array([9.0, 9.0]), place, points), [9.0, 9.0])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_perimeter_is_guarded_evenly(seed: int) -> None:
    run = made(f"seed={seed}", scenario="operations/perimeter")
    moments = moments_of(run)
    assert run.simulation.finished
    points = shapely.points(moments[-1].state.pose[:, :2])
    assert shapely.distance(SQUARE, points).max() <= 0.1
    at = np.sort(shapely.line_locate_point(SQUARE, points))
    gaps = np.diff(np.append(at, at[0] + 20.0))
    assert gaps.max() <= 1.15 * 20.0 / 12


@pytest.mark.parametrize("topology", ['{use="ring"}', '{use="chain"}', '{use="full"}'])
def test_a_formation_is_taken_up_on_any_connected_network(topology: str) -> None:
    run = made(f"network.topology={topology}", "stop.iterations=1500", scenario="operations/formation")
    moments = moments_of(run)
    assert run.simulation.finished
    own = moments[-1].state.pose[:, :2] - np.array(run.scenario.task.table["places"])
    assert np.hypot(*(own - own.mean(axis=0)).T).max() < 0.12


def test_a_formation_marches_at_the_velocity_asked_for() -> None:
    moments = moments_of(made(scenario="operations/march"))
    middle = places_of(moments).mean(axis=1)
    assert_allclose((middle[-1] - middle[-40]) / 39.0, [0.03, 0.0], atol=0.003)
    assert moments[-1].measured.values["error"] < 0.15


def test_robots_stand_once_they_are_where_they_ought_to_be() -> None:
    for scenario in ("area-coverage", "formation", "dispersion"):
        moments = moments_of(made("stop.iterations=400", GO_ON, scenario=f"operations/{scenario}"))
        places = places_of(moments)
        assert np.hypot(*(places[-1] - places[-20]).T).max() < 0.06, scenario


def test_whoever_is_dead_is_not_counted() -> None:
    keys = ('faults=[{use="remove", at=3, robots=[0, 4]}]', "stop.iterations=8", GO_ON)
    for scenario in ("rendezvous", "dispersion", "area-coverage", "perimeter", "formation"):
        for moment in moments_of(made(*keys, scenario=f"operations/{scenario}")):
            assert all(np.isfinite(value) for value in moment.measured.values.values())
    gaps = moments_of(made(*keys, scenario="operations/dispersion"))[-1].measured.robots["gaps"]
    assert np.isinf(gaps[[0, 4]]).all()
    assert np.isfinite(np.delete(gaps, [0, 4])).all()


@pytest.mark.parametrize(
    "scenario",
    ["rendezvous", "dispersion", "area-coverage", "perimeter", "formation", "average-consensus", "lights", "pursuit"],
)
def test_a_swarm_without_a_live_robot_has_done_no_task(scenario: str) -> None:
    dead = 'faults=[{use="crash", at=0, fraction=1.0, min_alive=0}]'
    moments = moments_of(made(dead, "stop.iterations=3", scenario=f"operations/{scenario}"))
    assert not moments[0].state.alive.any()
    assert not any(moment.measured.finished for moment in moments)


def test_places_and_corners_that_cannot_be_are_refused() -> None:
    for keys, words, scenario in (
        (["mind.strategy.places=[[0.0, 0.0]]"], r"mind\.strategy\.places: 1 for 9 robots", "formation"),
        (["task.places=[[0.0, 0.0]]"], r"task\.places: 1 for 9 robots; expected one for each", "formation"),
        (["mind.strategy.corners=[[0,0],[1,1],[1,0],[0,1]]"], r"mind\.strategy\.corners: they make no", "perimeter"),
        (["task.corners=[[0,0],[1,1]]"], r"task\.corners: ", "perimeter"),
    ):
        with pytest.raises(InputError, match=words):
            made(*keys, scenario=f"operations/{scenario}")
