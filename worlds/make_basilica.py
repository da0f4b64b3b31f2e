"""Draws basilica.svg: an early Christian basilica with narthex, aisles, transept, apse, chapels and sacristies.

    python worlds/make_basilica.py [FILE]

Lengths are metres: x runs from the west front to the apse, `off` away from the long axis. Straight walls lie on
multiples of 0.15 m, so that they fill cells of that size exactly, and columns are centred on corners of cells. What
lies on the axis is drawn once; the south is the mirror image of the north.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import NamedTuple

from drawn import read_floor_plan

from swarmsim.world.arena import Arena

CELL, MARGIN_CELLS, ROBOT = 0.15, 8, 0.055  # m, cells, m: what the printed counts are for

PAPER = 1.2  # around the building
LENGTH, HALF = 30.0, 9.0  # of the building, outside
AXIS = PAPER + HALF

BODY, WALL = 3.15, 0.75  # aisle wall: inside off, thickness
ROW, COLUMN = 1.65, 0.3  # colonnade: off and radius of the columns
COLUMNS = (4.95, 1.65, 8)  # first x, spacing, how many on each side
FRONT, NARTHEX, NAVE = 0.75, 2.7, 3.3  # x where narthex begins, where it ends, where the nave begins
PORTAL, SIDE = 0.75, (2.1, 3.0)  # doors of front and narthex: off of the jambs
LEAF = (0.15, 0.3)  # x of the closed door leaves
WEST, EAST = 18.75, 21.45  # x of the transept
ARM = 8.25  # off of its ends
CHAPEL, CHAPEL_DOOR = (5.25, 5.55), (19.65, 20.55)  # off of the wall, x of its door
NICHE, NICHE_OFF = 0.78, 6.9  # apse of a chapel: radius (0.75 would graze corners of cells), off of its centre
SACRISTY, SACRISTY_DOOR = (22.2, 24.9, 2.4, 4.95), (3.3, 4.2)  # x, x, off, off; off of its door
CHOIR, CHORD = 1.8, 27.45  # half width of choir and apse, x where the apse begins


class Corner(NamedTuple):
    """A corner of a contour; with a radius, an arc clockwise on the page leads to it."""

    x: float
    off: float
    radius: float = 0.0


SHELL = NICHE + 0.42  # radius of the chapel's apse, outside
SPREAD = math.sqrt(SHELL**2 - WALL**2)  # from the centre to where its outside meets the transept's

# From west to east, north of the axis; the contour closes across the axis, in the east by the apse.
OUTSIDE = [
    Corner(LEAF[0], PORTAL), Corner(0, PORTAL),
    Corner(0, SIDE[0]), Corner(LEAF[0], SIDE[0]), Corner(LEAF[0], SIDE[1]), Corner(0, SIDE[1]),
    Corner(0, BODY + WALL), Corner(WEST - WALL, BODY + WALL),
    Corner(WEST - WALL, HALF), Corner(EAST + WALL, HALF),
    Corner(EAST + WALL, NICHE_OFF + SPREAD), Corner(EAST + WALL, NICHE_OFF - SPREAD, SHELL),
    Corner(EAST + WALL, SACRISTY[3] + 0.6), Corner(SACRISTY[1] + 0.6, SACRISTY[3] + 0.6),
    Corner(SACRISTY[1] + 0.6, CHOIR + WALL), Corner(CHORD, CHOIR + WALL),
]  # fmt: skip
INSIDE = [
    Corner(LEAF[1], PORTAL), Corner(FRONT, PORTAL),
    Corner(FRONT, SIDE[0]), Corner(LEAF[1], SIDE[0]), Corner(LEAF[1], SIDE[1]), Corner(FRONT, SIDE[1]),
    Corner(FRONT, BODY), Corner(WEST, BODY), Corner(WEST, ARM), Corner(EAST, ARM),
    Corner(EAST, NICHE_OFF + NICHE), Corner(EAST, NICHE_OFF - NICHE, NICHE),
    Corner(EAST, SACRISTY_DOOR[1]), Corner(SACRISTY[0], SACRISTY_DOOR[1]),
    Corner(SACRISTY[0], SACRISTY[3]), Corner(SACRISTY[1], SACRISTY[3]),
    Corner(SACRISTY[1], SACRISTY[2]), Corner(SACRISTY[0], SACRISTY[2]),
    Corner(SACRISTY[0], SACRISTY_DOOR[0]), Corner(EAST, SACRISTY_DOOR[0]),
    Corner(EAST, CHOIR), Corner(CHORD, CHOIR),
]  # fmt: skip


def num(length: float) -> str:
    """A length with no more digits than it needs."""
    return f"{round(length, 4) + 0.0:g}"


def step(x: float, y: float, radius: float) -> str:
    """The path command that leads to a point."""
    return f"A{num(radius)} {num(radius)} 0 0 1 {num(x)} {num(y)}" if radius else f"L{num(x)} {num(y)}"


def contour(north: list[Corner], apse: float) -> str:
    """Path data along `north`, around the apse of that radius, and back along the mirror image."""
    ahead = [step(x, -off, radius) for x, off, radius in north]
    arcs = [apse] + [corner.radius for corner in reversed(north[1:])]  # an arc belongs to its other end on the way back
    back = [step(corner.x, corner.off, radius) for corner, radius in zip(reversed(north), arcs, strict=True)]
    return " ".join(["M" + ahead[0][1:], *ahead[1:], *back, "Z"])


def box(west: float, east: float, low: float, high: float, extra: str = "") -> str:
    """A rectangle from x to x and from off to off (negative is south)."""
    return f'<rect x="{num(west)}" y="{num(-high)}" width="{num(east - west)}" height="{num(high - low)}"{extra}/>'


def disc(x: float, off: float, radius: float) -> str:
    """A circle."""
    return f'<circle cx="{num(x)}" cy="{num(-off)}" r="{num(radius)}"/>'


def mirrored(name: str, parts: list[str]) -> list[str]:
    """The parts in the north, and their mirror image in the south."""
    inner = [f"  {part}" for part in parts]
    south = f'<g id="{name}-south" transform="scale(1 -1)">'
    return [f'<g id="{name}-north">', *inner, "</g>", south, *inner, "</g>"]


def layer(name: str, style: str, parts: list[str]) -> list[str]:
    """One layer, in which y = 0 is the long axis."""
    inner = [f"    {part}" for part in parts]
    opening = f'<g id="{name}" inkscape:groupmode="layer" inkscape:label="{name}" {style}>'
    origin = f'  <g transform="translate({num(PAPER)} {num(AXIS)})">'
    return [opening, origin, *inner, "  </g>", "</g>"]


def walls() -> list[str]:
    """The shell in one piece, inner walls, buttresses, and the leaves of the closed front doors."""
    first, spacing, count = COLUMNS
    inner = [
        box(NARTHEX, NAVE, PORTAL, SIDE[0]),
        box(NARTHEX, NAVE, SIDE[1], BODY + 0.15),
        box(WEST - 0.15, CHAPEL_DOOR[0], *CHAPEL),
        box(CHAPEL_DOOR[1], EAST + 0.15, *CHAPEL),
        *(box(x - 0.3, x + 0.3, BODY + WALL - 0.15, BODY + WALL + 0.3) for x in _every(first, 2 * spacing, count // 2)),
    ]
    leaves = [box(*LEAF, -PORTAL, PORTAL), box(*LEAF, *SIDE), box(*LEAF, -SIDE[1], -SIDE[0])]
    return [
        f'<path id="shell" fill-rule="evenodd" d="{contour(OUTSIDE, CHOIR + WALL)} {contour(INSIDE, CHOIR)}"/>',
        *mirrored("inner-walls", inner),
        '<g id="door-leaves" fill="#7a4f2a">',
        *(f"  {leaf}" for leaf in leaves),
        "</g>",
    ]


def pillars() -> list[str]:
    """Two colonnades, and the four piers of the crossing."""
    first, spacing, count = COLUMNS
    colonnade = [
        f'<g transform="translate({num(first)} {num(-ROW)})">',
        *(f"  {disc(spacing * i, 0, COLUMN)}" for i in range(count)),
        "</g>",
    ]
    piers = [box(18.0, 18.9, 1.2, 2.1), box(EAST - 0.6, EAST, 1.2, 2.1)]
    return [*mirrored("colonnade", colonnade), *mirrored("piers", piers)]


def furniture() -> list[str]:
    """Ambo, chancel screen, altar with its ciborium, the clergy's bench with the throne; font, altar, tables."""
    octagon = [(0.6, 0.3), (0.3, 0.6), (-0.3, 0.6), (-0.6, 0.3), (-0.6, -0.3), (-0.3, -0.6), (0.3, -0.6), (0.6, -0.3)]
    bench, end = 1.71, 1.5367  # radius of its middle, off of its ends; the stroke reaches into the wall
    return [
        '<g id="ambo" transform="translate(14.85 0)">',
        '  <polygon points="' + " ".join(f"{num(x)},{num(y)}" for x, y in octagon) + '"/>',
        f"  {box(-1.35, -0.45, -0.3, 0.3)}",
        f"  {box(0.45, 1.35, -0.3, 0.3)}",
        "</g>",
        *mirrored("chancel-screen", [box(22.8, 22.95, 0.6, CHOIR)]),
        box(25.8, 26.55, -0.6, 0.6, ' id="altar"'),
        *mirrored("ciborium", [disc(25.35, 0.9, 0.15), disc(27.0, 0.9, 0.15)]),
        f'<path id="bench" fill="none" stroke="#a8824f" stroke-width="0.38" d="M{num(CHORD + 0.75)} {num(-end)} '
        f'{step(CHORD + 0.75, end, bench)}"/>',
        box(28.5, 29.25, -0.3, 0.3, ' id="throne"'),
        '<circle id="font" cx="20.1" cy="-7.05" r="0.6"/>',
        box(20.4, 20.85, -7.35, -6.45, ' id="chapel-altar"'),
        *mirrored("tables", [box(24.45, 24.9, 3.3, 4.2)]),
    ]


def drawing() -> list[str]:
    """What architects add: the floor, windows, and the vaults above as dashed lines. None of it is solid."""
    first, spacing, count = COLUMNS
    bays = _every(first, spacing, count)
    beams = [f"M{num(x)} {num(-BODY)}V{num(BODY)}" for x in bays]
    crossing = f"M18.9 -1.2L{num(EAST - 0.6)} 1.2M18.9 1.2L{num(EAST - 0.6)} -1.2"
    dome = [f"M{num(CHORD)} 0L{num(CHORD + CHOIR * c)} {num(CHOIR * s)}" for c, s in ((0.866, 0.5), (0.5, 0.866))]
    dome += [f"M{num(CHORD)} 0L{num(CHORD + CHOIR * c)} {num(-CHOIR * s)}" for c, s in ((0.866, 0.5), (0.5, 0.866))]
    chord = f"M{num(CHORD)} {num(-CHOIR)}V{num(CHOIR)}"
    return [
        f'<path fill="#f6efe0" d="{contour(INSIDE, CHOIR)}"/>',
        '<g fill="none" stroke="#c9b795" stroke-width="0.04" stroke-dasharray="0.18 0.12">',
        f'  <path d="{"".join(beams)}"/>',
        f'  <path d="{crossing}{chord}{"".join(dome)}"/>',
        "</g>",
    ]


def windows() -> list[str]:
    """Light slots in the walls, for the eye alone: beams see a closed wall."""
    first, spacing, count = COLUMNS
    north = [box(x - 0.3, x + 0.3, BODY + 0.3, BODY + 0.45) for x in _every(first + spacing, 2 * spacing, count // 2)]
    north += [box(19.65, 20.55, ARM + 0.3, ARM + 0.45), box(22.95, 23.85, SACRISTY[3] + 0.225, SACRISTY[3] + 0.375)]
    return mirrored("windows", north)


def spawn() -> list[str]:
    """Where robots may start: the whole floor, or close together behind the doors."""
    return [f'<path id="floor" d="{contour(INSIDE, CHOIR)}"/>', box(3.6, 6.3, -1.2, 1.2, ' id="entrance"')]


def scale_bar() -> list[str]:
    """Ten metres below the west front."""
    x, y = PAPER, 2 * AXIS - 0.75
    bars = "".join(f"M{num(x + 2 * i)} {num(y)}h1v0.15h-1z" for i in range(5))
    marks = "".join(
        f'<text x="{num(x + m)}" y="{num(y - 0.12)}">{m}{" m" if m == 10 else ""}</text>' for m in (0, 5, 10)
    )
    return [
        '<g id="scale-bar" fill="#5b5148" font-family="sans-serif" font-size="0.36" text-anchor="middle">',
        f'  <rect x="{num(x)}" y="{num(y)}" width="10" height="0.15" fill="none" stroke="#555" stroke-width="0.03"/>',
        f'  <path d="{bars}"/>',
        f"  {marks}",
        "</g>",
    ]


def draw() -> str:
    """The drawing as SVG text."""
    width, height = LENGTH + 2 * PAPER, 2 * AXIS
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        "<!-- One user unit is one metre. Drawn by make_basilica.py: edit that, not this. -->",
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"',
        f'     width="{num(width * 40)}" height="{num(height * 40)}" viewBox="0 0 {num(width)} {num(height)}">',
        "<title>Basilica</title>",
        f'<rect id="paper" width="{num(width)}" height="{num(height)}" fill="#fdfbf6"/>',
        *layer("drawing", 'stroke="none"', drawing()),
        *layer("spawn", 'fill="#2f7fd6" fill-opacity="0.12" stroke="none"', spawn()),
        *layer("walls", 'fill="#3d3835" stroke="none"', walls()),
        *layer("pillars", 'fill="#6b5d52" stroke="none"', pillars()),
        *layer("furniture", 'fill="#a8824f" stroke="none"', furniture()),
        *layer("openings", 'fill="#dfe9ef" stroke="none"', windows()),
        *scale_bar(),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _every(first: float, spacing: float, count: int) -> list[float]:
    """Evenly spaced values of x."""
    return [first + spacing * i for i in range(count)]


def main() -> None:
    """Writes the file and prints what a robot finds in it."""
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("basilica.svg")
    source = draw()
    file.write_text(source, encoding="utf-8", newline="\n")
    arena = Arena.open(read_floor_plan(source, file.name), CELL, MARGIN_CELLS, file.name)
    print(f"{file}: {arena.floor('floor').sum()} free cells of {CELL} m, {arena.reachable('floor', ROBOT).sum()} "
          f"reachable for a robot of {2 * ROBOT} m, {len(arena.segments)} wall segments")  # fmt: skip


if __name__ == "__main__":
    main()
