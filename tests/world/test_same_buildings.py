"""The same building drawn in other ways, and random maps: what must not change, and what must add up."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from buildings import (
    AXES,
    FREE,
    GAP,
    STYLES,
    THREE,
    UNKNOWN,
    WALL_GREY,
    Rooms,
    door,
    floor_in,
    lines,
    pgm,
    plan_in,
    svg,
    yaml,
)
from scipy import ndimage
from shapely import affinity

from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.world.arena import Arena
from swarmsim.world.plan import FloorPlan
from swarmsim.world.unreached import unreached

PIXEL = 0.1  # m
SEEDS = (1, 2, 3)


def read(folder: Path, text: str, **keys: object) -> FloorPlan:
    (folder / "w.svg").write_text(text, encoding="utf-8")
    return plan_in(convert({"file": str(folder / "w.svg"), **keys}, World))


def box(*numbers: float) -> str:
    return " ".join(map(str, numbers))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("style", STYLES)
def test_four_styles_of_a_plan_have_the_same_rooms(tmp_path: Path, seed: int, style: str) -> None:
    rooms = Rooms.of(seed)
    plan = read(tmp_path, svg("".join(rooms.drawn(style)), box(0, 0, *rooms.size)), doors=0.9)
    assert plan.openings == ()
    floor = floor_in(plan)
    assert floor.area == pytest.approx(rooms.area + 0.18 * (rooms.count - 1), rel=1e-4)
    down = [rooms.box(ends) for ends in rooms.doors]
    cuts = [shapely.box(x, rooms.size[1] - y - high, x + wide, rooms.size[1] - y) for x, y, wide, high in down]
    assert len(shapely.get_parts(floor.difference(shapely.union_all(cuts).buffer(1e-6)))) == rooms.count


@pytest.mark.parametrize("seed", SEEDS)
def test_closed_rooms_get_a_door_each_none_outwards_and_none_into_furniture(tmp_path: Path, seed: int) -> None:
    rooms = Rooms.of(seed)
    plan = read(tmp_path, svg("".join(rooms.drawn("closed")), box(0, 0, *rooms.size)), doors=0.9)
    assert len(plan.openings) == rooms.count - 1
    assert any(f"{rooms.count - 1} doors of 0.9 m were made" in notice for notice in plan.notices)
    width, height = rooms.size
    inner = shapely.box(0.2, 0.2, width - 0.2, height - 0.2)
    for opening in plan.openings:
        assert inner.covers(shapely.box(*opening))
        assert not any(shapely.box(*opening).intersects(one) for one in rooms.furniture)
    floor = floor_in(plan)
    assert floor.area == pytest.approx(rooms.area + 0.18 * (rooms.count - 1), rel=1e-3)
    assert read(tmp_path, svg("".join(rooms.drawn("closed")), box(0, 0, *rooms.size))).openings == ()


BODIES = {  # 8 m x 6 m
    "gaps": lines(AXES, GAP),
    "arcs": lines(AXES, "M5.1 .1V5.9") + door(60),
    "rooms": THREE,
    "front-door": lines("M3 5.9H.1V.1H7.9V5.9H4", GAP),
}


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_margins_turns_and_scale_leave_the_floor_alone(tmp_path: Path, body: str) -> None:
    plain = floor_in(read(tmp_path, svg(body)))
    for share in (0.1, 3.0):
        x, y = 8 * share, 6 * share
        plan = read(tmp_path, svg(body, box(-x, -y, 8 + 2 * x, 6 + 2 * y)))
        moved = affinity.translate(floor_in(plan), -x, -y)
        assert moved.symmetric_difference(plain).area < 1e-3
    for turn, view in ((90, (-6, 0, 6, 8)), (180, (-8, -6, 8, 6)), (270, (0, -8, 6, 8))):
        turned = floor_in(read(tmp_path, svg(f'<g transform="rotate({turn})">{body}</g>', box(*view))))
        back = affinity.rotate(turned, turn, origin=(0, 0))
        back = affinity.translate(back, *(np.array(plain.bounds[:2]) - back.bounds[:2]))
        assert back.symmetric_difference(plain).area < 1e-3
    for times in (0.001, 37.8):
        text = svg(f'<g transform="scale({times})">{body}</g>', box(0, 0, 8 * times, 6 * times))
        assert floor_in(read(tmp_path, text, width=8)).symmetric_difference(plain).area < 1e-3


@pytest.mark.parametrize("style", STYLES)
def test_the_order_of_things_that_do_not_overlap_leaves_the_floor_alone(tmp_path: Path, style: str) -> None:
    rooms = Rooms.of(5)
    shapes, rng = rooms.drawn(style), np.random.default_rng(1)
    plain = floor_in(read(tmp_path, svg("".join(shapes), box(0, 0, *rooms.size))))
    bars = [one for one in shapes if "#fff" in one]  # lie on what they cut
    rest = [one for one in shapes if "#fff" not in one]
    for _ in range(3):
        text = "".join([*rng.permutation(np.array(rest, object)), *rng.permutation(np.array(bars, object))])
        assert floor_in(read(tmp_path, svg(text, box(0, 0, *rooms.size)))).symmetric_difference(plain).area < 1e-6


def test_a_path_may_be_split(tmp_path: Path) -> None:
    whole = floor_in(read(tmp_path, svg(lines(AXES + GAP))))
    corners = [(0.1, 0.0), (0.1, 6.0), (0.0, 5.9), (8.0, 5.9), (7.9, 6.0), (7.9, 0.0), (8.0, 0.1), (0.0, 0.1)]
    parts = [f"M{a} {b}L{c} {d}" for (a, b), (c, d) in list(pairwise(corners))[::2]]
    split = floor_in(read(tmp_path, svg(lines(*parts, "M5.1 0V1", "M5.1 1V2.5", "M5.1 3.4V6"))))
    assert split.symmetric_difference(whole).area < 1e-6


def raster(folder: Path, states: np.ndarray, **keys: object) -> FloorPlan:
    (folder / "w.pgm").write_bytes(pgm(states))
    (folder / "w.yaml").write_text(yaml("w.pgm", resolution=PIXEL), encoding="utf-8")
    return plan_in(convert({"file": str(folder / "w.yaml"), **keys}, World), PIXEL)


def random_states(rng: np.random.Generator) -> np.ndarray:
    """A small map: walls along some lines, specks, and patches and specks of what nobody knows."""
    rows, columns = rng.integers(4, 16, 2)
    states = np.full((rows, columns), FREE, np.uint8)
    for _ in range(rng.integers(0, 5)):
        at = rng.integers(0, min(rows, columns))
        states[(at, slice(None)) if rng.random() < 0.5 else (slice(None), at)] = WALL_GREY
    states[rng.random(states.shape) < rng.choice([0.0, 0.05, 0.3])] = WALL_GREY
    states[rng.random(states.shape) < rng.choice([0.0, 0.05, 0.2])] = UNKNOWN
    if rng.random() < 0.3:
        states[: rng.integers(1, rows), : rng.integers(1, columns)] = UNKNOWN
    return states


def check_rasters(folder: Path, seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    refused = 0
    for _ in range(count):
        states = random_states(rng)
        plan = raster(folder, states)
        pixel = PIXEL**2
        page = states.size * pixel
        solid = (states != FREE).sum() * pixel
        assert plan.layers["walls"].area == pytest.approx((states == WALL_GREY).sum() * pixel, abs=1e-6)
        assert plan.unknown.area == pytest.approx((states == UNKNOWN).sum() * pixel, abs=1e-6)
        assert plan.walls.area == pytest.approx(solid, abs=1e-6)
        pieces, number = ndimage.label(states == FREE)
        sizes = sorted(np.bincount(pieces.ravel(), minlength=number + 1)[1:] * pixel)
        free = shapely.get_parts(shapely.box(*plan.page).difference(plan.walls))
        free = free[shapely.area(free) > 1e-9] if number else free[:0]
        assert sorted(shapely.area(free)) == pytest.approx(sizes, abs=1e-6)
        if not number:
            assert not plan.spawns  # nothing is free
            refused += 1
            continue
        floor = shapely.get_parts(plan.spawns["spawn"])
        assert len(floor) == 1
        pockets = sum(sizes) - floor[0].area
        assert floor[0].area + pockets + solid == pytest.approx(page, abs=1e-6)
        assert min(abs(np.array(sizes) - floor[0].area)) < 1e-6
    assert refused < 0.1 * count


def test_floor_pockets_walls_and_unknown_are_the_page_in_400_random_maps(tmp_path: Path) -> None:
    check_rasters(tmp_path, 1, 400)


@pytest.mark.slow
def test_floor_pockets_walls_and_unknown_are_the_page_in_2000_random_maps(tmp_path: Path) -> None:
    check_rasters(tmp_path, 2, 2000)


@pytest.mark.parametrize("seed", range(5))
def test_a_hole_of_a_pixel_joins_a_pocket_for_what_is_narrower(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = np.full((40, 60), FREE, np.uint8)
    states[0] = states[-1] = states[:, 0] = states[:, -1] = WALL_GREY
    left, low = rng.integers(4, 20, 2)
    wide, high = rng.integers(8, 14, 2)
    states[low : low + high, left : left + wide] = WALL_GREY
    states[low + 1 : low + high - 1, left + 1 : left + wide - 1] = FREE
    pocket = (high - 2) * (wide - 2) * PIXEL**2
    whole = raster(tmp_path, states)
    hole = low + int(rng.integers(3, high - 3))
    states[hole, left] = FREE
    pierced = raster(tmp_path, states)
    assert floor_in(pierced).area == pytest.approx(floor_in(whole).area + pocket + PIXEL**2)
    for plan, narrow, closed in ((whole, 0, 1), (pierced, 1, 0)):
        arena = Arena.open(plan, PIXEL, 1, "w")
        found = unreached(arena, arena.reachable("spawn", 0.055), 0.055, "spawn")
        assert (len(found.narrow), len(found.pockets)) == (narrow, closed)
        assert shapely.area([*found.narrow, *found.pockets]).sum() == pytest.approx(pocket, rel=0.05)
        slim = unreached(arena, arena.reachable("spawn", 0.04), 0.04, "spawn")
        assert (len(slim.narrow), len(slim.pockets)) == (0, closed)
