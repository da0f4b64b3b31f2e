from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import made, worded_of

from swarmsim.core.building import Building, Survey
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Inbox
from swarmsim.core.parts import Parts
from swarmsim.core.state import Intents, Knowledge, Moment, Senses, State
from swarmsim.core.streams import Streams
from swarmsim.engine.build import BuiltRun
from swarmsim.engine.simulation import Steered
from swarmsim.faults.localisation import Belief, LocalisationFault, landing_places
from swarmsim.operations.mapping.measures.quality import MapMeasures
from swarmsim.recording.digests import Digests

STRUCK = "at=4, duration=3, robots=[1]"
WITH = range(4, 7)  # the iterations with the fault


class Watch:
    """What happened in a run, and what its robots believed."""

    def __init__(self, *faults: str, iterations: int = 9, scenario: str = "room", more: tuple[str, ...] = ()) -> None:
        listed = ", ".join(fault if "use=" in fault else f'{{use="localisation", {fault}}}' for fault in faults)
        self.run = made(f"stop.iterations={iterations}", f"faults=[{listed}]", *more, scenario=scenario)
        self.moments: list[Moment] = []
        self.believed: list[np.ndarray] = []
        self.digests = Digests()
        simulation = self.run.simulation
        self._strategy, self.requires_knowledge = (
            simulation.parts.strategy,
            simulation.parts.strategy.requires_knowledge,
        )
        simulation.parts = replace(simulation.parts, strategy=self)
        simulation.run([self, self.digests])

    def step(self, senses: Senses, inbox: Inbox, knowledge: Knowledge) -> Intents:
        self.believed.append(senses.pose.copy())
        return self._strategy.step(senses, inbox, knowledge)

    def sample(self, moment: Moment) -> None:
        self.moments.append(moment)

    @property
    def error(self) -> np.ndarray:
        """What the estimates (iterations, n, 3) are more than the poses."""
        return np.stack([b - m.state.pose for b, m in zip(self.believed, self.moments, strict=True)])


@pytest.fixture(scope="module")
def plain() -> Watch:
    return Watch()


@pytest.fixture(scope="module")
def biased() -> Watch:
    return Watch(f'failure="bias", dx=0.3, dy=-0.1, dyaw=0.2, {STRUCK}')


def context(run: BuiltRun) -> BuildContext:
    return BuildContext.of(run.scenario.robots, run.arena.lattice, 1.0, Streams(1), run.simulation.parts.building)


def test_a_biased_estimate_errs_by_so_much_from_the_onset_to_the_end(biased: Watch) -> None:
    expected = np.zeros((9, 3, 3))
    expected[4:7, 1] = [0.3, -0.1, 0.2]
    np.testing.assert_allclose(biased.error, expected, atol=1e-12)
    assert not biased.error[:4].any()
    assert not biased.error[:, [0, 2]].any()
    assert not biased.error[7:].any()


def test_a_tile_lies_as_many_cells_aside_as_its_robot_errs(biased: Watch) -> None:
    lattice, parts = biased.run.arena.lattice, biased.run.simulation.parts
    for t, moment in enumerate(biased.moments):
        sensed = parts.sensor.sense(moment.state).tiles
        np.testing.assert_array_equal(moment.readings.tiles.values, sensed.values)
        aside = lattice.cells(biased.believed[t][:, :2]) - lattice.cells(moment.state.pose[:, :2])
        np.testing.assert_array_equal(moment.readings.tiles.origins - sensed.origins, aside)
        assert moment.readings.tiles.origins.dtype == np.int32
        assert not aside[[0, 2]].any()
        assert aside[1].any() == (t in WITH)


def test_nothing_differs_before_the_onset_and_the_events_say_when(biased: Watch, plain: Watch) -> None:
    assert biased.digests.rows[:4] == plain.digests.rows[:4]
    assert biased.digests.rows[4] != plain.digests.rows[4]
    events = [(event.iteration, event.robot, event.kind) for event in worded_of(biased.moments, biased.run)]
    assert events[:2] == [(4, 1, "localisation bias"), (7, 1, "localisation bias over")]


def test_motion_is_asked_at_believed_poses_and_others_rows_are_bit_equal(plain: Watch) -> None:
    asked, run = [], made()

    class Still:
        def follow(self, intents: Intents) -> None:
            asked.append(intents)

        def command(self, pose: np.ndarray) -> np.ndarray:
            asked.append(pose)
            return np.zeros((len(pose), 2))

    parts = replace(run.simulation.parts, motion=Still())
    fault = LocalisationFault(failure="bias", dx=0.3, dyaw=0.5, at=0, robots=[1]).build(context(run))
    motion = Steered(parts.motion, fault.install(parts).localisation)
    pose = np.array([[-0.0, 1.0, -0.0], [2.0, 1.0, 0.0], [3.0, 1.0, -0.0]])
    given = pose.copy()
    motion.command(given)
    assert given.tobytes() == pose.tobytes()
    np.testing.assert_allclose(asked[0][1], [2.3, 1.0, 0.5])
    assert asked[0][[0, 2]].tobytes() == pose[[0, 2]].tobytes()
    intents = plain.moments[0].intents
    motion.follow(intents)
    assert asked[1] is intents


def test_a_lone_biased_robot_maps_its_world_aside_and_steers_by_that_map() -> None:
    alone = ("robots.count=1", "network.topology.k=0", "mind.strategy.ties='row-order'")
    right = Watch(iterations=60, more=alone)
    wrong = Watch('failure="bias", dx=0.30, at=0, min_alive=0', iterations=60, more=alone)
    np.testing.assert_array_equal(
        wrong.moments[0].readings.tiles.origins - right.moments[0].readings.tiles.origins, [[0, 2]]
    )
    # Two whole cells aside, it sees, decides and goes just as it would without the error.
    np.testing.assert_allclose(wrong.moments[-1].state.pose, right.moments[-1].state.pose, atol=1e-6)
    known = right.run.simulation.parts.computation.maps.observed[0]
    np.testing.assert_array_equal(wrong.run.simulation.parts.computation.maps.observed[0][:, 2:], known[:, :-2])
    assert known.any()


def test_a_drift_grows_by_so_much_in_every_iteration() -> None:
    drifting = Watch(f'failure="drift", dx=0.02, dy=-0.01, dyaw=0.1, {STRUCK}')
    for t, steps in enumerate([0, 0, 0, 0, 1, 2, 3, 0, 0]):
        np.testing.assert_allclose(drifting.error[t, 1], np.array([0.02, -0.01, 0.1]) * steps, atol=1e-12)
    assert not drifting.error[:, [0, 2]].any()


def test_a_random_walk_has_the_steps_asked_for() -> None:
    walk = Watch(
        'failure="drift", sigma=0.004, sigma_yaw=0.02, at=0, fraction=1.0, min_alive=0',
        iterations=250,
        scenario="basilica",
        more=("robots.count=8",),
    )
    steps = np.diff(walk.error, axis=0, prepend=0.0)
    count = steps.shape[0] * steps.shape[1]
    assert count >= 2000
    for axis, sigma in ((0, 0.004), (1, 0.004), (2, 0.02)):
        drawn = steps[..., axis].reshape(-1) / sigma
        assert abs(drawn.mean()) < 2.6 / np.sqrt(count)
        assert abs(drawn.var() - 1.0) < 2.6 * np.sqrt(2.0 / count)
    correlation = np.corrcoef(np.concatenate([steps[:-1].reshape(-1, 3).T, steps[1:].reshape(-1, 3).T]))
    assert np.abs(correlation - np.eye(6)).max() < 0.1


def test_the_drift_of_one_robot_depends_neither_on_others_nor_on_other_faults() -> None:
    alone = Watch(f'failure="drift", sigma=0.05, {STRUCK}').error[:, 1]
    together = Watch('failure="drift", sigma=0.05, at=4, duration=3, robots=[0, 1, 2], min_alive=0').error[:, 1]
    beside = Watch(f'failure="drift", sigma=0.05, {STRUCK}', 'failure="drift", sigma=0.05, at=1, robots=[2]')
    np.testing.assert_allclose(together, alone, atol=1e-12)
    np.testing.assert_allclose(beside.error[:, 1], alone, atol=1e-12)
    second = Watch('failure="bias", dx=0.1, at=4, robots=[2]', f'failure="drift", sigma=0.05, {STRUCK}').error[:, 1]
    assert np.abs(second - alone).max() > 1e-3  # each fault has numbers of its own


def test_errors_of_several_faults_add_up() -> None:
    both = Watch(f'failure="bias", dx=0.1, {STRUCK}', 'failure="bias", dx=0.2, dyaw=0.1, at=5, robots=[1]')
    np.testing.assert_allclose(both.error[4:8, 1, 0], [0.1, 0.3, 0.3, 0.2], atol=1e-12)
    lattice, moment = both.run.arena.lattice, both.moments[5]
    sensed = both.run.simulation.parts.sensor.sense(moment.state).tiles
    aside = lattice.cells(both.believed[5][:, :2]) - lattice.cells(moment.state.pose[:, :2])
    np.testing.assert_array_equal(moment.readings.tiles.origins - sensed.origins, aside)


def test_a_drift_that_begins_again_begins_at_nothing() -> None:
    error = Watch('failure="drift", dx=0.02, at=1, duty=[2, 1], robots=[1]').error[:, 1, 0]
    np.testing.assert_allclose(error, np.array([0, 1, 2, 0, 1, 2, 0, 1, 2]) * 0.02, atol=1e-12)


def test_places_to_land_have_room_and_a_way_from_the_entrance() -> None:
    lattice = Lattice(0.0, 0.0, 1.0, 3, 8)
    wall = np.array([[0.0, 2.4, 3.0, 2.4]])  # 0.1 m from the centres of the upper row
    free = np.ones(lattice.shape, bool)
    free[:, 5] = False  # nobody comes to what lies beyond
    free[0, 1] = False
    building = Building(Survey(wall, np.zeros_like(free), np.array([[0.5, 0.5]]), lambda: free), None)
    building.occupied[1, 4] = True

    def cells(radius: float) -> set[tuple[int, int]]:
        return {tuple(cell) for cell in lattice.cells(landing_places(building, lattice, radius)).tolist()}

    hall = {(row, column) for row in range(3) for column in range(5)} - {(0, 1), (1, 4)}
    assert cells(0.05) == cells(0.1) == hall
    assert cells(0.11) == hall - {(2, 0), (2, 1), (2, 2)}
    building.found = replace(building.found, entrance=np.empty((0, 2)))
    assert cells(0.05) == set()
    building.found = replace(building.found, walls=np.empty((0, 4)), entrance=np.array([[7.5, 0.5]]))
    assert cells(0.4) == {(row, column) for row in range(3) for column in (6, 7)}


@pytest.fixture(scope="module")
def kidnapped() -> Watch:
    return Watch('failure="kidnap", at=6, duration=8, count=4', iterations=20, scenario="basilica")


def test_a_kidnapped_robot_is_elsewhere_and_does_not_notice(kidnapped: Watch) -> None:
    plain = Watch(iterations=7, scenario="basilica")
    events = worded_of(kidnapped.moments, kidnapped.run)
    carried = sorted(event.robot for event in events if event.kind == "localisation kidnap")
    assert {event.iteration for event in events if event.robot in carried} == {6, 14}
    assert len(carried) == 4
    others = np.setdiff1d(np.arange(15), carried)
    there, before = kidnapped.moments[6].state, plain.moments[6].state
    np.testing.assert_array_equal(there.pose[others], before.pose[others])
    assert (np.hypot(*(there.pose - before.pose)[carried, :2].T) >= 2 * 0.055).all()
    assert not there.velocity[carried].any()
    np.testing.assert_allclose(kidnapped.believed[6][carried, :2], before.pose[carried, :2], atol=1e-12)
    np.testing.assert_array_equal(kidnapped.believed[6][:, 2], there.pose[:, 2])  # the compass
    error = kidnapped.error
    np.testing.assert_allclose(error[6:14, carried], np.tile(error[6, carried], (8, 1, 1)), atol=1e-12)
    assert not error[:6].any()
    assert not error[14:].any()
    assert not error[:, others].any()


def test_kidnapped_robots_land_clear_of_walls_and_bodies_where_they_could_have_gone(kidnapped: Watch) -> None:
    run = kidnapped.run
    arena, radius = run.arena, run.scenario.robots.radius
    reachable = arena.reachable(run.scenario.robots.spawn, radius)
    places = landing_places(run.simulation.parts.building, arena.lattice, radius)
    np.testing.assert_array_equal(places, arena.lattice.centres(np.argwhere(reachable)))
    watch = Watch(
        'failure="kidnap", at=2, every=2, duration=1, fraction=1.0, min_alive=0', iterations=25, scenario="basilica"
    )
    for moment in watch.moments[2::2]:
        pose = moment.state.pose
        cells = arena.lattice.cells(pose[:, :2])
        assert reachable[tuple(cells.T)].all()
        np.testing.assert_allclose(pose[:, :2], arena.lattice.centres(cells), atol=1e-12)
        apart = np.hypot(*(pose[:, None, :2] - pose[:, :2]).transpose(2, 0, 1))
        assert (apart[~np.eye(15, dtype=bool)] >= 2 * radius).all()
    yaws = np.concatenate([moment.state.pose[:, 2] for moment in watch.moments[2::2]])
    assert yaws.min() < -2.0
    assert yaws.max() > 2.0


def test_where_one_robot_is_put_does_not_depend_on_who_else_is() -> None:
    one = Watch('failure="kidnap", at=3, robots=[2]', iterations=5, scenario="basilica")
    more = Watch('failure="kidnap", at=3, robots=[1, 2, 9]', iterations=5, scenario="basilica")
    again = Watch('failure="kidnap", at=3, robots=[2]', iterations=5, scenario="basilica")
    np.testing.assert_array_equal(one.moments[3].state.pose[2], more.moments[3].state.pose[2])
    assert one.digests.rows == again.digests.rows
    other = Watch('failure="kidnap", at=3, robots=[2]', iterations=5, scenario="basilica", more=("seed=2",))
    assert (other.moments[3].state.pose[2] != one.moments[3].state.pose[2]).any()


def test_a_kidnapped_robot_dead_reckons_from_where_it_believes_to_be(kidnapped: Watch) -> None:
    for (one, other), (before, after) in zip(
        pairwise(kidnapped.moments[6:14]), pairwise(kidnapped.believed[6:14]), strict=True
    ):
        np.testing.assert_allclose(after - before, other.state.pose - one.state.pose, atol=1e-12)


def test_the_dead_are_not_kidnapped_back_to_life() -> None:
    watch = Watch('failure="kidnap", at=1, duty=[1, 2], robots=[1]', '{use="crash", at=3, robots=[1]}', iterations=10)
    assert [bool(moment.state.alive[1]) for moment in watch.moments] == [True] * 3 + [False] * 7
    np.testing.assert_array_equal(watch.moments[4].state.pose[1], watch.moments[9].state.pose[1])


def test_a_robot_stays_where_there_is_nowhere_to_put_it() -> None:
    run = made()
    parts = run.simulation.parts
    nothing = np.zeros_like(parts.building.explorable)
    parts.building.found = replace(parts.building.found, explore=lambda: nothing)
    before = parts.bodies.state()
    installed = LocalisationFault(failure="kidnap", at=0, robots=[1]).build(context(run)).install(parts)
    np.testing.assert_array_equal(installed.bodies.state().pose, before.pose)
    pose = installed.localisation.locate(before)
    np.testing.assert_array_equal(pose, before.pose)


def test_nobody_is_put_onto_people() -> None:
    run = made()
    parts = run.simulation.parts
    places = landing_places(parts.building, run.arena.lattice, 0.055)
    free = places[7]

    class Crowd:
        discs = np.array([[*place, 0.1] for place in places if (place != free).any()])

    if len(Crowd.discs):
        parts.building.crowds.append(Crowd())
    # 0.15 m between centres are less than the radii's sum, so the place itself is not free either.
    before = parts.bodies.state()
    installed = LocalisationFault(failure="kidnap", at=0, robots=[1]).build(context(run)).install(parts)
    np.testing.assert_array_equal(installed.bodies.state().pose, before.pose)
    Crowd.discs = Crowd.discs[np.hypot(*(Crowd.discs[:, :2] - free).T) > 0.155]
    installed = LocalisationFault(failure="kidnap", at=0, robots=[1]).build(context(run)).install(parts)
    np.testing.assert_allclose(installed.bodies.state().pose[1, :2], free)


@pytest.mark.parametrize(
    "fault",
    [
        'failure="bias", dx=1e6, dy=-1e6, at=0',
        'failure="bias", dx=-1e6, dy=1e6, dyaw=1e6, at=0',
        'failure="drift", dx=1e6, dy=1e6, sigma=1e6, sigma_yaw=1e6, at=0',
    ],
)
def test_however_wrong_an_estimate_lies_on_the_map(fault: str, tmp_path) -> None:
    watch = Watch(f"{fault}, fraction=1.0, min_alive=0", iterations=15)
    lattice, run = watch.run.arena.lattice, watch.run
    for t, moment in enumerate(watch.moments):
        cells = lattice.cells(watch.believed[t][:, :2])
        assert (cells >= 0).all()
        assert (cells < lattice.shape).all()
        assert (moment.readings.tiles.origins > -7).all()
        assert (moment.readings.tiles.origins < lattice.shape).all()
    # What watches a run must not fall over tiles that lie beside the map.
    probe = MapMeasures(run.scenario.robots.count, run.explorable, lattice)
    with run.recorder(tmp_path / "recording.h5") as recorder:
        for moment in watch.moments:
            probe.sample(moment)
            recorder.sample(moment)


def test_belief_off_the_map_is_at_its_edge_and_within_it_is_exact() -> None:
    lattice = made().arena.lattice
    error, active = np.zeros((3, 3)), np.array([True, True, False])
    belief = Belief(error, active, lattice)
    left, right, low, high = lattice.extent
    pose = np.array([[left + 1.0, low + 1.0, 0.1], [left + 1.0, low + 1.0, 0.2], [-1e9, 1e9, 7.0]])
    error[0] = [0.25, -0.5, 1.0]
    error[1] = [-99.0, 99.0, 0.0]
    believed = belief.of(pose)
    np.testing.assert_array_equal(believed[0], pose[0] + error[0])
    assert lattice.cells(believed[1, :2]).tolist() == [lattice.rows - 1, 0]
    np.testing.assert_array_equal(believed[2], pose[2])
    assert right > left
    assert high > low


def test_localisation_beneath_keeps_its_own_arrays() -> None:
    run = made()
    parts: Parts = run.simulation.parts
    state: State = parts.bodies.state()
    readings = parts.sensor.sense(state)
    tiles = readings.tiles
    pose, origins = state.pose.copy(), tiles.origins.copy()
    fault = LocalisationFault(failure="bias", dx=1.0, at=0, robots=[1]).build(context(run))
    believed = fault.install(parts).localisation.locate(state)
    moved = readings.put(state.pose, believed, parts.lattice)
    assert (believed[1] != pose[1]).any()
    assert (moved.tiles.origins[1] != origins[1]).any()
    np.testing.assert_array_equal(state.pose, pose)
    np.testing.assert_array_equal(tiles.origins, origins)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('failure="lost", at=1', r"faults\[0\]\.failure"),
        ('failure="bias", at=1', r"faults\[0\]\.dx: no error is given; .*dx or dy or dyaw"),
        ('failure="bias", dx=0.0, at=1', r"faults\[0\]\.dx: no error is given"),
        ('failure="drift", at=1', r"faults\[0\]\.dx: no error is given; .*sigma"),
        ('failure="bias", sigma=0.1, dx=1.0, at=1', r"faults\[0\]\.sigma: .*'bias' has none.*'drift'"),
        ('failure="kidnap", dx=1.0, at=1', r"faults\[0\]\.dx: .*'kidnap' has none.*'drift' or 'bias'"),
        ('failure="drift", sigma=-1.0, at=1', r"faults\[0\]\.sigma.*> 0"),
        ('failure="bias", dx=1e7, at=1', r"faults\[0\]\.dx.*1000000"),
        ('failure="kidnap"', r"faults\[0\]\.at: required key is missing"),
        ('failure="kidnap", at=1, radius=3.0', r"faults\[0\]\.radius: unknown key"),
    ],
)
def test_a_fault_that_cannot_work_is_refused(fault: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Watch(fault)
