"""Maps that forget, and patrols, against closed forms, plain numpy and breadth-first search."""

import math
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from conftest import made, seen_as, setting_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mappers import Mapper, inbox_of
from numpy.testing import assert_array_equal

from swarmsim.core.errors import PlacedError
from swarmsim.core.lattice import Lattice
from swarmsim.core.readings import Tiles
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.kernels import occupancy, scratch, search
from swarmsim.operations.mapping.computation import OccupancyGrid
from swarmsim.recording.digests import Digests

CELL = 0.15
LATTICE = Lattice(0.0, 0.0, CELL, 16, 16)
SPOT = (8, 8)  # the cell in question
NOBODY = np.empty(0, np.int32)


def logit(p):
    return math.log(p / (1.0 - p))


def minds(robots=1, **parameters):
    context = setting_of(robots, seed=1)
    return Mapper(**parameters).build(context)


def observe(mind, iteration, value, robots=1, alive=None):
    """Everybody stands in row 8, column 5, and sees the SPOT alone."""
    pose = np.tile([5.5 * CELL, 8.5 * CELL, 0.0], (robots, 1))
    tiles = Tiles(np.full((robots, 1, 1), value, np.uint8), np.tile(np.array(SPOT, np.int32), (robots, 1)))
    nobody = inbox_of(NOBODY, NOBODY, np.empty((0, 1, 1), np.uint8), np.empty((0, 2), np.int32))
    alive = np.ones(robots, bool) if alive is None else alive
    return mind.step(seen_as(iteration, pose, alive, tiles), nobody)


@pytest.mark.parametrize("decay", [0.0, 0.01, 0.05, 0.2])
@pytest.mark.parametrize(("lowest", "highest"), [(0.12, 0.97), (0.12, 0.98), (0.03, 0.95)])
def test_a_wall_that_is_gone_is_unlearned_in_as_many_observations_as_the_formula_says(decay, lowest, highest) -> None:
    mind = minds(decay=decay, lowest=lowest, highest=highest)
    for iteration in range(20):
        observe(mind, iteration, OCCUPIED)
    known = float(mind.log_odds[0][SPOT])
    needed = 0
    while mind.log_odds[0][SPOT] >= 0.0:
        observe(mind, 20 + needed, FREE)
        needed += 1
    miss = -logit(0.4)
    if decay:  # l_k = l_0 g^k - m (1 - g^k) / (1 - g) < 0
        expected = math.log(1.0 + known * decay / miss) / -math.log(1.0 - decay)
    else:
        assert known == pytest.approx(logit(highest))
        expected = known / miss
    assert needed == math.floor(expected) + 1


def test_a_new_wall_is_learned_in_one_observation_with_the_default_increments() -> None:
    mind = minds()
    for iteration in range(20):
        observe(mind, iteration, FREE)
    assert mind.log_odds[0][SPOT] == pytest.approx(logit(0.12))
    observe(mind, 20, OCCUPIED)
    assert mind.log_odds[0][SPOT] > 0.0


@pytest.mark.parametrize("decay", [0.01, 0.05])
@pytest.mark.parametrize("value", [FREE, OCCUPIED])
def test_a_cell_not_seen_again_is_forgotten_when_the_formula_says(decay, value) -> None:
    mind = minds(decay=decay)
    for iteration in range(30):
        observe(mind, iteration, value)
    known = abs(float(mind.log_odds[0][SPOT]))
    lasted = 0
    while mind.observed[0][SPOT]:
        observe(mind, 30 + lasted, UNKNOWN)
        lasted += 1
    assert lasted == math.ceil(math.log(2.0 * known / -logit(0.4)) / -math.log(1.0 - decay))
    assert mind.log_odds[0][SPOT] == 0.0


def test_without_decay_nothing_is_ever_forgotten() -> None:
    mind = minds()
    observe(mind, 0, FREE)
    before = mind.log_odds.copy()
    for iteration in range(1, 2000):
        observe(mind, iteration, UNKNOWN)
    assert_array_equal(mind.log_odds, before)


def test_the_dead_forget_nothing() -> None:
    mind = minds(2, decay=0.1)
    observe(mind, 0, FREE, robots=2)
    for iteration in range(1, 60):
        observe(mind, iteration, UNKNOWN, robots=2, alive=np.array([True, False]))
    assert [bool(mind.observed[robot][SPOT]) for robot in (0, 1)] == [False, True]
    assert mind.log_odds[1][SPOT] == pytest.approx(logit(0.4))


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.integers(0, 2**32), st.floats(0.5, 1.0), st.floats(0.0, 0.5))
def test_fading_is_what_numpy_says(seed, kept, least) -> None:
    rng = np.random.default_rng(seed)
    log_odds = rng.normal(0.0, 1.0, (3, 40)).astype(np.float32)
    observed, alive = rng.random((3, 40)) < 0.7, rng.random(3) < 0.7
    kept, least = np.float32(kept), np.float32(least)
    faded = np.where(alive[:, None], log_odds * kept, log_odds)
    sure = (np.abs(faded) >= least) | ~alive[:, None]
    ours, known = log_odds.copy(), observed.copy()
    occupancy.fade(ours, known, alive, kept, least)
    assert_array_equal(ours, np.where(sure, faded, 0.0))
    assert_array_equal(known, observed & sure)


def test_a_reading_is_as_old_as_it_was_sensed_and_a_piece_of_a_map_says_nothing() -> None:
    seen = np.zeros((2, 6, 6), np.int32)
    tiles, origins = np.full((2, 1, 2), FREE, np.uint8), np.array([[0, 0], [1, 1]], np.int32)
    tiles[1, 0, 1] = UNKNOWN
    heard, places = np.full((3, 1, 1), OCCUPIED, np.uint8), np.array([[0, 0], [4, 4], [5, 5]], np.int32)
    sources, sensed = np.array([1, 1, -1], np.int32), np.array([2, 3, 8], np.int32)
    receivers = np.zeros(3, np.int32)
    occupancy.see(seen, 9, np.array([True, True]), tiles, origins, receivers, heard, places, sources, sensed)
    expected = np.zeros((2, 6, 6))
    expected[0, 0, :2] = 9  # one's own reading of now is not made older by another's
    expected[0, 4, 4] = 4
    expected[1, 1, 1] = 9
    assert_array_equal(seen, expected)


def walking(open_, start):
    """Steps (rows, columns) from `start` between edge neighbours, by breadth-first search; inf for no way."""
    steps = np.full(open_.shape, np.inf)
    steps[start] = 0
    queue = deque([start])
    while queue:
        r, c = queue.popleft()
        for there in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            inside = 0 <= there[0] < open_.shape[0] and 0 <= there[1] < open_.shape[1]
            if inside and open_[there] and np.isinf(steps[there]):
                steps[there] = steps[r, c] + 1
                queue.append(there)
    return steps


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.integers(0, 2**32))
def test_a_patrol_goes_to_the_nearest_cell_at_least_half_as_old_as_the_oldest_in_reach(seed) -> None:
    rng = np.random.default_rng(seed)
    wall = rng.random((9, 9)) < 0.3
    wall[4, 4] = False
    observed = rng.random((9, 9)) < 0.9
    log_odds = np.where(wall, 1.0, -1.0).astype(np.float32)
    never = np.zeros((1, 9, 9), np.int32)
    maps = search.Maps(log_odds[None], observed[None], never, never)
    patrol = search.Patrol(rng.integers(0, 5, (1, 9, 9)).astype(np.int32), np.zeros(1, np.int32))
    rules = search.Rules(0.0, 0.0, CELL, np.zeros((1, 2), np.int32), 0, 4, True, 8, 4)
    found = search.nearest_stale(maps, patrol, 0, 4, rules, 4 * 9 + 4, np.uint64(0), scratch.working_memory(81))
    steps = walking(observed & ~wall, (4, 4))
    cells = [
        (4 - int(patrol.seen[0, r, c]), steps[r, c], 9 * r + c)
        for r, c in np.ndindex(9, 9)
        if 0 < steps[r, c] < np.inf and patrol.seen[0, r, c] < 4
    ]
    stale = [(way, cell) for age, way, cell in cells if 2 * age >= max(cells)[0]]
    assert found == (min(stale)[1] if cells else -1)


def ages(*overrides: str, iterations: int = 500):
    """When each cell of the domain was last sensed by anybody, in a run that goes on after 100 %."""
    run = made(f"stop.iterations={iterations}", 'stop.when_done="continue"', *overrides)
    building, last = run.simulation.parts.building, np.full(run.explorable.shape, -1)

    class Watch:
        def sample(self, moment) -> None:
            for tile, (row, column) in zip(moment.readings.tiles.values, moment.readings.tiles.origins, strict=True):
                window = last[row : row + tile.shape[0], column : column + tile.shape[1]]
                window[tile != UNKNOWN] = moment.state.iteration

    assert run.simulation.run([Watch()])
    return iterations - last[building.explorable], run


def test_a_patrol_sees_every_cell_again_and_those_who_stand_do_not() -> None:
    patrolled, _ = ages('mind.strategy.idle="patrol"')
    stood, _ = ages()
    assert patrolled.max() < 200
    assert stood.max() > 400


def test_forgetting_robots_come_back_to_what_they_forgot() -> None:
    seen, _ = ages("mind.computation.decay=0.02")
    assert seen.max() < 200


def test_on_patrol_a_frontier_comes_first() -> None:
    """One that appears behind the robot turns it round within its patience."""
    context = setting_of(1, seed=1)
    mind = Mapper(idle="patrol").build(context)
    mind.observed[:] = True
    mind.log_odds[:] = 1.0
    mind.log_odds[0, 8, 1:15] = -1.0  # a corridor along row 8
    pose, goals = np.array([[10.5 * CELL, 8.5 * CELL, 0.0]]), []
    blind = Tiles(np.zeros((1, 1, 1), np.uint8), np.zeros((1, 2), np.int32))
    nobody = inbox_of(NOBODY, NOBODY, np.empty((0, 1, 1), np.uint8), np.empty((0, 2), np.int32))
    for iteration in range(20):
        if iteration == 6:
            mind.observed[0, 7, 2] = False  # beside the corridor
        intents = mind.step(seen_as(iteration, pose, np.ones(1, bool), blind), nobody)
        goals.append(tuple(LATTICE.cells(intents.goals[0]).tolist()))
        pose[0, :2] = intents.waypoints[0, 0]
    assert set(goals[:6]) <= {(8, c) for c in range(1, 15)} - {(8, 2)}  # on patrol in the corridor
    assert (8, 2) in goals[6:12]


def test_what_one_robot_forgets_and_patrols_depends_on_its_own_row_alone() -> None:
    nobody = inbox_of(NOBODY, NOBODY, np.empty((0, 6, 7), np.uint8), np.empty((0, 2), np.int32))
    outcomes = []
    for other in (1, 2):
        mind = minds(2, decay=0.05, idle="patrol")
        own, others = np.random.default_rng(7), np.random.default_rng(other)
        goals = []
        for iteration in range(60):
            values = np.stack([draw.choice([0, 1, 1, 1, 2], (6, 7)).astype(np.uint8) for draw in (own, others)])
            origins = np.stack([draw.integers(0, 9, 2).astype(np.int32) for draw in (own, others)])
            pose = np.array([[*own.uniform(1.0, 1.4, 2), 0.0], [*others.uniform(1.0, 1.4, 2), 0.0]])
            seen = seen_as(iteration, pose, np.ones(2, bool), Tiles(values, origins))
            goals.append(tuple(LATTICE.cells_within(mind.step(seen, nobody).goals[0]).tolist()))
        outcomes.append((goals, mind.log_odds[0].copy()))
    assert outcomes[0][0] == outcomes[1][0]
    assert_array_equal(outcomes[0][1], outcomes[1][1])


def test_a_run_that_forgets_and_patrols_is_the_same_again() -> None:
    totals = []
    for _ in range(2):
        digests = Digests()
        keys = (
            'mind.strategy.idle="patrol"',
            "mind.computation.decay=0.02",
            'stop.when_done="continue"',
            "stop.iterations=200",
        )
        made(*keys).simulation.run([digests])
        totals.append(digests.total())
    assert totals[0] == totals[1]


def test_a_map_that_forgets_shrinks_and_grows() -> None:
    run = made("mind.computation.decay=0.02", 'stop.when_done="continue"', "stop.iterations=200")
    curve = []

    class Watch:
        def sample(self, moment) -> None:
            curve.append(moment.measured.values["coverage"])

    run.simulation.run([Watch()])
    assert any(later < earlier for earlier, later in pairwise(curve))
    assert any(later > earlier for earlier, later in pairwise(curve[100:]))


def test_maps_that_no_memory_holds_are_refused_before_they_are_made() -> None:
    """Twenty thousand million cells take 100 GB and more."""
    context = setting_of(100_000, shape=(500, 500), seed=1)
    with pytest.raises(PlacedError, match=r"100000 robots with maps of 250000 cells each .* more than 20000000000"):
        OccupancyGrid().build(context)
