"""Small drawings and maps that are easily misread, each with the right result."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
import shapely
from buildings import AXES, FRAME, FREE, GAP, PAGE, UNKNOWN, WALL_GREY, floor_in, lines, pgm, plan_in, yaml
from buildings import svg as drawing
from drawn import read_floor_plan
from numpy.typing import NDArray

from swarmsim.cli.worlds import CELL
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World, load
from swarmsim.core.scenario.part import plain
from swarmsim.engine.build import build
from swarmsim.engine.inspection import Inspection, inspect
from swarmsim.world import svg
from swarmsim.world.plan import FloorPlan
from swarmsim.world.reading import plan_of
from swarmsim.world.source import floor_plan, read_world

SPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
LAYERS_PARTIAL = (
    f'<svg {SPACES} viewBox="0 0 6 4"><g inkscape:groupmode="layer" inkscape:label="Base plan">'
    '<path d="M.1 .1H5.9V3.9H.1Z M3 .1V1.5 M3 2.5V3.9" fill="none" stroke="#000" stroke-width=".2"/></g>'
    '<g inkscape:groupmode="layer" inkscape:label="Furniture"><rect x="4" y="1" width=".6" height=".6"/></g></svg>'
)
ROOM = 'fill="#d33" stroke="#000" stroke-width=".1"'
ROOMS_FILLED = (
    f'<svg {SPACES} viewBox="0 0 6 4">'
    '<rect x=".1" y=".1" width="5.8" height="3.8" fill="#f6d5d5" stroke="#000" stroke-width=".1"/>'
    f'<rect x=".2" y=".2" width="1.8" height="1.6" {ROOM}/><rect x="4" y=".2" width="1.8" height="1.6" {ROOM}/>'
    '<text x="1" y="1" font-size=".3">101</text></svg>'
)
FRONT_DOOR = (
    f'<svg {SPACES} viewBox="0 0 6 4">'
    '<path d="M2.4 3.9H.1V.1H5.9V3.9H3.4 M3.9 .1V1.5 M3.9 2.4V3.9" fill="none" stroke="#000" stroke-width=".1"/>'
    '<rect x="1.2" y="1.2" width=".6" height=".6" fill="none" stroke="#000" stroke-width=".05"/></svg>'
)


def hall(**boxes: tuple[int, int, int, int]) -> NDArray[np.uint8]:
    """6 m x 4 m in pixels of 10 cm, open all round, with boxes of walls: left, low, right, high in pixels."""
    pixels = np.full((40, 60), FREE, np.uint8)
    for left, low, right, high in boxes.values():
        pixels[low:high, left:right] = WALL_GREY
    return pixels


def closed() -> NDArray[np.uint8]:
    pixels = hall()
    pixels[:4] = pixels[-4:] = pixels[:, :4] = pixels[:, -4:] = WALL_GREY
    return pixels


RACK = hall(wall=(20, 10, 22, 30), rack=(40, 25, 50, 35))
RACK[26:34, 41:49] = FREE
EDGE = hall(wall=(20, 10, 22, 30))
EDGE[32:, :8] = UNKNOWN
POCKET = closed()
POCKET[:12, :] = WALL_GREY
POCKET[6:8, 30:34] = FREE


def opened(folder: Path, content: str | NDArray[np.uint8], **keys: object) -> World:
    if isinstance(content, str):
        (folder / "w.svg").write_text(content, encoding="utf-8")
        return convert({"file": str(folder / "w.svg"), **keys}, World)
    (folder / "w.pgm").write_bytes(pgm(content))
    (folder / "w.yaml").write_text(yaml("w.pgm", resolution=0.1), encoding="utf-8")
    return convert({"file": str(folder / "w.yaml"), **keys}, World)


def checked(folder: Path, world: World) -> tuple[Inspection, str]:
    """What `world check` finds, and the path of a scenario with five robots in that world."""
    path = folder / "run.toml"
    table = {"world": msgspec.to_builtins(world, enc_hook=plain), "robots": {"count": 5}, "stop": {"iterations": 1500}}
    path.write_bytes(msgspec.toml.encode({**table, "network": {"topology": {"use": "knn", "k": 2}}}))
    scenario = load(path)
    return inspect(scenario, read_world(scenario.world, scenario.grid.cell), "w", 1.1), str(path)


def finishes(path: str) -> bool:
    return bool(build(load(Path(path)), path).simulation.run([]))


@pytest.mark.parametrize(
    ("content", "area", "said"),
    [
        (RACK, 22.6, "1 pocket of 0.64 m2 at (4.50 m, 3.00 m) cannot be entered and does not count"),
        (EDGE, 24.0 - 0.4 - 0.64, "a border closes it there"),
        (POCKET, 5.2 * 2.4, "1 pocket of 0.08 m2"),
        (FRONT_DOOR, None, "1 pocket of 0.30 m2 at (1.50 m, 2.50 m) cannot be entered and does not count"),
    ],
    ids=["rack", "edge", "pocket", "front-door"],
)
def test_what_nobody_can_enter_does_not_count_and_the_run_finishes(tmp_path: Path, content, area, said) -> None:
    world = opened(tmp_path, content)
    found, path = checked(tmp_path, world)
    assert found.problem is None
    assert any(said in notice for notice in found.notices)
    floor = floor_in(plan_in(world, CELL))
    assert area is None or floor.area == pytest.approx(area)
    assert finishes(path)


def test_robots_start_in_the_rooms_behind_an_open_front_door(tmp_path: Path) -> None:
    floor = floor_in(plan_in(opened(tmp_path, FRONT_DOOR)))
    assert [shapely.contains_xy(floor, *at) for at in ((3, 2), (5, 2), (0.5, 0.5), (1.5, 2.5))] == [True] * 3 + [False]
    found, _ = checked(tmp_path, opened(tmp_path, FRONT_DOOR, border=False))
    assert "world.border = true" in (found.problem or "")


def test_a_layer_that_exists_does_not_hide_the_walls_in_another(tmp_path: Path) -> None:
    told = plan_in(opened(tmp_path, LAYERS_PARTIAL)).notices
    (notice,) = [one for one in told if "decoration" in one]
    assert "1 visible shape outside of its layers, 92 % of what is drawn, is decoration (`Base plan` 1)" in notice
    assert 'world.layers = {walls = ["Base plan"]}' in notice
    found, path = checked(tmp_path, opened(tmp_path, LAYERS_PARTIAL, layers={"walls": ["Base plan"]}))
    assert found.problem is None
    assert found.arena.plan.walls.area == pytest.approx(19.2 * 0.2 + 2 * 1.3 * 0.2 + 0.36)
    assert finishes(path)


def test_rooms_that_are_filled_become_floor_by_one_key(tmp_path: Path) -> None:
    plan = plan_in(opened(tmp_path, ROOMS_FILLED, solid="strokes"))
    floor = floor_in(plan)
    assert all(shapely.contains_xy(floor, *at) for at in ((1, 3), (5, 3), (3, 1)))
    assert len(plan.openings) == 2
    with pytest.raises(InputError, match=r"solid") as caught:
        plan_in(opened(tmp_path, ROOMS_FILLED, solid="all"))
    assert 'world.solid = "strokes"' in str(caught.value)


def plan(shape: str, more: str = "") -> FloorPlan:
    return read_floor_plan(f'<svg {SPACES} viewBox="0 0 10 10" {more}>{shape}</svg>', "w.svg")


WALLS = '<g id="walls">{}</g>'


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        ("<style>@media print { path { display: none } }</style>" + WALLS.format('<path d="M1 1H3V3H1Z"/>'), 4.0),
        ("<style>/* path { fill: none } */ rect { FILL: none }</style>"
         + WALLS.format('<path d="M1 1H3V3H1Z"/><rect x="5" y="5" width="2" height="2"/>'), 4.0),
        (WALLS.format('<path d="M1 1H3V3H1Z"/><rect x="5" y="5" width="2" height="2" fill="transparent"/>'), 4.0),
        (WALLS.format('<path d="M0 0H2V2H0Z" transform="rotate(90)" style="transform-origin: 2px 2px"/>'), 4.0),
        (WALLS.format('<line x1="1" y1="1" x2="9" y2="1" stroke="#000" stroke-width=".5"/>'), 4.0),
        (WALLS.format('<line x1="1" y1="1" x2="9" y2="1" fill="none" stroke="#000" stroke-width=".5"/>'), 4.0),
        (WALLS.format('<path d="M1 1H9" stroke="#000" stroke-width=".5"/>'), 4.0),
        ('<symbol id="s" viewBox="0 0 2 2"><rect width="2" height="2"/></symbol>'
         + WALLS.format('<use href="#s" x="1" y="1" width="2" height="2"/>'), 4.0),
        (WALLS.format('<path d="M1 1H3V3H1Z"/><rect x="5" y="5" width="2" height="2" fill="none"/>'), 4.0),
        (WALLS.format('<path d="M1 1H3V3H1Z" stroke-dasharray="4"/>'), 4.0),
        (WALLS.format('<path d="M1 1H3V3H1Z"/><text x="1" y="1">A</text>'), 4.0),
    ],
    ids=["print", "comment", "transparent", "origin", "line", "line-none", "open-path", "symbol", "invisible", "dash",
         "text"],
)  # fmt: skip
def test_what_paints_is_wall_and_nothing_else(shape: str, area: float) -> None:
    assert plan(shape).walls.area == pytest.approx(area)


def test_a_turned_shape_lies_where_its_origin_says() -> None:
    turned = WALLS.format('<path d="M0 0H2V1H0Z" transform="rotate(90)" style="transform-origin: 2px 2px"/>')
    assert plan(turned).walls.bounds == pytest.approx((3.0, 8.0, 4.0, 10.0))


def test_a_text_in_a_layer_is_told_once() -> None:
    told = plan(WALLS.format('<path d="M1 1H3V3H1Z"/><text>A</text><text>B</text>')).notices
    assert [notice for notice in told if "text" in notice] == [
        "w.svg: 2 <text> are passed over: neither text nor pictures are walls"
    ]


def test_all_that_is_painted_is_wall_or_floor_or_told_as_decoration() -> None:
    shapes = {"walls": "M0 0H4V2H0Z", "Grid": "M5 0H7V2H5Z", "Trees": "M8 0H9V2H8Z"}
    groups = "".join(f'<g id="{name}"><path d="{data}"/></g>' for name, data in shapes.items())
    hidden = '<g display="none"><path d="M0 5H9V6H0Z"/></g>'
    found = plan(groups + hidden)
    (notice,) = [one for one in found.notices if "decoration" in one]
    match = re.search(r"(\d+) visible shapes outside of its layers, (\d+) % of what is drawn", notice)
    assert match is not None
    painted = 8.0 + 4.0 + 2.0
    assert (int(match[1]), int(match[2])) == (2, round(100.0 * (painted - found.walls.area) / painted))
    assert "`Grid` 1" in notice
    assert "`Trees` 1" in notice
    assert any("1 shape is hidden, and passed over" in one for one in found.notices)


def test_what_is_left_out_of_a_drawing_without_layers_is_told() -> None:
    wall, grid = lines(AXES, GAP), lines("M0 3H8", "M4 0V6", colour="#eee", width=0.01)
    for body, said in (
        (FRAME + wall, "a frame of 15.1 m x 13.1 m around the drawing is taken for that of its sheet"),
        (grid + wall, "2 faint strokes are taken for a grid or a mark, not for walls"),
    ):
        found = plan_of(svg.read(drawing(body, PAGE), "w.svg", World(file="w.svg")), World(file="w.svg"))
        assert any(said in notice and 'world.solid = "all"' in notice for notice in found.notices)
        kept = World(file="w.svg", solid="all")
        whole = plan_of(svg.read(drawing(body, PAGE), "w.svg", kept), kept)
        assert whole.walls.area > found.walls.area + 0.05
        assert not any(said in notice for notice in whole.notices)


def test_rooms_with_an_open_front_door_are_the_floor_and_not_what_happens_to_be_closed(tmp_path: Path) -> None:
    room = 'fill="#fffdf7" stroke="#222" stroke-width=".15"'
    door = 'stroke="#fffdf7" stroke-width=".3"'
    world = opened(
        tmp_path,
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 24 20"><g {room}><rect x="4" y="4" width="16" '
        'height="12"/><rect x="4" y="4" width="8" height="8"/><rect x="12" y="4" width="8" height="8"/>'
        f'<rect x="4" y="12" width="16" height="4"/></g><path d="M7 12H8M20 13.5V14.5" {door}/></svg>',
    )
    plan = floor_plan(read_world(world, CELL), world)
    assert plan.spawns["spawn"].area == pytest.approx(184.9, abs=1.0)
    assert len(plan.openings) == 1  # into the room that is drawn closed
    assert not plan.border.is_empty


def test_a_door_symbol_over_an_outer_wall_opens_nothing(tmp_path: Path) -> None:
    world = opened(
        tmp_path,
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 12 8"><g fill="none" stroke="#000" stroke-width=".2">'
        '<path d="M1 1H11V7H1ZM6 1V7"/><path d="M6 3H6.9A.9 .9 0 0 1 6 3.9M1 3H1.9A.9 .9 0 0 1 1 3.9" '
        'stroke-width=".05"/></g></svg>',
    )
    plan = floor_plan(read_world(world, CELL), world)
    assert any("1 door symbol leads outside" in notice for notice in plan.notices)
    assert plan.border.is_empty
    assert plan.spawns["spawn"].area == pytest.approx(9.8 * 5.8 - 0.2 * 5.8 + 0.2 * 0.9, abs=0.2)
