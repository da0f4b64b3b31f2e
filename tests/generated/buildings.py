"""Small buildings: those that generators make, and halls with a few blocks in every format that is read."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from random import Random
from typing import Any

import shapely
from generated.keys import drawn

from swarmsim.core.scenario import registry

#: Of each generator: sizes in m in which it makes something small; all are whole cells of 0.15 m.
SMALL: dict[str, dict[str, Any]] = {
    "rooms": {"width": (3.0, 4.2), "height": (2.4, 3.3), "room": (0.9, 1.2), "door": (0.45, 0.6), "wall": (0.15,)},
    "office": {
        "width": (3.6, 4.2), "height": (3.75, 4.05), "corridor": (0.45, 0.6), "room": (1.05, 1.2), "door": (0.45,),
        "wall": (0.15,),
    },
    "maze": {"width": (2.4, 3.3), "height": (2.4, 3.0), "passage": (0.45, 0.6), "wall": (0.15,)},
    "cave": {"width": (4.5,), "height": (3.9,), "filled": (0.38, 0.4), "grain": (0.3,)},
    "obstacles": {
        "width": (3.0, 4.2), "height": (3.0, 3.6), "block": (0.3, 0.45), "filled": (0.1, 0.2), "wall": (0.15,),
    },
}  # fmt: skip
FORMATS = ("svg", "geojson", "wkt", "yaml")
PIXEL = 0.05  # m
THICK = 0.15  # m, of walls


@dataclass(frozen=True)
class Place:
    """A building: its table in a scenario, the files it is in, and what of its page is solid, if we drew that."""

    world: dict[str, Any]
    width: float  # m
    height: float  # m
    files: dict[str, bytes] = field(default_factory=dict)
    solid: shapely.Geometry | None = None


def place(dice: Random, large: bool) -> Place:
    """Any building."""
    return _made(dice, large) if dice.random() < 0.5 else _hall(dice, large)


def solid_of(text: str) -> shapely.Geometry:
    """What is solid in the floor plan that a generator has drawn, read without any help."""
    walls = [
        shapely.geometry.shape(feature["geometry"])
        for feature in json.loads(text)["features"]
        if feature["properties"]["layer"] in ("walls", "pillars", "furniture")
    ]
    return shapely.union_all(walls)


def _made(dice: Random, large: bool) -> Place:
    use = dice.choice(sorted(registry.known("generator")))
    sizes = SMALL.get(use, {})
    own = {key: (lambda values=values: _between(dice, values)) for key, values in sizes.items()}
    keys = drawn(dice, registry.find("generator", use), own)
    if large:
        keys |= {"width": 6.0, "height": 4.5}
    table = {"generate": {"use": use, **keys}, "seed": dice.randint(0, 2**31)}
    short = 0.75 if use in ("maze", "obstacles") else 0.0  # m: these round down to whole passages and squares
    return Place(table, keys["width"] - short, keys["height"] - short)


def _between(dice: Random, values: tuple[float, ...]) -> float:
    """One of the multiples of a cell between two values, or of a half cell where they are shares."""
    if values[0] < 0.45 and values[-1] - values[0] < 0.15:
        return dice.choice(values)
    return round(0.15 * dice.randint(round(values[0] / 0.15), round(values[-1] / 0.15)), 4)


def _hall(dice: Random, large: bool) -> Place:
    """A hall with a wall across that leaves a doorway, and blocks; the gaps are wide enough for most robots."""
    cells = (dice.randint(32, 40), dice.randint(24, 30)) if large else (dice.randint(16, 28), dice.randint(14, 22))
    width, height = (round(THICK * count, 4) for count in cells)
    boxes = [
        (0.0, 0.0, width, THICK), (0.0, height - THICK, width, height), (0.0, 0.0, THICK, height),
        (width - THICK, 0.0, width, height),
    ]  # fmt: skip
    across = THICK * dice.randint(cells[0] // 2 - 1, cells[0] // 2 + 1)
    if dice.random() < 0.5:
        door = THICK * dice.randint(4, cells[1] - 9)
        boxes += [(across, 0.0, across + THICK, door), (across, door + 0.6, across + THICK, height)]
    for left in (0.0, across):
        if dice.random() < 0.6:
            x, y = left + THICK * dice.randint(4, 5), THICK * dice.randint(5, cells[1] - 7)
            if left < x + 0.3 < left + width / 2 - 0.5:
                boxes.append((x, y, x + dice.choice((0.15, 0.3)), y + dice.choice((0.15, 0.3))))
    boxes = [tuple(round(edge, 4) for edge in box) for box in boxes]
    solid = shapely.union_all([shapely.box(*box) for box in boxes])
    form = dice.choice(FORMATS)
    files = _files(form, boxes, solid, width, height)
    world: dict[str, Any] = {"file": f"hall.{form}"}
    if dice.random() < 0.5:
        world["spawn"] = [0.2, 0.2, round(across - 0.2, 4), round(height - 0.4, 4)]
    return Place(world, width, height, files, solid)


def _files(form: str, boxes: Any, solid: shapely.Geometry, width: float, height: float) -> dict[str, bytes]:
    """The hall's files in one format, by name."""
    if form == "svg":
        rects = "".join(
            f'<rect x="{left:g}" y="{height - high:g}" width="{right - left:g}" height="{high - low:g}"/>'
            for left, low, right, high in boxes
        )
        page = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}">'
        return {"hall.svg": f'{page}<g id="walls">{rects}</g></svg>'.encode()}
    if form == "geojson":
        feature = {"type": "Feature", "properties": {"layer": "walls"}, "geometry": shapely.geometry.mapping(solid)}
        return {"hall.geojson": json.dumps({"type": "FeatureCollection", "features": [feature]}).encode()}
    if form == "wkt":
        return {"hall.wkt": solid.wkt.encode()}
    columns, rows = round(width / PIXEL), round(height / PIXEL)
    pixels = [[254] * columns for _ in range(rows)]
    for box in boxes:
        left, low, right, high = (round(edge / PIXEL) for edge in box)
        for row in pixels[rows - high : rows - low]:
            row[left:right] = [0] * (right - left)
    picture = "\n".join(" ".join(map(str, row)) for row in pixels)
    about = f"image: hall.pgm\nresolution: {PIXEL}\norigin: [0, 0, 0]\nnegate: 0\n"
    about += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    return {"hall.yaml": about.encode(), "hall.pgm": f"P2\n{columns} {rows}\n255\n{picture}\n".encode()}
