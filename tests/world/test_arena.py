"""The arena against slow, obvious answers, and worlds small enough to know by heart."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon, affinity, box

from swarmsim.core.errors import InputError
from swarmsim.world.arena import Arena
from swarmsim.world.plan import FloorPlan
from swarmsim.world.unreached import Unreached, unreached


def plan(walls: shapely.Geometry, size: tuple[float, float], **spawns: shapely.Geometry) -> FloorPlan:
    solid = MultiPolygon([part for part in shapely.get_parts(walls) if part.geom_type == "Polygon"])
    return FloorPlan(
        solid,
        {"walls": solid},
        {key: MultiPolygon(list(shapely.get_parts(area))) for key, area in spawns.items()},
        (0.0, 0.0, *size),
    )


def sketch(rows: str, cell: float = 1.0) -> Arena:
    """A world drawn in characters, upper row first: # is wall, s is spawn area; margin of one cell."""
    lines = [line.strip() for line in rows.split()]
    marks = {mark: [] for mark in "#s"}
    for y, line in enumerate(reversed(lines)):
        for x, mark in enumerate(line):
            marks.get(mark, []).append(box(x * cell, y * cell, (x + 1) * cell, (y + 1) * cell))
    size = (len(lines[0]) * cell, len(lines) * cell)
    spawn = shapely.union_all(marks["s"])
    return Arena.open(plan(shapely.union_all(marks["#"]), size, s=spawn), cell, 1, "sketch.svg")


def picture(arena: Arena, cells: np.ndarray) -> str:
    """Cells of the page as characters, upper row first."""
    page = slice(1, 1 + round(arena.plan.height)), slice(1, 1 + round(arena.plan.width))
    marks = np.where(cells, "o", np.where(arena.occupied, "#", "."))[page]
    return " ".join("".join(line) for line in marks[::-1])


def refused(arena: Arena, radius: float = 0.3, spawn: str = "s") -> str:
    with pytest.raises(InputError) as caught:
        beside(arena, radius, spawn).refuse(arena, radius, spawn)
    return str(caught.value)


def beside(arena: Arena, radius: float, spawn: str = "s") -> Unreached:
    return unreached(arena, arena.reachable(spawn, radius), radius, spawn)


# --- the truth grid


def slow_truth(arena: Arena) -> np.ndarray:
    """Whether walls cover more than a millionth of each cell, one cell at a time."""
    lattice = arena.lattice
    truth = np.zeros(lattice.shape, dtype=bool)
    for row in range(lattice.rows):
        for column in range(lattice.columns):
            x, y = lattice.x0 + column * lattice.cell, lattice.y0 + row * lattice.cell
            square = box(x, y, x + lattice.cell, y + lattice.cell)
            truth[row, column] = square.intersection(arena.plan.walls).area > 1e-6 * lattice.cell**2
    return truth


numbers = st.floats(-1.0, 5.0).map(lambda value: round(value, 3))
boxes = st.tuples(numbers, numbers, st.floats(0.05, 2.0), st.floats(0.05, 2.0), st.floats(0.0, 90.0)).map(
    lambda v: affinity.rotate(box(v[0], v[1], v[0] + v[2], v[1] + v[3]), v[4])
)
discs = st.tuples(numbers, numbers, st.floats(0.05, 1.5)).map(lambda v: shapely.Point(v[:2]).buffer(v[2]))
rings = discs.map(lambda disc: disc.difference(disc.buffer(-0.2)))


@given(st.lists(boxes | discs | rings, min_size=1, max_size=5), st.sampled_from([0.15, 0.3, 0.37, 1.0]))
@settings(max_examples=40, deadline=None)
def test_truth_is_what_overlaps(shapes: list[shapely.Geometry], cell: float) -> None:
    arena = Arena.open(plan(shapely.union_all(shapes), (4.0, 3.0)), cell, 2, "any.svg")
    differ = np.argwhere(arena.occupied != slow_truth(arena))
    for row, column in differ:  # an overlap of a millionth of a cell may be judged either way
        x, y = arena.lattice.x0 + column * cell, arena.lattice.y0 + row * cell
        share = box(x, y, x + cell, y + cell).intersection(arena.plan.walls).area / cell**2
        assert share == pytest.approx(1e-6, abs=1e-9)


@pytest.mark.parametrize("cell", [0.15, 0.1, 0.3, 1 / 3, 0.07])
def test_walls_on_cell_edges_do_not_leak(cell: float) -> None:
    walls = [box(i * cell, j * cell, (i + 1) * cell, (j + 2) * cell) for i in range(0, 120, 7) for j in range(0, 90, 5)]
    arena = Arena.open(plan(shapely.union_all(walls), (120 * cell, 90 * cell)), cell, 3, "grid.svg")
    wanted = np.zeros(arena.lattice.shape, dtype=bool)
    for i in range(0, 120, 7):
        for j in range(0, 90, 5):
            wanted[j + 3 : j + 5, i + 3] = True
    assert np.array_equal(arena.occupied, wanted)


def test_a_corner_in_a_cell_occupies_it() -> None:
    arena = Arena.open(plan(box(0.0, 0.0, 1.01, 1.0), (3.0, 3.0)), 1.0, 1, "corner.svg")
    assert np.argwhere(arena.occupied).tolist() == [[1, 1], [1, 2]]


def test_the_lattice_is_anchored_at_the_page_and_covers_what_sticks_out() -> None:
    arena = Arena.open(plan(box(-0.2, 0.5, 2.0, 4.4), (3.0, 2.0)), 0.15, 4, "plan.svg")
    lattice = arena.lattice
    assert (lattice.x0 / 0.15, lattice.y0 / 0.15) == pytest.approx((-2 - 4, -4))
    assert (lattice.columns, lattice.rows) == (2 + 20 + 8 + 2, 30 + 8)  # two more fill the last word of a row


def test_nobody_needs_as_many_cells_as_that() -> None:
    with pytest.raises(InputError, match=r"plan.svg: 3000 m x 2000 m .* is the scale right"):
        Arena.open(plan(box(0, 0, 1, 1), (3000.0, 2000.0)), 0.15, 7, "plan.svg")
    with pytest.raises(ValueError, match="margin is 0"):
        Arena.open(plan(box(0, 0, 1, 1), (3.0, 2.0)), 0.15, 0, "plan.svg")


# --- the boundary


@given(st.lists(boxes | discs | rings, min_size=1, max_size=4))
@settings(max_examples=40, deadline=None)
def test_solid_lies_on_the_left_of_every_segment(shapes: list[shapely.Geometry]) -> None:
    arena = Arena.open(plan(shapely.union_all(shapes), (4.0, 3.0)), 0.5, 1, "any.svg")
    start, end = arena.segments[:, :2], arena.segments[:, 2:]
    length = np.hypot(*(end - start).T)
    assert (length > 0).all()
    assert length.sum() == pytest.approx(arena.plan.walls.length)
    assert 0.5 * np.sum(start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]) == pytest.approx(arena.plan.walls.area)
    long = length > 1e-3
    middle, along = (start + end)[long] / 2, ((end - start) / length[:, None])[long]
    left = np.column_stack([-along[:, 1], along[:, 0]]) * 1e-7
    assert shapely.contains_xy(arena.plan.walls, *(middle + left).T).all()
    assert not shapely.contains_xy(arena.plan.walls, *(middle - left).T).any()


# --- floor and reachable cells


TWO_ROOMS = """
    #######
    #s.#..#
    #.....#
    #..#..#
    #######
"""


def test_floor_is_all_that_is_connected() -> None:
    arena = sketch(TWO_ROOMS)
    assert picture(arena, arena.floor("s")) == "####### #oo#oo# #ooooo# #oo#oo# #######"
    assert picture(arena, arena.spawn_cells("s")) == "####### #o.#..# #.....# #..#..# #######"


def test_floor_is_not_connected_across_corners() -> None:
    arena = sketch("##### #s.## ##.## ###.# #####")
    assert picture(arena, arena.floor("s")) == "##### #oo## ##o## ###.# #####"


def test_reachable_is_where_a_disc_clears_the_walls() -> None:
    arena = sketch(TWO_ROOMS)
    assert np.array_equal(arena.reachable("s", 0.5), arena.floor("s"))  # it touches on both sides, and fits


def test_reachable_stays_clear_of_round_things() -> None:
    walls = shapely.union_all([box(0, 0, 9, 9).difference(box(1, 1, 8, 8)), shapely.Point(4.5, 4.5).buffer(0.4, 64)])
    arena = Arena.open(plan(walls, (9, 9), s=box(1, 1, 2, 2)), 0.5, 1, "post.svg")
    cells = np.argwhere(arena.reachable("s", 0.45))
    centres = arena.lattice.centres(cells)
    clear = np.minimum(np.hypot(*(centres - 4.5).T) - 0.4, 3.5 - np.abs(centres - 4.5).max(axis=1))
    assert clear.min() >= 0.45 - 1e-3
    assert len(cells) == 12 * 12 - 12


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 0.45))
@settings(max_examples=40, deadline=None)
def test_floor_against_a_walk_cell_by_cell(seed: int, share: float) -> None:
    walls = np.ones((9, 11), dtype=bool)
    walls[1:-1, 1:-1] = np.random.default_rng(seed).random((7, 9)) < share
    walls[1, 1] = False
    arena = sketch("\n".join("".join("#" if w else "." for w in line) for line in walls[::-1]).replace(".", "s", 0))
    spawned = Arena.open(plan(arena.plan.walls, (11, 9), s=box(1, 1, 2, 2)), 1.0, 1, "maze.svg")
    todo, seen = [(2, 2)], {(2, 2)}
    while todo:
        row, column = todo.pop()
        for cell in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
            if cell not in seen and not spawned.occupied[cell]:
                seen.add(cell)
                todo.append(cell)
    assert {(int(row), int(column)) for row, column in np.argwhere(spawned.floor("s"))} == seen


def test_of_a_spawn_area_in_two_pieces_the_larger_counts() -> None:
    arena = sketch("####### #s#sss# #s#...# #######")
    assert picture(arena, arena.floor("s")) == "####### #.#ooo# #.#ooo# #######"


# --- what is refused


def test_an_unknown_spawn_area() -> None:
    arena = Arena.open(plan(box(0, 0, 1, 1), (3, 3), nave=box(1, 1, 2, 2), apse=box(2, 2, 3, 3)), 1.0, 1, "b.svg")
    with pytest.raises(InputError, match=r"b.svg: no spawn area 'knave'; did you mean 'nave'\? it has apse, nave"):
        arena.floor("knave")
    with pytest.raises(InputError, match="no spawn area 'crypt'; it has apse, nave"):
        arena.floor("crypt")


def test_a_spawn_area_in_a_wall() -> None:
    walls = box(0, 0, 5, 5).difference(box(1, 1, 4, 4))
    half = Arena.open(plan(walls, (5, 5), s=box(0, 2, 2, 3)), 1.0, 1, "b.svg")
    assert "spawn area 's' lies in a wall at (0.50 m, 2.50 m): 1 of its 2 m2 are solid" in refused(half)
    less = Arena.open(plan(walls, (5, 5), s=box(0.1, 2, 2, 3)), 1.0, 1, "b.svg")
    assert less.reachable("s", 0.3).sum() == 9
    small = Arena.open(plan(walls, (5, 5), s=box(1.6, 2, 1.9, 3)), 1.0, 1, "b.svg")
    assert "at (1.75 m, 2.50 m) holds the centre of no free cell of 1 m; make it larger" in refused(small)


def test_a_robot_too_large_for_its_spawn_area() -> None:
    assert "a robot of 1.2 m does not fit anywhere in spawn area 's' at (1.50 m, 3.50 m)" in refused(
        sketch("##### #s..# #...# ##### #####"), 0.6
    )


GAPS = {
    "in the right wall": ("####### #s....# #.....# #...... #######", "open near (6.50 m, 1.50 m)"),
    "in the left wall": ("####### #....s# ......# #.....# #######", "open near (0.50 m, 2.50 m)"),
    "in the lower wall": ("####### #s....# #.....# #.....# ##.####", "open near (2.50 m, 0.50 m)"),
    "behind a narrower door": (
        "########### #s.#.....## #..#.....## #........## #..#....... #..#....... ###########",
        "open near (10.50 m, 2.50 m)",
    ),
    "in a notch": ("####### #s.#### #..#... #.....# #######", "open near (5.50 m, 2.50 m)"),
}


@pytest.mark.parametrize(("rows", "message"), GAPS.values(), ids=GAPS.keys())
def test_an_open_outline_is_named_where_it_is_open(rows: str, message: str) -> None:
    said = refused(sketch(rows))
    gap = re.search(r"open near \((.*) m, (.*) m\)", said)
    assert gap, said
    wanted = re.search(r"open near \((.*) m, (.*) m\)", message)
    assert wanted
    assert math.dist(*(tuple(map(float, match.groups())) for match in (gap, wanted))) <= 1.0, said


def test_a_spawn_area_outside() -> None:
    assert "spawn area 's' lies outside of the walls at (4.50 m, 1.50 m); move it inside" in refused(
        sketch("####.. #..#s. ####..")
    )


def test_a_gap_narrower_than_a_cell_still_lets_robots_out() -> None:
    walls = box(0, 0, 5, 5).difference(box(1, 1, 4, 4)).difference(box(3.5, 2.2, 5, 2.8))
    arena = Arena.open(plan(walls, (5, 5), s=box(1, 1, 2, 2)), 1.0, 1, "b.svg")
    assert "a robot of 0.5 m can slip out of spawn area 's'" in refused(arena, 0.25)
    assert arena.reachable("s", 0.31).sum() == 9


def test_a_room_without_a_door() -> None:
    said = refused(sketch("######## #s.#...# #..#...# ########"))
    assert "the room at (5.50 m, 2.00 m), 6 m2, has no way to spawn area 's'; give it a door" in said


def test_a_pocket_too_small_to_move_in_is_no_room() -> None:
    arena = sketch("###### #s.#.# #..### ######")
    assert arena.reachable("s", 0.4).sum() == 4  # 0.04 m2 to move in, less than the robot's own 0.5 m2
    assert "the room at (4.50 m, 2.50 m), 1 m2, has no way" in refused(arena, 0.2)  # 0.36 m2 against 0.13 m2


def test_a_robot_wider_than_every_door() -> None:
    walls = box(0, 0, 9, 5).difference(box(1, 1, 4, 4)).difference(box(5, 1, 8, 4)).difference(box(4, 2, 5, 2.9))
    narrow = Arena.open(plan(walls.difference(box(4, 3.2, 5, 3.5)), (9, 5), s=box(1, 1, 2, 2)), 0.1, 1, "b.svg")
    assert narrow.reachable("s", 0.4).sum() > 900
    said = refused(narrow, 0.46)
    assert "a robot of 0.92 m is wider than every door to the room at (6.45 m, 2.50 m), 9.07 m2;" in said
    width = re.search(r"the widest way there is (.*) m;", said)
    assert width
    assert float(width[1]) == pytest.approx(0.9, abs=2e-3)


def test_a_door_between_cells() -> None:
    walls = box(0, 0, 9, 5).difference(box(1, 1, 4, 4)).difference(box(5, 1, 8, 4)).difference(box(4, 1.5, 5, 2.5))
    said = refused(Arena.open(plan(walls, (9, 5), s=box(1, 1, 2, 2)), 1.0, 1, "b.svg"))
    assert "no chain of free cells leads to the room at (5.50 m, 1.50 m)" in said


def test_a_niche_of_one_cell_is_left_out() -> None:
    arena = sketch("##### #s.## ##.## ###.# #####")
    beside = plan(arena.plan.walls.difference(box(2.9, 1.4, 3.1, 2.1)), (5, 5), s=box(1, 3, 2, 4))
    assert Arena.open(beside, 1.0, 1, "b.svg").reachable("s", 0.05).sum() == 3


# --- the domain


def test_domain_by_hand() -> None:
    arena = sketch("##### #s..# #.#.# #...# #####")
    reachable = arena.reachable("s", 0.3)
    everything = np.ones(arena.lattice.shape, dtype=bool)
    assert picture(arena, arena.explorable(reachable, everything)) == ".ooo. ooooo ooooo ooooo .ooo.".replace(".", "#")


def test_domain_leaves_out_free_cells_that_nobody_sees_and_their_walls() -> None:
    arena = sketch("####### #s....# #######")
    reachable = np.zeros(arena.lattice.shape, dtype=bool)
    reachable[2, 2:4] = True
    observed = np.zeros(arena.lattice.shape, dtype=bool)
    observed[1:4, 1:5] = True
    assert picture(arena, arena.explorable(reachable, observed)) == "#ooo### oooo..# #ooo###"


def test_domain_leaves_out_what_is_seen_through_a_gap_but_not_connected() -> None:
    arena = sketch("##### #s#.# #####")
    reachable = np.zeros(arena.lattice.shape, dtype=bool)
    reachable[2, 2] = True
    domain = arena.explorable(reachable, np.ones_like(reachable))
    assert picture(arena, domain) == "#o### oo#.# #o###".replace("oo#", "ooo")


def test_wall_cells_that_no_place_shows_are_no_part_of_the_domain() -> None:
    arena = sketch("####### #s....# #######")
    reachable = arena.reachable("s", 0.3)
    seen = reachable.copy()
    assert np.array_equal(arena.explorable(reachable, seen), reachable)
    seen[1:4] = True
    seen[3, 6] = False
    domain = arena.explorable(reachable, seen)
    assert not domain[3, 6]
    assert (domain <= seen).all()
    assert domain[3, 2:6].all()
