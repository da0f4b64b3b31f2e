"""Test buildings in the drawing styles of programs and people, each with its floor's area."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World
from swarmsim.world.plan import FloorPlan
from swarmsim.world.source import floor_plan, read_world

Place = tuple[float, float]  # m
CELL = 0.1  # m


@dataclass(frozen=True, slots=True)
class Made:
    """A file and the facts about its building."""

    name: str
    content: str | bytes | Callable[[Path], None]  # of the file, or its writer
    area: float  # m2 of floor
    inside: tuple[Place, ...]  # places on the floor
    outside: tuple[Place, ...]  # places off it: in walls, in furniture, outside the building
    keys: Mapping[str, object] = field(default_factory=dict)  # of `[world]`
    says: tuple[str, ...] = ()  # words of its notices
    more: Mapping[str, bytes] = field(default_factory=dict)  # files beside it
    slack: float = 0.0  # m2, beyond 1 % of the area

    def world(self, folder: Path, **keys: object) -> World:
        """Write the file; gives its world."""
        path = folder / self.name
        for name, content in self.more.items():
            (folder / name).write_bytes(content)
        if callable(self.content):
            self.content(path)
        else:
            path.write_bytes(self.content.encode() if isinstance(self.content, str) else self.content)
        return convert({"file": str(path), **self.keys, **keys}, World)


def plan_in(world: World, cell: float = CELL) -> FloorPlan:
    return floor_plan(read_world(world, cell), world)


def floor_in(plan: FloorPlan) -> shapely.Polygon:
    """The closed piece of free space that holds most of the spawn areas."""
    solid = shapely.union(plan.walls, plan.border)
    around = shapely.box(*shapely.total_bounds([solid, shapely.box(*plan.page)])).buffer(1.0)
    pieces = shapely.get_parts(around.difference(solid))
    inner = pieces[~shapely.intersects(pieces, around.exterior)]
    spawns = shapely.union_all([*plan.spawns.values()]) if plan.spawns else around
    return inner[shapely.area(shapely.intersection(inner, spawns)).argmax()]


# ---------------------------------------------------------------------------------------------------------------- SVG
# Most are one house: 8 m x 6 m, walls of 0.2 m, and one across it at 5.0 m to 5.2 m with a door of 0.9 m at y = 2.5 m
# to 3.4 m, from above. Drawings have y down; places have y up, as plans have.

WIDTH, HEIGHT, WALL = 8.0, 6.0, 0.2
LEFT, RIGHT = 4.8 * 5.6, 2.6 * 5.6  # m2
HOUSE = LEFT + RIGHT + 0.2 * 0.9
IN = ((1.0, 1.0), (4.0, 5.0), (7.0, 1.0))  # floor in both rooms
OUT = ((0.1, 3.0), (5.1, 1.0), (4.0, 5.95))  # in walls
AXES = "M.1 .1H7.9V5.9H.1Z"  # of the outer walls


def svg(body: str, box: str = "0 0 8 6", more: str = "") -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" {more}>{body}</svg>'


def lines(*data: str, colour: str = "#000", width: float = WALL) -> str:
    """Strokes, each as its own element."""
    return "".join(f'<path d="{one}" fill="none" stroke="{colour}" stroke-width="{width}"/>' for one in data)


def rect(x: float, y: float, width: float, height: float, paint: str = "") -> str:
    return f'<rect x="{x}" y="{y}" width="{width}" height="{height}" {paint}/>'


GAP = "M5.1 .1V2.5M5.1 3.4V5.9"  # the wall across with its door
WHOLE = "M5.1 .1V5.9"
BLACK = (  # all walls as filled shapes
    rect(0, 0, 8, 0.2) + rect(0, 5.8, 8, 0.2) + rect(0, 0, 0.2, 6) + rect(7.8, 0, 0.2, 6)
)
ACROSS = rect(5, 0, 0.2, 2.5) + rect(5, 3.4, 0.2, 2.6)
TWO = "M0 0H8V6H0ZM.2 .2H5V2.5H5.2V.2H7.8V5.8H5.2V3.4H5V5.8H.2Z"  # both sides of every wall


def arc(hinge: Place, closed: Place, degrees: float, parts: int = 1) -> tuple[str, str]:
    """A door: the leaf, opened by `degrees`, and the arc to its closed position, as two paths."""
    (x, y), (end, low) = hinge, closed
    radius, start = math.hypot(end - x, low - y), math.atan2(low - y, end - x)
    open_ = start + math.radians(degrees)
    tip = x + radius * math.cos(open_), y + radius * math.sin(open_)
    swing = f"M{tip[0]:.6f} {tip[1]:.6f}A{radius} {radius} 0 0 0 {end} {low}"
    return f"M{x} {y}L{tip[0]:.6f} {tip[1]:.6f}", swing


def cubic(hinge: Place, closed: Place, degrees: float) -> str:
    """A door as one path with a cubic curve for its arc, as most programs write it."""
    (x, y), (end, low) = hinge, closed
    radius, start = math.hypot(end - x, low - y), math.atan2(low - y, end - x)
    turn = math.radians(degrees)
    pull = 4.0 / 3.0 * math.tan(turn / 4.0) * radius
    tip = np.array([x + radius * math.cos(start + turn), y + radius * math.sin(start + turn)])
    one = tip + pull * np.array([math.sin(start + turn), -math.cos(start + turn)])
    two = np.array([end, low]) + pull * np.array([-math.sin(start), math.cos(start)])
    return "M{} {}L{:.6f} {:.6f}C{:.6f} {:.6f} {:.6f} {:.6f} {} {}".format(x, y, *tip, *one, *two, end, low)


HINGE, CLOSED = (5.1, 3.4), (5.1, 2.5)  # of the door in the wall across, drawn in the middle of the wall
PEN = 0.04


def door(degrees: float) -> str:
    return lines(*arc(HINGE, CLOSED, degrees), width=PEN)


def stroked(degrees: float) -> float:
    """The floor area in m2 that a door symbol would cover if it were a wall."""
    return PEN * 0.9 * (1.0 + math.radians(degrees))


ROOMS = (  # rooms as filled areas with outlines, walls between their outlines
    rect(0.1, 0.1, 5.0, 5.8, 'fill="#f6e3c5" stroke="#000" stroke-width=".2"')
    + rect(5.1, 0.1, 2.8, 5.8, 'fill="#cfe3f6" stroke="#000" stroke-width=".2"')
)
THREE = (  # three rooms, the last below the second
    rect(0.1, 0.1, 5.0, 5.8, 'fill="#f6e3c5" stroke="#000" stroke-width=".2"')
    + rect(5.1, 0.1, 2.8, 2.9, 'fill="#cfe3f6" stroke="#000" stroke-width=".2"')
    + rect(5.1, 3.0, 2.8, 2.9, 'fill="#e3cff6" stroke="#000" stroke-width=".2"')
)
IN_THREE = ((1.0, 1.0), (6.5, 5.0), (6.5, 1.0))
OUT_THREE = ((0.1, 3.0), (6.5, 3.0), (5.1, 0.5))
FRAME = lines("M-3.5 -3.5H11.5V9.5H-3.5Z", width=0.05)
PAGE = "-4 -4 16 14"  # the house in the middle of a page
FAR = ((-0.5 + 4, 3.0 + 4), (10.0 + 4, 9.0 + 4), (4.0 + 4, 5.95 + 4))
INK = '<g inkscape:groupmode="layer" inkscape:label="{}">{}</g>'
SPACES = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'


def moved(places: tuple[Place, ...], x: float, y: float) -> tuple[Place, ...]:
    return tuple((one + x, other + y) for one, other in places)


TABLE = 0.64  # m2


def _svgs() -> list[Made]:
    house = lines(AXES, GAP)
    closed = lines(AXES, WHOLE)
    table = ((2.4, 2.4),)
    found = [
        Made("strokes.svg", svg(house), HOUSE, IN, OUT),
        Made("one-path.svg", svg(lines(AXES + GAP)), HOUSE, IN, OUT),
        Made("thick-filled.svg", svg(BLACK + ACROSS), HOUSE, IN, OUT),
        Made("hollow-walls.svg", svg(lines(TWO, width=0.02)), HOUSE - 0.01 * 39, IN, OUT, slack=0.2),
        Made(
            "hollow-walls-separate.svg",
            svg(lines(*(f"M{one}" for one in TWO.split("M")[1:]), width=0.02)),
            HOUSE - 0.01 * 39,
            IN,
            OUT,
            slack=0.2,
        ),
        Made(
            "hollow-furniture.svg",
            svg(house + lines("M2 3.2H2.8V4H2Z", width=0.02)),
            HOUSE - 0.82**2,
            IN,
            (*OUT, *table),
        ),
        Made("solid-furniture.svg", svg(house + rect(2, 3.2, 0.8, 0.8)), HOUSE - TABLE, IN, (*OUT, *table)),
        Made(
            "round-table.svg",
            svg(house + '<circle cx="2.4" cy="3.6" r=".6"/>'),
            HOUSE - 0.36 * math.pi,
            IN,
            (*OUT, *table),
        ),
        Made("white-bars.svg", svg(closed + rect(4.9, 2.5, 0.4, 0.9, 'fill="#fff"')), HOUSE, IN, OUT),
        Made("white-stroke-bars.svg", svg(closed + lines("M5.1 2.5V3.4", colour="white", width=0.3)), HOUSE, IN, OUT),
        Made(
            "classes.svg",
            svg(f'<g class="walls">{closed}</g><g class="doors">{rect(5, 2.5, 0.2, 0.9)}</g>'),
            HOUSE,
            IN,
            OUT,
        ),
        Made(
            "layers.svg",
            svg(
                INK.format("Walls", closed)
                + INK.format("Doors", rect(4.9, 2.5, 0.4, 0.9))
                + INK.format("Furniture", rect(2, 3.2, 0.8, 0.8)),
                more=SPACES,
            ),
            HOUSE - TABLE,
            IN,
            (*OUT, *table),
        ),
        Made(
            "named-classes.svg",
            svg(f'<g class="mur">{closed}</g><g class="porte">{rect(4.9, 2.5, 0.4, 0.9)}</g>'),
            HOUSE,
            IN,
            OUT,
            {"layers": {"walls": [".mur"], "doors": [".porte"]}},
        ),
        Made(
            "front-door.svg",
            svg(lines("M3 5.9H.1V.1H7.9V5.9H4", GAP)),
            HOUSE + 0.1,
            IN,
            OUT[:2],
            says=("a border closes it",),
            slack=0.2,
        ),
        Made(
            "front-door-page.svg",
            svg(lines("M3 5.9H.1V.1H7.9V5.9H4", GAP), PAGE),
            HOUSE + 0.2,
            moved(IN, 4, 4),
            FAR[:2],
            says=("a border closes it",),
        ),
        Made("frame.svg", svg(FRAME + house, PAGE), HOUSE, moved(IN, 4, 4), FAR),
        Made(
            "title-block.svg",
            svg(FRAME + lines("M6 8H11.5M6 8V9.5M9 8V9.5", width=0.05) + house, PAGE),
            HOUSE,
            moved(IN, 4, 4),
            FAR,
        ),
        Made(
            "dark-paper.svg",
            svg(rect(-4, -4, 16, 14, 'fill="#123a6b"') + lines(AXES, GAP, colour="#fff"), PAGE),
            HOUSE,
            moved(IN, 4, 4),
            FAR,
            says=("fills the page and is taken for its paper",),
        ),
        Made(
            "courtyard.svg",
            svg(lines("M.1 .1H11.9V9.9H.1Z", "M4 3H8V7H4Z"), "0 0 12 10"),
            11.6 * 9.6 - 4.2**2,
            ((1, 1), (11, 9), (2, 5)),
            ((6, 5), (4, 5), (0.1, 5)),
        ),
        Made(
            "l-shape.svg",
            svg(lines("M3 5.9H.1V.1H3.9V3.1H7.9V5.9H4"), "0 0 8 6"),
            3.6 * 3.0 + 7.6 * 2.6 + 0.1,
            ((1, 1), (2, 5), (7, 1)),
            ((6, 4.5), (7.9, 2), (3.9, 4)),
            says=("a border closes it",),
            slack=0.3,
        ),
        Made(
            "rooms-filled.svg",
            svg(ROOMS),
            LEFT + RIGHT,
            IN,
            OUT,
            {"solid": "strokes", "doors": 0.9},
            says=("1 door of 0.9 m was made",),
            slack=0.18,
        ),
        Made(
            "rooms-found.svg",
            svg(THREE),
            LEFT + 2.6 * 5.4 + 0.36,
            IN_THREE,
            OUT_THREE,
            says=("filled areas cover", "2 doors of 0.9 m were made"),
        ),
        Made(
            "rooms-page.svg",
            svg(rect(-4, -4, 16, 14, 'fill="#fff"') + THREE, PAGE),
            LEFT + 2.6 * 5.4 + 0.36,
            moved(IN_THREE, 4, 4),
            (*moved(OUT_THREE, 4, 4), (1, 1)),
            says=("filled areas cover",),
        ),
        Made(
            "rooms-with-door.svg",
            svg(THREE + rect(4.9, 1, 0.4, 0.9, 'fill="#fff"') + rect(4.9, 4, 0.4, 0.9, 'fill="#fff"')),
            LEFT + 2.6 * 5.4 + 0.36,
            IN_THREE,
            OUT_THREE,
        ),
        Made(
            "rooms-in-classes.svg",
            svg('<g class="room">' + THREE.replace("stroke=", "data-was=") + "</g>"),
            LEFT + 2.7 * 5.6,
            IN_THREE,
            OUT_THREE,
            {"floor": [".room"]},
            says=("2 doors",),
            slack=2.5,
        ),
        Made(
            "faint-fills.svg",
            svg(lines(AXES, GAP) + rect(0.5, 0.5, 4, 4, 'fill="#00f" fill-opacity=".02"')),
            HOUSE,
            IN,
            OUT,
        ),
        Made(
            "half-transparent.svg",
            svg(THREE.replace('fill="', 'fill-opacity=".4" fill="')),
            LEFT + 2.6 * 5.4 + 0.36,
            IN_THREE,
            OUT_THREE,
        ),
        Made(
            "partial-layers.svg",
            svg(INK.format("Base plan", house) + INK.format("Furniture", rect(2, 3.2, 0.8, 0.8)), more=SPACES),
            HOUSE - TABLE,
            IN,
            (*OUT, *table),
            {"layers": {"walls": ["Base plan"]}},
        ),
        Made(
            "hidden.svg",
            svg(house + '<g display="none">' + rect(1, 1, 3, 3) + "</g>" + rect(1, 1, 1, 1, 'visibility="hidden"')),
            HOUSE,
            IN,
            OUT,
            says=("2 shapes are hidden, and passed over",),
        ),
        Made(
            "stray.svg",
            svg(house + BLACK * 20 + rect(5e6, -4e7, 1, 1)),
            HOUSE,
            IN,
            OUT,
            says=("1 shape is far off the page",),
        ),
        Made("nested.svg", svg("<g>" * 300 + house + "</g>" * 300), HOUSE, IN, OUT),
        Made(
            "undeclared.svg",
            svg(
                '<defs><path id="w" d="M5.1 .1V2.5M5.1 3.4V5.9" stroke="#000" stroke-width=".2"/></defs>'
                + lines(AXES)
                + '<use xlink:href="#w"/>'
            ),
            HOUSE,
            IN,
            OUT,
        ),
        Made(
            "mm.svg",
            svg(f'<g transform="scale(1000)">{house}</g>', "0 0 8000 6000", 'width="8000mm" height="6000mm"'),
            HOUSE,
            IN,
            OUT,
        ),
        Made(
            "clipped.svg",
            svg(
                '<clipPath id="c"><rect width="8" height="6"/></clipPath><g clip-path="url(#c)">'
                + house
                + rect(8, 2, 9, 1)
                + "</g>"
            ),
            HOUSE,
            IN,
            OUT,
        ),
        Made(
            "texts.svg",
            svg(house + '<text x="1" y="2" font-size=".5">Hall</text>'),
            HOUSE,
            IN,
            OUT,
            says=("1 <text> are passed over",),
        ),
    ]
    for degrees in (90, 60, 30, 13):
        found.append(
            Made(f"arc-{degrees}-gap.svg", svg(house + door(degrees)), HOUSE, IN, OUT, says=("1 door symbol cuts",))
        )
        found.append(
            Made(f"arc-{degrees}-over.svg", svg(closed + door(degrees)), HOUSE, IN, OUT, says=("1 door symbol cuts",))
        )
        found.append(
            Made(
                f"arc-{degrees}-cubic.svg",
                svg(closed + lines(cubic(HINGE, CLOSED, degrees), width=PEN)),
                HOUSE,
                IN,
                OUT,
                says=("1 door symbol cuts",),
            )
        )
    return found


SVGS = _svgs()


def _hard() -> list[Made]:
    """Drawings with ambiguous shapes."""
    house, closed = lines(AXES, GAP), lines(AXES, WHOLE)
    thin = {"width": 0.03}
    window = rect(2, -0.02, 1.5, 0.24, 'fill="#fff" stroke="#000" stroke-width=".03"') + lines("M2 .1H3.5", **thin)
    slots = lines("M.1 3.5V5.9H7.9V.1H3.5M2 .1H.1V2", GAP) + lines(
        "M2 0H3.5M2 .1H3.5M2 .2H3.5M0 2V3.5M.2 2V3.5", **thin
    )
    pie = "M5.1 3.4L4.2 3.4A.9 .9 0 0 1 5.1 2.5Z"
    return [
        Made("pie-door.svg", svg(closed + lines(pie, **thin)), HOUSE, IN, OUT, says=("1 door symbol cuts",)),
        Made(
            "pie-door-filled.svg",
            svg(closed + f'<path d="{pie}" fill="#fff" stroke="#000" stroke-width=".03"/>'),
            HOUSE,
            IN,
            OUT,
            says=("1 door symbol cuts",),
        ),
        Made("pie-door-gap.svg", svg(house + lines(pie, **thin)), HOUSE, IN, OUT, says=("1 door symbol cuts",)),
        Made(
            "box-leaf.svg",
            svg(house + lines("M5.1 3.4H4.2V3.36H5.1Z", "M4.2 3.4A.9 .9 0 0 1 5.1 2.5", width=0.01)),
            HOUSE,
            IN,
            OUT,
            says=("1 door symbol cuts",),
        ),
        Made(
            "box-leaf-filled.svg",
            svg(closed + rect(4.2, 3.36, 0.9, 0.04) + lines("M4.2 3.4A.9 .9 0 0 1 5.1 2.5", width=0.01)),
            HOUSE,
            IN,
            OUT,
            says=("1 door symbol cuts",),
        ),
        Made(
            "leaf-beside-wall.svg",
            svg(house + lines("M5 3.4H4.1", "M4.1 3.4A.9 .9 0 0 1 5 2.5", width=0.03)),
            HOUSE,
            IN,
            OUT,
            says=("1 door symbol cuts",),
        ),
        Made(
            "double-door.svg",
            svg(
                lines(AXES, "M5.1 .1V2M5.1 3.6V5.9")
                + lines("M5.1 2H4.3A.8 .8 0 0 0 5.1 2.8A.8 .8 0 0 0 4.3 3.6H5.1", **thin)
            ),
            LEFT + RIGHT + 0.32,
            IN,
            OUT,
        ),
        Made(
            "double-door-over.svg",
            svg(
                closed
                + lines(
                    "M5.1 2H4.3", "M4.3 2A.8 .8 0 0 0 5.1 2.8", "M5.1 3.6H4.3", "M4.3 3.6A.8 .8 0 0 1 5.1 2.8", **thin
                )
            ),
            LEFT + RIGHT + 0.32,
            IN,
            OUT,
            says=("2 door symbols cut",),
        ),
        Made(
            "front-door-symbol.svg",
            svg(house + lines("M3 5.9V5", "M3 5A.9 .9 0 0 1 3.9 5.9", **thin)),
            HOUSE + 0.18,
            IN,
            OUT[:2],
            slack=0.2,
        ),
        Made("windows-white.svg", svg(house + window), HOUSE, IN, OUT),
        Made("windows-lines.svg", svg(slots), HOUSE, IN, OUT[1:], slack=0.3),
        Made(
            "shower.svg",
            svg(house + lines("M.2 .2H1.1A.9 .9 0 0 1 .2 1.1Z", **thin)),
            HOUSE - 0.25 * math.pi * 0.81,
            (*IN[:2], (2.0, 5.0)),
            (*OUT, (0.5, 5.5)),
            slack=0.05,
        ),
        Made(
            "round-rug.svg",
            svg(house + lines("M2 3A.8 .8 0 1 0 3.6 3A.8 .8 0 1 0 2 3Z", **thin)),
            HOUSE - math.pi * 0.815**2,
            IN,
            OUT,
        ),
        Made(
            "rounded-table.svg",
            svg(
                house
                + '<rect x="1.5" y="3" width="2.4" height="1.4" rx=".6" fill="none" stroke="#000" stroke-width=".03"/>'
            ),
            HOUSE - 2.43 * 1.43 + (4 - math.pi) * 0.615**2,
            IN,
            (*OUT, (2.5, 2.3)),
        ),
        Made(
            "stairs.svg",
            svg(house + lines(*(f"M{6 + 0.3 * i:.1f} 4.6V5.8" for i in range(6)), "M6 4.6H7.5", **thin)),
            HOUSE - 1.515 * 1.215,
            (*IN[:2], (7.0, 5.0)),
            (*OUT, (6.5, 0.8)),
            slack=0.1,
        ),
        Made(
            "round-building.svg",
            svg(
                '<circle cx="4" cy="4" r="3.9" fill="none" stroke="#000" stroke-width=".2"/>'
                + lines("M4 .1V3.5M4 4.5V7.9"),
                "0 0 8 8",
            ),
            math.pi * 3.8**2 - 0.2 * 6.6,
            ((2, 4), (6, 4), (4, 4)),
            ((4, 1), (0.5, 0.5), (0.1, 4)),
            slack=0.1,
        ),
        Made(
            "slanted.svg",
            svg(f'<g transform="translate(8 2) rotate(30)">{house}</g>', "0 0 16 14"),
            HOUSE,
            ((8.0, 8.5), (9.0, 10.0), (11.5, 6.0)),
            ((1, 1), (15, 13), (1, 13)),
        ),
        Made(
            "grid-behind.svg",
            svg(
                lines(
                    *(f"M{i} 0V6" for i in range(1, 8)), *(f"M0 {i}H8" for i in range(1, 6)), colour="#eee", width=0.01
                )
                + house
            ),
            HOUSE,
            IN,
            OUT,
        ),
        Made(
            "rooms-and-page.svg",
            svg(FRAME + THREE, PAGE),
            LEFT + 2.6 * 5.4 + 0.36,
            moved(IN_THREE, 4, 4),
            (*moved(OUT_THREE, 4, 4), (1, 1)),
            says=("filled areas cover",),
        ),
        Made(
            "frame-open-door.svg",
            svg(FRAME + lines("M3 5.9H.1V.1H7.9V5.9H4", GAP), PAGE),
            HOUSE + 0.2,
            moved(IN, 4, 4),
            FAR[:2],
        ),
        Made(
            "frame-of-four-lines.svg",
            svg(
                lines("M-3.5 -3.5H11.5", "M11.5 -3.5V9.5", "M11.5 9.5H-3.5", "M-3.5 9.5V-3.5", width=0.05) + house, PAGE
            ),
            HOUSE,
            moved(IN, 4, 4),
            FAR,
        ),
        Made(
            "two-frames.svg",
            svg(
                rect(-3.9, -3.9, 15.8, 13.8, 'fill="none" stroke="#000" stroke-width=".01"')
                + FRAME
                + lines("M6 8H11.5M6 8V9.5", width=0.05)
                + house,
                PAGE,
            ),
            HOUSE,
            moved(IN, 4, 4),
            FAR,
        ),
        Made(
            "rooms-hollow-walls.svg",
            svg(
                rect(0, 0, 8, 6, 'fill="#ddd" stroke="#000" stroke-width=".02"')
                + rect(0.2, 0.2, 4.8, 5.6, 'fill="#fee" stroke="#000" stroke-width=".02"')
                + rect(5.2, 0.2, 2.6, 2.7, 'fill="#efe" stroke="#000" stroke-width=".02"')
                + rect(5.2, 3.1, 2.6, 2.7, 'fill="#eef" stroke="#000" stroke-width=".02"')
            ),
            LEFT + 2.6 * 5.4 + 0.36,
            IN_THREE,
            OUT_THREE[:1] + OUT_THREE[2:] + ((6.5, 2.99),),
            says=("2 doors",),
            slack=0.2,
        ),
        Made("walls-grey.svg", svg(house.replace("#000", "#888")), HOUSE, IN, OUT),
        Made(
            "walls-light-on-dark-rooms.svg",
            svg(rect(0, 0, 8, 6, 'fill="#222"') + lines(AXES, GAP, colour="#ddd")),
            HOUSE,
            IN,
            OUT,
        ),
        Made("coloured-floor.svg", svg(rect(0, 0, 8, 6, 'fill="#c8e6c9"') + house), HOUSE, IN, OUT),
        Made(
            "one-room-filled.svg",
            svg(rect(0.1, 0.1, 7.8, 5.8, 'fill="#c8e6c9" stroke="#000" stroke-width=".2"') + lines(GAP)),
            HOUSE,
            IN,
            OUT,
        ),
        Made("floor-below.svg", svg(rect(0.5, 0.5, 7, 5, 'fill="#c8e6c9"') + house), HOUSE, IN, OUT),
    ]


HARD = _hard()


def _furnished() -> list[Made]:
    """Plans with hollow walls, furniture, and other elements of CAD programs."""
    house, slack = lines(AXES, GAP), 0.4
    hollow = lines("M0 0H8V6H0ZM.2 .2H5V5.8H.2ZM5.2 .2H7.8V5.8H5.2Z", width=0.02)
    faces = [lines(*arc((x, 3.4), (x, 2.5), degrees), width=0.02) for x, degrees in ((5.1, 60), (5.0, 90))]
    white = 'fill="#fff" stroke="#000" stroke-width=".02"'
    bed = rect(1, 1, 2, 1.6, white) + rect(1, 1, 0.4, 0.7, white)
    sizes = lines("M0 -1H8", "M0 -1.2V-.1", "M8 -1.2V-.1", "M5.1 -1.2V-.1", width=0.01)
    shade = '<linearGradient id="g"><stop offset="0" stop-color="#eee"/><stop offset="1" stop-color="#ddd"/>'
    arrow = '<circle cx="10" cy="0" r=".8" fill="none" stroke="#000" stroke-width=".02"/>'
    cut = ("1 door symbol cuts",)
    return [
        Made("hollow-swing.svg", svg(hollow + faces[0]), HOUSE, IN, OUT, says=cut, slack=slack),
        Made("hollow-swing-face.svg", svg(hollow + faces[1]), HOUSE, IN, OUT, says=cut, slack=slack),
        Made("hollow-made.svg", svg(hollow), HOUSE, IN, OUT, {"doors": 0.9}, ("1 door of 0.9 m",), slack=slack),
        Made("bed.svg", svg(house + bed), HOUSE - 2.02 * 1.62, IN, (*OUT, (2, 4.2), (1.2, 4.8))),
        Made("sofa.svg", svg(house + rect(1, 1, 2, 1.6, 'fill="#ccc"')), HOUSE - 3.2, IN, (*OUT, (2, 4.2))),
        Made("sizes.svg", svg(house + sizes, "-2 -2 12 10"), HOUSE, moved(IN, 2, 2), ((1, 5), (2.1, 5), (7.1, 3))),
        Made("sizes-frame.svg", svg(FRAME + house + sizes, PAGE), HOUSE, moved(IN, 4, 4), FAR),
        Made("gradient.svg", svg(f"{shade}</linearGradient>{rect(0.3, 0.3, 7, 5, PAINTED)}{house}"), HOUSE, IN, OUT),
        Made("sliding.svg", svg(house + lines("M5.06 2.4V3", "M5.14 2.9V3.5", width=0.03)), HOUSE, IN, OUT),
        Made("arrow.svg", svg(house + arrow, "-2 -2 14 10"), HOUSE, moved(IN, 2, 2), ((12, 8), (1, 5), (7.1, 3))),
    ]


PAINTED = 'fill="url(#g)"'
FURNISHED = _furnished()


# --------------------------------------------------------------------------------------------------------------- maps

FREE, WALL_GREY, UNKNOWN = 254, 0, 205
PIXEL = 0.05  # m


def yaml(image: str, **keys: object) -> str:
    said = {"image": image, "resolution": PIXEL, "origin": [0.0, 0.0, 0.0], "negate": 0, "occupied_thresh": 0.65}
    return "".join(f"{key}: {value}\n" for key, value in {**said, "free_thresh": 0.196, **keys}.items())


def pgm(pixels: NDArray[np.uint8]) -> bytes:
    """An image of grey levels with its first row at the bottom."""
    rows, columns = pixels.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + pixels[::-1].tobytes()


def hall(rows: int = 120, columns: int = 160) -> NDArray[np.uint8]:
    """The house again: 8 m x 6 m, in pixels of 5 cm."""
    pixels = np.full((rows, columns), FREE, np.uint8)
    pixels[:4] = pixels[-4:] = pixels[:, :4] = pixels[:, -4:] = WALL_GREY
    pixels[:52, 100:104] = pixels[70:, 100:104] = WALL_GREY
    return pixels


def _maps() -> list[Made]:
    def pair(
        name: str, pixels: NDArray[np.uint8], area: float, outside: tuple[Place, ...] = OUT, **more: object
    ) -> Made:
        keys = {key: more.pop(key) for key in ("world",) if key in more}
        inside = more.pop("inside", IN)
        says, slack, shift = more.pop("says", ()), more.pop("slack", 0.0), more.pop("shift", (0.0, 0.0))
        return Made(
            f"{name}.yaml",
            yaml(f"{name}.pgm", **more),
            area,
            moved(inside, *shift),
            moved(outside, *shift),
            keys.get("world", {}),
            says,
            {f"{name}.pgm": pgm(pixels)},
            slack,
        )  # type: ignore[arg-type]

    free = LEFT + RIGHT + 0.18
    rng = np.random.default_rng(3)
    specks = hall()
    for row, column in rng.integers(8, 50, (25, 2)):
        specks[row, column] = WALL_GREY
    thick = hall()
    thick[:20] = WALL_GREY
    thick[8:12, 30:38] = FREE  # 0.08 m2 within a wall
    rack = hall()
    rack[60:80, 30:60] = WALL_GREY
    rack[62:78, 32:58] = FREE
    cropped = hall()[4:, 4:]  # without the lower and the left wall
    unknown = hall()[4:, 4:]
    unknown[:30, :40] = UNKNOWN
    around = np.full((200, 240), UNKNOWN, np.uint8)
    around[40:160, 40:200] = hall()
    masked = np.where(hall() == WALL_GREY, 0, 255).astype(np.uint8)
    table = hall()
    rows, columns = np.indices(table.shape)
    table[np.hypot(rows - 60, columns - 50) < 12] = WALL_GREY
    dashes = hall()
    dashes[:52, 100:104] = FREE
    dashes[10:12, 100:104] = WALL_GREY
    return [
        pair("plain", hall(), free),
        pair("specks", specks, free - 24 * PIXEL**2, slack=0.3),
        pair(
            "pocket",
            thick,
            free - 0.8 * (4.8 + 2.6),
            inside=((1.0, 2.0), (4.0, 5.0), (7.0, 1.5)),
            outside=(*OUT, (1.7, 0.5)),
            says=(),
        ),
        pair("rack", rack, free - 1.5, outside=(*OUT, (2.2, 3.5))),
        pair(
            "cropped",
            cropped,
            free,
            shift=(-0.2, -0.2),
            outside=((5.1, 1.0), (4.0, 5.95), (9.0, 1.0)),
            says=("a border closes it",),
            slack=0.2,
        ),
        pair(
            "cropped-unknown",
            unknown,
            free - 3.0,
            shift=(-0.2, -0.2),
            inside=((3.0, 1.0), *IN[1:]),
            outside=((5.1, 1.0), (4.0, 5.95), (1.0, 1.0)),
            says=("a border closes it",),
            slack=0.2,
        ),
        pair("unknown-around", around, free, shift=(2.0, 2.0), outside=(*OUT, (-1.0, 3.0))),
        pair("negative", 255 - masked, free, negate=1),
        pair("turned-origin", hall(), free, origin=[10.0, -3.0, 0.0], shift=(10.0, -3.0)),
        pair("round-table", table, free - math.pi * 0.36, outside=(*OUT, (2.5, 3.0)), slack=0.1),
        pair("filled-pockets", rack, free - 1.5, outside=(*OUT, (2.2, 3.5)), world={"pockets": "fill"}),
        pair("swept", specks, free, world={"despeckle": 0.02}, slack=0.3),
        pair("open-below", dashes, free + 0.2 * 2.3 - 0.02, outside=(OUT[0], OUT[2], (5.1, 5.0)), slack=0.05),
    ]


MAPS = _maps()


# ---------------------------------------------------------------------------------------------------------------- DXF


def cad(draw: Callable[[object, float], None], unit: int = 4, metre: float = 0.001) -> Callable[[Path], None]:
    """Writes a document by `draw`; metres are divided by the document's unit."""

    def write(path: Path) -> None:
        import ezdxf

        document = ezdxf.new("R2010")
        document.header["$INSUNITS"] = unit
        draw(document, metre)
        document.saveas(path)

    return write


RINGS = (
    [(0, 0), (8, 0), (8, 6), (0, 6)],
    [
        *((0.2, 0.2), (5, 0.2), (5, 2.6), (5.2, 2.6), (5.2, 0.2), (7.8, 0.2)),
        *((7.8, 5.8), (5.2, 5.8), (5.2, 3.5), (5, 3.5), (5, 5.8), (0.2, 5.8)),
    ],
)


def _dxfs() -> list[Made]:
    def scaled(corners: object, metre: float) -> list[Place]:
        return [(x / metre, y / metre) for x, y in corners]  # type: ignore[attr-defined]

    def sides(document: object, metre: float, layer: str = "0") -> None:
        for ring in RINGS:
            document.modelspace().add_lwpolyline(scaled(ring, metre), close=True, dxfattribs={"layer": layer})  # type: ignore[attr-defined]

    def blocks(document: object, metre: float) -> None:
        sides(document, metre, "A-WALL")
        document.layers.add("A-FURN")  # type: ignore[attr-defined]
        block = document.blocks.new("TABLE")  # type: ignore[attr-defined]
        block.add_lwpolyline(scaled(((0, 0), (0.8, 0), (0.8, 0.8), (0, 0.8)), metre), close=True)
        document.modelspace().add_blockref("TABLE", (2 / metre, 2 / metre), dxfattribs={"layer": "A-FURN"})  # type: ignore[attr-defined]

    def frozen(document: object, metre: float) -> None:
        sides(document, metre, "A-WALL")
        document.layers.add("Hatches").freeze()  # type: ignore[attr-defined]
        document.layers.add("Old").off()  # type: ignore[attr-defined]
        for layer in ("Hatches", "Old"):
            document.modelspace().add_line((0, 3 / metre), (8 / metre, 3 / metre), dxfattribs={"layer": layer})  # type: ignore[attr-defined]

    def swung(degrees: float) -> Callable[[object, float], None]:
        def draw(document: object, metre: float) -> None:
            space = document.modelspace()  # type: ignore[attr-defined]
            for ring in (RINGS[0], RINGS[1][:2] + RINGS[1][-2:], RINGS[1][4:8]):
                space.add_lwpolyline(scaled(ring, metre), close=True)
            turn = math.radians(degrees)
            hinge, tip = (5.0, 2.6), (5.0 - 0.9 * math.sin(turn), 2.6 + 0.9 * math.cos(turn))
            space.add_line(*scaled((hinge, tip), metre))
            space.add_arc(scaled((hinge,), metre)[0], 0.9 / metre, 90, 90 + degrees)

        return draw

    thin = 0.01 * 4 * 12  # m2 that pens of 0.02 m cover at most
    return [
        Made("mm.dxf", cad(sides), HOUSE, IN, OUT, slack=thin),
        Made("inches.dxf", cad(sides, 1, 0.0254), HOUSE, IN, OUT, slack=thin),
        Made("blocks.dxf", cad(blocks), HOUSE - TABLE, IN, (*OUT, (2.4, 2.4)), slack=thin),
        Made("frozen.dxf", cad(frozen), HOUSE, IN, OUT, slack=thin),
        *(
            Made(f"swing-{degrees}.dxf", cad(swung(degrees)), HOUSE, IN, OUT, says=("1 door symbol cuts",), slack=thin)
            for degrees in (90, 30, 13)
        ),
    ]


DXFS = _dxfs()


ALL = [*SVGS, *HARD, *FURNISHED, *MAPS, *DXFS]


# ------------------------------------------------------------------------------------------------- plans of many rooms

HOLLOW = 'fill="none" stroke="#000" stroke-width=".04"'
STYLES = ("gaps", "arcs", "bars", "classes")


@dataclass(frozen=True, slots=True)
class Rooms:
    """A building of rooms in a grid, each with hollow furniture, joined by a tree of doors."""

    xs: tuple[float, ...]  # m, the axes of the walls across
    ys: tuple[float, ...]
    doors: tuple[tuple[Place, Place], ...]  # the ends of each, on the axes

    @classmethod
    def of(cls, seed: int, columns: int = 3, rows: int = 2) -> Rooms:
        rng = np.random.default_rng(seed)
        xs = np.round(0.1 + np.cumsum([0.0, *rng.uniform(3.2, 5.0, columns)]), 2)
        ys = np.round(0.1 + np.cumsum([0.0, *rng.uniform(3.2, 5.0, rows)]), 2)
        edges = [((i, j), (i + 1, j)) for i in range(columns - 1) for j in range(rows)]
        edges += [((i, j), (i, j + 1)) for i in range(columns) for j in range(rows - 1)]
        reached, doors = {(0, 0)}, []
        while len(reached) < columns * rows:
            one, other = edges[rng.choice([k for k, edge in enumerate(edges) if len(reached & set(edge)) == 1])]
            reached |= {one, other}
            along = (ys[one[1]], ys[one[1] + 1]) if one[1] == other[1] else (xs[one[0]], xs[one[0] + 1])
            start = round(float(rng.uniform(along[0] + 0.4, along[1] - 1.3)), 2)
            if one[1] == other[1]:
                doors.append(((float(xs[other[0]]), start), (float(xs[other[0]]), start + 0.9)))
            else:
                doors.append(((start, float(ys[other[1]])), (start + 0.9, float(ys[other[1]]))))
        return cls(tuple(map(float, xs)), tuple(map(float, ys)), tuple(doors))

    @property
    def size(self) -> Place:
        return round(self.xs[-1] + 0.1, 6), round(self.ys[-1] + 0.1, 6)

    @property
    def count(self) -> int:
        return (len(self.xs) - 1) * (len(self.ys) - 1)

    @property
    def area(self) -> float:
        """m2 of the rooms, without doors."""
        wide, high = np.diff(self.xs) - WALL, np.diff(self.ys) - WALL
        return float(np.outer(wide, high).sum()) - self.count * 0.64**2

    @property
    def furniture(self) -> list[shapely.Polygon]:
        """The tables' boxes, y up, as `box` gives doors."""
        return [
            shapely.box(x - 0.32, self.size[1] - y - 0.32, x + 0.32, self.size[1] - y + 0.32) for x, y in self.tables
        ]

    @property
    def tables(self) -> list[Place]:
        """The middle of each room, y down, with a table of 0.6 m x 0.6 m."""
        return [((a + b) / 2, (c + d) / 2) for a, b in pairwise(self.xs) for c, d in pairwise(self.ys)]

    def drawn(self, style: str) -> list[str]:
        """The elements of a drawing, y down."""
        walls = [((x, self.ys[0]), (x, self.ys[-1])) for x in self.xs]
        walls += [((self.xs[0], y), (self.xs[-1], y)) for y in self.ys]
        cap = "butt" if style == "gaps" else "square"
        gaps = shapely.union_all([shapely.LineString(one).buffer(1e-9) for one in self.doors if style == "gaps"])
        parts = shapely.get_parts([shapely.LineString(ends).difference(gaps) for ends in walls])
        data = ["M{} {}L{} {}".format(*shapely.get_coordinates(part).ravel().tolist()) for part in parts]
        shapes = [f'<path d="{one}" stroke="#000" stroke-width="{WALL}" stroke-linecap="{cap}"/>' for one in data]
        boxes = [self.box(one) for one in self.doors]
        if style == "gaps":
            shapes += [rect(x - 0.1, y - 0.1, WALL, WALL) for x in self.xs for y in self.ys]
        if style == "arcs":
            for number, (hinge, end) in enumerate(self.doors):
                shapes += [lines(one, width=PEN) for one in arc(hinge, end, (90, 60, 30)[number % 3])]
        if style == "bars":
            shapes += [rect(*box, 'fill="#fff"') for box in boxes]
        tables = [rect(x - 0.3, y - 0.3, 0.6, 0.6, HOLLOW) for x, y in self.tables]
        if style != "classes":
            return shapes + tables
        layers = {"walls": shapes, "doors": [rect(*box) for box in boxes], "furniture": tables}
        return [f'<g class="{layer}">{"".join(found)}</g>' for layer, found in layers.items()]

    def box(self, ends: tuple[Place, Place]) -> tuple[float, float, float, float]:
        """A door's place in the wall: x, y, width, height, y down."""
        (a, b), (c, d) = ends
        return (a - 0.1, b, WALL, d - b) if a == c else (a, b - 0.1, c - a, WALL)
