"""Beams, bins and tiles against exact rational arithmetic and against shadows cut with shapely."""

import math
from fractions import Fraction

import numpy as np
import pytest
import shapely
from conftest import building, setting_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from shapely.affinity import rotate, scale

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, State
from swarmsim.core.streams import Streams
from swarmsim.kernels import rays
from swarmsim.robots.sensors import IrRing

CELL = 0.15
NO_WALLS = np.empty((0, 4))
NO_DISCS = np.empty((0, 3))


def exact_cast(origin, angle, reach, walls, discs):
    """Distance to the first surface, with every comparison made in rational numbers."""
    x, y = map(Fraction, origin)
    dx, dy = Fraction(math.cos(angle)), Fraction(math.sin(angle))
    best = reach
    for x1, y1, x2, y2 in ([Fraction(float(value)) for value in wall] for wall in walls):
        turn = dx * (y2 - y1) - dy * (x2 - x1)
        if turn == 0:
            continue
        along = ((x1 - x) * (y2 - y1) - (y1 - y) * (x2 - x1)) / turn
        share = ((x1 - x) * dy - (y1 - y) * dx) / turn
        if 0 <= share <= 1 and along >= 0:
            best = min(best, float(along))
    for cx, cy, radius in ([Fraction(float(value)) for value in disc] for disc in discs):
        # |origin + t direction - centre|^2 = radius^2, a quadratic in t
        a = dx * dx + dy * dy
        half_b = dx * (x - cx) + dy * (y - cy)
        c = (x - cx) ** 2 + (y - cy) ** 2 - radius**2
        under = half_b**2 - a * c
        if under >= 0 and half_b <= 0:
            best = min(best, (float(-half_b) - math.sqrt(under)) / float(a))
    return best


def beam(origin, angle, reach, walls, discs=NO_DISCS):
    distance, hit = rays.cast(np.array(origin, float), np.array([angle], float), reach, np.array(walls, float), discs)
    return distance[0], hit[0]


def lattice(rows=40, columns=44, cell=CELL, x0=-1.2, y0=-0.9):
    return Lattice(x0, y0, cell, rows, columns)


def swarm(pose, alive=None):
    pose = np.asarray(pose, float).reshape(-1, 3)
    alive = np.ones(len(pose), bool) if alive is None else np.asarray(alive)
    return State(0, pose, np.zeros_like(pose), np.zeros((len(pose), 2)), alive)


def sensor(walls=NO_WALLS, grid=None, radius=0.055, **parameters):
    robots = Robots(count=1, spawn="anywhere", radius=radius)
    return IrRing(**parameters).build(BuildContext.of(robots, grid or lattice(), 1.0, Streams(1), building(walls)))


def outline(solid):
    """The boundary of walls as segments with the solid side on the left."""
    parts = shapely.get_parts(shapely.orient_polygons(solid))
    corners = [np.array(ring.coords) for part in parts for ring in (part.exterior, *part.interiors)]
    return np.concatenate([np.hstack([each[:-1], each[1:]]) for each in corners])


def visible_from(x, y, pieces):
    """Whatever no convex wall piece covers or puts in its shadow, within 2 m."""
    shadows = [
        shapely.convex_hull(shapely.union(piece, scale(piece, 1000.0, 1000.0, origin=(x, y)))) for piece in pieces
    ]
    return shapely.difference(shapely.box(x - 2.0, y - 2.0, x + 2.0, y + 2.0), shapely.union_all(shadows))


def cell_box(grid, row, column):
    x, y = grid.x0 + column * grid.cell, grid.y0 + row * grid.cell
    return shapely.box(x, y, x + grid.cell, y + grid.cell)


def observed_cells(tiles, robot=0):
    """(row, column, value) of all cells in a tile that are not unknown."""
    for r, c in np.argwhere(tiles.values[robot] != UNKNOWN):
        yield tiles.origins[robot, 0] + r, tiles.origins[robot, 1] + c, tiles.values[robot, r, c]


def assert_sees_no_further_than_light(tiles, grid, pose, pieces):
    solid = shapely.union_all(pieces)
    for robot, (x, y, _) in enumerate(pose):
        visible = visible_from(x, y, pieces)
        for row, column, value in observed_cells(tiles, robot):
            box = cell_box(grid, row, column)
            if value == FREE:
                assert shapely.area(shapely.intersection(box, visible)) > 1e-9, f"({row}, {column}) lies behind a wall"
            else:
                assert shapely.intersects(box, solid), f"({row}, {column}) is no wall"
                seen = shapely.distance(shapely.intersection(box, solid), visible)
                assert seen < 3e-6, f"the wall in ({row}, {column}) cannot be seen"


# --- beams ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("chunk", range(10))
def test_cast_equals_exact_arithmetic_on_1000_random_beams(chunk):
    rng = np.random.default_rng(chunk)
    met = 0
    for _ in range(40):
        origin = rng.uniform(-2.0, 2.0, 2)
        walls = rng.uniform(-2.0, 2.0, (rng.integers(0, 9), 4))
        discs = np.column_stack([rng.uniform(-2.0, 2.0, (6, 2)), rng.uniform(0.02, 0.3, 6)])[: rng.integers(0, 7)]
        discs = discs[np.hypot(*(discs[:, :2] - origin).T) > discs[:, 2] + 0.01]
        angles, reach = rng.uniform(-10.0, 10.0, 25), rng.uniform(0.5, 4.0)
        distance, hit = rays.cast(origin, angles, reach, walls, discs)
        expected = [exact_cast(origin, angle, reach, walls, discs) for angle in angles]
        assert_allclose(distance, expected, rtol=0.0, atol=1e-9)
        assert_array_equal(hit >= 0, np.array(expected) < reach)
        met += np.sum(hit >= 0)
    assert 200 < met < 950


def test_the_hit_names_the_surface_on_which_the_beam_ends():
    rng = np.random.default_rng(77)
    kinds = set()
    for _ in range(200):
        walls = rng.uniform(-2.0, 2.0, (5, 4))
        discs = np.column_stack([rng.uniform(-2.0, 2.0, (4, 2)), np.full(4, 0.1)])
        origin, angles = np.array([3.0, 3.0]), rng.uniform(-np.pi, np.pi, 20)
        distance, hit = rays.cast(origin, angles, 8.0, walls, discs)
        for angle, far, which in zip(angles, distance, hit, strict=True):
            end = shapely.Point(origin + far * np.array([math.cos(angle), math.sin(angle)]))
            if 0 <= which < 5:
                assert shapely.LineString(walls[which].reshape(2, 2)).distance(end) < 1e-9
                kinds.add("wall")
            elif which >= 5:
                assert abs(shapely.Point(discs[which - 5, :2]).distance(end) - 0.1) < 1e-7
                kinds.add("disc")
            else:
                assert far == 8.0
                kinds.add("nothing")
    assert kinds == {"wall", "disc", "nothing"}


@settings(derandomize=True, deadline=None, max_examples=300)
@given(
    st.lists(st.floats(0.05, 1.0), min_size=3, max_size=24),
    st.floats(0.0, 7.0),
    st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
)
def test_beams_at_the_corners_of_a_closed_room_never_slip_out(radii, turn, middle):
    """Around a point that sees the whole room, each corner belongs to two walls, one on either side of its beam."""
    bearings = turn + np.arange(len(radii)) * (2.0 * np.pi / len(radii))
    corners = np.array(middle) + np.array(radii)[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
    walls = np.hstack([corners, np.roll(corners, -1, axis=0)])
    offsets = corners - middle
    angles = np.arctan2(offsets[:, 1], offsets[:, 0])
    distance, hit = rays.cast(np.array(middle), angles, 5.0, walls, NO_DISCS)
    assert_allclose(distance, np.hypot(*offsets.T), rtol=0.0, atol=1e-9)
    index = np.arange(len(radii))
    assert np.all((hit == index) | (hit == (index - 1) % len(radii)))


def test_beams_at_the_corner_of_a_convex_pillar_never_slip_in():
    rng = np.random.default_rng(5)
    for _ in range(500):
        square = rotate(shapely.box(0.0, 0.0, *rng.uniform(0.05, 1.0, 2)), rng.uniform(0.0, 360.0))
        walls = outline(square)
        origin = rng.uniform(-3.0, 3.0, 2)
        if shapely.distance(square, shapely.Point(origin)) < 0.01:
            continue
        for corner in walls[:, :2]:
            towards = corner - origin
            far = np.hypot(*towards)
            beyond = shapely.LineString([corner + 1e-6 * towards, corner + 10.0 * towards])
            before = shapely.LineString([origin, corner - 1e-6 * towards])
            if beyond.intersects(square) and not before.intersects(square):
                assert beam(origin, math.atan2(towards[1], towards[0]), 20.0, walls)[0] <= far + 1e-9


def test_a_beam_along_a_wall_ends_at_its_near_end():
    assert beam((0.0, 0.0), 0.0, 5.0, [[1.0, 0.0, 3.0, 0.0]]) == (1.0, 0)
    assert beam((0.0, 0.0), 0.0, 5.0, [[3.0, 0.0, 1.0, 0.0]]) == (1.0, 0)
    assert beam((2.0, 0.0), 0.0, 5.0, [[1.0, 0.0, 3.0, 0.0]]) == (0.0, 0)


def test_a_beam_along_the_line_of_a_wall_that_lies_behind_it_meets_nothing():
    assert beam((4.0, 0.0), 0.0, 5.0, [[1.0, 0.0, 3.0, 0.0]]) == (5.0, -1)


@pytest.mark.parametrize("quarter", range(4))
def test_a_beam_along_the_side_of_a_square_pillar_is_stopped_by_the_pillar(quarter):
    square = rotate(shapely.box(1.0, 0.0, 2.0, 1.0), 90.0 * quarter, origin=(0.0, 0.0))
    walls = np.round(outline(square))
    distance, hit = beam((0.0, 0.0), quarter * math.pi / 2.0, 5.0, walls)
    assert distance == pytest.approx(1.0, abs=1e-9)
    assert hit >= 0


def test_a_beam_parallel_to_a_wall_beside_it_meets_nothing():
    assert beam((0.0, 0.0), 0.0, 5.0, [[1.0, 1e-9, 3.0, 1e-9]]) == (5.0, -1)


def test_a_beam_that_grazes_the_end_of_a_wall_meets_it_and_one_a_nanometre_off_does_not():
    assert beam((0.0, 0.0), 0.0, 5.0, [[2.0, 0.0, 2.0, 1.0]]) == (2.0, 0)
    assert beam((0.0, 0.0), 0.0, 5.0, [[2.0, 1.0, 2.0, 0.0]]) == (2.0, 0)
    assert beam((0.0, 0.0), 0.0, 5.0, [[2.0, 1e-9, 2.0, 1.0]]) == (5.0, -1)


def test_a_beam_tangent_to_a_disc_touches_it_and_one_a_nanometre_off_does_not():
    assert beam((0.0, 0.0), 0.0, 5.0, NO_WALLS, np.array([[3.0, 1.0, 1.0]])) == (3.0, 0)
    assert beam((0.0, 0.0), 0.0, 5.0, NO_WALLS, np.array([[3.0, 1.0 + 1e-9, 1.0]])) == (5.0, -1)


def test_a_surface_exactly_at_reach_is_met_and_one_beyond_is_not():
    assert beam((0.0, 0.0), 0.0, 2.0, [[2.0, -1.0, 2.0, 1.0]]) == (2.0, 0)
    assert beam((0.0, 0.0), 0.0, 2.0, [[2.0000001, -1.0, 2.0000001, 1.0]]) == (2.0, -1)


def test_walls_and_discs_behind_the_beam_are_not_met():
    assert beam((0.0, 0.0), 0.0, 5.0, [[-1.0, -1.0, -1.0, 1.0]], np.array([[-2.0, 0.0, 0.5]])) == (5.0, -1)


def test_of_two_walls_at_the_same_distance_the_later_row_is_named():
    wall = [2.0, -1.0, 2.0, 1.0]
    assert beam((0.0, 0.0), 0.0, 5.0, [wall, [3.0, -1.0, 3.0, 1.0], wall]) == (2.0, 2)


# --- bins ----------------------------------------------------------------------------------------


def test_bins_never_lose_a_wall_within_reach():
    rng = np.random.default_rng(3)
    close = listed = 0
    for _ in range(100):
        walls = rng.uniform(-1.0, 7.0, (12, 4))
        reach, side = rng.uniform(0.1, 1.5), rng.uniform(0.2, 2.0)
        rows, columns = rng.integers(1, 8, 2)
        x0, y0 = rng.uniform(-1.0, 1.0, 2)
        start, members = rays.bins(walls, reach, x0, y0, side, rows, columns)
        assert start[0] == 0
        assert start[-1] == len(members)
        for square in range(rows * columns):
            inside = members[start[square] : start[square + 1]]
            assert np.all(np.diff(inside) > 0)
            corner = np.array([x0 + square % columns * side, y0 + square // columns * side])
            room = shapely.box(*corner, *(corner + side))
            for index, wall in enumerate(walls):
                if room.distance(shapely.LineString(wall.reshape(2, 2))) <= reach:
                    assert index in inside
                    close += 1
            listed += len(inside)
    assert close <= listed < 2.5 * close


def test_tiles_do_not_depend_on_the_coarse_squares():
    """With a far greater reach than the tile every wall is near; with the default most are not."""
    rng = np.random.default_rng(8)
    walls = rng.uniform(0.0, 4.0, (40, 4))
    walls[:, 2:] = walls[:, :2] + rng.uniform(-0.4, 0.4, (40, 2))
    state = swarm(np.column_stack([rng.uniform(0.0, 4.0, (100, 2)), rng.uniform(-4.0, 4.0, 100)]))
    near, far = sensor(walls, reach=1.0).sense(state).tiles, sensor(walls, reach=50.0).sense(state).tiles
    assert_array_equal(near.values, far.values)


# --- tiles ---------------------------------------------------------------------------------------


def test_in_the_open_all_42_cells_are_free_from_2000_random_poses():
    rng = np.random.default_rng(1)
    pose = np.column_stack([rng.uniform(0.0, 4.0, 2000), rng.uniform(0.0, 4.0, 2000), rng.uniform(-7.0, 7.0, 2000)])
    tiles = sensor().sense(swarm(pose)).tiles
    assert tiles.values.shape == (2000, 6, 7)
    assert np.all(tiles.values == FREE)


def test_in_the_open_all_cells_are_free_from_cell_centres_edges_and_corners():
    grid = lattice()
    halves = [
        (grid.x0 + (20 + 0.5 * i) * CELL, grid.y0 + (20 + 0.5 * j) * CELL, k * math.pi / 36)
        for i in range(3) for j in range(3) for k in range(72)
    ]  # fmt: skip
    assert np.all(sensor().sense(swarm(halves)).tiles.values == FREE)


@settings(derandomize=True, deadline=None, max_examples=150)
@given(st.integers(1, 12), st.integers(1, 12), st.floats(0.02, 1.0), st.integers(0, 2**32 - 1))
def test_the_least_number_of_beams_that_is_accepted_sees_every_cell_in_the_open(rows, columns, cell, seed):
    grid = lattice(60, 60, cell, 0.0, 0.0)
    reach = cell * math.hypot(rows, columns)
    with pytest.raises(InputError, match=r"^beams: 1 beams .* at least \d+ are needed$") as refused:
        sensor(grid=grid, tile=(rows, columns), reach=reach, beams=1)
    needed = int(str(refused.value).split()[-3])
    with pytest.raises(InputError, match=r"^beams: \d+ beams lie "):
        sensor(grid=grid, tile=(rows, columns), reach=reach, beams=needed - 1)
    rng = np.random.default_rng(seed)
    pose = np.column_stack([rng.uniform(20.0 * cell, 40.0 * cell, (20, 2)), rng.uniform(-4.0, 4.0, 20)])
    tiles = sensor(grid=grid, tile=(rows, columns), reach=reach, beams=needed).sense(swarm(pose)).tiles
    assert np.all(tiles.values == FREE)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.integers(1, 9), st.integers(1, 9), st.floats(0.0, 4.0), st.floats(0.0, 4.0))
def test_odd_sides_centre_on_the_robots_cell_and_even_sides_on_the_nearest_edge(rows, columns, x, y):
    grid = lattice()
    origin = sensor(tile=(rows, columns), beams=400).sense(swarm([x, y, 0.3])).tiles.origins[0]
    for first, size, position in ((origin[0], rows, (y - grid.y0) / CELL), (origin[1], columns, (x - grid.x0) / CELL)):
        if size % 2:
            assert first + (size - 1) / 2 == math.floor(position)
        else:
            assert abs(first + size / 2 - position) <= 0.5 + 1e-9


def test_cells_beyond_reach_stay_unknown():
    grid = lattice()
    pose = np.array([[2.02, 2.03, 0.4]])
    tiles = sensor(grid=grid, reach=0.3).sense(swarm(pose)).tiles
    free = 0
    for row, column, value in observed_cells(tiles):
        assert value == FREE
        assert cell_box(grid, row, column).distance(shapely.Point(pose[0, :2])) < 0.3
        free += 1
    assert 9 <= free < 42


def test_dead_robots_have_unknown_tiles_and_do_not_stop_beams():
    pose = [[1.0, 1.0, 0.0], [1.3, 1.0, 0.0]]
    tiles = sensor(robots="occupied").sense(swarm(pose, [True, False])).tiles
    assert np.all(tiles.values[1] == UNKNOWN)
    assert np.all(tiles.values[0] == FREE)
    assert np.any(sensor(robots="occupied").sense(swarm(pose)).tiles.values[0] == OCCUPIED)


def test_a_robot_that_is_ignored_changes_nothing():
    pose = [[1.0, 1.0, 0.0], [1.3, 1.0, 0.0]]
    assert np.all(sensor(robots="ignored").sense(swarm(pose)).tiles.values == FREE)
    assert IrRing().robots == "ignored"


@pytest.mark.parametrize("seen", ["occlude", "occupied"])
def test_a_robot_that_occludes_hides_what_is_behind_it(seen):
    grid = lattice()
    rng = np.random.default_rng(11)
    hidden = marked = 0
    for _ in range(200):
        x, y = rng.uniform(1.0, 2.0, 2)
        bearing, apart = rng.uniform(-np.pi, np.pi), rng.uniform(0.12, 0.7)
        other = (x + apart * math.cos(bearing), y + apart * math.sin(bearing))
        tiles = sensor(grid=grid, robots=seen).sense(swarm([[x, y, rng.uniform(-4.0, 4.0)], [*other, 0.0]])).tiles
        body = shapely.Point(other).buffer(0.055, quad_segs=64)
        visible = visible_from(x, y, [body])
        for row, column, value in observed_cells(tiles):
            box = cell_box(grid, row, column)
            if value == FREE:
                assert shapely.area(shapely.intersection(box, visible)) > 1e-9
            else:
                assert seen == "occupied"
                assert shapely.distance(shapely.intersection(box, body), visible) < 1e-4
        hidden += np.sum(tiles.values[0] == UNKNOWN)
        marked += np.sum(tiles.values[0] == OCCUPIED)
    assert hidden > 50
    assert (marked > 100) == (seen == "occupied")


def test_a_straight_wall_on_a_cell_edge_splits_the_tile_exactly():
    """Before it nothing is occupied, in its first layer nothing is free, and all beyond is unknown."""
    grid = lattice()
    rng = np.random.default_rng(2)
    for _ in range(300):
        column = 24
        x_wall = grid.x0 + column * CELL
        solid = shapely.box(x_wall, -5.0, x_wall + 20 * CELL, 10.0)
        pose = [x_wall - rng.uniform(0.06, 0.5), rng.uniform(1.0, 3.0), rng.uniform(-4.0, 4.0)]
        tiles = sensor(outline(solid), grid).sense(swarm(pose)).tiles
        values, first = tiles.values[0], tiles.origins[0, 1]
        columns = first + np.arange(7)
        assert np.all(values[:, columns < column] == FREE)
        assert not np.any(values[:, columns >= column] == FREE)
        assert np.all(values[:, columns > column] == UNKNOWN)
        beside = np.flatnonzero(columns == column)
        if len(beside):
            straight_ahead = int((pose[1] - grid.y0) // CELL) - tiles.origins[0, 0]
            assert values[straight_ahead, beside[0]] == OCCUPIED


@pytest.mark.parametrize("chunk", range(4))
def test_among_walls_on_cell_edges_occupied_is_wall_free_is_floor_and_nothing_is_seen_through_a_wall(chunk):
    """Robots stand anywhere, and at cell centres with beams that pass exactly through the corners of cells."""
    rng = np.random.default_rng(chunk)
    seen = {FREE: 0, OCCUPIED: 0, UNKNOWN: 0}
    for _ in range(12):
        grid = lattice(16, 16)
        wall = rng.random(grid.shape) < rng.uniform(0.05, 0.45)
        wall[:4], wall[-4:], wall[:, :4], wall[:, -4:] = True, True, True, True
        floor = np.argwhere(~wall)
        if not len(floor):
            continue
        pieces = [cell_box(grid, row, column) for row, column in np.argwhere(wall)]
        cells = floor[rng.integers(0, len(floor), 8)]
        offsets = np.vstack([rng.uniform(-0.45, 0.45, (5, 2)), np.zeros((3, 2))]) * CELL
        yaw = np.append(rng.uniform(-4.0, 4.0, 5), [0.0, math.pi / 4.0, -math.pi / 2.0])
        pose = np.column_stack([grid.centres(cells) + offsets, yaw])
        tiles = sensor(outline(shapely.union_all(pieces)), grid).sense(swarm(pose)).tiles
        for robot in range(len(pose)):
            for row, column, value in observed_cells(tiles, robot):
                assert wall[row, column] == (value == OCCUPIED)
        assert_sees_no_further_than_light(tiles, grid, pose, pieces)
        for value in seen:
            seen[value] += np.sum(tiles.values == value)
    assert min(seen.values()) > 100


def test_no_beam_slips_between_two_wall_cells_that_touch_at_a_corner():
    grid = lattice(20, 20, CELL, 0.0, 0.0)
    for row, column, down, right in [(10, 10, 1, 1), (10, 10, -1, 1), (10, 10, 1, -1), (10, 10, -1, -1)]:
        pieces = [cell_box(grid, row + down, column), cell_box(grid, row, column + right)]
        x, y = grid.centres(np.array([row, column]))
        for turn in range(8):
            tiles = sensor(outline(shapely.union_all(pieces)), grid).sense(swarm([x, y, turn * math.pi / 4.0])).tiles
            values = {(r, c): value for r, c, value in observed_cells(tiles)}
            assert (row + down, column + right) not in values
            assert values[row + down, column] == values[row, column + right] == OCCUPIED


@pytest.mark.parametrize("chunk", range(4))
def test_among_walls_anywhere_no_cell_is_observed_that_light_does_not_reach(chunk):
    rng = np.random.default_rng(100 + chunk)
    seen = {FREE: 0, OCCUPIED: 0, UNKNOWN: 0}
    for _ in range(40):
        grid = lattice(30, 30, CELL, *rng.uniform(-0.1, 0.0, 2))
        pieces = [
            rotate(shapely.box(x, y, x + rng.uniform(0.02, 0.8), y + rng.uniform(0.02, 0.3)), rng.uniform(0.0, 180.0))
            for x, y in rng.uniform(1.0, 3.0, (6, 2))
        ]
        solid = shapely.union_all(pieces)
        places = rng.uniform(1.2, 3.0, (30, 2))
        places = places[shapely.distance(shapely.points(places), solid) > 0.055][:5]
        pose = np.column_stack([places, rng.uniform(-4.0, 4.0, len(places))])
        tiles = sensor(outline(solid), grid).sense(swarm(pose)).tiles
        assert_sees_no_further_than_light(tiles, grid, pose, pieces)
        for value in seen:
            seen[value] += np.sum(tiles.values == value)
    assert min(seen.values()) > 100


@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0])
def test_from_inside_a_closed_box_nothing_outside_is_observed(angle):
    """The room has walls one centimetre thick, the plainest case for a beam to slip through at a corner."""
    rng = np.random.default_rng(21)
    grid = lattice()
    observed = 0
    for _ in range(60):
        width, height = rng.uniform(0.15, 0.6, 2)
        inner = rotate(shapely.box(2.0, 2.0, 2.0 + width, 2.0 + height), angle)
        walls = outline(inner.buffer(0.01, join_style="mitre") - inner)
        left, low, right, high = inner.bounds
        points = shapely.points(rng.uniform((left, low), (right, high), (50, 2)))
        points = points[shapely.contains(inner.buffer(-0.06), points)][:5]
        pose = np.column_stack([shapely.get_coordinates(points), rng.uniform(-4.0, 4.0, len(points))])
        tiles = sensor(walls, grid).sense(swarm(pose)).tiles
        for robot in range(len(pose)):
            for row, column, value in observed_cells(tiles, robot):
                box = cell_box(grid, row, column)
                inside = shapely.area(shapely.intersection(box, inner)) > 1e-9
                assert inside if value == FREE else box.distance(inner) <= 1e-5
                observed += 1
    assert observed > 1000


def test_ranges_are_those_of_single_beams_and_tiles_stay_as_they_are() -> None:
    walls = np.array([[0.0, 0.0, 0.0, 5.0], [0.0, 5.0, 6.0, 5.0], [6.0, 5.0, 6.0, 0.0], [6.0, 0.0, 0.0, 0.0]])
    rng = np.random.default_rng(8)
    pose = np.column_stack([rng.uniform(0.3, 5.7, 9), rng.uniform(0.3, 4.7, 9), rng.uniform(-3.0, 3.0, 9)])
    alive = np.arange(9) != 4
    state = State(0, pose, np.zeros((9, 3)), np.zeros((9, 2)), alive)
    context = setting_of(9, shape=(40, 48), walls=walls)
    plain = IrRing().build(context).sense(state)
    both = IrRing(ranges=True, reach=1.0).build(context).sense(state)
    assert plain.beams is None
    np.testing.assert_array_equal(both.tiles.values, plain.tiles.values)
    for robot in range(9):
        if not alive[robot]:
            assert np.isinf(both.beams.ranges[robot]).all()
            continue
        angles = pose[robot, 2] + both.beams.bearings
        u = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        with np.errstate(divide="ignore"):
            to = np.concatenate([(side - pose[robot, :2]) / u for side in (np.zeros(2), np.array([6.0, 5.0]))], axis=1)
        expected = np.where(to > 0.0, to, np.inf).min(axis=1)
        np.testing.assert_allclose(both.beams.ranges[robot], np.where(expected <= 1.0, expected, np.inf), atol=1e-9)
    dead = IrRing(ranges=True).build(context).without([0, 5]).sense(state).beams.ranges
    left = np.delete(np.arange(72), [0, 5])
    assert np.isnan(dead[:, [0, 5]]).all()
    np.testing.assert_array_equal(dead[:, left], both.beams.ranges[:, left])


@pytest.mark.parametrize("robots", [2, 30, 150])
def test_beams_in_a_crowd_end_where_casting_against_everybody_says(robots: int) -> None:
    random = np.random.default_rng(robots)
    side = 0.35 * math.sqrt(robots) + 0.5
    pose = np.column_stack([random.uniform(-0.2, side, (robots, 2)), random.uniform(-3.0, 3.0, robots)])  # some outside
    alive, radii = random.random(robots) > 0.1, random.uniform(0.03, 0.09, robots)
    angles = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
    ring, reach = np.stack([np.cos(angles), np.sin(angles)], axis=1), 0.6
    walls = np.array([[side, 0.0, 0.0, 0.0], [0.0, side, side, side]])
    coarse = (0.0, 0.0, 0.4, math.ceil(side / 0.4), math.ceil(side / 0.4))
    tiles, origins = np.empty((robots, 6, 7), np.uint8), np.empty((robots, 2), np.int32)
    ranges = np.full((robots, 36), np.inf)
    near, nobody = rays.bins(walls, reach, *coarse), np.empty((0, 3))
    rays.sense(pose, alive, ring, reach, walls, *near, nobody, coarse, (0.0, 0.0, 0.15), radii, True, True, tiles,
               origins, ranges)  # fmt: skip
    inside = (pose[:, :2] > 0.0).all(axis=1) & (pose[:, :2] < side).all(axis=1)
    for robot in np.flatnonzero(alive & inside):
        others = alive & (np.arange(robots) != robot)
        discs = np.column_stack([pose[others, :2], radii[others]])
        distance, hit = rays.cast(pose[robot, :2], angles + pose[robot, 2], reach, walls, discs)
        assert ranges[robot] == pytest.approx(np.where(hit >= 0, distance, np.inf), abs=1e-9)


@pytest.mark.parametrize("u", [2.0, 2.5])
@pytest.mark.parametrize(
    ("du", "dv", "cells"),
    [
        (-1.0, 0.0, [(2, 0), (2, 1), (2, 2)]),
        (1.0, 0.0, [(2, 2), (2, 3), (2, 4)]),
        (0.0, 1.0, [(2, 2), (3, 2), (4, 2)]),
        (0.0, -1.0, [(0, 2), (1, 2), (2, 2)]),
    ],
)
def test_a_beam_along_an_axis_crosses_the_cells_before_it(u, du, dv, cells):
    tile = np.zeros((5, 5), np.uint8)
    rays._mark(tile, 0, 0, u, 2.5, du, dv, 2.4, False)
    expected = [cell for cell in cells if not (u == 2.0 and du == -1.0 and cell == (2, 2))]
    assert sorted(set(map(tuple, np.argwhere(tile == FREE).tolist())) | {(2, 2)}) == sorted({*expected, (2, 2)})
