"""Maps, frontiers and paths against dictionaries, shifted arrays and scipy's Dijkstra."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from swarmsim.kernels import occupancy, scratch, search

ONE_CELL = np.zeros((1, 2), np.int32)
PLUS = np.array([[0, 0], [-1, 0], [0, -1], [0, 1], [1, 0]], np.int32)
SQUARE = np.array(sorted(np.ndindex(3, 3), key=lambda offset: offset != (1, 1)), np.int32) - 1
ROW_ORDER = np.uint64(0)
NOW = 10


def rules(neighbours=8, footprint=ONE_CELL):
    span = int(np.abs(footprint).max())
    return search.Rules(0.0, 0.0, 0.15, footprint, span, neighbours, True, 8, 4)


def maps(wall, observed=None, barred=None, shunned=None):
    observed = np.ones_like(wall) if observed is None else observed
    log_odds = np.where(observed, np.where(wall, 1.0, -1.0), 0.0).astype(np.float32)
    none = np.zeros(wall.shape, np.int32)
    return search.Maps(
        log_odds[None],
        observed[None].copy(),
        (none if barred is None else barred)[None].copy(),
        (none if shunned is None else shunned)[None].copy(),
    )


def shifted(cells, row, column, outside=False):
    """At (r, c) the value of `cells` at (r + row, c + column)."""
    rows, columns = cells.shape
    padded = np.pad(cells, 2, constant_values=outside)
    return padded[2 + row : 2 + row + rows, 2 + column : 2 + column + columns]


def standable(wall, observed, footprint=ONE_CELL, barred=None):
    free = observed & ~wall
    for row, column in footprint[1:]:
        free &= ~shifted(observed & wall, row, column)
    return free if barred is None else free & (barred <= NOW)


def distances(standing, start, neighbours, straight=1.0, diagonal=search.SQRT2):
    """Costs (rows, columns) of the cheapest ways from `start`, by scipy, in cells at first; inf where there is none."""
    rows, columns = standing.shape
    standing = standing.copy()
    standing.flat[start] = True
    index = np.arange(standing.size).reshape(standing.shape)
    heads, tails, costs = [], [], []
    for dr, dc in [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)][:neighbours]:
        legal = standing & shifted(standing, dr, dc)
        if dr and dc:
            legal &= shifted(standing, dr, 0) & shifted(standing, 0, dc)
        heads.append(index[legal])
        tails.append(index[legal] + dr * columns + dc)
        costs.append(np.full(legal.sum(), diagonal if dr and dc else straight))
    edges = (np.concatenate(costs), (np.concatenate(heads), np.concatenate(tails)))
    graph = coo_array(edges, shape=(standing.size, standing.size)).tocsr()
    return dijkstra(graph, indices=start).reshape(rows, columns)


def frontiers(wall, observed):
    unknown_beside = np.zeros_like(wall)
    for row, column in [(0, 1), (1, 0), (0, -1), (-1, 0)]:
        unknown_beside |= shifted(~observed, row, column)
    return observed & ~wall & unknown_beside


def random_map(rng, known=1.0):
    shape = rng.integers(1, 28, 2)
    wall = rng.random(shape) < rng.choice([0.0, 0.15, 0.3, 0.45])
    observed = rng.random(shape) < known
    return wall, observed


def shortest(wall, start, goal, neighbours=8, footprint=ONE_CELL, observed=None, barred=None):
    path = np.full(wall.size, -7, np.int32)
    known = maps(wall, observed, barred)
    work = scratch.working_memory(wall.size)
    count = search.a_star(known, 0, NOW, rules(neighbours, footprint), start, goal, work, path)
    return path[:count]


def length(path, columns):
    return np.hypot(np.diff(path // columns), np.diff(path % columns)).sum()


def assert_legal(path, standing, neighbours):
    """Contiguous, on cells a robot may stand in but for the first, and never around the corner of another."""
    rows, columns = np.divmod(path, standing.shape[1])
    assert np.all(standing[rows[1:], columns[1:]])
    down, right = np.diff(rows), np.diff(columns)
    assert np.all(np.maximum(np.abs(down), np.abs(right)) == 1)
    diagonal = (down != 0) & (right != 0)
    assert neighbours == 8 or not diagonal.any()
    passable = standing.copy()
    passable[rows[0], columns[0]] = True
    before = np.flatnonzero(diagonal)
    assert np.all(passable[rows[before] + down[before], columns[before]])
    assert np.all(passable[rows[before], columns[before] + right[before]])
    assert len(set(path.tolist())) == len(path)


# --- A* ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("neighbours", [4, 8])
@pytest.mark.parametrize("footprint", [ONE_CELL, PLUS, SQUARE], ids=["cell", "plus", "square"])
def test_a_star_is_as_short_as_dijkstra_on_200_random_grids(neighbours, footprint):
    rng = np.random.default_rng(neighbours * 10 + len(footprint))
    found = 0
    for _ in range(200):
        wall, observed = random_map(rng, rng.choice([1.0, 0.8]))
        barred = np.where(rng.random(wall.shape) < 0.05, rng.integers(NOW - 2, NOW + 3, wall.shape), 0).astype(np.int32)
        standing = standable(wall, observed, footprint, barred)
        start, goal = rng.integers(0, wall.size, 2)
        expected = distances(standing, start, neighbours).flat[goal]
        path = shortest(wall, start, goal, neighbours, footprint, observed, barred)
        if np.isinf(expected):
            assert len(path) == 0
            continue
        assert path[0] == start
        assert path[-1] == goal
        assert_legal(path, standing, neighbours)
        assert length(path, wall.shape[1]) == pytest.approx(expected, abs=1e-9)
        found += 1
    assert 20 < found < 180


def test_a_star_gives_the_same_way_whatever_was_searched_before():
    rng = np.random.default_rng(14)
    used = scratch.working_memory(28 * 28)
    for _ in range(60):
        wall, _ = random_map(rng)
        start, goal = rng.integers(0, wall.size, 2)
        path = np.zeros(wall.size, np.int32)
        count = search.a_star(maps(wall), 0, NOW, rules(), start, goal, used, path)
        assert_array_equal(path[:count], shortest(wall, start, goal))


def test_a_bounded_search_goes_on_where_it_paused_and_finds_the_same():
    rng, paused = np.random.default_rng(15), 0
    for _ in range(60):
        wall, observed = random_map(rng, 0.998)
        known, start = maps(wall, observed), int(rng.integers(0, wall.size))
        work, path = scratch.working_memory(wall.size), np.zeros(wall.size, np.int32)
        told = (known, 0, NOW, rules(), start, np.uint64(0))
        while True:
            work.left[0] = 5
            found = search.nearest_frontier(*told, work)
            assert work.left[0] >= 0
            if found[1] != search.PAUSED:
                break
            assert work.left[0] == 0
            paused += 1
        whole = scratch.working_memory(wall.size)
        assert found == search.nearest_frontier(*told, whole)
        if found[1] >= 0:
            way = path[: search.traced(found[1], work, path)]
            assert (way[0], way[-1]) == (start, found[1])
            assert length(way, wall.shape[1]) == pytest.approx(
                length(shortest(wall, start, found[1], observed=observed), wall.shape[1])
            )
    assert paused > 20


def test_a_paused_search_is_given_up_where_the_robot_has_moved():
    known, work = maps(np.zeros((1, 40), bool), np.arange(40)[None] < 39), scratch.working_memory(40)
    work.left[0] = 5
    assert search.nearest_frontier(known, 0, NOW, rules(), 0, np.uint64(0), work)[1] == search.PAUSED
    work.left[0] = 5
    assert search.nearest_frontier(known, 0, NOW, rules(), 36, np.uint64(0), work) == (38, 38)


def test_the_way_from_a_cell_to_itself_is_that_cell():
    assert shortest(np.zeros((3, 3), bool), 4, 4).tolist() == [4]


def test_a_robot_may_leave_a_cell_that_it_would_not_enter():
    wall = np.zeros((1, 4), bool)
    wall[0, 0] = True
    assert shortest(wall, 0, 3).tolist() == [0, 1, 2, 3]
    assert shortest(wall, 3, 0).tolist() == []


def test_unknown_cells_are_no_way():
    observed = np.ones((1, 5), bool)
    observed[0, 2] = False
    assert shortest(np.zeros((1, 5), bool), 0, 4, observed=observed).tolist() == []


def test_diagonal_steps_do_not_cut_the_corner_of_a_wall():
    wall = np.zeros((2, 2), bool)
    assert shortest(wall, 0, 3, 8).tolist() == [0, 3]
    assert len(shortest(wall, 0, 3, 4)) == 3
    wall[0, 1] = True
    assert shortest(wall, 0, 3, 8).tolist() == [0, 2, 3]
    wall[1, 0] = True
    assert shortest(wall, 0, 3, 8).tolist() == []


@pytest.mark.parametrize("until", [NOW, NOW + 1])
def test_a_barred_cell_opens_again_when_its_time_is_over(until):
    barred = np.zeros((1, 3), np.int32)
    barred[0, 1] = until
    assert len(shortest(np.zeros((1, 3), bool), 0, 2, barred=barred)) == (3 if until == NOW else 0)


def test_a_wide_robot_takes_the_wide_way():
    """A door one cell wide is near, one three cells wide is far."""
    wall = np.zeros((13, 9), bool)
    wall[:, 4] = True
    wall[1, 4] = False
    wall[8:11, 4] = False
    start, goal = 1 * 9 + 1, 1 * 9 + 7
    assert 1 * 9 + 4 in shortest(wall, start, goal)
    assert 9 * 9 + 4 in shortest(wall, start, goal, footprint=SQUARE)


# --- frontiers -----------------------------------------------------------------------------------


def test_a_frontier_is_free_and_known_with_an_unknown_cell_across_an_edge():
    rng = np.random.default_rng(31)
    both = set()
    for _ in range(300):
        wall, observed = random_map(rng, rng.choice([0.3, 0.7, 0.95]))
        known = maps(wall, observed)
        expected = frontiers(wall, observed)
        for r, c in np.ndindex(wall.shape):
            assert search.is_frontier(known, 0, r, c) == expected[r, c]
        both |= set(expected.flat)
    assert both == {True, False}


def test_a_cell_as_likely_free_as_occupied_is_no_frontier_and_not_entered():
    observed = np.array([[True, True, False]])
    log_odds = np.array([[-1.0, 0.0, 0.0]], np.float32)
    none = np.zeros((1, 1, 3), np.int32)
    known = search.Maps(log_odds[None], observed[None], none, none)
    assert not search.is_frontier(known, 0, 0, 1)
    assert not search.fits(known, 0, NOW, rules(), 0, 1)


def nearest(wall, observed, start, salt=ROW_ORDER, neighbours=8, footprint=ONE_CELL, shunned=None):
    work = scratch.working_memory(wall.size)
    known = maps(wall, observed, shunned=shunned)
    return search.nearest_frontier(known, 0, NOW, rules(neighbours, footprint), start, np.uint64(salt), work)


def splitmix64(value):
    """The finaliser of Steele, Lea and Flood (2014), in Python's unbounded integers."""
    low = 2**64 - 1
    z = (value + 0x9E3779B97F4A7C15) & low
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & low
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & low
    return z ^ (z >> 31)


def equally_near(wall, observed, start, neighbours, shunned=0):
    """All the frontier cells at the least distance from `start`, in row-major order."""
    far = distances(standable(wall, observed), start, neighbours)
    far = np.where(frontiers(wall, observed) & (np.asarray(shunned) <= NOW), far, np.inf)
    return np.flatnonzero(far <= far.min() + 1e-9) if np.isfinite(far.min()) else np.array([-1])


@pytest.mark.parametrize("neighbours", [4, 8])
def test_the_nearest_frontier_is_the_first_in_row_order_of_those_at_the_least_distance(neighbours):
    rng = np.random.default_rng(41 + neighbours)
    kinds = {"none": 0, "one": 0, "tied": 0}
    for _ in range(400):
        wall, observed = random_map(rng, rng.choice([0.9, 0.97, 1.0]))
        shunned = np.where(rng.random(wall.shape) < 0.2, rng.integers(NOW - 2, NOW + 3, wall.shape), 0).astype(np.int32)
        start = rng.choice(np.flatnonzero(observed & ~wall)) if (observed & ~wall).any() else 0
        near = equally_near(wall, observed, start, neighbours, shunned)
        goal, stand = nearest(wall, observed, start, neighbours=neighbours, shunned=shunned)
        assert goal == stand == near[0]
        kinds["none" if near[0] < 0 else "one" if len(near) == 1 else "tied"] += 1
    assert min(kinds.values()) > 30


@pytest.mark.parametrize("neighbours", [4, 8])
def test_with_a_salt_ties_are_broken_by_cell_and_salt_alone(neighbours):
    """The order is a hash of the cell, so it is the same from wherever the search comes."""
    rng = np.random.default_rng(51 + neighbours)
    tied = changed = 0
    for _ in range(400):
        wall, observed = random_map(rng, 0.95)
        start = rng.choice(np.flatnonzero(observed & ~wall)) if (observed & ~wall).any() else 0
        salt = int(rng.integers(1, 2**63))
        near = equally_near(wall, observed, start, neighbours)
        goal, stand = nearest(wall, observed, start, salt, neighbours)
        assert goal == stand == min(near, key=lambda cell, salt=salt: splitmix64(int(cell) ^ salt))
        tied += len(near) > 1
        changed += goal != near[0]
    assert tied > 50
    assert changed > 20


def test_two_frontiers_rank_alike_from_either_side_of_a_corridor_and_no_salt_favours_a_direction():
    """In a corridor open at both ends, from its middle, with every salt, and mirrored."""
    observed = np.ones((1, 13), bool)
    observed[0, [0, -1]] = False
    wall = np.zeros((1, 13), bool)
    choices = [nearest(wall, observed, 6, salt)[0] for salt in range(1, 201)]
    assert choices == [nearest(wall, observed, 6, salt)[0] for salt in range(1, 201)]
    assert set(choices) == {1, 11}
    assert 60 < choices.count(1) < 140


@pytest.mark.parametrize("footprint", [PLUS, SQUARE], ids=["plus", "square"])
def test_a_wide_robot_explores_from_the_nearest_cell_that_it_fits_into(footprint):
    """A frontier that it fits into is explored from itself, another from a cell beside it."""
    rng = np.random.default_rng(61)
    kinds = {"none": 0, "itself": 0, "beside": 0}
    for _ in range(300):
        wall, observed = random_map(rng, rng.choice([0.9, 0.97]))
        standing = standable(wall, observed, footprint)
        rows, columns = wall.shape
        start = int(rng.integers(0, wall.size))
        border = frontiers(wall, observed)
        explored = {}
        for cell in range(wall.size):
            r, c = divmod(cell, columns)
            around = [
                row * columns + column
                for row in range(max(r - 1, 0), min(r + 2, rows))
                for column in range(max(c - 1, 0), min(c + 2, columns))
                if border[row, column] and ((row, column) == (r, c) or not standing[row, column])
            ]
            if around:
                explored[cell] = around[0]
        far = distances(standing, start, 8).ravel()
        # The robot already stands at `start`, whether it fits there or not.
        stands = sorted((far[cell] if cell != start else -1.0, cell) for cell in explored if np.isfinite(far[cell]))
        goal, stand = nearest(wall, observed, start, footprint=footprint)
        if not stands:
            assert (goal, stand) == (-1, -1)
            kinds["none"] += 1
            continue
        tied = [cell for distance, cell in stands if distance <= stands[0][0] + 1e-9]
        assert stand == tied[0]
        assert goal == explored[stand]
        kinds["itself" if goal == stand else "beside"] += 1
    assert min(kinds.values()) > 10


# --- fusing tiles --------------------------------------------------------------------------------

HIT, MISS, LOW, HIGH = (np.float32(value) for value in (0.75, -0.5, -1.25, 1.5))  # sums are exact in float32


def fuse_plainly(shape, alive, tiles, origins, receivers, heard, heard_origins, belief):
    """The same with one dictionary of cells per robot; `belief` is changed, the fresh counts are given."""
    own = [(i, tiles[i], origins[i]) if alive[i] else None for i in range(len(alive))]
    said = [(i, heard[m], heard_origins[m]) for m, i in enumerate(receivers)]
    fresh = []
    for message in own + said:
        new = 0
        if message is not None:
            robot, tile, origin = message
            for (r, c), value in np.ndenumerate(tile):
                cell = (origin[0] + r, origin[1] + c)
                if value and 0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1]:
                    new += cell not in belief[robot]
                    gained = belief[robot].get(cell, 0.0) + (0.75 if value == 2 else -0.5)
                    belief[robot][cell] = min(max(gained, -1.25), 1.5)
        fresh.append(new)
    return fresh


SAID = np.empty((0, 0, 0), np.float32)  # by the sensor itself: nothing


def test_fusing_equals_dictionaries_of_clamped_sums():
    rng = np.random.default_rng(71)
    lowest = highest = outside = 0
    for _ in range(60):
        robots, shape, window = rng.integers(1, 6), tuple(rng.integers(3, 12, 2)), rng.integers(1, 8, 2)
        log_odds, observed = np.zeros((robots, *shape), np.float32), np.zeros((robots, *shape), bool)
        belief = [{} for _ in range(robots)]
        alive = rng.random(robots) < 0.8
        for _ in range(8):
            tiles = rng.integers(0, 3, (robots, *window)).astype(np.uint8)
            origins = rng.integers(-8, 12, (robots, 2)).astype(np.int32)
            receivers = np.sort(rng.choice(np.flatnonzero(alive), rng.integers(0, 8))) if alive.any() else np.empty(0)
            receivers = receivers.astype(np.int32)
            heard = rng.integers(0, 3, (len(receivers), *window)).astype(np.uint8)
            heard_origins = rng.integers(-8, 12, (len(receivers), 2)).astype(np.int32)
            fresh = np.full(robots + len(receivers), -1, np.int32)
            messages = (tiles, origins, receivers, heard, heard_origins)
            occupancy.fuse(log_odds, observed, alive, tiles, SAID, *messages[1:], HIT, MISS, LOW, HIGH, fresh)
            assert fresh.tolist() == fuse_plainly(shape, alive, *messages, belief)
            outside += np.sum(origins < 0)
        for robot in range(robots):
            expected = np.zeros(shape)
            for cell, value in belief[robot].items():
                expected[cell] = value
            assert_array_equal(log_odds[robot], expected)
            assert {tuple(map(int, cell)) for cell in np.argwhere(observed[robot])} == {
                (int(r), int(c)) for r, c in belief[robot]
            }
        lowest, highest = lowest + np.sum(log_odds == LOW), highest + np.sum(log_odds == HIGH)
    assert min(lowest, highest, outside) > 20


def fuse_one_cell(own, *heard):
    log_odds, observed = np.zeros((1, 1, 1), np.float32), np.zeros((1, 1, 1), bool)
    fresh = np.zeros(1 + len(heard), np.int32)
    occupancy.fuse(
        log_odds, observed, np.ones(1, bool), np.full((1, 1, 1), own, np.uint8), SAID, np.zeros((1, 2), np.int32),
        np.zeros(len(heard), np.int32), np.array(heard, np.uint8).reshape(-1, 1, 1),
        np.zeros((len(heard), 2), np.int32), HIT, MISS, LOW, HIGH, fresh,
    )  # fmt: skip
    return log_odds.item(), fresh.tolist()


def test_the_own_tile_comes_first_then_those_heard_in_order():
    """At a clamp the order shows: three hits and a miss end lower than a miss and three hits."""
    assert fuse_one_cell(2, 2, 2, 1) == (1.0, [1, 0, 0, 0])
    assert fuse_one_cell(2, 1, 2, 2) == (1.5, [1, 0, 0, 0])
    assert fuse_one_cell(1, 2, 2, 2) == (1.5, [1, 0, 0, 0])


def test_unknown_cells_of_a_tile_teach_nothing():
    assert fuse_one_cell(0) == (0.0, [0])
    assert fuse_one_cell(0, 0, 1) == (-0.5, [0, 0, 1])
