"""Floor plans: every kind of shape against areas known from formulas, and every kind of mistake."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import shapely
from drawn import read_floor_plan
from hypothesis import example, given, settings
from hypothesis import strategies as st

from swarmsim.core.errors import InputError
from swarmsim.world.outlines import FLATNESS
from swarmsim.world.plan import FloorPlan

SPAWN = '<g id="spawn"><rect id="start" x="9" y="1" width="1" height="1"/></g>'
INKSCAPE = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
XLINK = 'xmlns:xlink="http://www.w3.org/1999/xlink"'


def drawing(walls: str, *, root: str = 'viewBox="0 0 12 8"', spawn: str = SPAWN, rest: str = "") -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {INKSCAPE} {XLINK} {root}>'
        f'{rest}<g id="walls">{walls}</g>{spawn}</svg>'
    )


def plan(walls: str, scale: float = 1.0, **parts: str) -> FloorPlan:
    return read_floor_plan(drawing(walls, **parts), "plan.svg", scale)


def same(shape: shapely.Geometry, wanted: shapely.Geometry) -> bool:
    """Whether two shapes differ by no point farther than a flattened curve may stray."""
    return shape.hausdorff_distance(wanted) < 1.01 * FLATNESS and shape.symmetric_difference(wanted).area < 0.02


def error(source: str) -> str:
    with pytest.raises(InputError) as caught:
        read_floor_plan(source, "plan.svg")
    message = str(caught.value)
    assert message.startswith("plan.svg: ")
    assert "\n" not in message
    return message


STROKE = 'fill="none" stroke="black" stroke-width="0.5"'
SHAPES = {
    "rect": ('<rect x="1" y="2" width="3" height="1.5"/>', 4.5, (1, 4.5, 4, 6)),
    "rect, both radii": (
        '<rect x="1" y="2" width="3" height="2" rx="1" ry="0.5"/>', 6 - (4 - math.pi) * 0.5, (1, 4, 4, 6),
    ),
    "rect, one radius": ('<rect width="3" height="2" ry="0.5"/>', 6 - (4 - math.pi) * 0.25, (0, 6, 3, 8)),
    "rect, radius too large": ('<rect width="2" height="2" rx="9"/>', math.pi, (0, 6, 2, 8)),
    "circle": ('<circle cx="3" cy="3" r="2"/>', 4 * math.pi, (1, 3, 5, 7)),
    "ellipse": ('<ellipse cx="4" cy="3" rx="3" ry="1"/>', 3 * math.pi, (1, 4, 7, 6)),
    "polygon": ('<polygon points="0,0 4,0 4,3"/>', 6, (0, 5, 4, 8)),
    "polyline": ('<polyline points="0 0 4 0 4 3 0 0"/>', 6, (0, 5, 4, 8)),
    "polyline, stroke": (f'<polyline {STROKE} points="1,1 3,1"/>', 1, (1, 6.75, 3, 7.25)),
    "line": (f'<line {STROKE} x1="1" y1="1" x2="1" y2="5"/>', 2, (0.75, 3, 1.25, 7)),
    "lines": ('<path d="M1 1h2v2h-2z"/>', 4, (1, 5, 3, 7)),
    "absolute lines": ('<path d="M1,1H3V3L1,3Z"/>', 4, (1, 5, 3, 7)),
    "open, filled": ('<path d="M1 1H3V3H1"/>', 4, (1, 5, 3, 7)),
    "open, filled, stroke": (
        f'<path d="M1 1H3V3H1" {STROKE.replace("none", "red")}/>', 4 + 1.5 + 2 * 0.25**2, (1, 4.75, 3.25, 7.25),
    ),
    "open, one of two": ('<path d="M0 0H4V4H0ZM5 0H6V1"/>', 16.5, (0, 4, 6, 8)),
    "dashes": (f'<line {STROKE} stroke-dasharray="1 1" x1="1" y1="1" x2="1" y2="5"/>', 2, (0.75, 3, 1.25, 7)),
    "closed by its last point": ('<path d="M1 1H3V3H1V1"/>', 4, (1, 5, 3, 7)),
    "arc": ('<path d="M1 4A2 2 0 0 1 5 4Z"/>', 2 * math.pi, (1, 4, 5, 6)),
    "arc, other way": ('<path d="M1 4A2 2 0 0 0 5 4Z"/>', 2 * math.pi, (1, 2, 5, 4)),
    "arc, flags without blanks": ('<path d="M1 4a2 2 0 01 4 0z"/>', 2 * math.pi, (1, 4, 5, 6)),
    "arc, large": ('<path d="M3 2A2 2 0 1 1 1 4L3 4Z"/>', 3 * math.pi, (1, 2, 5, 6)),
    "arc, radius too small": ('<path d="M1 4A0.1 0.1 0 0 1 5 4Z"/>', 2 * math.pi, (1, 4, 5, 6)),
    "arc, no radius": ('<path d="M1 1A0 0 0 0 1 5 1V3Z"/>', 4, (1, 5, 5, 7)),
    "quadratic": ('<path d="M0 4Q2 0 4 4Z"/>', 16 / 3, (0, 4, 4, 6)),
    "smooth quadratic": ('<path d="M0 4Q1 2 2 4T4 4Z"/>', 8 / 3, (0, 3, 4, 5)),
    "cubic": ('<path d="M0 4C0 1 4 1 4 4Z"/>', 0.6 * 3 * 4, (0, 4, 4, 6.25)),
    "smooth cubic": ('<path d="M0 4C0 2 2 2 2 4S4 6 4 4Z"/>', 2 * 0.6 * 2 * 2, (0, 2.5, 4, 5.5)),
    "hole, even-odd": ('<path fill-rule="evenodd" d="M0 0H4V4H0ZM1 1H3V3H1Z"/>', 12, (0, 4, 4, 8)),
    "no hole, nonzero": ('<path d="M0 0H4V4H0ZM1 1H3V3H1Z"/>', 16, (0, 4, 4, 8)),
    "hole, nonzero": ('<path d="M0 0H4V4H0ZM1 1V3H3V1Z"/>', 12, (0, 4, 4, 8)),
    "after z": ('<path d="M1 1h2v2h-2z l-1 0 0 -1 1 0 z"/>', 5, (0, 5, 3, 8)),
    "bow tie": ('<path d="M0 0L4 4V0L0 4Z"/>', 8, (0, 4, 4, 8)),
    "both paints": ('<rect x="2" y="2" width="2" height="2" stroke="red" stroke-width="1"/>', 9, (1.5, 3.5, 4.5, 6.5)),
    "frame": (f'<rect x="2" y="2" width="2" height="2" {STROKE}/>', 2.5**2 - 1.5**2, (1.75, 3.75, 4.25, 6.25)),
    "ring": (f'<circle cx="4" cy="4" r="2" {STROKE}/>', math.pi * (2.25**2 - 1.75**2), (1.75, 1.75, 6.25, 6.25)),
    "mitre": (f'<path d="M1 1H3V3" {STROKE}/>', 2.0, (1, 5, 3.25, 7.25)),
    "bevel": (f'<path d="M1 1H3V3" stroke-linejoin="bevel" {STROKE}/>', 2 - 0.5 * 0.25**2, (1, 5, 3.25, 7.25)),
    "round join": (
        f'<path d="M1 1H3V3" stroke-linejoin="round" {STROKE}/>', 2 - (1 - math.pi / 4) * 0.25**2, (1, 5, 3.25, 7.25),
    ),
    "square caps": (f'<path d="M1 1H3" stroke-linecap="square" {STROKE}/>', 1.25, (0.75, 6.75, 3.25, 7.25)),
    "round caps": (
        f'<path d="M1 1H3" stroke-linecap="round" {STROKE}/>', 1 + math.pi * 0.25**2, (0.75, 6.75, 3.25, 7.25),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("shape", "area", "bounds"), SHAPES.values(), ids=SHAPES.keys())
def test_shape_has_its_area_and_bounds(shape: str, area: float, bounds: tuple[float, ...]) -> None:
    walls = plan(shape).walls
    assert walls.is_valid
    assert walls.area == pytest.approx(area, abs=FLATNESS * 15)  # no outline here is curved over more than 15 m
    assert walls.bounds == pytest.approx(bounds, abs=FLATNESS)


def test_pentagram_by_both_rules() -> None:
    tips = [(4 + 3 * math.sin(0.8 * math.pi * i), 4 - 3 * math.cos(0.8 * math.pi * i)) for i in range(5)]
    star = f'<path {{}} d="M{"L".join(f"{x} {y}" for x, y in tips)}Z"/>'
    whole, hollow = plan(star.format("")).walls, plan(star.format('fill-rule="evenodd"')).walls
    core = 3 * math.cos(0.4 * math.pi) / math.cos(0.2 * math.pi)  # radius of the inner pentagon
    assert whole.area - hollow.area == pytest.approx(2.5 * core**2 * math.sin(0.4 * math.pi))


TRANSFORMS = {
    "translate(3 1)": ((3, 1), (4, 1), (3, 2)),
    "translate(3)": ((3, 0), (4, 0), (3, 1)),
    "scale(2,3)": ((0, 0), (2, 0), (0, 3)),
    "scale(2)": ((0, 0), (2, 0), (0, 2)),
    "rotate(90)": ((0, 0), (0, 1), (-1, 0)),
    "rotate(90 1 1)": ((2, 0), (2, 1), (1, 0)),
    "skewX(45)": ((0, 0), (1, 0), (1, 1)),
    "skewY(45)": ((0, 0), (1, 1), (0, 1)),
    "matrix(0 2 3 0 1 4)": ((1, 4), (1, 6), (4, 4)),
    "translate(1,2) scale(2) , rotate(-90)": ((1, 2), (1, 0), (3, 2)),
}


@pytest.mark.parametrize(("transform", "images"), TRANSFORMS.items(), ids=TRANSFORMS.keys())
def test_transforms_move_the_unit_triangle(transform: str, images: tuple[tuple[float, float], ...]) -> None:
    walls = plan(f'<polygon points="0 0 1 0 0 1" transform="{transform}"/>').walls
    assert same(walls, shapely.Polygon([(x, 8 - y) for x, y in images]))


def test_nested_transforms_apply_from_the_inside_out() -> None:
    inner = '<g transform="scale(2 1)"><rect width="1" height="1"/></g>'
    walls = plan(f'<g transform="translate(5 4)"><g transform="rotate(90)">{inner}</g></g>').walls
    assert same(walls, shapely.box(4, 2, 5, 4))


def test_a_stroke_is_stretched_with_its_shape() -> None:
    walls = plan(f'<line transform="scale(4 2)" x1="1" y1="1" x2="1" y2="3" {STROKE}/>').walls
    assert same(walls, shapely.box(3, 2, 5, 6))


@pytest.mark.parametrize("turn", [0, 30, 45])
def test_curves_stray_less_than_a_millimetre_after_scaling(turn: float) -> None:
    walls = plan(f'<circle r="0.01" transform="translate(6 4) rotate({turn}) scale(300 100)"/>').walls
    corners = np.array(walls.geoms[0].exterior.coords) - (6, 4)
    angle = -math.radians(turn)
    turned = corners @ np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    middles = (turned[1:] + turned[:-1]) / 2 / (3, 1)
    assert ((1 - np.hypot(*middles.T)) * 3).max() < FLATNESS
    assert np.hypot(*(turned / (3, 1)).T) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("root", "scale", "size", "bounds"),
    [
        ('viewBox="0 0 12 8"', 1.0, (12, 8), (1, 5, 3, 7)),
        ('width="480" height="99" viewBox="0 0 12 8"', 1.0, (12, 8), (1, 5, 3, 7)),
        ('width="100%" height="300px" viewBox="0 0 12 8"', 1.0, (12, 8), (1, 5, 3, 7)),
        ('width="12" height="8"', 1.0, (12, 8), (1, 5, 3, 7)),
        ('viewBox="-1,-2,12,8"', 1.0, (12, 8), (2, 3, 4, 5)),
        ('viewBox="0 0 12 8"', 2.5, (30, 20), (2.5, 12.5, 7.5, 17.5)),
        ('width="1200cm" viewBox="0 0 12 8"', 1.0, (12, 8), (1, 5, 3, 7)),
        ('width="24000mm" height="16000mm" viewBox="0 0 12 8"', 1.0, (24, 16), (2, 10, 6, 14)),
        ('width="120mm" height="80mm" viewBox="0 0 12 8"', 100.0, (12, 8), (1, 5, 3, 7)),
        ('width="1in" viewBox="0 0 12 8"', 12 / 0.0254, (12, 8), (1, 5, 3, 7)),
        ('width="72pt" viewBox="0 0 12 8"', 12 / 0.0254, (12, 8), (1, 5, 3, 7)),
        ('width="6pc" viewBox="0 0 12 8"', 12 / 0.0254, (12, 8), (1, 5, 3, 7)),
        ('width="12in" height="8in"', 96 / 0.0254, (96 * 12, 96 * 8), (1, 96 * 8 - 3, 3, 96 * 8 - 1)),
    ],
)
def test_scale(root: str, scale: float, size: tuple[float, float], bounds: tuple[float, ...]) -> None:
    read = plan('<rect x="1" y="1" width="2" height="2"/>', scale, root=root)
    assert (read.width, read.height) == pytest.approx(size)
    assert read.walls.bounds == pytest.approx(bounds, abs=1e-9)


@pytest.mark.parametrize("root", ['viewBox="0 0 12 8"', 'width="1200cm" viewBox="0 0 1200 800"'])
def test_lengths_with_units_are_metres(root: str) -> None:
    walls = plan('<rect x="50cm" y="0" width="1000mm" height="10%"/>', root=root).walls
    assert walls.bounds == pytest.approx((0.5, 7.2, 1.5, 8), abs=1e-12)


def test_layers_are_kept_apart_and_their_union_is_solid() -> None:
    layers = (
        '<g id="pillars"><circle cx="8" cy="4" r="1"/></g>'
        f'<g id="layer7" {INKSCAPE} inkscape:label="furniture"><rect x="1" y="1" width="2" height="2"/></g>'
        '<g id="notes"><rect width="12" height="8"/><text>Nave</text></g><rect width="12" height="8"/>'
    )
    read = plan('<rect width="2" height="2"/>', rest=layers)
    assert {name: round(layer.area, 2) for name, layer in read.layers.items()} == {
        "walls": 4.0, "pillars": 3.14, "furniture": 4.0,
    }  # fmt: skip
    assert read.walls.area == pytest.approx(4 + 4 - 1 + math.pi, abs=0.01)
    assert isinstance(read.walls, shapely.MultiPolygon)


def test_walls_that_abut_are_one() -> None:
    thirds = "".join(f'<rect x="{i / 3}" width="{1 / 3}" height="1"/>' for i in range(9))
    walls = plan(thirds).walls
    assert len(walls.geoms) == 1
    assert not walls.geoms[0].interiors
    assert walls.bounds == pytest.approx((0, 7, 3, 8), abs=1e-9)


def test_a_spawn_area_is_the_inside_of_an_element_with_an_id() -> None:
    spawn = (
        '<g id="spawn"><g transform="translate(1 1)"><circle id="a" r="1" fill="none" stroke="red"/></g>'
        '<g id="b"><rect id="b1" width="1" height="1"/><rect id="b2" x="3" width="1" height="1"/></g></g>'
    )
    spawns = plan('<rect width="2" height="2"/>', spawn=spawn).spawns
    assert list(spawns) == ["a", "b"]
    assert spawns["a"].area == pytest.approx(math.pi, abs=0.01)
    assert spawns["b"].area == pytest.approx(2)


@pytest.mark.parametrize(
    "shape",
    [
        '<rect class="soft" width="5" height="5"/>',
        '<g style="display:none"><rect width="5" height="5"/></g>',
        '<rect display="none" width="5" height="5"/>',
        '<g visibility="hidden"><rect width="5" height="5"/></g>',
        '<defs><rect width="5" height="5"/></defs>',
        "<title>5</title>",
        "<!-- rect -->",
        '<path d="M0 0H5"/>',
        '<polyline points="0 0 1 1"/>',
        '<line x2="3" y2="3"/>',
        '<path d=""/>',
        "<path/>",
        '<path d="M1 1Z"/>',
        '<path d="M0 0H4H0Z"/>',
        '<rect width="3"/>',
        '<rect width="0" height="3"/>',
        "<circle/>",
        '<ellipse rx="2"/>',
        '<polygon points="0 0 1 1"/>',
        '<polygon points=""/>',
        '<rect width="5" height="5" fill="none"/>',
        '<rect width="5" height="5" fill="Transparent" stroke="NONE" stroke-dasharray="1 1"/>',
        '<rect width="5" height="5" fill="#12345600"/>',
        '<rect width="5" height="5" fill="url(#nowhere) none"/>',
        '<g opacity="0"><rect width="5" height="5"/></g>',
        '<line fill="none" stroke="red" stroke-width="0" x2="3"/>',
        '<rect width="5" height="5" transform="scale(0)"/>',
        '<svg viewBox="0 0 1 1"/>',
        '<text id="label">Nave</text>',
        '<g><image href="scan.png"/></g>',
        "<foreignObject/>",
        '<symbol><rect width="5" height="5"/></symbol>',
    ],
)
def test_what_is_not_shown_is_not_solid(shape: str) -> None:
    style = "<style>/* x */ .soft, .ghost { display : none } text > a { font-size: 1px } @import 'x.css';</style>"
    assert plan(f'<rect width="1" height="1"/>{shape}', rest=style).walls.area == pytest.approx(1)


def test_paint_is_inherited_and_overridden_in_the_order_of_css() -> None:
    style = "<style><![CDATA[ rect {fill:none; stroke:red; stroke-width:1} #solid {fill:blue; stroke:none} ]]></style>"
    walls = (
        '<g fill="none"><rect id="solid" width="2" height="2" stroke="red"/>'
        '<rect x="5" y="3" width="2" height="2" style="stroke-width:0.5"/></g>'
    )
    assert plan(walls, rest=style).walls.area == pytest.approx(4 + 2.5**2 - 1.5**2)


def test_visible_inside_hidden() -> None:
    walls = '<g visibility="hidden"><rect visibility="visible" width="2" height="2"/></g>'
    assert plan(walls).walls.area == pytest.approx(4)


@pytest.mark.parametrize("href", ["href", "xlink:href"])
def test_use_repeats_a_shape(href: str) -> None:
    walls = f'<use {href}="#unit" x="2" transform="scale(2)"/><use {href}="#pair" fill="none"/>'
    defs = (
        '<defs><rect id="unit" width="1" height="1"/>'
        '<g id="pair"><rect x="8" width="1" height="1" fill="red"/><use href="#unit" y="4" fill="red"/></g></defs>'
    )
    wanted = shapely.union_all([shapely.box(4, 6, 6, 8), shapely.box(8, 7, 9, 8), shapely.box(0, 3, 1, 4)])
    assert same(plan(walls, rest=defs).walls, wanted)


def test_no_namespace_is_read_all_the_same() -> None:
    source = drawing('<rect width="1" height="1"/>').replace('xmlns="http://www.w3.org/2000/svg"', "")
    assert read_floor_plan(source, "plan.svg").walls.area == pytest.approx(1)


BAD_SHAPES = {
    '<path d="M0 0L1"/>': "too few or too many numbers",
    '<path d="M0 0H"/>': "too few numbers",
    '<path d="M0 0L1 1 2 0 oops"/>': "d has 'o', which is not a path command",
    '<path d="L1 1 2 0Z"/>': "should start with M",
    '<path d="M0 0H1e999V1Z"/>': "too large",
    '<path d="M0 0H99999V1Z"/>': "farther than 10000 m",
    '<rect width="-3" height="3"/>': "width is -3; it should not be negative",
    '<rect width="3m" height="3"/>': "width is '3m'; it should be a number, alone or with px, %, mm",
    '<rect width="nan" height="3"/>': "width is 'nan'",
    '<rect width="1e400" height="3"/>': "width is '1e400'",
    '<rect width="3" height="3" rx="-1"/>': "rx or ry is negative",
    '<polygon points="0 0 1 0 1"/>': "points has 5 numbers",
    '<polygon points="0 0 1 zero"/>': "should hold numbers alone",
    '<line fill="none" stroke="red" stroke-width="thick" x2="3"/>': "stroke-width is 'thick'",
    '<line fill="none" stroke="red" stroke-linecap="blunt" x2="3"/>': "'blunt' is no stroke-linecap",
    '<rect width="1" height="1" transform="spin(3)"/>': r"transform is 'spin\(3\)'",
    '<rect width="1" height="1" transform="scale(1 2 3)"/>': "transform scale has 3 numbers; it should have 1 or 2",
    '<rect width="1" height="1" transform="scale(a)"/>': "should hold numbers alone",
    '<rect width="1" height="1" transform="scale(1e200) scale(1e200)"/>': "out of all bounds",
    '<rect width="1" height="1" transform="rotate(1.7e308 1e308 0) scale(1e308)"/>': "out of all bounds",
    '<use href="#nowhere"/>': "<use> number 1 .*'#nowhere', which is not a shape or group here; unlink the clone",
    '<use href="other.svg#wall"/>': "unlink the clone",
    "<use/>": "unlink the clone",
    '<use href="#start" x="far"/>': "x is 'far'",
    '<g id="loop"><use href="#loop"/></g>': "nested deeper",
    "<g>" * 450 + "</g>" * 450: "nested deeper",
    '<g style="display:none"><rect width="1" height="1"/></g>': "the layer `walls` has no wall in it",
    "": "the layer `walls` has no wall in it",
}


@pytest.mark.parametrize(("shape", "message"), BAD_SHAPES.items(), ids=range(len(BAD_SHAPES)))
def test_a_bad_shape_is_refused_by_name(shape: str, message: str) -> None:
    assert re.search(message, error(drawing(shape))), error(drawing(shape))


WALL = '<rect width="1" height="1"/>'
BAD_DRAWINGS = {
    "": "line 1, column 1: not XML",
    "<svg>\n  <g></svg>": r"line 2, column \d+: not XML \(mismatched tag\)",
    "<svg\ud800/>": "line 1, column 5: not XML",
    "<svg>&amp;&nbsp;</svg>": "not XML .undefined entity",
    "<html/>": "the root is not an <svg> element",
    drawing(WALL, root=""): r"<svg> number 1 \(line 1\): width is '' and there is no viewBox",
    drawing(WALL, root='width="90%" height="3"'): "width is '90%' and there is no viewBox",
    drawing(WALL, root='viewBox="0 0 12"'): "viewBox has 3 numbers; it should have 4",
    drawing(WALL, root='viewBox="0 0 a b"'): "viewBox is '0 0 a b'",
    drawing(WALL, root='viewBox="0 0 0 8"'): "the viewBox is 0 x 8; it should be larger than nothing",
    drawing(WALL, root='width="0mm" viewBox="0 0 12 8"'): "the page is 0 m",
    drawing(WALL, root='width="1cm" viewBox="0 0 0 8"'): "the viewBox is 0 x 8",
    drawing(WALL, root='viewBox="0 0 1e9 8"'): "at most 10000 m",
    drawing(WALL, root='viewBox="0 0 12 8" width="1cm" height="9cm" preserveAspectRatio="left"'): "xMidYMid meet",
    drawing(WALL).replace('id="walls"', 'id="wall"'): "no layer `walls`",
    drawing(WALL, rest="<g>" * 2000 + "</g>" * 2000): "nested deeper",
    drawing(WALL, spawn='<g id="spawn"/>'): "the layer `spawn` has no area in it",
    drawing(WALL, spawn=f'<g id="spawn">{WALL}</g>'): "<rect> number 2 .*a spawn area has no id",
    drawing(WALL, spawn=f"{SPAWN}{SPAWN}"): '<rect id="start"> .*another spawn area has the same id',
}


@pytest.mark.parametrize(("source", "message"), BAD_DRAWINGS.items(), ids=range(len(BAD_DRAWINGS)))
def test_a_bad_drawing_is_refused(source: str, message: str) -> None:
    assert re.search(message, error(source)), error(source)


def test_the_line_of_the_element_is_named() -> None:
    assert '<circle id="font"> (line 3)' in error(drawing('<rect width="1" height="1"/>\n\n<circle id="font" r="-1"/>'))


@pytest.mark.thorough
@pytest.mark.parametrize("leaf", ['<rect id="g0" width="1" height="1"/>', '<g id="g0"/>'])
def test_references_cannot_multiply_without_end(leaf: str) -> None:
    levels = "".join(f'<g id="g{i + 1}">' + f'<use href="#g{i}"/>' * 10 + "</g>" for i in range(9))
    message = error(drawing('<use href="#g9"/>', rest=f"<defs>{leaf}{levels}</defs>"))
    assert "simplify the drawing" in message


def test_entities_cannot_multiply_without_end() -> None:
    levels = "".join(f'<!ENTITY e{i + 1} "' + f"&e{i};" * 10 + '">' for i in range(9))
    source = f'<!DOCTYPE svg [<!ENTITY e0 "x">{levels}]>' + drawing("<title>&e9;</title>")
    assert "not XML" in error(source)


RICH = drawing(
    '<g transform="translate(1 1) rotate(10)"><path id="p" fill-rule="evenodd" d="M0 0H4V4H0ZM1 1A1 2 30 0 1 3 2L2 3Z"'
    " />"
    '<path d="M0 0C1 1 2 0 3 3S1 2 4 1Q1 2 3 1T0 0" fill="none" stroke="red" stroke-width="2%"/></g>'
    '<circle cx="5" cy="5" r="1"/><use href="#p" x="2"/><polygon points="1,2 3 4 5 1"/>',
    root='width="12cm" viewBox="0 0 12 8"',
    rest="<style>.a{fill:none}</style>",
)
PIECES = [
    "", "0", "-1", "1e308", "1e-308", "nan", "Z", "M", "A", "z m", ",", '"', "<g>", "</g>", "url(#p)", "none", "%",
    "cm", "matrix(1 0 0 0 0 0)", "rotate(1e9)", "\x00", "\ud800", "&lt;", "]]>", "<use href='#walls'/>", "{", ":", ";",
]  # fmt: skip


def only_input_errors(source: str) -> None:
    try:
        read = read_floor_plan(source, "plan.svg")
    except InputError as refusal:
        message = str(refusal)
    else:
        message = "plan.svg: "
        assert read.walls.is_valid
        assert np.isfinite(read.walls.bounds).all()
    assert message.startswith("plan.svg: ")


@given(st.text(max_size=200))
@settings(max_examples=100, deadline=None)
def test_any_text_is_read_or_refused(text: str) -> None:
    only_input_errors(text)
    only_input_errors(drawing("").replace("</g>", f"{text}</g>", 1))


@given(st.text(alphabet="MmZzLlHhVvCcSsQqTtAa0123456789.,-e ", max_size=60))
@settings(max_examples=150, deadline=None)
@example("M0 0A1 1 0 0 0 z")
@example("M0 0 L z z z 1 1")
@example("m.1.1a0 0 0 00 0 0z")
def test_any_path_is_read_or_refused(data: str) -> None:
    only_input_errors(drawing(f'<path d="M1 1 {data}" stroke="red"/>'))
    only_input_errors(drawing(f'<path d="{data}" fill="none" stroke="red"/>'))


@given(
    st.lists(
        st.tuples(st.integers(0, len(RICH)), st.integers(0, 12), st.sampled_from(PIECES) | st.text(max_size=4)),
        min_size=1,
        max_size=4,
    )
)
@settings(max_examples=400, deadline=None)
def test_any_damage_to_a_good_drawing_is_read_or_refused(cuts: list[tuple[int, int, str]]) -> None:
    source = RICH
    for start, length, piece in cuts:
        source = source[:start] + piece + source[start + length :]
    only_input_errors(source)


NUMBER = re.compile(r"(?<=[ \"(MHVLAQCST,])-?\d+(?:\.\d+)?")


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_any_numbers_in_a_good_drawing_are_read_or_refused(data: st.DataObject) -> None:
    numbers = st.floats() | st.sampled_from([0.0, 1e-9, 1e4, 1e150, -1e300]) | st.integers(-20, 20)
    spots = list(NUMBER.finditer(RICH))
    chosen = data.draw(st.lists(st.sampled_from(range(len(spots))), min_size=1, max_size=3, unique=True))
    source = RICH
    for spot in sorted(chosen, reverse=True):
        match = spots[spot]
        source = source[: match.start()] + repr(data.draw(numbers)) + source[match.end() :]
    only_input_errors(source)


def test_a_good_drawing_is_read_in_full() -> None:
    read = read_floor_plan(RICH, "plan.svg", 100.0)
    assert read.width == pytest.approx(12)
    assert read.walls.area > 12


def test_long_path_data_takes_no_longer_for_a_curve_at_its_end() -> None:
    """A pattern that tried all ways to cut digits into numbers would not end within the life of this machine."""
    data = "M0 0L" + " ".join(f"{1000001 + i} {2000003 + i}" for i in range(300)) + "C0 0 1 1 2 2Z"
    with pytest.raises(InputError, match="farther than"):
        read_floor_plan(f'<svg viewBox="0 0 4 4"><path d="{data}"/></svg>', "plan.svg")


def test_a_page_of_pixels_is_told_how_large_it_is_taken() -> None:
    walls = '<path d="M0 0H1200V800H0Z M9 9V791H1191V9Z" fill-rule="evenodd"/>'
    (told, _) = read_floor_plan(f'<svg viewBox="0 0 1200 800">{walls}</svg>', "w.svg").notices
    assert "its page is 1200 m x 800 m, as one user unit counts as a metre; world.width = METRES" in told
    (only,) = read_floor_plan(f'<svg viewBox="0 0 1200 800">{walls}</svg>', "w.svg", across=12.0).notices
    assert "its visible shape is a wall" in only
