"""Floor plans of CAD programs: what is solid in them, by area and place."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely
from ezdxf import xclip
from ezdxf.document import Drawing as Document
from shapely import MultiPolygon

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.world.areas import polygons
from swarmsim.world.cad import primitives
from swarmsim.world.cad.dxf import THIN, WALL, read
from swarmsim.world.plan import SOLID_LAYERS, FloorPlan
from swarmsim.world.reading import plan_of
from swarmsim.world.shapes import Drawing

UNITS = {"mm": (4, 0.001), "cm": (5, 0.01), "in": (1, 0.0254), "m": (6, 1.0)}
HOUSE = [  # m, the lines of a plan of 8 x 5 m with walls of 0.2 m and a door of 0.9 m in the one across
    ((0, 0), (8, 0), (8, 5), (0, 5), (0, 0)),
    ((0.2, 0.2), (4, 0.2), (4, 2), (4.2, 2), (4.2, 0.2), (7.8, 0.2), (7.8, 4.8)),
    ((7.8, 4.8), (4.2, 4.8), (4.2, 2.9), (4, 2.9), (4, 4.8), (0.2, 4.8), (0.2, 0.2)),
]


def plan(unit: str = "mm") -> tuple[Document, Callable[..., Any]]:
    """An empty file in a unit, and what draws an open polyline in metres into it, a line a side."""
    document = ezdxf.new("R2010")
    code, metre = UNITS[unit]
    document.header["$INSUNITS"] = code

    def draw(*corners: tuple[float, float], layer: str = "0", into: Any = None) -> None:
        points = [(x / metre, y / metre) for x, y in corners]
        for one, other in pairwise(points):
            (document.modelspace() if into is None else into).add_line(one, other, dxfattribs={"layer": layer})

    return document, draw


def house(unit: str = "mm", layer: str = "0") -> Document:
    document, draw = plan(unit)
    for line in HOUSE:
        draw(*line, layer=layer)
    return document


def drawing(document: Document, folder: Path, **world: Any) -> Drawing:
    path = folder / "plan.dxf"
    document.saveas(path)
    return read(path, convert({"file": str(path), **world}, World))


def solid(drawing: Drawing, layers: tuple[str, ...] = (*SOLID_LAYERS, "")) -> MultiPolygon:
    """What is solid; layers that say nothing are, where no other is asked for."""
    areas = [area for shape in drawing.shapes if shape.layer in layers for area in (shape.fill, shape.stroke)]
    return polygons(shapely.union_all(areas))


def floors(drawing: Drawing) -> list[float]:
    """The areas of the pieces of floor, m2, the largest first."""
    free = shapely.get_parts(polygons(shapely.box(*drawing.page).difference(solid(drawing))))
    return sorted((piece.area for piece in free if piece.area > 1e-6), reverse=True)


def covers(drawing: Drawing, x: float, y: float) -> bool:
    return bool(shapely.contains_xy(solid(drawing), x, y))


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("layer", ["0", "A-WALL"])
def test_walls_of_two_lines_have_their_area_in_any_unit(tmp_path: Path, unit: str, layer: str) -> None:
    found = drawing(house(unit, layer), tmp_path)
    assert found.unit == unit
    assert found.page == pytest.approx((0, 0, 8, 5), abs=1e-6)
    assert solid(found).area == pytest.approx(5.78, abs=1e-4)
    assert floors(found) == pytest.approx([34.22], abs=1e-4)
    assert [covers(found, *point) for point in ((2, 2), (6, 4), (4.1, 2.5))] == [False] * 3
    assert [covers(found, *point) for point in ((4.1, 1), (0.1, 3), (7.9, 4.9))] == [True] * 3
    assert {shape.layer for shape in found.shapes} == {"walls" if layer == "A-WALL" else ""}
    assert {shape.group for shape in found.shapes} == {layer}
    assert found.notices == ()


@pytest.mark.parametrize("turn", [30.0, 90.0, 217.0])
def test_a_turned_plan_in_any_order_has_the_same_walls(tmp_path: Path, turn: float) -> None:
    document, draw = plan()
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    sides = [side for line in HOUSE for side in pairwise(line)]
    for side in np.random.default_rng(1).permutation(len(sides)):
        draw(*((x * cos - y * sin, x * sin + y * cos) for x, y in sides[side]))
    found = solid(drawing(document, tmp_path))
    assert found.area == pytest.approx(5.78, abs=1e-3)
    assert [hole.area for hole in map(shapely.Polygon, found.geoms[0].interiors)] == pytest.approx([34.22], abs=1e-3)


def test_walls_may_be_closed_polylines_that_are_drawn_carelessly(tmp_path: Path) -> None:
    document, draw = plan()
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (8000, 0), (8000, 5000), (0, 5000)], close=True)
    space.add_lwpolyline([(200, 200), (4000, 200), (4000, 4800), (200, 4800)], close=True)
    draw((4.2, 0.198), (4.2, 4.8), (7.8, 4.8), (7.8, 0.203), (4.202, 0.203))  # misses by 2 mm
    found = drawing(document, tmp_path)
    assert solid(found).area == pytest.approx(5.96, abs=0.02)
    assert floors(found) == pytest.approx([17.48, 16.56], abs=0.02)


def test_open_ends_of_walls_of_two_lines_are_closed(tmp_path: Path) -> None:
    document, draw = plan()
    for low, high in ((0, 2), (3, 5)):
        draw((1, low), (1, high))
        draw((1.2, low), (1.2, high))
    found = drawing(document, tmp_path)
    assert solid(found).area == pytest.approx(2 * 2 * 0.2, abs=1e-4)
    assert not covers(found, 1.1, 2.5)


def test_jambs_in_the_layer_of_doors_close_walls(tmp_path: Path) -> None:
    document, draw = plan()
    draw((0, 0), (3, 0), layer="WAND")
    draw((0, 0.2), (3, 0.2), layer="WAND")
    draw((0, 0), (0, 0.2), layer="TÜREN")
    draw((3, 0), (3, 0.2), layer="TÜREN")
    assert solid(drawing(document, tmp_path), ("walls",)).area == pytest.approx(0.6, abs=1e-4)


def test_single_lines_are_walls_of_a_tenth_of_a_metre(tmp_path: Path) -> None:
    document, draw = plan()
    draw((0, 0), (8, 0), (8, 5), (0, 5), (0, 0))
    draw((4, 0), (4, 2))
    draw((4, 2.9), (4, 5))
    found = drawing(document, tmp_path)
    assert floors(found) == pytest.approx([7.9 * 4.9 - 0.1 * (4.1 - 0.1)] + [0.05**2] * 4, abs=1e-4)
    assert {shape.pen for shape in found.shapes} == {WALL}
    assert covers(found, 4.04, 1)
    assert not covers(found, 4.06, 1)


def test_lines_farther_apart_than_walls_are_thick_stay_two_walls(tmp_path: Path) -> None:
    document, draw = plan()
    draw((0, 0), (4, 0))
    draw((0, 0.8), (4, 0.8))
    assert {shape.pen for shape in drawing(document, tmp_path).shapes} == {WALL}
    document, draw = plan()
    draw((0, 0), (4, 0))
    draw((1, 0.3), (2, 0.3))  # a shelf at a wall
    assert [shape.pen for shape in drawing(document, tmp_path).shapes] == [WALL, THIN]


def test_symbols_of_doors_stay_lines_and_fill_nothing(tmp_path: Path) -> None:
    document = house()
    space = document.modelspace()
    for layer, y in (("0", 2.0), ("A-DOOR", 2.9)):
        turn = 1 if layer == "0" else -1
        space.add_line((4200, y * 1000), (4200 + 900, y * 1000), dxfattribs={"layer": layer})
        start, end = (0, 90) if turn == 1 else (270, 360)
        space.add_arc((4200, y * 1000), 900, start, end, dxfattribs={"layer": layer})
    found = drawing(document, tmp_path)
    symbols = [shape for shape in found.shapes if shape.where.startswith("ARC") or shape.group == "A-DOOR"]
    assert [(shape.layer, shape.group) for shape in symbols] == [("", "0"), ("", "A-DOOR"), ("", "A-DOOR")]
    assert all(len(shape.lines) == 1 and shape.fill.is_empty for shape in symbols)
    arc = symbols[0].lines[0]
    assert np.hypot(*(arc - (4.2, 2.0)).T) == pytest.approx(0.9, abs=1e-6)
    middles = (arc[1:] + arc[:-1]) / 2.0
    assert np.hypot(*(middles - (4.2, 2.0)).T).min() >= 0.9 - 1e-3
    assert solid(found, ("",)).difference(solid(drawing(house(), tmp_path))).area < 0.4
    assert not covers(found, 4.5, 2.4)


def test_symbols_of_doors_cut_walls_that_run_on(tmp_path: Path) -> None:
    document, draw = plan()
    draw((0, 0), (8, 0), (8, 5), (0, 5), (0, 0))
    draw((0.2, 0.2), (4, 0.2), (4, 4.8), (0.2, 4.8), (0.2, 0.2))
    draw((4.2, 0.2), (7.8, 0.2), (7.8, 4.8), (4.2, 4.8), (4.2, 0.2))
    closed = plan_of(drawing(document, tmp_path), World(file="plan.dxf"))
    assert (closed.walls.area, len(rooms(closed))) == (pytest.approx(5.96, abs=1e-4), 2)
    draw((4.2, 2), (5.1, 2))
    document.modelspace().add_arc((4200, 2000), 900, 0, 90)
    opened = plan_of(drawing(document, tmp_path), World(file="plan.dxf"))
    assert rooms(opened) == pytest.approx([34.22], abs=0.03)
    assert not shapely.contains_xy(opened.walls, 4.1, 2.5)
    assert shapely.contains_xy(opened.walls, 4.1, 1.5)


def test_layers_of_walls_make_the_rest_decoration(tmp_path: Path) -> None:
    document = house(layer="A-WALL")
    document.modelspace().add_line((1000, 1000), (2000, 1000), dxfattribs={"layer": "ARROWS"})
    found = plan_of(drawing(document, tmp_path), World(file="plan.dxf"))
    assert found.walls.area == pytest.approx(5.78, abs=1e-4)
    assert any("decoration (`ARROWS` 1)" in one for one in found.notices)


def rooms(plan: FloorPlan) -> list[float]:
    """The areas of the pieces of floor, m2, the largest first."""
    free = shapely.get_parts(polygons(shapely.box(*plan.page).difference(plan.walls)))
    return sorted((piece.area for piece in free if piece.area > 1e-3), reverse=True)


def test_things_in_layer_0_of_a_block_are_in_the_layer_of_its_insertion(tmp_path: Path) -> None:
    document = house(layer="WALLS")
    inner = document.blocks.new("LEG")
    inner.add_circle((0, 0), 50, dxfattribs={"layer": "0"})
    block = document.blocks.new("TABLE")
    block.add_lwpolyline([(0, 0), (1000, 0), (1000, 500), (0, 500)], close=True, dxfattribs={"layer": "0"})
    block.add_line((0, 0), (1000, 500), dxfattribs={"layer": "COLS"})
    block.add_blockref("LEG", (500, 250), dxfattribs={"layer": "0"})
    space = document.modelspace()
    space.add_blockref("TABLE", (2000, 1000), dxfattribs={"layer": "Mobiliar", "rotation": 90, "xscale": 2.0})
    found = drawing(document, tmp_path)
    furniture = [shape for shape in found.shapes if shape.layer == "furniture"]
    assert [shape.group for shape in furniture] == ["Mobiliar", "Mobiliar"]
    assert [round(side, 3) for side in shapely.LineString(furniture[0].lines[0]).bounds] == [1.5, 1.0, 2.0, 3.0]
    assert [shape.group for shape in found.shapes if shape.layer == "pillars"] == ["COLS"]
    assert solid(found, ("walls",)).area == pytest.approx(5.78, abs=1e-4)


def test_a_block_is_inserted_as_often_as_it_says_and_clipped(tmp_path: Path) -> None:
    document, _ = plan("m")
    block = document.blocks.new("POST")
    block.add_solid([(0, 0), (1, 0), (0, 1), (1, 1)])
    space = document.modelspace()
    space.add_blockref(
        "POST", (0, 0), dxfattribs={"row_count": 2, "row_spacing": 3, "column_count": 3, "column_spacing": 2}
    )
    xclip.XClip(space.add_blockref("POST", (10, 0))).set_block_clipping_path([(0, 0), (0.5, 1)])
    found = drawing(document, tmp_path, layers={"pillars": ["0"]})
    assert solid(found).area == pytest.approx(6.5)
    assert covers(found, 4.5, 3.5)
    assert not covers(found, 10.7, 0.5)


def test_what_cannot_be_seen_does_not_count_and_is_told(tmp_path: Path) -> None:
    document, draw = plan()
    for line in HOUSE:
        draw(*line)
    for name in ("FROZEN", "OFF", "SEEN"):
        document.layers.add(name)
        draw((1, 1), (2, 1), layer=name)
    document.layers.get("FROZEN").freeze()
    document.layers.get("OFF").off()
    block = document.blocks.new("BLOCK")
    draw((0, 0), (1, 1), layer="SEEN", into=block)
    draw((0, 0), (1, 1), layer="0", into=block)
    space = document.modelspace()
    space.add_blockref("BLOCK", (1000, 1000), dxfattribs={"layer": "FROZEN"})  # hides all of it
    space.add_blockref("BLOCK", (1000, 1000), dxfattribs={"layer": "OFF"})  # hides what has no layer of its own
    space.add_line((0, 0), (1000, 1000), dxfattribs={"invisible": 1})
    space.add_line((0, 0), (1000, 1000), dxfattribs={"layer": "Defpoints"})
    found = drawing(document, tmp_path)
    assert [shape.group for shape in found.shapes if shape.group != "0"] == ["SEEN", "SEEN"]
    assert found.notices == (
        "what is invisible, or in layers that are frozen or off, does not count: by layer, 2 FROZEN, 2 OFF, 1 0, "
        "1 Defpoints",
    )


def test_notes_are_no_walls_and_are_told(tmp_path: Path) -> None:
    document = house()
    space = document.modelspace()
    space.add_text("Hall").set_placement((1000, 1000))
    space.add_mtext("Kitchen")
    space.add_point((5000, 1000))
    space.add_linear_dim((0, -500), (0, 0), (8000, 0)).render()
    hatch = space.add_hatch(color=7)
    hatch.set_pattern_fill("ANSI31")
    hatch.paths.add_polyline_path([(0, 0), (2000, 0), (2000, 2000)], is_closed=True)
    found = drawing(document, tmp_path)
    assert solid(found).area == pytest.approx(5.78, abs=1e-4)
    assert found.notices == (
        "1 TEXT, 1 MTEXT, 1 POINT, 1 DIMENSION, 1 HATCH of a pattern are passed over: none of these is a wall",
    )


def test_solid_fills_are_walls_unless_they_colour_rooms(tmp_path: Path) -> None:
    document, _ = plan("m")
    space = document.modelspace()

    def filled(box: tuple[float, float, float, float], color: int, layer: str = "0") -> Any:
        left, low, right, high = box
        hatch = space.add_hatch(color=color, dxfattribs={"layer": layer})
        hatch.paths.add_polyline_path([(left, low), (right, low), (right, high), (left, high)], is_closed=True)
        return hatch

    holed = filled((0, 0, 8, 5), 8)
    holed.paths.add_polyline_path([(0.2, 0.2), (7.8, 0.2), (7.8, 4.8), (0.2, 4.8)], is_closed=True, flags=16)
    filled((1, 1, 3, 3), 3)  # the colour of a room
    filled((5, 1, 6, 2), 7)  # black
    filled((5, 3, 6, 4), 3, "COLS")
    filled((3, 3, 3.9, 3.05), 7, "A-DOOR")
    space.add_trace([(3, 4), (4, 4), (3, 4.2), (4, 4.2)])
    found = drawing(document, tmp_path)
    assert solid(found).area == pytest.approx(40 - 7.6 * 4.6 + 1 + 1 + 0.2, abs=1e-6)
    assert not covers(found, 2, 2)
    assert "solid fills in layers of doors are passed over (1)" in found.notices
    assert [one for one in found.notices if one.startswith("solid fills") and one.endswith("the colours of rooms (1)")]


def test_widths_of_polylines_are_pens(tmp_path: Path) -> None:
    document, _ = plan()
    space = document.modelspace()
    space.add_lwpolyline(
        [(100, 100), (7900, 100), (7900, 4900), (100, 4900)], close=True, dxfattribs={"const_width": 200}
    )
    space.add_lwpolyline([(2000, 2000, 400, 0), (4000, 2000, 0, 0)], format="xyse")
    space.add_polyline2d(
        [(5000, 1000), (5000, 3000)], dxfattribs={"default_start_width": 100, "default_end_width": 100}
    )
    found = drawing(document, tmp_path)
    assert [shape.pen for shape in found.shapes] == pytest.approx([0.2, 0.2, 0.1])
    assert [shape.stroke.area for shape in found.shapes] == pytest.approx([5.04, 0.4, 0.2], abs=1e-6)
    assert found.page == pytest.approx((0, 0, 8, 5), abs=1e-6)


def test_curves_are_flattened_to_a_millimetre(tmp_path: Path) -> None:
    document, _ = plan("cm")
    space = document.modelspace()
    space.add_circle((0, 0), 300)
    space.add_ellipse((1000, 0), (300, 0), 0.5)
    space.add_spline([(0, 1000), (200, 1200), (400, 1000)])
    found = drawing(document, tmp_path)
    circle, ellipse, spline = (shape.lines[0] for shape in found.shapes)
    assert shapely.Polygon(circle).area == pytest.approx(math.pi * 9, rel=1e-3)
    assert shapely.hausdorff_distance(shapely.LineString(circle), shapely.Point(0, 0).buffer(3, 256).exterior) < 2e-3
    assert shapely.Polygon(ellipse).area == pytest.approx(math.pi * 4.5, rel=1e-3)
    assert spline[[0, -1]].tolist() == pytest.approx(np.array([(0, 10), (4, 10)]))
    assert found.shapes[0].stroke.area == pytest.approx(math.pi * 6 * WALL, rel=1e-3)


def test_arcs_of_narrow_swings_have_a_few_corners(tmp_path: Path) -> None:
    document, _ = plan("cm")
    document.modelspace().add_arc((100, 100), 70, 350, 3)
    document.modelspace().add_arc((100, 100), 0, 0, 90)
    (shape,) = drawing(document, tmp_path).shapes
    assert len(shape.lines[0]) >= 7
    assert np.hypot(*(shape.lines[0] - (1.0, 1.0)).T) == pytest.approx(0.7, abs=1e-6)


def test_multilines_and_mirrored_things_are_read(tmp_path: Path) -> None:
    document, _ = plan("m")
    space = document.modelspace()
    style = document.mline_styles.new("WALL")
    style.elements.append(0.1)
    style.elements.append(-0.1)
    space.add_mline([(0, 0), (4, 0)], dxfattribs={"style_name": "WALL"})
    space.add_arc((-2, 2), 1, 0, 90, dxfattribs={"extrusion": (0, 0, -1)})
    found = drawing(document, tmp_path)
    assert covers(found, 2, -0.1)
    arc = next(shape.lines[0] for shape in found.shapes if shape.where.startswith("ARC"))
    assert sorted(arc[[0, -1]].round(6).tolist()) == [[1, 2], [2, 3]]


def test_layers_are_known_by_usual_names_and_by_the_scenario(tmp_path: Path) -> None:
    document, draw = plan()
    usual = {
        "A-WALL-FULL": "walls",
        "Wände": "walls",
        "plan$0$MURS": "walls",
        "xref|PARED": "walls",
        "AUSSENWAND_24": "walls",
        "A-GLAZ": "walls",
        "S-COLS": "pillars",
        "I-FURN": "furniture",
        "Möbel": "furniture",
        "A-WALL-IDEN": "",
        "A-DOOR": "",
        "Tür": "",
        "WALLPAPER": "",
        "0": "",
    }
    for number, name in enumerate(usual):
        draw((0, number), (5, number), layer=name)
        draw((0, number), (5, number), layer="SPECIAL")
    found = drawing(document, tmp_path)
    assert {shape.group: shape.layer for shape in found.shapes} == {**usual, "SPECIAL": ""}
    given = drawing(document, tmp_path, layers={"walls": ["spec*"]})
    assert {shape.group for shape in given.shapes if shape.layer == "walls"} == {"SPECIAL"}
    assert {shape.group for shape in given.shapes if shape.layer == "furniture"} == {"I-FURN", "Möbel"}
    with pytest.raises(
        InputError, match=r"world\.layers\.walls: no layer is called 'A-WAL-FULL'; did you mean 'A-WALL-F"
    ):
        drawing(document, tmp_path, layers={"walls": ["A-WAL-FULL"]})
    with pytest.raises(InputError, match=r"layers\.roof: unknown key; known: doors, floor"):
        drawing(document, tmp_path, layers={"roof": ["0"]})


def test_areas_are_what_their_outlines_enclose(tmp_path: Path) -> None:
    document = house(layer="WALLS")
    space = document.modelspace()
    for layer, left in (("START", 1000), ("A-AREA", 3000), ("Spawn", 5000)):
        corners = [(left, 1000), (left + 500, 1000), (left + 500, 2000), (left, 2000)]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})
    found = drawing(document, tmp_path, layers={"spawn": ["START", "Spawn"]}, floor=["A-AREA"])
    areas = {(shape.layer, shape.spawn): shape.fill.area for shape in found.shapes if shape.layer != "walls"}
    assert areas == pytest.approx({("spawn", "START"): 0.5, ("floor", ""): 0.5, ("spawn", "Spawn"): 0.5})
    assert all(shape.stroke.is_empty for shape in found.shapes if shape.layer in ("spawn", "floor"))


def test_a_file_without_a_unit_asks_for_one(tmp_path: Path) -> None:
    document = house()
    document.header["$INSUNITS"] = 0
    found = drawing(document, tmp_path, scale=0.001)
    assert (found.unit, found.notices) == ("", ())
    assert solid(found).area == pytest.approx(5.78, abs=1e-4)
    wide = drawing(document, tmp_path, width=8.0)
    assert wide.notices == ()
    assert solid(wide).area == pytest.approx(5.78, abs=1e-4)
    said = drawing(house("m"), tmp_path, scale=2.0)
    assert said.page == pytest.approx((0, 0, 16, 10), abs=0.11)
    metres = house("m")
    metres.header["$INSUNITS"] = 0
    assert "say world.scale" in drawing(metres, tmp_path).notices[0]
    with pytest.raises(InputError, match=r"8000 m wide|is its unit right"):
        drawing(house("m"), tmp_path, scale=2000.0)


def test_strays_are_passed_over_and_a_distant_plan_is_moved(tmp_path: Path) -> None:
    document, draw = plan()
    for line in HOUSE:
        draw(*((x + 3_500_000, y + 5_400_000) for x, y in line))
    draw((-42, 5_000), (-41, 5_001))
    found = drawing(document, tmp_path)
    assert found.page == pytest.approx((0, 0, 8, 5), abs=1e-5)
    assert solid(found).area == pytest.approx(5.78, abs=1e-3)
    assert found.notices == (
        "what lies far outside of all else is passed over (shapes: 1)",
        "it lies at (3500000, 5400000) m, and was moved so that this point is the origin",
    )


def test_what_other_programs_keep_elsewhere_is_told(tmp_path: Path) -> None:
    document = house()
    space = document.modelspace()
    document.add_xref_def("other.dwg", "OTHER")
    space.add_blockref("OTHER", (0, 0))
    space.add_3dface([(0, 0), (1, 0), (1, 1)])
    notices = drawing(document, tmp_path).notices
    assert notices == (
        "1 3DFACE cannot be read as lines; explode them, or export to plain 2D, if they are walls",
        "other drawings that it refers to are not read (1 other.dwg); bind them to have them in",
    )


def test_an_empty_model_space_is_refused(tmp_path: Path) -> None:
    document, _ = plan()
    with pytest.raises(
        InputError, match=r"plan\.dxf: its model space shows nothing that can be a wall; expected lines"
    ):
        drawing(document, tmp_path)
    document.layout().add_line((0, 0), (1, 1))
    with pytest.raises(InputError, match=r"layouts are not read; draw in model space"):
        drawing(document, tmp_path)


def test_blocks_that_multiply_without_end_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(primitives, "MOST", 1000)
    document, _ = plan()
    document.blocks.new("B0").add_line((0, 0), (1, 1))
    for level in range(1, 9):
        block = document.blocks.new(f"B{level}")
        for shift in range(10):
            block.add_blockref(f"B{level - 1}", (shift, 0))
    document.modelspace().add_blockref("B8", (0, 0))
    with pytest.raises(InputError, match="holds more than 1000 things"):
        drawing(document, tmp_path)


def test_a_missing_library_is_told_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(InputError) as told:
        read(tmp_path / "plan.dxf", World(file="plan.dxf"))
    assert str(told.value) == 'world: plan.dxf needs ezdxf; install it with: pip install "swarmsim-lab[cad]"'


def test_damaged_files_are_mended_or_refused_in_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    document = house()
    document.modelspace().add_lwpolyline([(0, 0, 0.5), (500, 500, 0)], format="xyb")
    document.modelspace().add_blockref("*Model_Space", (0, 0))
    path = tmp_path / "plan.dxf"
    document.saveas(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    contents = [whole[: int(share * len(whole))] for share in (0.0, 0.01, 0.3, 0.7, 0.95, 0.999)]
    contents += [b"AC1032" + bytes(100), b"%PDF-1.7", b"a letter", bytes(500)]
    for _ in range(40):
        spoilt = bytearray(whole)
        for place in rng.integers(len(whole) // 2, len(whole), 6):
            spoilt[place] = rng.integers(48, 58)
        contents.append(bytes(spoilt))
    told = []
    for content in contents:
        path.write_bytes(content)
        try:
            read(path, World(file=str(path)))
        except InputError as problem:
            told.append(str(problem))
    assert len(told) >= 6
    assert all(one.startswith(f"{path}: ") and "\n" not in one for one in told)
    assert f"{path}: is a DWG file; save the drawing as DXF" in told
    assert capfd.readouterr() == ("", "")
