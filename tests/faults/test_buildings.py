"""Doors, furniture, rubble and people, against the strict survey of a redrawn plan, geometry and the truth."""

import math
import re
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from conftest import ROOT, made, worded
from numpy.testing import assert_array_equal

from swarmsim.core.errors import InputError
from swarmsim.core.events import boxes_at
from swarmsim.core.scenario.file import load
from swarmsim.core.state import FREE, OCCUPIED
from swarmsim.engine.build import build
from swarmsim.faults.building import Door, Strikes
from swarmsim.operations.mapping.measures.changes import Change, ChangeMeasures
from swarmsim.recording.digests import Digests
from swarmsim.recording.reader import Recording

ROOM = str(ROOT / "scenarios" / "room.toml")
RADIUS = 0.055
DOORWAY = (3.15, 1.65, 3.3, 2.55)  # the one between the two rooms
SLACK = 0.0035  # m: how far contacts give way: a sub-step at full speed, and Chipmunk's own slop
GO_ON = 'stop.when_done="continue"'


def fault(use: str, **keys: object) -> str:
    spelled = ", ".join(f"{key}={list(value) if isinstance(value, tuple) else value}" for key, value in keys.items())
    return f'{{use="{use}", {spelled}}}'


def faults(*each: str) -> str:
    return f"faults=[{', '.join(each)}]"


class Watch:
    """Keeps what happens, and the building of each moment."""

    def __init__(self, run) -> None:
        self.building = run.simulation.parts.building
        self.run, self.moments, self.events = run, [], []
        self._people = self.building.walkers()  # who walk while robots drive, so that they are kept from before
        self.walls, self.truths, self.domains, self.people = [], [], [], []

    def seen(self):
        building = self.building
        return building.walls, building.occupied, building.explorable

    def sample(self, moment) -> None:
        self.moments.append(moment)
        self.events.extend(moment.events)
        for kept, value in zip((self.walls, self.truths, self.domains), self.seen(), strict=True):
            kept.append(value)
        self.people.append(self._people)
        self._people = self.building.walkers()

    @property
    def told(self):
        """The events in words."""
        return worded(self.events, self.run.scenario)


def watched(*overrides: str, iterations: int = 200, scenario: str = "room"):
    run = made(f"stop.iterations={iterations}", GO_ON, *overrides, scenario=scenario)
    watch = Watch(run)
    run.simulation.run([watch])
    return run, watch


def deepest(run, watch) -> float:
    """How far any body of any moment reaches into the walls and boxes of that moment, in m."""
    worst = -math.inf
    plan = run.arena.plan.walls
    for moment in watch.moments:
        boxes = [shapely.box(*box) for box in boxes_at(watch.events, moment.state.iteration)]
        solid = shapely.union_all([plan, *boxes])
        places = shapely.points(moment.state.pose[:, :2])
        worst = max(worst, float((RADIUS - shapely.distance(solid, places)).max()))
    return worst


@pytest.fixture(scope="module")
def closing():
    """The door closes when the map has been complete for a while."""
    return watched(faults(fault("door", at=130, box=DOORWAY)))


def test_truth_domain_and_walls_change_in_the_very_iteration(closing) -> None:
    run, watch = closing
    assert [(e.iteration, e.robot, e.kind) for e in watch.told if "door" in e.kind] == [(130, -1, "door closed")]
    row, column = run.arena.lattice.cells(np.array([3.225, 2.1]))
    closed = [bool(truth[row, column]) for truth in watch.truths]
    assert closed == [False] * 130 + [True] * 70
    smaller = [domain.sum() < run.explorable.sum() for domain in watch.domains]
    assert smaller == closed
    assert all(
        (moment.measured.values["coverage"] * domain.sum()) % 1 == pytest.approx(0.0, abs=1e-9)
        or (moment.measured.values["coverage"] * domain.sum()) % 1 == pytest.approx(1.0, abs=1e-9)
        for moment, domain in zip(watch.moments, watch.domains, strict=True)
    )
    assert [len(walls) for walls in watch.walls] == [len(run.arena.segments)] * 130 + [len(watch.walls[-1])] * 70


def test_a_room_cut_off_leaves_the_domain(closing) -> None:
    run, watch = closing
    column = run.arena.lattice.cells(np.array([3.3 + 0.2, 1.0]))[1]
    assert run.explorable[:, column:].any()
    assert not watch.domains[-1][:, column:].any()
    assert watch.domains[-1].any()


def test_no_beam_passes_a_closed_door(closing) -> None:
    run, watch = closing
    column = int(run.arena.lattice.cells(np.array([3.3 + 1e-6, 1.0]))[1])  # the first one beyond
    rows = run.arena.lattice.cells(np.array([[3.2, 1.65 + 1e-6], [3.2, 2.55 - 1e-6]]))[:, 0]
    for moment in watch.moments[130:]:
        for robot, tile in enumerate(moment.readings.tiles.values):
            if moment.state.pose[robot, 0] > 3.15:
                continue
            row0, column0 = moment.readings.tiles.origins[robot]
            beyond = tile[max(rows[0] - row0, 0) : max(rows[1] + 1 - row0, 0), max(column - column0, 0) :]
            assert not (beyond == FREE).any()


def test_no_body_is_ever_inside_a_wall(closing) -> None:
    assert deepest(*closing) < SLACK


def test_a_body_stops_at_a_closed_door() -> None:
    run = made(
        "robots.count=1", "network.topology.k=0", "stop.iterations=400", GO_ON, faults(fault("door", at=0, box=DOORWAY))
    )
    bodies = run.simulation.parts.bodies
    bodies.crash(np.array([0]))
    bodies.place(np.array([0]), np.array([[2.9, 2.1, 0.0]]))

    class Ahead:
        def command(self, pose):
            return np.full((1, 2), 0.15)

    for _ in range(6):
        state = bodies.drive(Ahead(), 1.0)
    assert 3.15 - RADIUS - 0.01 < state.pose[0, 0] < 3.15 - RADIUS + SLACK


def test_a_door_waits_for_the_robot_in_it() -> None:
    run = made(
        "robots.count=1", "network.topology.k=0", "stop.iterations=10", GO_ON, faults(fault("door", at=2, box=DOORWAY))
    )
    bodies, building, watch = run.simulation.parts.bodies, run.simulation.parts.building, Watch(run)
    bodies.crash(np.array([0]))
    bodies.place(np.array([0]), np.array([[3.225, 2.1, 0.0]]))
    bodies.crash(np.array([0]))
    for _ in range(5):
        run.simulation.tick([watch])
    assert building.boxes == ()
    assert [(e.iteration, e.kind) for e in watch.told] == [(2, "door waits")]
    bodies.remove(np.array([0]))  # whoever is gone is not waited for
    run.simulation.tick([watch])
    assert building.boxes == (DOORWAY,)
    assert watch.told[-1].kind == "door closed"


def test_a_door_opens_and_closes_on_its_schedule_and_everything_comes_back() -> None:
    run, watch = watched(faults(fault("door", at=10, every=40, duration=15, box=DOORWAY)), iterations=100)
    told = [(e.iteration, e.kind) for e in watch.told if e.robot < 0 and e.kind.startswith("door")]
    closed = [i for i, kind in told if kind == "door closed"]
    opened = [i for i, kind in told if kind == "door opened"]
    assert opened == [25, 65]
    assert all(10 <= i < 25 or 50 <= i < 65 or i >= 90 for i in closed)
    assert_array_equal(watch.domains[30], run.explorable)
    assert_array_equal(watch.truths[30], run.arena.occupied)
    assert_array_equal(watch.walls[30], run.arena.segments)
    assert deepest(run, watch) < SLACK


def test_a_door_can_be_closed_from_the_start_and_open_later() -> None:
    _, watch = watched(faults(fault("door", at=0, duration=20, box=DOORWAY)), iterations=25)
    assert [(e.iteration, e.kind) for e in watch.told[:2]] == [(0, "door closed"), (20, "door opened")]
    assert boxes_at(watch.events, 0) == boxes_at(watch.events, 19) == [DOORWAY]
    assert boxes_at(watch.events, 20) == []


def test_a_door_can_wait_until_so_much_is_mapped() -> None:
    _, watch = watched(faults(fault("door", progress=0.5, box=DOORWAY)), iterations=120)
    reached = next(m.state.iteration for m in watch.moments if m.measured.values["coverage"] >= 0.5)
    closed = [e.iteration for e in watch.told if e.kind in ("door closed", "door waits")]
    assert closed[0] == reached + 1


def test_a_run_that_goes_on_ends_at_its_limit_and_is_finished(closing) -> None:
    run, watch = closing
    assert run.simulation.finished
    assert len(watch.moments) == 200
    assert watch.told[-1].kind == "finished"
    stopped = made("stop.iterations=200")
    assert stopped.simulation.run()
    assert stopped.simulation.state.iteration < 120


def test_before_a_change_the_run_is_what_it_would_have_been(closing) -> None:
    _, plain = watched(iterations=130)
    for ours, theirs in zip(closing[1].moments, plain.moments, strict=False):
        assert_array_equal(ours.state.pose, theirs.state.pose)
        assert_array_equal(ours.readings.tiles.values, theirs.readings.tiles.values)


@pytest.mark.parametrize("box", [(2.1, 0.6, 2.7, 1.2), (0.9, 2.83, 1.4, 3.3), (3.9, 0.3, 4.5, 0.77)])
def test_a_box_that_cuts_nothing_off_changes_what_a_redrawn_plan_would(box) -> None:
    run = made()
    left, low, right, high = box
    rect = f'<rect x="{left}" y="{3.9 - high}" width="{right - left}" height="{high - low}"/>'
    svg = (ROOT / "worlds" / "room.svg").read_text()
    redrawn = svg.replace('<g id="pillars"', f'<g id="furniture">{rect}</g><g id="pillars"')
    strict = build(load(ROOT / "scenarios" / "room.toml"), ROOM, redrawn)
    building = run.simulation.parts.building
    building.rebuild((box,))
    assert_array_equal(building.occupied, strict.arena.occupied)
    assert_array_equal(building.explorable, strict.explorable)
    assert len(building.entrance) == len(strict.simulation.parts.building.entrance)


def test_without_boxes_the_building_is_as_planned() -> None:
    run = made()
    building = run.simulation.parts.building
    building.rebuild((DOORWAY,))
    assert not np.array_equal(building.explorable, run.explorable)
    building.rebuild(())
    assert_array_equal(building.explorable, run.explorable)
    assert_array_equal(building.walls, run.arena.segments)
    assert building.version == 2


def test_furniture_moves_as_a_whole_and_back() -> None:
    here, there = (2.1, 0.6, 2.5, 1.0), (3.9, 2.6, 4.3, 3.0)
    run, watch = watched(faults(fault("furniture", at=30, duration=40, box=here, to=there)), iterations=100)
    for moment in watch.moments:
        assert boxes_at(watch.events, moment.state.iteration) in ([], [here], [there])
    moves = [(e.iteration, e.kind) for e in watch.told if e.kind == "furniture placed"]
    assert len(moves) == 3
    assert moves[1][0] >= 30
    assert moves[2][0] >= 70
    assert deepest(run, watch) < SLACK


def test_boxes_of_several_faults_stand_side_by_side() -> None:
    chest = (4.2, 0.4, 4.6, 0.8)
    both = faults(fault("furniture", at=0, duration=30, box=chest), fault("door", at=10, box=DOORWAY))
    run, watch = watched(both, iterations=60)
    assert set(boxes_at(watch.events, 59)) == {DOORWAY} == set(run.simulation.parts.building.boxes)
    assert any(len(boxes_at(watch.events, i)) == 2 for i in range(60))


RUBBLE = fault("rubble", at=5, every=10, count=4, region=(0.3, 0.3, 2.9, 3.6), size=(0.1, 0.3))


def test_rubble_falls_in_its_region_on_nobody_and_the_events_tell_where() -> None:
    run, watch = watched(faults(RUBBLE), "robots.count=6", iterations=60)
    building = run.simulation.parts.building
    assert boxes_at(watch.events, 59) == list(building.boxes)
    assert len(building.boxes) > 15
    for left, low, right, high in building.boxes:
        assert 0.3 <= left < right <= 2.9
        assert 0.3 <= low < high <= 3.6
        assert 0.0999 <= right - left <= 0.3011
    assert deepest(run, watch) < SLACK


def test_rubble_depends_on_the_seed_alone_and_each_fall_has_its_own_draws() -> None:
    def fallen(*overrides: str) -> list[str]:
        _, watch = watched(*overrides, iterations=20)
        return [event.cause for event in watch.told if event.kind == "rubble fell"]

    assert fallen(faults(RUBBLE)) == fallen(faults(RUBBLE))
    assert fallen(faults(RUBBLE)) != fallen(faults(RUBBLE), "seed=2")


def test_rubble_can_be_cleared_away() -> None:
    _, watch = watched(faults(RUBBLE.replace("every=10", "duration=12")), iterations=30)
    assert len(boxes_at(watch.events, 16)) == 4
    assert boxes_at(watch.events, 17) == []


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (fault("door", box=DOORWAY), r"faults\[0\]\.at: expected either at or progress"),
        (fault("door", at=1, progress=0.5, box=DOORWAY), r"faults\[0\]\.at: expected either"),
        (fault("door", at=1), r"faults\[0\]\.box: required key is missing"),
        (fault("door", at=1, box=(3.0, 1.0, 3.0, 2.0)), r"faults\[0\]\.box: \[3, 1, 3, 2\] has no size"),
        (fault("door", at=1, box=(3.0, 1.0, 5.2, 2.0)), r"faults\[0\]\.box: .*reaches out of the page"),
        (fault("door", at=1, every=5, box=DOORWAY), r"faults\[0\]\.every: 5 iterations, but"),
        (fault("door", at=1, every=5, duration=5, box=DOORWAY), r"faults\[0\]\.every"),
        (fault("door", at=1, durtion=5, box=DOORWAY), r"faults\[0\]\.durtion: unknown key; did you mean 'duration'"),
        (fault("furniture", at=1, box=DOORWAY, to=(9.0, 1.0, 9.5, 2.0)), r"faults\[0\]\.to: .*reaches out"),
        (fault("rubble", at=1, region=(0.3, 0.3, 0.6, 3.6)), r"faults\[0\]\.size: 0.15 to 0.5 m in a region of 0.3"),
        (fault("rubble", at=1, region=(-0.3, 0.3, 3.6, 3.6)), r"faults\[0\]\.region: .*reaches out"),
        (fault("people", count=900), r"faults\[0\]\.count: the floor has room for \d+ people"),
        (fault("people", radius=0), r"faults\[0\]\.radius"),
    ],
)
def test_a_change_that_cannot_work_is_refused(given: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(faults(given))


def test_boxes_that_leave_no_place_to_stand_are_refused() -> None:
    building = made().simulation.parts.building
    with pytest.raises(InputError, match="leave no place"):
        building.rebuild(((0.0, 0.0, 5.1, 3.9),))
    assert building.version == 0


@pytest.mark.parametrize(("every", "duration"), [(None, None), (None, 4), (5, 2), (3, None), (2, 7)])
def test_the_strikes_that_last_are_those_a_loop_finds(every, duration) -> None:
    change = Door(at=3, every=every, duration=duration, box=DOORWAY)
    schedule = Strikes(change, again=True)
    for now in range(40):
        starts = [3] if every is None else range(3, 40, every)
        lasting = [k for k, s in enumerate(starts) if s <= now and (duration is None or now < s + duration)]
        assert list(schedule.strikes(now, 0.0)) == lasting


CROWD = faults(fault("people", count=2, radius=0.12, speed=0.4))


@pytest.fixture(scope="module")
def crowded():
    return watched(CROWD, "robots.count=6", iterations=250)


def test_people_walk_far_and_never_through_walls(crowded) -> None:
    run, watch = crowded
    places = np.array([people[:, :2] for people in watch.people])
    for person in range(2):
        points = shapely.points(places[:, person])
        assert shapely.distance(run.arena.plan.walls, points).min() >= 0.12 - 1e-9
    steps = np.hypot(*(places[1:] - places[:-1]).transpose(2, 0, 1))
    assert steps.max() <= 0.4 + 1e-9
    assert steps.sum(axis=0).min() > 10.0


def test_people_never_push_anybody(crowded) -> None:
    """Nobody is ever nearer than touching, give or take a robot's own sub-step, and no robot is in a wall."""
    run, watch = crowded
    for moment, people in zip(watch.moments, watch.people, strict=True):
        apart = moment.state.pose[:, None, :2] - people[:, :2]
        assert (np.hypot(*apart.transpose(2, 0, 1)) > RADIUS + 0.12 - SLACK).all()
    assert deepest(run, watch) < SLACK


def test_a_person_does_not_move_a_robot_that_stands_in_the_way() -> None:
    run = made(
        "robots.count=1",
        "network.topology.k=0",
        "stop.iterations=300",
        GO_ON,
        faults(fault("people", count=1, radius=0.25)),
    )
    bodies, building = run.simulation.parts.bodies, run.simulation.parts.building
    bodies.crash(np.array([0]))
    bodies.place(np.array([0]), np.array([[3.225, 2.1, 0.0]]))  # in the only doorway: 0.9 m wide

    class Still:
        def command(self, pose):
            return np.zeros((1, 2))

    met = math.inf
    for _ in range(300):
        state = bodies.drive(Still(), 1.0)
        assert np.hypot(*(state.pose[0, :2] - (3.225, 2.1))) < 1e-6
        met = min(met, float(np.hypot(*(building.crowds[0].discs[0, :2] - (3.225, 2.1)))))
    assert met < 1.0


def test_beams_end_at_people_but_the_truth_does_not_know_them(crowded) -> None:
    run, watch = crowded
    lattice, seen = run.arena.lattice, 0
    for moment, people in zip(watch.moments, watch.people, strict=True):
        for tile, origin in zip(moment.readings.tiles.values, moment.readings.tiles.origins, strict=True):
            cells = np.argwhere(tile == OCCUPIED) + origin
            cells = cells[~run.arena.occupied[cells[:, 0], cells[:, 1]]]  # no wall is there
            apart = lattice.centres(cells)[:, None] - people[:, :2]
            near = np.hypot(*apart.transpose(2, 0, 1)).min(axis=1, initial=np.inf)
            assert (near < 0.12 + lattice.cell * math.sqrt(0.5) + 1e-5).all()
            seen += len(cells)
    assert seen > 100
    assert all(np.array_equal(truth, run.arena.occupied) for truth in watch.truths)


@pytest.mark.parametrize("given", [CROWD, faults(fault("door", at=20, duration=30, box=DOORWAY)), faults(RUBBLE)])
def test_a_changing_world_is_the_same_again_and_its_recording_tells_it(given, tmp_path) -> None:
    totals = []
    for number in range(2):
        run, digests = made("stop.iterations=70", GO_ON, given), Digests()
        path = tmp_path / f"{number}.h5"
        with run.recorder(path) as recorder:
            run.simulation.run([recorder, digests])
        totals.append(digests.total())
    assert totals[0] == totals[1] == Recording(path).digest()
    assert boxes_at(Recording(path).events(), 69) == list(run.simulation.parts.building.boxes)
    assert Recording(path).summary()["status"] == "not finished"


def test_a_box_waits_for_people_too() -> None:
    run = made("stop.iterations=5", faults(fault("people", count=1), fault("door", at=2, box=DOORWAY)))
    run.simulation.parts.building.crowds[0].discs[0, :2] = (3.0, 2.1)
    run.simulation.parts.building.crowds[0]._people = None  # it does not walk in this test
    run.simulation.parts.building.crowds[0].walk = None
    builder = run.simulation.parts.schedule._entries[-1]
    assert not builder._is_clear(DOORWAY)
    run.simulation.parts.building.crowds[0].discs[0, :2] = (1.0, 1.0)
    assert builder._is_clear(DOORWAY)


def followed(*mind: str) -> dict[str, float | int | None]:
    run = made("stop.iterations=450", GO_ON, *mind, faults(fault("door", at=130, box=DOORWAY)))
    measures = ChangeMeasures(run.simulation.parts.building)
    run.simulation.run([measures])
    return measures.summary()


def test_the_union_follows_a_door_with_forgetting_or_patrol_and_does_not_without() -> None:
    for key in ("mind.computation.decay=0.02", 'mind.strategy.idle="patrol"'):
        found = followed(key)
        assert (found["changes"], found["changes_detected"], found["remapped_share"]) == (1, 1, 1.0)
        assert found["detection_half"] < 150
        assert found["stale_end"] == 0.0
    stale = followed()
    assert (stale["changes"], stale["changes_detected"], stale["remapped_share"]) == (1, 0, 0.0)
    assert stale["stale_end"] > 0.0


def test_the_scenario_of_the_page_on_buildings_runs(tmp_path) -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "buildings.md").read_text(), flags=re.DOTALL)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    path = tmp_path / "changing.toml"
    path.write_text(room.partition("[stop]")[0] + block)
    run = build(load(path), str(path))
    watch = Watch(run)
    while run.simulation.state.iteration < 150:
        run.simulation.tick([watch])
    assert "door closed" in [event.kind for event in watch.told]


class Maps:
    """Knowledge that is maps and nothing else."""

    def __init__(self, robots: int, shape: tuple[int, int]) -> None:
        self.observed = np.ones((robots, *shape), bool)
        self.log_odds = np.full((robots, *shape), -1.0, np.float32)


def test_delays_count_from_the_first_iteration_with_the_change() -> None:
    from swarmsim.core.building import Building, Survey
    from swarmsim.core.state import State

    free, wall = np.zeros((2, 4), bool), np.zeros((2, 4), bool)
    wall[0] = True  # four cells
    everything, nowhere = np.ones((2, 4), bool), np.zeros((0, 2))

    def survey(occupied: np.ndarray) -> Survey:
        return Survey(np.zeros((0, 4)), occupied, nowhere, lambda: everything)

    building = Building(survey(free), lambda boxes: survey(wall))
    maps = Maps(2, (2, 4))
    measures = ChangeMeasures(building)

    def after(iteration: int) -> None:
        empty = np.zeros((2, 3))
        state = State(iteration, empty, empty, empty[:, :2], np.ones(2, bool))
        measures.sample(SimpleNamespace(state=state, building=building, knowledge=maps))

    for iteration in range(3):
        after(iteration)
    assert measures.summary()["stale_end"] is None
    building.rebuild(())  # between iterations 2 and 3
    after(3)
    maps.log_odds[0, 0, 0] = 1.0
    after(4)
    maps.log_odds[1, 0, :2] = 1.0
    after(5)
    (change,) = measures.changes
    assert change.cells.tolist() == [0, 1, 2, 3]
    assert change == Change(3, change.cells, first=2, half=3, robots={1: 3}, right=0.5)
    found = measures.summary()
    assert found["robots_detected"] == 0.5
    assert found["stale_mean"] == pytest.approx((4 + 3 + 2) / 3 / 8)
    assert found["remapped_share"] == 0.5


def test_rows_of_events_are_read_whatever_else_there_is(closing) -> None:
    events = closing[1].events
    assert boxes_at(events, 129) == []
    assert boxes_at(events, 130) == [DOORWAY]
    assert all(earlier.iteration <= later.iteration for earlier, later in pairwise(events))
