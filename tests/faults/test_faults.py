from __future__ import annotations

from itertools import pairwise

import msgspec
import numpy as np
import pytest
from conftest import made, moments_of, worded, worded_of

from swarmsim.core.errors import InputError
from swarmsim.core.state import Moment
from swarmsim.recording.reader import Recording

SHRINKING = 'faults=[{use="remove", at=20, every=10, count=3, min_alive=4}]'


def watch(*overrides: str, iterations: int = 60) -> tuple[list[Moment], object]:
    run = made(f"stop.iterations={iterations}", *overrides, scenario="basilica")
    return moments_of(run), run


@pytest.fixture(scope="module")
def shrunk() -> tuple[list[Moment], object]:
    return watch(SHRINKING)


def test_robots_are_removed_when_asked_down_to_those_kept(shrunk) -> None:
    moments, _ = shrunk
    alive = [int(moment.state.alive.sum()) for moment in moments]
    assert alive == [15] * 20 + [12] * 10 + [9] * 10 + [6] * 10 + [4] * 10


def test_every_removal_is_an_event_with_its_robot_and_cause(shrunk) -> None:
    moments, run = shrunk
    events = [event for event in worded_of(moments, run) if event.kind == "removed"]
    assert [event.iteration for event in events] == [20] * 3 + [30] * 3 + [40] * 3 + [50] * 2
    assert all("remove at=20 every=10" in event.cause for event in events)
    gone = {event.robot for event in events}
    assert gone == set(np.flatnonzero(~moments[-1].state.alive))
    assert len(gone) == len(events) == 11


def test_the_removed_neither_sense_nor_hear_nor_speak_nor_move(shrunk) -> None:
    moments, _ = shrunk
    for moment, following in pairwise(moments[50:]):
        dead = np.flatnonzero(~moment.state.alive)
        assert not np.isin(moment.links, dead).any()
        assert not moment.readings.tiles.values[dead].any()
        assert (moment.intents.counts[dead] == 0).all()
        np.testing.assert_array_equal(following.state.pose[dead], moment.state.pose[dead])


def test_nobody_meets_the_body_of_a_removed_robot() -> None:
    run = made("robots.count=2", 'faults=[{use="remove", at=1, count=1}]', "stop.iterations=5", scenario="room")
    space = run.simulation.parts.bodies.space
    before = len(space.shapes)
    run.simulation.run()
    assert len(space.shapes) == before - 1


def test_what_happened_before_the_first_removal_is_untouched(shrunk) -> None:
    plain, _ = watch(iterations=20)
    for ours, theirs in zip(shrunk[0][:20], plain, strict=True):
        np.testing.assert_array_equal(ours.state.pose, theirs.state.pose)
        np.testing.assert_array_equal(ours.readings.tiles.values, theirs.readings.tiles.values)
        np.testing.assert_array_equal(ours.intents.goals, theirs.intents.goals)


def test_a_lost_map_leaves_the_union_and_a_kept_one_stays() -> None:
    kept, _ = watch('faults=[{use="remove", at=20, count=10, min_alive=1, map="kept"}]', iterations=21)
    lost, _ = watch('faults=[{use="remove", at=20, count=10, min_alive=1, map="lost"}]', iterations=21)
    assert kept[20].measured.values["coverage"] >= kept[19].measured.values["coverage"]
    assert lost[20].measured.values["coverage"] < lost[19].measured.values["coverage"]
    dead = np.flatnonzero(~lost[20].state.alive)
    assert (lost[20].measured.robots["covered"][dead] == 0).all()
    assert (kept[20].measured.robots["covered"][dead] > 0).all()


def test_the_choice_depends_on_the_seed_alone() -> None:
    def gone(seed: int) -> list[int]:
        moments, _ = watch(f"seed={seed}", 'faults=[{use="remove", at=2, count=5}]', iterations=4)
        return np.flatnonzero(~moments[-1].state.alive).tolist()

    assert gone(1) == gone(1)
    assert gone(1) != gone(2)


def test_two_faults_each_take_their_own() -> None:
    faults = 'faults=[{use="remove", at=2, count=2}, {use="remove", at=4, count=3}]'
    moments, _ = watch(faults, iterations=6)
    assert [int(moment.state.alive.sum()) for moment in moments] == [15, 15, 13, 13, 10, 10]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('{use="remove", at=-1}', r"faults\[0\]\.at.*>= 0"),
        ('{use="remove"}', r"faults\[0\]\.at: required key is missing"),
        ('{use="remove", at=5, cuont=3}', r"faults\[0\]\.cuont: unknown key; did you mean 'count'"),
        ('{use="remove", at=5, min_alive=15}', r"faults\[0\]\.min_alive: 15 of 15 robots"),
        ('{use="remove", at=5, map="burnt"}', r"faults\[0\]\.map"),
        ('{use="remvoe", at=5}', r"faults\[0\]\.use.*'remvoe'.*'remove'"),
        ("{at=5}", r"faults\[0\]\.use"),
    ],
)
def test_a_fault_that_cannot_work_is_refused(fault: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(f"faults=[{fault}]", scenario="basilica")


def test_a_recording_tells_who_was_removed_and_verifies(tmp_path) -> None:
    from swarmsim.recording.digests import Digests

    run = made("stop.iterations=30", 'faults=[{use="remove", at=10, count=5}]', scenario="basilica")
    path = tmp_path / "recording.h5"
    with run.recorder(path) as recorder:
        run.simulation.run([recorder])
    recording = Recording(path)
    assert [event.kind for event in worded(recording.events(), run.scenario)] == ["removed"] * 5 + ["not finished"]
    assert recording["alive"].sum(axis=1).tolist() == [15] * 10 + [10] * 20
    assert recording.scenario == msgspec.structs.replace(run.scenario)
    from swarmsim.engine.build import build

    digests = Digests()
    build(recording.scenario, "again", recording.world).simulation.run([digests])
    assert digests.total() == recording.digest()


def in_room(faults: str, *overrides: str, iterations: int = 40, robots: int = 4) -> tuple[list[Moment], object]:
    run = made(f"stop.iterations={iterations}", f"robots.count={robots}", f"faults=[{faults}]", *overrides)
    return moments_of(run), run


def test_a_lost_map_does_not_come_back_with_its_robot() -> None:
    moments, _ = in_room('{use="remove", at=10, robots=[1], duration=5, map="lost"}')
    each = [float(moment.measured.robots["covered"][1]) for moment in moments]
    assert each[9] > each[15] > 0
    assert each[10:15] == [0.0] * 5


def test_the_absent_are_no_obstacles() -> None:
    run = made("robots.count=3", 'faults=[{use="join", at=5, count=2}]')
    assert run.simulation.parts.bodies.solid.tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ('{use="join", at=3, count=4}', r"faults\[0\]\.count: 4 of 4 robots are late"),
        ('{use="join", at=3, times=2}', r"faults\[0\]\.every: required key is missing"),
        ('{use="join", at=0}', r"faults\[0\]\.at: .*>= 1"),
        (f'{{use="join", at={10**30}}}', r"faults\[0\]\.at: "),
        ('{use="remove", at=0, robots=[3]}, {use="join", at=3}', r"count: robots 3 are dead at the start already"),
        ('{use="motor", at=0}', r"faults\[0\]\.failure: required key is missing"),
        ('{use="motor", failure="off", at=0, factor=0.5}', r"faults\[0\]\.factor: .*'off' has none"),
        ('{use="motor", failure="slow", at=0, speed=0.1}', r"faults\[0\]\.speed: .*'slow' has none"),
        ('{use="motor", failure="stuck", at=0, speed=0.2}', r"faults\[0\]\.speed: 0.2 m/s is more than"),
        ('{use="motor", failure="slow", at=0, wheel="middle"}', r"faults\[0\]\.wheel"),
    ],
)
def test_what_cannot_happen_to_bodies_and_motors_is_refused(faults: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        in_room(faults)


def test_the_stuck_motors_of_the_dead_do_not_run() -> None:
    for death in ("crash", "remove"):
        moments, _ = in_room(
            f'{{use="motor", failure="stuck", at=0, robots=[0]}}, {{use="{death}", at=5, robots=[0]}}', robots=3
        )
        places = np.array([moment.state.pose[0, :2] for moment in moments])
        assert np.ptp(places[7:], axis=0).max() < 0.02  # it may be pushed, or roll out
        assert all((moment.state.wheels[0] == 0.0).all() for moment in moments[6:])


def test_the_others_are_untouched_by_a_motor_until_they_meet_it() -> None:
    plain, _ = in_room("", 'network.topology={use="none"}', iterations=12)
    broken, _ = in_room(
        '{use="motor", failure="off", at=3, robots=[0]}', 'network.topology={use="none"}', iterations=12
    )
    for ours, theirs in zip(broken, plain, strict=True):
        np.testing.assert_array_equal(ours.state.pose[1:], theirs.state.pose[1:])
        np.testing.assert_array_equal(ours.intents.goals[1:], theirs.intents.goals[1:])
    assert (broken[5].state.pose[0] != plain[5].state.pose[0]).any()


def test_a_run_that_was_interrupted_says_so_whatever_happened_to_the_building_last(tmp_path) -> None:
    run = made("stop.iterations=30", 'faults=[{use="furniture", at=4, box=[4.0, 2.4, 4.3, 2.9]}]')
    path = tmp_path / "recording.h5"
    with run.recorder(path) as recorder:
        for _ in range(8):
            run.simulation.tick([recorder])
    summary = Recording(path).summary()
    assert summary["status"] == "interrupted"
    assert summary["events"] == [{"event": "box-stands", "iteration": 4, "fault": 0, "box": (4.0, 2.4, 4.3, 2.9)}]
