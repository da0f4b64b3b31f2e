"""What a robot decides, and on what alone: maps, goals, ways, and the wheels that follow them."""

import numpy as np
import pytest
import shapely
from conftest import building, seen_as, setting_of
from hypothesis import given, settings
from hypothesis import strategies as st
from mappers import Mapper, inbox_of
from numpy.testing import assert_array_equal

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Parts, Schedule
from swarmsim.core.readings import Channels, Tiles, tile_channels
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Intents
from swarmsim.core.streams import Streams
from swarmsim.engine.simulation import Simulation
from swarmsim.network.channel import Perfect
from swarmsim.network.topology import Isolated
from swarmsim.operations.mapping.grids import OccupancyGrids
from swarmsim.operations.mapping.measures.coverage import Coverage
from swarmsim.operations.mapping.measures.quality import probability
from swarmsim.robots.bodies import Pymunk, RigidDiscs
from swarmsim.robots.localisation import PerfectLocalisation
from swarmsim.robots.motion import PurePursuit
from swarmsim.robots.sensors import IrRing
from swarmsim.robots.suites import Rig

CELL = 0.15
PATIENCE = 4
SIGNS = {"?": UNKNOWN, ".": FREE, "#": OCCUPIED}
CORRIDOR = "?..............?"
LOOP = """
########
#......?
#.####.#
#......#
########
"""


def drawn(picture):
    """The cells of a drawing, its first line being row 0."""
    return np.array([[SIGNS[sign] for sign in line] for line in picture.split()], np.uint8)


def context(count=1, shape=(16, 16), seed=5, **robots):
    return setting_of(count, shape, seed, CELL, **robots)


def silence(window):
    nobody = np.empty(0, np.int32)
    return inbox_of(nobody, nobody, np.empty((0, *window), np.uint8), np.empty((0, 2), np.int32))


class Alone:
    """One robot that is put where the test wants it and shown whatever the test draws."""

    def __init__(self, picture, seed=5, radius=0.055, **parameters):
        self.world = drawn(picture)
        place = context(shape=self.world.shape, seed=seed, radius=radius)
        self.lattice = place.lattice
        self.mind = Mapper(**{"patience": PATIENCE, **parameters}).build(place)
        self.iteration = 0

    def at(self, row, column, picture=None):
        """The intents of the next iteration, with the robot in the middle of a cell and all of `picture` in view."""
        if picture is not None:
            self.world = drawn(picture)
        pose = np.array([[*self.lattice.centres(np.array([row, column])), 0.0]])
        tiles = Tiles(self.world[None], np.zeros((1, 2), np.int32))
        senses = seen_as(self.iteration, pose, np.ones(1, bool), tiles)
        self.iteration += 1
        self.intents = self.mind.step(senses, silence(self.world.shape))
        return self.intents

    @property
    def goal(self):
        return tuple(self.lattice.cells_within(self.intents.goals[0]).tolist())

    @property
    def way(self):
        waypoints = self.intents.waypoints[0, : self.intents.counts[0]]
        return [tuple(cell) for cell in self.lattice.cells(waypoints).tolist()]

    @property
    def planned(self):
        return bool(self.intents.planned[0])


# --- goals and ways ------------------------------------------------------------------------------


def test_a_robot_walks_to_the_nearest_frontier_on_the_shortest_way():
    robot = Alone(CORRIDOR)
    robot.at(0, 5)
    assert robot.goal == (0, 1)
    assert robot.way == [(0, 4), (0, 3), (0, 2), (0, 1)]
    assert robot.planned


def test_a_goal_is_kept_while_it_is_a_frontier_even_if_another_is_nearer():
    robot = Alone(CORRIDOR)
    robot.at(0, 5)
    for column in (7, 9, 10):
        robot.at(0, column)
        assert robot.goal == (0, 1)
        assert not robot.planned


def test_planning_in_every_iteration_always_takes_the_nearest():
    robot = Alone(CORRIDOR, replan="every-iteration")
    for column, goal in [(5, 1), (6, 1), (9, 14), (10, 14), (5, 1)]:
        robot.at(0, column)
        assert robot.goal == (0, goal)
        assert robot.planned


@pytest.mark.parametrize("news", ["#..............?", "?#.............?"], ids=["nothing behind it", "a wall itself"])
def test_a_goal_that_is_no_frontier_any_more_is_dropped(news):
    robot = Alone(CORRIDOR)
    robot.at(0, 5)
    robot.at(0, 5, news)
    assert robot.goal == (0, 14)
    assert robot.planned


def test_when_the_way_is_blocked_another_is_planned_to_the_same_goal():
    robot = Alone(LOOP)
    robot.at(1, 1)
    assert robot.goal == (1, 6)
    assert (1, 3) in robot.way
    blocked = LOOP.replace("#......?", "#.#....?")
    robot.at(1, 1, blocked)
    assert robot.goal == (1, 6)
    assert robot.planned
    assert (3, 3) in robot.way
    robot.at(2, 1, blocked)
    assert not robot.planned
    assert (3, 3) in robot.way


def test_a_goal_that_cannot_be_reached_any_more_is_dropped():
    robot = Alone(LOOP)
    robot.at(1, 1)
    intents = robot.at(1, 1, LOOP.replace("#......?", "#.#....?").replace("#......#", "#..#...#"))
    assert robot.goal == (-1, -1)
    assert intents.counts[0] == 0


def test_the_way_ahead_leaves_out_what_the_robot_has_passed():
    robot = Alone(CORRIDOR)
    robot.at(0, 5)
    robot.at(0, 4)
    assert robot.way == [(0, 3), (0, 2), (0, 1)]
    robot.at(0, 2)
    assert robot.way == [(0, 1)]


@pytest.mark.parametrize("replan", ["on-arrival", "every-iteration"])
def test_a_robot_without_progress_bars_the_next_cell_and_goes_around_it(replan):
    robot = Alone(LOOP, replan=replan)
    robot.at(1, 1)
    for _ in range(PATIENCE - 1):
        robot.at(1, 1)
        assert robot.way[0] == (1, 2)
        assert robot.planned == (replan == "every-iteration")
    robot.at(1, 1)
    assert robot.planned
    assert robot.goal == (1, 6)
    assert (1, 2) not in robot.way
    assert (3, 3) in robot.way


def test_progress_of_half_a_cell_is_enough_not_to_be_stuck():
    robot = Alone(CORRIDOR)
    robot.at(0, 12, "?.............##")
    for step in range(20):
        robot.at(0, 12 - 0.6 * (step // 3))
        assert robot.goal == (0, 1)
        assert not robot.planned


def test_a_stuck_robot_with_no_other_choice_gives_way():
    """In a dead end the way out is barred as well as blocked: it walks about where it can, and tries again."""
    robot = Alone("?.....#")
    ways = set()
    for _ in range(12 * PATIENCE):
        robot.at(0, 4)
        ways.add((robot.goal, robot.way[-1] if robot.way else None))
    assert ((-1, -1), (0, 5)) in ways
    assert ((0, 1), (0, 1)) in ways


def test_a_goal_that_yields_nothing_is_shunned_for_a_while():
    robot = Alone(CORRIDOR)
    robot.at(0, 5)
    robot.at(0, 1)
    shunned = robot.iteration
    assert robot.goal == (0, 14)
    robot.at(0, 14)
    goals = []
    for _ in range(15 * PATIENCE):
        goals.append((robot.iteration, robot.goal))
        robot.at(0, 13)
    assert goals[0][1] == (-1, -1)
    again = [iteration for iteration, goal in goals if goal != (-1, -1)]
    assert shunned + 10 * PATIENCE - 1 <= again[0] <= shunned + 12 * PATIENCE


def test_a_robot_without_a_frontier_stands_until_its_map_grows():
    shut = "####### #.....# #######"
    robot = Alone(shut)
    for _ in range(3 * PATIENCE):
        intents = robot.at(1, 2)
        assert robot.goal == (-1, -1)
        assert intents.counts[0] == 0
        assert not robot.planned
    other = Alone("####### #...??# #######")
    other.at(1, 1)
    other.at(1, 3)
    other.at(1, 3)
    assert other.goal == (-1, -1)
    other.at(1, 3, "####### #....?# #######")
    assert other.goal == (1, 4)
    assert other.planned


def test_unknown_behind_a_diagonal_is_no_reason_to_go_there():
    robot = Alone("?#### #...# #####")
    robot.at(1, 2)
    assert robot.goal == (-1, -1)


def test_free_cells_that_only_neighbours_know_a_way_to_are_no_goal():
    """A tile heard from afar is an island on the map: no known-free way leads to it."""
    robot = Alone("####???? #..#?..? ####????")
    robot.at(1, 1)
    assert robot.goal == (-1, -1)


def test_a_robot_that_is_wider_than_a_cell_stays_out_of_narrow_doors():
    """Its own cell and the four around it lie under a disc of radius 0.1 m in cells of 0.15 m."""
    picture = """
    ########
    #...#..?
    #......?
    #...#..?
    ########
    """
    narrow, wide = Alone(picture), Alone(picture, radius=0.1)
    narrow.at(2, 2)
    wide.at(2, 2)
    assert narrow.goal[1] == 6
    assert wide.goal == (-1, -1)


def test_ties_go_by_rows_or_by_an_order_of_the_robots_own():
    goals = {}
    for ties in ("row-order", "own-order"):
        goals[ties] = []
        for seed in range(40):
            robot = Alone("?.......?", seed=seed, ties=ties)
            robot.at(0, 4)
            goals[ties].append(robot.goal[1])
    assert set(goals["row-order"]) == {1}
    assert set(goals["own-order"]) == {1, 7}


@pytest.mark.parametrize("changes", [{"hit": 0.4}, {"miss": 0.6}, {"lowest": 0.45}, {"highest": 0.85}])
def test_probabilities_out_of_order_are_refused(changes):
    with pytest.raises(InputError, match=r"^hit: expected lowest < miss < 0.5 < hit < highest, got "):
        Mapper(**changes).build(context())


# --- exploring whole maps ------------------------------------------------------------------------


def is_frontier(observed, free):
    unknown = np.pad(~observed, 1, constant_values=False)
    beside = unknown[:-2, 1:-1] | unknown[2:, 1:-1] | unknown[1:-1, :-2] | unknown[1:-1, 2:]
    return free & beside


def flooded(free, start):
    """The cells that are 4-connected to `start` through free cells."""
    reached, front = {start}, [start]
    while front:
        r, c = front.pop()
        for cell in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
            if cell not in reached and free[cell]:
                reached.add(cell)
                front.append(cell)
    return reached


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("replan", ["on-arrival", "every-iteration"])
def test_a_robot_explores_all_that_it_can_reach_of_a_maze_and_then_stands(replan, neighbours):
    """It sees a window of 3 x 3 cells, through walls, and moves one waypoint per iteration. In every iteration its
    goal is a frontier on its map and its way leads through cells that it knows to be free."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        lattice = Lattice(0.0, 0.0, CELL, 20, 24)
        wall = rng.random(lattice.shape) < 0.3
        wall[[0, -1]] = wall[:, [0, -1]] = True
        truth = np.where(wall, OCCUPIED, FREE).astype(np.uint8)
        start = here = tuple(np.argwhere(~wall)[rng.integers(0, (~wall).sum())].tolist())
        mind = Mapper(replan=replan, neighbours=neighbours).build(context(shape=lattice.shape, seed=seed))
        for iteration in range(5000):
            origin = np.array([[here[0] - 1, here[1] - 1]], np.int32)
            tile = truth[None, here[0] - 1 : here[0] + 2, here[1] - 1 : here[1] + 2]
            pose = np.array([[*lattice.centres(np.array(here)), 0.0]])
            seen = seen_as(iteration, pose, np.ones(1, bool), Tiles(tile, origin))
            intents = mind.step(seen, silence((3, 3)))
            observed, free = mind.observed[0], mind.observed[0] & (mind.log_odds[0] < 0.0)
            if intents.counts[0] == 0:
                break
            assert is_frontier(observed, free)[tuple(lattice.cells(intents.goals[0]))]
            way = [tuple(cell) for cell in lattice.cells(intents.waypoints[0, : intents.counts[0]]).tolist()]
            assert all(free[cell] for cell in way)
            here = way[0]
        reached = flooded(~wall, start)
        assert all(observed[cell] for cell in reached)
        assert not any(is_frontier(observed, free)[cell] for cell in flooded(free, here))
        assert_array_equal(free[observed], ~wall[observed])


# --- locality ------------------------------------------------------------------------------------

WINDOW, SHAPE, SWARM = (6, 7), (16, 24), 5


def random_senses(rng, iteration):
    """A moment in which nothing makes sense, with a random inbox sorted by receiver and sender."""
    pose = np.column_stack([rng.uniform(0.0, [3.6, 2.4], (SWARM, 2)), rng.uniform(-4.0, 4.0, SWARM)])
    alive = rng.random(SWARM) < 0.9
    values = rng.choice([UNKNOWN, FREE, OCCUPIED], (SWARM, *WINDOW), p=[0.3, 0.6, 0.1]).astype(np.uint8)
    origins = np.floor(pose[:, 1::-1] / CELL).astype(np.int32) - 3
    heard = (rng.random((SWARM, SWARM)) < 0.4) & alive & alive[:, None] & ~np.eye(SWARM, dtype=bool)
    receivers, senders = (ids.astype(np.int32) for ids in np.nonzero(heard))
    inbox = inbox_of(receivers, senders, values[senders], origins[senders])
    return seen_as(iteration, pose, alive, Tiles(values, origins)), inbox


def columns_of(inbox):
    return inbox.receivers, inbox.senders, inbox.content.values, inbox.content.origins


def transplanted(mine, others, robot):
    """What `others` sense and hear, but for `robot`, for which it is as in `mine`."""
    (mine, my_inbox), (others, other_inbox) = mine, others
    pose, alive = others.pose.copy(), others.alive.copy()
    values, origins = others.readings.tiles.values.copy(), others.readings.tiles.origins.copy()
    pose[robot], alive[robot] = mine.pose[robot], mine.alive[robot]
    values[robot], origins[robot] = mine.readings.tiles.values[robot], mine.readings.tiles.origins[robot]
    to_me, to_others = my_inbox.receivers == robot, other_inbox.receivers != robot
    fields = [
        np.concatenate([ours[to_me], theirs[to_others]])
        for ours, theirs in zip(columns_of(my_inbox), columns_of(other_inbox), strict=True)
    ]
    order = np.lexsort((fields[1], fields[0]))
    return seen_as(mine.iteration, pose, alive, Tiles(values, origins)), inbox_of(*(field[order] for field in fields))


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.integers(0, SWARM - 1),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["on-arrival", "every-iteration"]),
    st.sampled_from(["own-order", "row-order"]),
    st.integers(1, 5),
)
def test_a_robot_decides_by_what_it_senses_and_hears_alone(robot, seed, replan, ties, patience):
    place = context(SWARM, SHAPE)
    parameters = Mapper(replan=replan, ties=ties, patience=patience)
    here, elsewhere = parameters.build(place), parameters.build(place)
    mine, others = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    pose = None
    for iteration in range(12):
        seen, inbox = random_senses(mine, iteration)
        if pose is not None and mine.random() < 0.7:  # most often it stands still, so that it gets stuck
            seen.pose[robot] = pose
        pose = seen.pose[robot].copy()
        one = here.step(seen, inbox)
        two = elsewhere.step(*transplanted((seen, inbox), random_senses(others, iteration), robot))
        assert_array_equal(one.goals[robot], two.goals[robot])
        assert one.counts[robot] == two.counts[robot]
        assert one.planned[robot] == two.planned[robot]
        count = one.counts[robot]
        assert_array_equal(one.waypoints[robot, :count], two.waypoints[robot, :count])
        assert_array_equal(here.observed[robot], elsewhere.observed[robot])
        assert_array_equal(here.log_odds[robot], elsewhere.log_odds[robot])
    rest = np.arange(SWARM) != robot
    assert not np.array_equal(here.log_odds[rest], elsewhere.log_odds[rest])


def test_what_a_robot_hears_does_change_what_it_does():
    """The counterpart of locality: without it, a robot that ignores everything would pass."""
    place = context(SWARM, SHAPE)
    changed = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        hearing, deaf = Mapper().build(place), Mapper().build(place)
        for iteration in range(5):
            seen, inbox = random_senses(rng, iteration)
            one = hearing.step(seen, inbox)
            two = deaf.step(seen, silence(WINDOW))
            changed += not np.array_equal(one.goals, two.goals, equal_nan=True)
    assert changed > 20


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.permutations(range(SWARM)), st.integers(0, 2**32 - 1))
def test_the_order_of_robots_in_memory_does_not_matter(order, seed):
    """With row-order ties and endless patience robots are all alike: renaming them renames their intents."""
    order = np.array(order)  # row i of the second swarm is robot order[i] of the first
    rows = np.argsort(order)
    place = context(SWARM, SHAPE)
    parameters = Mapper(ties="row-order", patience=1000)
    one, other = parameters.build(place), parameters.build(place)
    rng = np.random.default_rng(seed)
    for iteration in range(8):
        seen, inbox = random_senses(rng, iteration)
        first = np.unique(inbox.receivers, return_index=True)[1]  # one message each: their order would matter
        inbox = inbox_of(*(field[first] for field in columns_of(inbox)))
        again = np.argsort(rows[inbox.receivers])
        renamed = inbox_of(
            rows[inbox.receivers][again].astype(np.int32), rows[inbox.senders][again].astype(np.int32),
            inbox.content.values[again], inbox.content.origins[again],
        )  # fmt: skip
        tiles = Tiles(seen.readings.tiles.values[order], seen.readings.tiles.origins[order])
        a = one.step(seen, inbox)
        b = other.step(seen_as(iteration, seen.pose[order], seen.alive[order], tiles), renamed)
        assert_array_equal(a.goals[order], b.goals)
        assert_array_equal(a.counts[order], b.counts)
        assert_array_equal(a.planned[order], b.planned)
        for row, robot in enumerate(order):
            assert_array_equal(a.waypoints[robot, : a.counts[robot]], b.waypoints[row, : b.counts[row]])
        assert_array_equal(one.log_odds[order], other.log_odds)


def test_dead_robots_neither_map_nor_move():
    place = context(SWARM, SHAPE)
    mind = Mapper().build(place)
    rng = np.random.default_rng(3)
    for iteration in range(5):
        mind.step(*random_senses(rng, iteration))
    before = mind.log_odds.copy()
    seen, _ = random_senses(rng, 5)
    nobody = seen_as(5, seen.pose, np.zeros(SWARM, bool), seen.readings.tiles)
    intents = mind.step(nobody, silence(WINDOW))
    assert np.isnan(intents.goals).all()
    assert not intents.counts.any()
    assert not intents.planned.any()
    assert_array_equal(mind.log_odds, before)


# --- occupancy grids -----------------------------------------------------------------------------


def test_probabilities_are_those_of_the_increments_and_stay_within_the_limits():
    grids = OccupancyGrids(1, Lattice(0.0, 0.0, CELL, 1, 3), hit=0.8, miss=0.3, lowest=0.1, highest=0.9)
    assert probability(grids.log_odds)[0].tolist() == [[0.5, 0.5, 0.5]]
    tiles = Tiles(np.array([[[OCCUPIED, FREE, UNKNOWN]]], np.uint8), np.zeros((1, 2), np.int32))
    for occupied, free in [(0.8, 0.3), (0.9, 9 / 58), (0.9, 0.1), (0.9, 0.1)]:
        grids.update(np.ones(1, bool), tiles, silence((1, 3)))
        assert probability(grids.log_odds)[0][0] == pytest.approx([occupied, free, 0.5], rel=1e-6)
    assert grids.observed.tolist() == [[[True, True, False]]]


def test_updating_tells_how_many_cells_each_tile_was_the_first_to_show():
    grids = OccupancyGrids(2, Lattice(0.0, 0.0, CELL, 2, 4), 0.9, 0.4, 0.12, 0.97)
    tiles = Tiles(np.full((2, 1, 2), FREE, np.uint8), np.array([[0, 0], [1, 2]], np.int32))
    ids = np.array([0, 1], np.int32)
    inbox = inbox_of(ids, ids[::-1].copy(), tiles.values[::-1].copy(), np.array([[1, 2], [1, 1]], np.int32))
    assert grids.update(np.array([True, True]), tiles, inbox).tolist() == [2, 2, 2, 1]
    assert grids.update(np.array([True, False]), tiles, inbox).tolist() == [0, 0, 0, 0]


# --- following a path ----------------------------------------------------------------------------


class Follow:
    """A follower on real bodies in the open, with every pose and wanted wheel speed along the way."""

    def __init__(self, start, paths, seconds, look_ahead=0.05):
        start = np.array(start, float).reshape(-1, 3)
        place = context(len(start))
        self.motion = PurePursuit(look_ahead=look_ahead).build(place)
        longest = max(map(len, paths))
        waypoints = np.zeros((len(paths), longest, 2))
        for row, path in zip(waypoints, paths, strict=True):
            row[: len(path)] = path
        counts = np.array([len(path) for path in paths], np.int32)
        none = np.full((len(paths), 2), np.nan)
        self.motion.follow(Intents(none, waypoints, counts, np.ones(len(paths), bool)))
        self.poses, self.wanted = [], []
        self.end = RigidDiscs(place.robots, Pymunk(), building(), start).drive(self, seconds)
        self.poses, self.wanted = np.array(self.poses), np.array(self.wanted)

    def command(self, pose):
        wanted = self.motion.command(pose)
        self.poses.append(pose.copy())
        self.wanted.append(wanted.copy())
        return wanted


STAIRS = CELL * np.array(
    [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (4, 2), (5, 2), (6, 3), (7, 4), (7, 5), (6, 6)]
)


def test_a_polyline_with_corners_is_followed_within_5_cm():
    run = Follow([0.0, 0.0, 0.0], [STAIRS], 30.0)
    line = shapely.LineString(STAIRS)
    off = shapely.distance(line, shapely.points(run.poses[:, 0, :2]))
    assert off.max() < 0.05
    for waypoint in STAIRS:
        assert np.linalg.norm(run.poses[:, 0, :2] - waypoint, axis=1).min() < 0.03
    assert shapely.hausdorff_distance(line, shapely.LineString(run.poses[:, 0, :2])) < 0.05


def test_a_robot_never_stops_at_waypoints_on_its_way_but_at_the_last():
    run = Follow([0.0, 0.0, 0.0], [STAIRS], 30.0)
    speed = np.linalg.norm(np.diff(run.poses[:, 0, :2], axis=0), axis=1) * 60.0
    left = np.linalg.norm(run.poses[1:, 0, :2] - STAIRS[-1], axis=1)
    under_way = (np.arange(len(speed)) > 15) & (left > 0.04) & (np.arange(len(speed)) < np.argmax(left < 0.04))
    assert under_way.sum() > 300
    assert speed[under_way].min() > 0.04
    assert speed.max() <= 0.15 * (1.0 + 1e-6)
    assert np.linalg.norm(run.end.pose[0, :2] - STAIRS[-1]) < 0.01
    assert np.abs(run.end.velocity[0]).max() < 1e-3


def test_a_robot_stops_at_the_end_of_a_straight_without_running_past_it():
    run = Follow([0.0, 0.0, 0.0], [[(CELL, 0.0), (4.0 * CELL, 0.0)]], 10.0)
    assert run.poses[:, 0, 0].max() < 4.0 * CELL + 0.005
    assert run.end.pose[0, 0] == pytest.approx(4.0 * CELL, abs=0.01)
    assert np.abs(run.end.velocity[0]).max() < 1e-3


@pytest.mark.parametrize("yaw", [np.pi, 2.5, -2.5, 1.7])
def test_a_path_that_starts_behind_is_turned_to_on_the_spot(yaw):
    run = Follow([0.0, 0.0, yaw], [[(0.5, 0.0), (1.0, 0.0)]], 15.0)
    turning = np.cos(run.poses[:, 0, 2]) < -0.05
    assert turning.sum() > 3
    assert np.linalg.norm(run.poses[turning, 0, :2], axis=1).max() < 0.003
    assert np.linalg.norm(run.end.pose[0, :2] - (1.0, 0.0)) < 0.01


def test_the_shorter_turn_is_taken():
    run = Follow([[0.0, 0.0, 2.5], [0.0, 5.0, -2.5]], [[(1.0, 0.0)], [(1.0, 5.0)]], 1.0)
    assert run.end.pose[0, 2] < 2.5
    assert run.end.pose[1, 2] > -2.5


def test_wanted_speeds_stay_within_the_motors_limits_and_each_robot_follows_its_own_path():
    rng = np.random.default_rng(2)
    start = [[10.0 * i, 0.0, rng.uniform(-3.0, 3.0)] for i in range(20)]
    steps = [rng.uniform(-0.3, 0.3, (rng.integers(1, 9), 2)) for _ in start]
    paths = [np.array(place[:2]) + np.cumsum(each, axis=0) for place, each in zip(start, steps, strict=True)]
    run = Follow(start, paths, 40.0)
    assert np.abs(run.wanted).max() <= 0.15 * (1.0 + 1e-9)
    for robot, path in enumerate(paths):
        assert np.linalg.norm(run.end.pose[robot, :2] - path[-1]) < 0.02
        alone = Follow(start[robot], [path], 5.0)
        if robot < 3:
            assert_array_equal(alone.wanted[:, 0], run.wanted[: len(alone.wanted), robot])


def test_a_robot_without_waypoints_wants_to_stand():
    run = Follow([0.0, 0.0, 1.0], [np.empty((0, 2))], 1.0)
    assert not run.wanted.any()


# --- random streams ------------------------------------------------------------------------------


def draws(streams, purpose, robot=-1):
    return streams.open(purpose, robot).random(8).tolist()


def test_a_stream_depends_on_seed_purpose_and_robot_alone_whatever_was_opened_before():
    names = [("spawn", 0), ("spawn", 1), ("ties", 0), ("ties", -1), ("faults", 3)]
    forwards = {name: draws(Streams(7), *name) for name in names}
    shared = Streams(7)
    backwards = {name: draws(shared, *name) for name in reversed(names)}
    assert forwards == backwards
    assert draws(shared, "spawn", 0) == forwards["spawn", 0]


def test_streams_of_different_seeds_purposes_and_robots_differ():
    opened = [
        tuple(draws(Streams(seed), purpose, robot))
        for seed in (0, 1, 2**63 - 1)
        for purpose in ("spawn", "ties", "")
        for robot in (-1, 0, 1, 99)
    ]
    assert len(set(opened)) == len(opened) == 36


# --- a whole swarm -------------------------------------------------------------------------------

CORRIDOR_WITH_BAY = """
########################
#...##############...###
#...#######.######...###
#....................###
#...##############...###
########################
"""


def world_of(picture, margin=8):
    """The lattice, the floor cells and the walls of a drawing; solid side on the left."""
    solid = np.pad(drawn(picture) == OCCUPIED, margin, constant_values=True)
    solid = np.pad(solid, ((0, 0), (0, -solid.shape[1] % Lattice.WORD)), constant_values=True)
    lattice = Lattice(0.0, 0.0, CELL, *solid.shape)
    boxes = [
        shapely.box(column * CELL, row * CELL, (column + 1) * CELL, (row + 1) * CELL)
        for row, column in np.argwhere(solid)
    ]
    merged = shapely.set_precision(shapely.union_all(boxes), 1e-6)
    walls = []
    for part in shapely.get_parts(shapely.orient_polygons(merged)):
        for ring in (part.exterior, *part.interiors):
            corners = np.array(ring.coords)
            walls.append(np.hstack([corners[:-1], corners[1:]]))
    return lattice, ~solid, np.concatenate(walls)


@pytest.mark.parametrize("seed", range(6))
def test_two_robots_head_on_in_a_narrow_corridor_with_a_bay_get_past_each_other(seed):
    """Nobody hears anybody, so each has to see the far room itself, and the corridor holds one robot at a time."""
    lattice, floor, walls = world_of(CORRIDOR_WITH_BAY)
    hall = building(walls, floor)
    channels = Channels(*tile_channels((6, 7), False))
    place = BuildContext.of(Robots(count=2, spawn="rooms"), lattice, 1.0, Streams(seed), hall, channels=channels)
    starts = lattice.centres(np.array([[8 + 3, 8 + 3], [8 + 3, 8 + 18]]))
    bodies = RigidDiscs(place.robots, Pymunk(), hall, np.column_stack([starts, [0.0, np.pi]]))
    mind = Mapper().build(place)
    parts = Parts(
        actuator=Rig((), ()), sensor=IrRing().build(place), localisation=PerfectLocalisation(),
        computation=mind.computation, strategy=mind.strategy,
        topology=Isolated().build(place), channel=Perfect().build(place),
        motion=PurePursuit().build(place), bodies=bodies, task=Coverage().build(place), building=hall,
        schedule=Schedule(bodies.state()), lattice=lattice,
    )  # fmt: skip
    simulation = Simulation(parts, 1.0, 10**6, "continue")
    blocked = 0
    for _ in range(2000):
        simulation.tick()
        blocked += np.linalg.norm(np.diff(simulation.state.pose[:, :2], axis=0)) < 0.12
        if mind.observed[:, floor].all():
            break
    assert blocked > 0
    assert mind.observed[0, floor].all()
    assert mind.observed[1, floor].all()
