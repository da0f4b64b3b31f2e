"""Minds that freeze, wander or reboot: what they decide, when it begins and ends, and that the others never notice."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import made, seen_as, setting_of, worded_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mappers import Mapper
from numpy.testing import assert_array_equal

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Parts
from swarmsim.core.state import FREE, OCCUPIED, Moment
from swarmsim.faults.mind import FailingMind, MindFault, RandomWalk
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.reader import Recording

FAILURES = ["frozen", "random-walk", "reboot"]
ONSET, END = 20, 50
ROBOT = 3


class Watch:
    """Keeps every moment, and robot ROBOT's map after it."""

    def __init__(self, *overrides: str, iterations: int = 70) -> None:
        self.run = made(f"stop.iterations={iterations}", *overrides, scenario="basilica")
        self.moments: list[Moment] = []
        self.maps: list[tuple[np.ndarray, np.ndarray]] = []
        self.run.simulation.run([self])

    def sample(self, moment: Moment) -> None:
        mind = self.run.simulation.parts.computation.maps
        self.moments.append(moment)
        self.maps.append((mind.observed[ROBOT].copy(), mind.log_odds[ROBOT].copy()))

    def way(self, iteration: int) -> np.ndarray:
        intents = self.moments[iteration].intents
        return intents.waypoints[ROBOT, : intents.counts[ROBOT]]

    def goal(self, iteration: int) -> tuple[int, int]:
        return tuple(self.run.arena.lattice.cells_within(self.moments[iteration].intents.goals[ROBOT]).tolist())


def watched(failure: str, more: str = f"at={ONSET}, duration={END - ONSET}, robots=[{ROBOT}]") -> Watch:
    return Watch(f'faults=[{{use="mind", failure="{failure}", {more}}}]')


@pytest.fixture(scope="module")
def plain() -> Watch:
    return Watch()


@pytest.fixture(scope="module")
def frozen() -> Watch:
    return watched("frozen")


@pytest.fixture(scope="module")
def wandering() -> Watch:
    return watched("random-walk")


@pytest.fixture(scope="module")
def rebooted() -> Watch:
    return watched("reboot")


# --- all of them ---------------------------------------------------------------------------------


@pytest.mark.parametrize("failure", FAILURES)
def test_nothing_happens_before_the_onset_and_events_tell_when_it_begins_and_ends(failure, plain, request) -> None:
    name = {"frozen": "frozen", "random-walk": "wandering", "reboot": "rebooted"}[failure]
    watch = request.getfixturevalue(name)
    for ours, theirs in zip(watch.moments[:ONSET], plain.moments, strict=False):
        for part, field in [("state", "pose"), ("intents", "goals"), ("intents", "waypoints")]:
            assert_array_equal(getattr(getattr(ours, part), field), getattr(getattr(theirs, part), field))
    for ours, theirs in zip(watch.moments[:ONSET], plain.moments, strict=False):
        assert_array_equal(ours.readings.tiles.values, theirs.readings.tiles.values)
    events = [(event.iteration, event.robot, event.kind) for event in worded_of(watch.moments, watch.run)]
    assert events[:2] == [(ONSET, ROBOT, f"mind {failure}"), (END, ROBOT, f"mind {failure} over")]
    assert not np.array_equal(watch.moments[-1].state.pose[ROBOT], plain.moments[-1].state.pose[ROBOT])


def replayed(watch: Watch, failure: str, *struck: int, begins: int = ONSET, ends: int = END) -> list:
    """What failing minds decide, and know, that are shown what a sound swarm perceived."""
    robots = watch.run.scenario.robots
    place = watch.run.context
    active = np.zeros(robots.count, np.bool_)
    effect = MindFault(at=0, failure=failure).build(place).effect
    plain = Mapper().build(place)
    parts = Parts(None, None, None, plain.computation, plain.strategy, *[None] * 8)
    parts = effect.wrap(parts, active)
    assert isinstance(parts.strategy, FailingMind)
    seen = []
    for moment in watch.moments:
        now = moment.state.iteration
        if now == begins:
            active[list(struck)] = True
            effect.begin(np.array(struck, np.int64), moment.state)
        if now == ends:
            active[:] = False
        observed = seen_as(now, moment.state.pose, moment.state.alive, moment.readings.tiles)
        knowledge = parts.computation.hear(observed, moment.inbox)
        intents = parts.strategy.step(observed, moment.inbox, knowledge)
        seen.append((intents, knowledge.observed.copy(), knowledge.log_odds.copy()))
    return seen


@pytest.mark.parametrize("failure", FAILURES)
def test_sound_minds_decide_and_map_what_they_would_without_the_fault(failure, plain) -> None:
    sound = np.arange(15) != ROBOT
    reference = replayed(plain, failure)
    for moment, (ours, observed, log_odds), (_, known, belief) in zip(
        plain.moments, replayed(plain, failure, ROBOT), reference, strict=True
    ):
        theirs = moment.intents
        assert_array_equal(ours.goals[sound], theirs.goals[sound])
        assert_array_equal(ours.counts[sound], theirs.counts[sound])
        assert_array_equal(ours.planned[sound], theirs.planned[sound])
        for robot in np.flatnonzero(sound):
            count = theirs.counts[robot]
            assert_array_equal(ours.waypoints[robot, :count], theirs.waypoints[robot, :count])
        assert_array_equal(observed[sound], known[sound])
        assert_array_equal(log_odds[sound], belief[sound])
        if failure != "reboot":
            assert_array_equal(log_odds, belief)


@pytest.mark.parametrize("failure", FAILURES)
def test_who_else_fails_changes_nothing_for_a_failing_mind(failure, plain) -> None:
    for (alone, *_), (together, *_) in zip(
        replayed(plain, failure, ROBOT), replayed(plain, failure, 1, ROBOT, 9), strict=True
    ):
        count = alone.counts[ROBOT]
        assert_array_equal(alone.goals[ROBOT], together.goals[ROBOT])
        assert count == together.counts[ROBOT]
        assert_array_equal(alone.waypoints[ROBOT, :count], together.waypoints[ROBOT, :count])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('{use="mind", at=1}', r"faults\[0\]\.failure: required key is missing"),
        ('{use="mind", at=1, failure="asleep"}', r"faults\[0\]\.failure: invalid enum value 'asleep'"),
        ('{use="mind", failure="frozen"}', r"faults\[0\]\.at: required key is missing"),
        ('{use="mind", at=1, failure="random-walk", reach=0.0}', r"faults\[0\]\.reach: .*> 0"),
        (
            '{use="mind", at=1, failure="frozen", reach=1.0}',
            r"faults\[0\]\.reach: a mind that fails by 'frozen' has none; expected failure = 'random-walk'",
        ),
    ],
)
def test_a_fault_that_cannot_work_is_refused(fault: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        made(f"faults=[{fault}]")


# --- frozen --------------------------------------------------------------------------------------


def test_a_frozen_mind_follows_its_last_way_to_the_end_and_stands_there(frozen) -> None:
    goal, last = frozen.goal(ONSET - 1), frozen.way(ONSET - 1)
    assert len(last) > 1
    for iteration in range(ONSET, END):
        assert frozen.goal(iteration) == goal
        way = frozen.way(iteration)
        assert 1 <= len(way) <= len(last)
        assert_array_equal(way, last[-len(way) :])
        assert not frozen.moments[iteration].intents.planned[ROBOT]
    poses = np.array([moment.state.pose[ROBOT, :2] for moment in frozen.moments])
    assert np.hypot(*(poses[END] - last[-1])) < 0.03
    assert np.hypot(*(poses[END] - poses[END - 1])) < 0.01
    assert np.hypot(*(poses[ONSET] - last[-1])) > 0.1


def test_a_frozen_mind_goes_on_mapping_and_comes_to_its_senses(frozen) -> None:
    assert frozen.maps[END - 1][0].sum() > frozen.maps[ONSET][0].sum()
    assert frozen.goal(END) != frozen.goal(END - 1)
    assert frozen.moments[END].intents.planned[ROBOT]


def test_a_mind_frozen_from_the_start_stands() -> None:
    watch = Watch('faults=[{use="mind", failure="frozen", at=0, robots=[3]}]', iterations=10)
    assert all(len(watch.way(iteration)) == 0 for iteration in range(10))
    assert {watch.goal(iteration) for iteration in range(10)} == {(-1, -1)}


# --- random walk ---------------------------------------------------------------------------------


def test_a_wanderer_walks_over_free_cells_of_its_own_map_to_one_place_after_the_other(wandering) -> None:
    lattice = wandering.run.arena.lattice
    goals = set()
    for iteration in range(ONSET, END):
        way = lattice.cells(wandering.way(iteration))
        observed, log_odds = wandering.maps[iteration]
        assert 1 <= len(way) <= 10
        assert tuple(way[-1]) == wandering.goal(iteration)
        assert observed[way[:, 0], way[:, 1]].all()
        assert (log_odds[way[:, 0], way[:, 1]] < 0.0).all()
        assert (np.abs(np.diff(way, axis=0)).sum(axis=1) == 1).all()
        goals.add(wandering.goal(iteration))
    assert len(goals) >= 4
    planned = [bool(moment.intents.planned[ROBOT]) for moment in wandering.moments[ONSET:END]]
    assert planned[0]
    assert len(goals) <= sum(planned) < len(planned)
    poses = np.array([moment.state.pose[ROBOT, :2] for moment in wandering.moments[ONSET : END + 1]])
    assert np.hypot(*np.diff(poses, axis=0).T).sum() > 1.0


def within(free: np.ndarray, start: tuple[int, int], steps: int) -> set[tuple[int, int]]:
    """The free cells at most so many edge steps from `start`, through free cells, without itself."""
    near = np.zeros_like(free)
    near[start] = True
    for _ in range(steps):
        padded = np.pad(near, 1)
        beside = padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
        near |= beside & free
    near[start] = False
    return {tuple(cell) for cell in np.argwhere(near).tolist()}


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.sampled_from([0.05, 0.1]))
def test_every_place_in_reach_and_no_other_is_drawn(seed, steps, radius) -> None:
    rng = np.random.default_rng(seed)
    lattice = Lattice(0.0, 0.0, 0.15, 9, 16)
    wall, observed = rng.random((2, *lattice.shape)) < np.array([0.2, 0.8])[:, None, None]
    free = observed & ~wall
    if radius > 0.075:  # the cells across each edge lie under the body as well
        known = np.pad(wall & observed, 1)
        free &= ~(known[:-2, 1:-1] | known[2:, 1:-1] | known[1:-1, :-2] | known[1:-1, 2:])
    start = tuple(rng.integers(0, lattice.shape).tolist())
    place = setting_of(1, lattice.shape, seed, radius=radius)

    mind = SimpleNamespace(terrain=lambda robot: np.where(wall, np.uint8(OCCUPIED), np.uint8(FREE)) * observed)
    drawn = set()
    pose = np.array([*lattice.centres(np.array(start)), 0.0])
    walk = RandomWalk(place, steps * 0.15 + 0.01, "walk")
    for _ in range(40 * steps * steps):
        walk.begin(np.array([0]), mind, None)
        decision = walk.decided(0, SimpleNamespace(pose=pose[None]), mind)
        assert decision.new == (len(decision.way) > 0)
        assert len(decision.way) <= steps
        drawn.add(tuple(lattice.cells_within(decision.goal).tolist()))
    assert drawn == (within(free, start, steps) or {(-1, -1)})


def test_a_wanderer_in_the_way_of_another_tries_another_place_in_time() -> None:
    lattice = Lattice(0.0, 0.0, 0.15, 8, 8)
    walk = RandomWalk(setting_of(1, lattice.shape, 1), 0.75, "walk")

    known = SimpleNamespace(terrain=lambda robot: np.full(lattice.shape, FREE, np.uint8))
    pose = np.array([*lattice.centres(np.array([4, 4])), 0.0])
    new = [walk.decided(0, SimpleNamespace(pose=pose[None]), known).new for _ in range(60)]  # it never gets anywhere
    gaps = np.diff(np.flatnonzero(new))
    assert len(gaps) > 2
    assert gaps.min() >= 4
    assert gaps.max() <= 12


# --- reboot --------------------------------------------------------------------------------------


def test_a_reboot_empties_the_map_and_the_robot_stands_until_it_is_up_again(rebooted) -> None:
    assert rebooted.moments[ONSET - 1].measured.robots["covered"][ROBOT] * rebooted.run.explorable.sum() > 50
    for iteration in range(ONSET, END):
        observed, log_odds = rebooted.maps[iteration]
        assert not observed.any()
        assert not log_odds.any()
        assert len(rebooted.way(iteration)) == 0
        assert rebooted.goal(iteration) == (-1, -1)
    tile = rebooted.moments[END].readings.tiles.values[ROBOT]
    assert rebooted.maps[END][0].sum() >= (tile > 0).sum() > 0
    assert len(rebooted.way(END)) > 0
    assert rebooted.moments[END].intents.planned[ROBOT]


def test_a_reboot_takes_one_iteration_unless_told_otherwise_and_can_strike_again() -> None:
    watch = Watch('faults=[{use="mind", failure="reboot", at=10, every=8, robots=[3]}]', iterations=30)
    empty = [iteration for iteration in range(30) if watch.moments[iteration].measured.robots["covered"][ROBOT] == 0]
    assert empty == [10, 18, 26]


def test_a_recording_shows_what_a_reboot_has_wiped(tmp_path: Path) -> None:
    fault = 'faults=[{use="mind", failure="reboot", at=12, duration=4, count=5}]'
    run = made("stop.iterations=40", fault, 'mind.computation.trust="quorum"', scenario="basilica")
    path = tmp_path / "recording.h5"
    with run.recorder(path) as recorder:
        run.simulation.run([recorder])
    replay = MapReplay(Recording(path))
    replay.advance(39)
    mind = run.simulation.parts.computation.maps
    assert_array_equal(replay.maps, np.where(mind.observed, 1 + (mind.log_odds > 0.0), 0))
