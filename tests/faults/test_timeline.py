"""When faults strike, whom and for how long, against counts and laws written out; then what they do to bodies."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import made, setting_of, worded_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.state import State
from swarmsim.faults.timeline import Timed, Timeline

Z99 = 2.576  # half the width of the 99 % interval of a normal law, in standard deviations
RADIUS, WHEEL_BASE, SPEED = 0.055, 0.10, 0.15  # m, m, m/s: the defaults of robots
SLACK = 0.0035  # m: how far contacts give way


def timeline(swarm: int = 5, seed: int = 1, number: int = 0, **keys: object) -> Timeline:
    context = replace(setting_of(swarm, (8, 8), seed, 1.0), number=number)
    return Timeline(convert(keys, Timed), context)


def state(iteration: int, alive=5, places=None) -> State:
    alive = np.ones(alive, bool) if isinstance(alive, int) else np.array(alive, bool)
    pose = np.zeros((len(alive), 3))
    if places is not None:
        pose[:, :2] = places
    return State(iteration, pose, np.zeros_like(pose), np.zeros((len(alive), 2)), alive)


def parts(links=()) -> SimpleNamespace:
    topology = SimpleNamespace(links=lambda state: np.array(links, np.int32).reshape(-1, 2))
    return SimpleNamespace(topology=topology)


def course(line: Timeline, iterations: int, alive=5, covered=lambda t: 0.0, places=None) -> np.ndarray:
    """Who has the fault in each iteration (t, n); checks on the way that begins and ends say the same."""
    rows, before = [], np.zeros(len(line.active), bool)
    for t in range(iterations):
        begins, ends = line.advance(state(t, alive, places), covered(t), parts())
        assert_array_equal(begins, np.flatnonzero(line.active & ~before))
        assert_array_equal(ends, np.flatnonzero(before & ~line.active))
        before = line.active.copy()
        rows.append(before)
    return np.array(rows)


def struck(swarm: int = 5, alive=None, places=None, links=(), **keys: object) -> list[int]:
    """Whom a fault strikes in iteration 0."""
    line = timeline(swarm, at=0, **keys)
    begins, _ = line.advance(state(0, swarm if alive is None else alive, places), 0.0, parts(links=links))
    return begins.tolist()


# When.


def test_a_fault_at_an_iteration_is_there_from_then_on_for_good() -> None:
    active = course(timeline(at=7, robots=[2]), 20)[:, 2]
    assert active.tolist() == [False] * 7 + [True] * 13


def test_a_fault_lasts_as_long_as_it_says() -> None:
    active = course(timeline(at=7, duration=4, robots=[2]), 20)[:, 2]
    assert active.tolist() == [False] * 7 + [True] * 4 + [False] * 9


def test_between_is_its_first_iteration_with_and_the_first_without_it() -> None:
    assert_array_equal(
        course(timeline(between=[3, 8], robots=[1]), 12), course(timeline(at=3, duration=5, robots=[1]), 12)
    )


def test_every_strikes_again_after_so_many_iterations() -> None:
    active = course(timeline(at=2, every=5, duration=2, robots=[0]), 20)[:, 0]
    assert np.flatnonzero(active).tolist() == [2, 3, 7, 8, 12, 13, 17, 18]


def test_every_without_an_end_takes_one_more_each_time_down_to_those_kept() -> None:
    assert (
        course(timeline(at=2, every=3, min_alive=2), 14).sum(axis=1).tolist() == [0] * 2 + [1] * 3 + [2] * 3 + [3] * 6
    )


def test_coverage_strikes_once_however_often_it_is_reached_again() -> None:
    shares = [0.1, 0.3, 0.5, 0.7, 0.4, 0.2, 0.6, 0.9]
    active = course(timeline(progress=0.5, duration=2, robots=[3]), 8, covered=lambda t: shares[t])[:, 3]
    assert np.flatnonzero(active).tolist() == [2, 3]


def test_a_rate_strikes_as_often_as_a_poisson_process() -> None:
    rate, iterations = 0.7, 4000
    strikes = course(timeline(40, rate=rate, duration=1), iterations + 1, alive=40).sum(axis=1)
    assert strikes[0] == 0
    expected = rate * iterations
    assert abs(strikes.sum() - expected) < Z99 * math.sqrt(expected)
    for k in range(4):
        share = math.exp(-rate) * rate**k / math.factorial(k)
        found = (strikes[1:] == k).mean()
        assert abs(found - share) < Z99 * math.sqrt(share * (1.0 - share) / iterations), k


@pytest.mark.parametrize(("mean", "shape"), [(60.0, 1.0), (80.0, 3.0)])
def test_lives_end_once_each_and_last_as_long_as_a_weibull_law_says(mean: float, shape: float) -> None:
    robots = 400
    line = timeline(robots, life={"mean": mean, "shape": shape}, duration=1, min_alive=0)
    active = course(line, 1000, alive=robots)
    assert (active.sum(axis=0) == 1).all()
    scale = mean / math.gamma(1.0 + 1.0 / shape)
    deviation = math.sqrt(scale**2 * math.gamma(1.0 + 2.0 / shape) - mean**2)
    lives = active.argmax(axis=0)
    # A life ends within an iteration, and the fault is there from the next one on: half an iteration later.
    assert abs(lives.mean() - (mean + 0.5)) < Z99 * deviation / math.sqrt(robots)
    assert (
        abs((lives > mean).mean() - math.exp(-((mean / scale) ** shape))) < Z99 * 0.5 / math.sqrt(robots) + 0.5 / mean
    )


def test_the_life_of_a_robot_does_not_depend_on_how_many_there_are() -> None:
    few = course(timeline(3, life={"mean": 20.0}, min_alive=0), 200, alive=3)
    many = course(timeline(9, life={"mean": 20.0}, min_alive=0), 200, alive=9)
    assert_array_equal(few, many[:, :3])


# How long.


def test_a_duty_switches_the_fault_on_and_off_until_it_ends() -> None:
    active = course(timeline(at=4, duty=[2, 3], duration=9, robots=[4]), 20)[:, 4]
    assert np.flatnonzero(active).tolist() == [4, 5, 9, 10]


def test_a_robot_with_the_fault_is_not_struck_again_before_it_ends() -> None:
    assert course(timeline(2, at=0, every=2, duration=7, robots=[0]), 8, alive=2)[:, 0].tolist() == [True] * 7 + [False]


def test_an_intermittent_fault_does_not_begin_again_with_the_dead() -> None:
    line = timeline(at=0, duty=[2, 2], robots=[0])
    seen = []
    for t in range(12):
        gone = [3 <= t < 6, False, False, False, False]
        line.advance(state(t, ~np.array(gone)), 0.0, parts())
        seen.append(bool(line.active[0]))
    assert np.flatnonzero(seen).tolist() == [0, 1, 8, 9]


# Whom.


def test_one_robot_at_random_unless_told_otherwise() -> None:
    chosen = [struck(5, number=number) for number in range(60)]
    assert all(len(robots) == 1 for robots in chosen)
    assert {robots[0] for robots in chosen} == set(range(5))


def test_the_choice_follows_from_the_seed_and_the_number_of_the_fault() -> None:
    assert struck(30, count=5, seed=3) == struck(30, count=5, seed=3)
    assert struck(30, count=5, seed=3) != struck(30, count=5, seed=4)
    assert struck(30, count=5, number=1) != struck(30, count=5, number=2)


def test_the_robots_named_are_struck_and_no_others() -> None:
    assert struck(6, robots=[4, 1]) == [1, 4]


def test_a_count_of_those_named_is_drawn_among_them() -> None:
    for number in range(20):
        chosen = struck(6, robots=[0, 3, 5], count=2, number=number)
        assert len(chosen) == 2
        assert set(chosen) < {0, 3, 5}


@pytest.mark.parametrize(("share", "alive", "expected"), [(0.2, 10, 2), (0.01, 10, 1), (0.75, 8, 6), (1.0, 10, 9)])
def test_a_share_of_those_alive_but_one_at_least_and_all_but_those_kept(share, alive, expected) -> None:
    assert len(struck(10, np.arange(10) < alive, fraction=share)) == expected


def test_the_dead_are_never_struck() -> None:
    assert struck(5, [True, False, True, False, True], fraction=1.0, min_alive=0) == [0, 2, 4]


PLACES = [(0.0, 0.0), (4.0, 0.0), (1.0, 1.0), (3.0, 0.5), (2.0, 2.0)]


def test_nearest_and_farthest_are_measured_from_the_point() -> None:
    assert struck(5, places=PLACES, target="nearest", point=[4.0, 1.0], count=2) == [1, 3]
    assert struck(5, places=PLACES, target="farthest", point=[4.0, 1.0], count=2) == [0, 2]


def test_of_equally_near_robots_the_lowest_ids_are_struck() -> None:
    assert struck(5, places=np.zeros((5, 2)), target="nearest", point=[1.0, 1.0], count=3) == [0, 1, 2]


def test_the_hub_is_whoever_is_heard_by_most() -> None:
    links = [(0, 3), (1, 3), (2, 3), (3, 0), (4, 0), (3, 1)]  # receiver, sender
    assert struck(5, links=links, target="hub") == [3]
    assert struck(5, links=links, target="hub", count=2) == [0, 3]


def test_a_region_means_all_inside_it_unless_a_count_says_otherwise() -> None:
    assert struck(5, places=PLACES, region=[0.5, 0.0, 3.0, 2.0]) == [2, 3, 4]
    assert len(struck(5, places=PLACES, region=[0.5, 0.0, 3.0, 2.0], count=2)) == 2
    assert struck(5, places=PLACES, region=[5.0, 5.0, 6.0, 6.0]) == []


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.integers(2, 9),
    st.integers(0, 8),
    st.sampled_from([{"count": 3}, {"fraction": 0.6}, {"rate": 1.5}, {}]),
    st.data(),
)
def test_so_many_live_robots_as_kept_are_without_the_fault_always(robots, keep, keys, data) -> None:
    keep = min(keep, robots - 1)
    when = {} if "rate" in keys else {"at": 0, "every": 1}
    line = timeline(robots, min_alive=keep, **when, **keys)
    alive = np.array(data.draw(st.lists(st.booleans(), min_size=robots, max_size=robots)))
    active = course(line, 15, alive=alive)
    assert ((alive & ~active).sum(axis=1) >= min(keep, alive.sum())).all()
    assert not (active & ~alive).any()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "at: required key is missing; expected at, between, progress, rate or life"),
        ({"at": 3, "rate": 0.5}, "rate: the fault strikes at=3 already; expected one of them"),
        ({"between": [3, 9], "progress": 0.5}, r"progress: the fault strikes between=\(3, 9\) already"),
        ({"rate": 0.5, "life": {"mean": 5.0}}, "life: the fault strikes rate=0.5 already"),
        ({"rate": 0.5, "every": 3}, "every: nothing to count from; expected `at` as well"),
        ({"between": [3, 9], "every": 20}, "every: nothing to count from"),
        ({"between": [9, 9]}, r"between: \[9, 9\] is empty; expected the second to be later"),
        ({"between": [3, 9], "duration": 2}, "duration: `between` says how long already"),
        ({"at": 3, "min_alive": 5}, "min_alive: 5 of 5 robots, so that none is ever struck"),
        ({"at": 3, "robots": []}, "robots: the list is empty"),
        ({"at": 3, "robots": [1, 5]}, "robots: there is no robot 5; expected ids from 0 to 4"),
        ({"at": 3, "count": 2, "fraction": 0.5}, "fraction: `count` says how many already"),
        ({"at": 3, "target": "nearest"}, "point: required key is missing; expected x and y in m for target='nearest'"),
        ({"at": 3, "target": "hub", "point": [1.0, 1.0]}, "point: target='hub' measures nothing"),
        ({"at": 3, "point": [1.0, 1.0]}, "point: target='random' measures nothing"),
        ({"at": 3, "region": [2.0, 0.0, 1.0, 1.0]}, r"region: \[2.0, 0.0, 1.0, 1.0\] holds nothing"),
        ({"at": -1}, "at: .*>= 0"),
        ({"at": 3, "duration": 0}, "duration: .*>= 1"),
        ({"rate": 0.0}, "rate: .*> 0"),
        ({"progress": 1.5}, "progress: .*<= 1"),
        ({"life": {"mean": 0.0}}, "life.mean: .*> 0"),
        ({"life": {"mean": 5.0, "shape": 0.05}}, "life.shape: .*>= 0.1"),
        ({"life": {"maen": 5.0}}, "life.maen: unknown key; did you mean 'mean'"),
        ({"at": 3, "duty": [0, 2]}, r"duty\[0\]: .*>= 1"),
        ({"at": 3, "target": "leader"}, "target: "),
    ],
)
def test_keys_that_contradict_each_other_are_refused(keys: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        timeline(**keys)


# Bodies.


class Watch:
    """Keeps the moments, and whose bodies were in the world in each."""

    def __init__(self, run) -> None:
        self.run, self.moments, self.solid = run, [], []

    def sample(self, moment) -> None:
        self.moments.append(moment)
        self.solid.append(self.run.simulation.parts.bodies.solid)

    @property
    def events(self):
        return [event for event in worded_of(self.moments, self.run) if event.robot >= 0]

    def told(self, kind: str) -> list[tuple[int, int]]:
        return [(event.iteration, event.robot) for event in self.events if event.kind == kind]

    def rows(self, robot: int) -> tuple[np.ndarray, ...]:
        """Poses (t, 3), velocities (t, 3) and wheel speeds (t, 2) of one robot."""
        fields = ("pose", "velocity", "wheels")
        return tuple(np.array([getattr(moment.state, name)[robot] for moment in self.moments]) for name in fields)


def watched(*overrides: str, iterations: int = 30, put=None) -> Watch:
    """A run in the room; `put` gives where some robots stand at the start."""
    run = made(f"stop.iterations={iterations}", 'stop.when_done="continue"', *overrides)
    bodies = run.simulation.parts.bodies
    for robot, pose in (put or {}).items():
        bodies.crash(np.array([robot]))
        bodies.place(np.array([robot]), np.array([pose]))
    run.simulation.state = bodies.state()
    watch = Watch(run)
    run.simulation.run([watch])
    return watch


def test_the_removed_return_to_the_spawn_area() -> None:
    watch = watched("robots.count=4", 'faults=[{use="remove", at=5, duration=10, robots=[0, 2]}]')
    assert watch.told("removed") == [(5, 0), (5, 2)]
    assert watch.told("returned") == [(15, 0), (15, 2)]
    out = np.array([False] * 5 + [True] * 10 + [False] * 15)
    assert_array_equal([not moment.state.alive[0] for moment in watch.moments], out)
    assert_array_equal([not solid[2] for solid in watch.solid], out)
    entrance = watch.run.simulation.parts.building.entrance
    back = watch.moments[15].state.pose[[0, 2], :2]
    assert (np.abs(entrance[:, None] - back).max(axis=2).min(axis=0) < 1e-9).all()
    assert (watch.moments[15].state.velocity[[0, 2]] == 0.0).all()
    assert (watch.moments[20].state.pose[[0, 2], :2] != back).any()


def test_who_returns_waits_while_the_spawn_area_is_full() -> None:
    faults = 'faults=[{use="remove", at=1, duration=3, robots=[0]}, {use="motor", failure="off", at=0, robots=[1]}]'
    run = made("robots.count=2", "stop.iterations=30", faults)
    parts = run.simulation.parts
    beside = parts.bodies.state().pose[1:, :2] + (0.05, 0.0)
    parts.building.found = replace(parts.building.found, entrance=beside)
    watch = Watch(run)
    for _ in range(8):
        run.simulation.tick([watch])
    assert not run.simulation.state.alive[0]
    parts.bodies.remove(np.array([1]))  # who stood in the way
    run.simulation.tick([watch])
    assert watch.told("returned") == [(8, 0)]
    assert_array_equal(watch.moments[-1].state.pose[0, :2], parts.building.entrance[0])
    assert run.simulation.state.alive[0]


def test_latecomers_are_absent_until_they_enter() -> None:
    watch = watched("robots.count=5", 'faults=[{use="join", at=6, every=4, count=2, times=2}]')
    assert watch.told("late") == [(0, 1), (0, 2), (0, 3), (0, 4)]
    assert watch.told("joined") == [(6, 1), (6, 2), (10, 3), (10, 4)]
    assert [int(moment.state.alive.sum()) for moment in watch.moments] == [1] * 6 + [3] * 4 + [5] * 20
    for t, (moment, solid) in enumerate(zip(watch.moments, watch.solid, strict=True)):
        late = np.array([1, 2, 3, 4]) if t < 6 else np.array([3, 4]) if t < 10 else np.array([], int)
        assert not solid[late].any()
        assert not np.isin(moment.links, late).any()
        assert not moment.readings.tiles.values[late].any()
        assert (moment.measured.robots["covered"][late] == 0).all()
    assert (watch.moments[10].measured.robots["covered"][3:] > 0).all()


@pytest.mark.parametrize("memory", ["empty", "copied"])
def test_latecomers_have_the_map_they_are_given(memory: str) -> None:
    watch = watched(
        "robots.count=4", 'network.topology={use="none"}', f'faults=[{{use="join", at=15, map="{memory}"}}]'
    )
    before, entry = watch.moments[14].measured.robots["covered"], watch.moments[15].measured.robots["covered"]
    if memory == "copied":
        assert entry[3] >= before[:3].max()
    else:
        seen = (watch.moments[15].readings.tiles.values[3] != 0).sum() / watch.run.explorable.sum()
        assert entry[3] <= seen < before[:3].max()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("at=5, count=3", "count: 3 of 3 robots are late; expected one at the start at least"),
        ("at=5, times=2", "every: required key is missing; expected iterations between 2 times"),
        ("at=0", "at: .*>= 1"),
        ("count=1", "at: required key is missing"),
        ("at=5, duration=3", "duration: unknown key"),
        ('at=5, map="kept"', "map: "),
    ],
)
def test_latecomers_that_cannot_be_are_refused(keys: str, message: str) -> None:
    with pytest.raises(InputError, match=rf"faults\[0\]\.{message}"):
        made(f'faults=[{{use="join", {keys}}}]')


def ahead_of(robot: int):
    """Motion that sends one robot straight ahead at full speed; the others stand."""
    wanted = np.zeros((2, 2))
    wanted[robot] = SPEED
    return SimpleNamespace(command=lambda pose: wanted)


@pytest.mark.parametrize("kind", ["crash", "remove"])
def test_others_bump_into_the_crashed_and_pass_the_removed(kind: str) -> None:
    run = made("robots.count=2")
    bodies = run.simulation.parts.bodies
    bodies.crash(np.array([0, 1]))
    bodies.place(np.array([0, 1]), np.array([[0.8, 0.9, 0.0], [1.2, 0.9, 0.0]]))
    (bodies.crash if kind == "crash" else bodies.remove)(np.array([1]))
    gaps = []
    for _ in range(6):
        pose = bodies.drive(ahead_of(0), 1.0).pose
        gaps.append(pose[1, 0] - pose[0, 0])
    if kind == "remove":
        assert gaps[-1] < -2.0 * RADIUS
        assert_array_equal(pose[1], [1.2, 0.9, 0.0])
    else:
        assert min(gaps) > 2.0 * RADIUS - 2.0 * SLACK
        assert gaps[-1] < 2.0 * RADIUS + 0.01


def test_the_crashed_stay_where_they_are_and_go_on_once_repaired() -> None:
    watch = watched('faults=[{use="crash", at=5, duration=10, robots=[1]}]')
    assert watch.told("crashed") == [(5, 1)]
    assert watch.told("repaired") == [(15, 1)]
    pose, _, wheels = watch.rows(1)
    assert (wheels[5:16] == 0.0).all()
    # It slides to a halt with locked wheels, within v^2 / (2 mu g) and a sub-step of where it died.
    assert np.hypot(*(pose[6:16, :2] - pose[5, :2]).T).max() < SPEED**2 / (2.0 * 0.6 * 9.81) + SPEED / 64.0
    assert_allclose(pose[7:16], pose[[7] * 9], atol=1e-6)
    assert all(solid.all() for solid in watch.solid)
    assert np.hypot(*(pose[20, :2] - pose[15, :2])) > 0.1
    assert [bool(moment.state.alive[1]) for moment in watch.moments] == [True] * 5 + [False] * 10 + [True] * 15


@pytest.mark.parametrize(("kind", "other"), [("crash", "remove"), ("remove", "crash"), ("remove", "remove")])
def test_an_intermittent_fault_brings_nobody_back_whom_another_has_taken(kind: str, other: str) -> None:
    faults = (
        f'faults=[{{use="{kind}", at=2, duty=[3, 3], robots=[0]}}, {{use="{other}", at=7, duration=13, robots=[0]}}]'
    )
    watch = watched(faults, iterations=24)
    # Out from 2 to 4 by the one and from 7 to 19 by the other; it begins with the living only, so not before 21.
    out = [t for t, moment in enumerate(watch.moments) if not moment.state.alive[0]]
    assert out == [2, 3, 4, *range(7, 20), 21, 22]


OPEN = {0: (0.7, 0.9, 0.0), 1: (4.5, 3.3, 0.0)}  # robot 0 with 2 m of free floor ahead, robot 1 in the other room


def test_a_motor_that_is_off_stands_and_one_that_is_on_again_drives() -> None:
    watch = watched("robots.count=2", 'faults=[{use="motor", failure="off", at=8, duration=10, robots=[0]}]')
    pose, velocity, wheels = watch.rows(0)
    assert np.abs(wheels[1:9]).max() > 0.1
    assert (wheels[9:19] == 0.0).all()
    assert np.abs(velocity[9:19]).max() < 1e-6
    assert_allclose(pose[10:19], pose[[10] * 9], atol=1e-6)
    assert np.abs(wheels[19:25]).max() > 0.1


def test_a_slow_motor_turns_at_its_factor_of_what_is_wanted() -> None:
    faults = (
        'faults=[{use="motor", failure="stuck", at=0, robots=[0]},'
        '{use="motor", failure="slow", factor=0.3, at=5, duration=4, robots=[0]}]'
    )
    pose, velocity, wheels = watched("robots.count=2", faults, put=OPEN, iterations=12).rows(0)
    factor = np.array([1.0] * 5 + [0.3] * 4 + [1.0] * 2)  # from iteration 1 on, at the end of each
    assert_allclose(wheels[2:], SPEED * np.column_stack([factor[1:], factor[1:]]), rtol=1e-9)
    assert_allclose(velocity[2:, 0], SPEED * factor[1:], atol=1e-3)
    ways = np.diff(pose[:, 0])
    assert_allclose(ways[[2, 3, 4, 6, 7, 8, 10]], SPEED * np.array([1, 1, 1, 0.3, 0.3, 0.3, 1]), atol=1e-3)


def test_a_stuck_motor_drives_at_its_speed_whatever_is_wanted() -> None:
    fault = 'faults=[{use="motor", failure="stuck", speed=0.08, at=0, robots=[0]}]'
    pose, _, wheels = watched("robots.count=2", fault, put=OPEN, iterations=12).rows(0)
    assert (wheels[1:] == 0.08).all()
    assert_allclose(np.diff(pose[1:], axis=0), [[0.08, 0.0, 0.0]] * 10, atol=1e-4)


def test_a_robot_with_one_wheel_stuck_and_the_other_off_turns_about_the_latter() -> None:
    faults = (
        'faults=[{use="motor", failure="stuck", wheel="left", speed=0.05, at=0, robots=[0]},'
        '{use="motor", failure="off", wheel="right", at=0, robots=[0]}]'
    )
    pose, velocity, wheels = watched("robots.count=2", faults, put=OPEN, iterations=20).rows(0)
    assert (wheels[1:] == [0.05, 0.0]).all()
    assert_allclose(velocity[2:, 2], -0.05 / WHEEL_BASE, rtol=0.01)
    assert_allclose(np.diff(pose[2:, 2]), -0.05 / WHEEL_BASE, rtol=0.01)
    pivot = pose[1:, :2] + 0.5 * WHEEL_BASE * np.column_stack([np.sin(pose[1:, 2]), -np.cos(pose[1:, 2])])
    assert np.ptp(pivot, axis=0).max() < 0.005


def test_a_wheel_that_is_off_leaves_the_other_alone() -> None:
    fault = 'faults=[{use="motor", failure="off", wheel="left", at=6, robots=[0]}]'
    plain = watched("robots.count=2", put=OPEN, iterations=20).rows(0)[2]
    wheels = watched("robots.count=2", fault, put=OPEN, iterations=20).rows(0)[2]
    assert_array_equal(wheels[:7], plain[:7])
    assert (wheels[7:, 0] == 0.0).all()
    assert np.abs(wheels[7:, 1]).max() > 0.05
