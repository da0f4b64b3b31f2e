"""One storey of an indoor map: rooms, the walls between them, and doors from room to room."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from swarmsim.world.areas import polygons
from swarmsim.world.indoor.doorways import WIDTH, Walls
from swarmsim.world.indoor.features import WALL, Tagged
from swarmsim.world.indoor.tags import FLOORS, NO_FLOOR, OPEN, OUTLINE, ROOM, kind_of, width_of
from swarmsim.world.plan import DOORS_LAYER, FLOOR_LAYER, LAYERS
from swarmsim.world.shapes import Shape

_GAP: Final = 0.5  # m, the widest gap between rooms that counts as wall
_SPECK: Final = 1e-3  # m2 of such a gap
_NAMED: Final = 12  # kinds of features in a notice


def storey(parts: Sequence[Tagged], notices: list[str]) -> list[Shape]:
    """The shapes of one storey: rooms are floor, solids keep their layer, and doors are openings.

    If walls are drawn (wrld3d), the floor is the inside of the building's outline, and rooms are only names.
    """
    walled = any(part.role == "walls" and part.feature.properties.get("type") in ("wall", "window") for part in parts)
    floor = _floor(parts, walled)
    own = [layer for layer in LAYERS if layer not in (FLOOR_LAYER, DOORS_LAYER)]
    stairs = [part for part in parts if part.role == NO_FLOOR and part.flat]
    solid = [shape for layer in own for shape in _drawn(parts, (layer,), layer)]
    solid += _drawn(stairs, (NO_FLOOR,), "walls")  # or they would get doors, like closed rooms
    doors = _doors(parts, floor, solid, walled, notices)
    mended = sum(not part.shape.is_valid for part in parts if part.role)
    if mended:
        notices.append(f"outlines that cross themselves were mended ({mended})")
    lost = [part for part in parts if not part.role or (part.role in (NO_FLOOR, *FLOORS) and not part.flat)]
    for what, told in (
        (stairs, "no floor, and closed"),
        (lost, "passed over, as neither floor nor wall nor door"),
    ):
        kinds = Counter(kind_of(part.feature.properties) for part in what)
        if kinds:
            listed = ", ".join(f"{kind} {count}" for kind, count in sorted(kinds.items())[:_NAMED])
            notices.append(f"{told}: {listed}")
    inner = [*solid, *(shape for shape in doors if shape.layer != DOORS_LAYER)]
    return [*_walled(floor, inner), *_between(floor), *solid, *doors]


def _drawn(parts: Sequence[Tagged], roles: Sequence[str], layer: str) -> list[Shape]:
    """The features with one of these roles and an area, in a layer."""
    found = [(part, part.area()) for part in parts if part.role in roles]
    return [part.drawn(area, layer) for part, area in found if not area.is_empty]


def _floor(parts: Sequence[Tagged], walled: bool) -> list[Shape]:
    """Rooms, and floor that is open towards other floor, joined where it touches, without the rooms in it."""
    rooms = _drawn(parts, (FLOOR_LAYER,) if walled else (FLOOR_LAYER, ROOM), FLOOR_LAYER)
    open_ = _drawn(parts, (OPEN, OUTLINE) if walled else (OPEN,), FLOOR_LAYER)
    rest = shapely.union_all([shape.fill for shape in open_]).difference(
        shapely.union_all([room.fill for room in rooms])
    )
    tree = shapely.STRtree([shape.fill for shape in open_])
    pieces = polygons(rest).geoms
    own = [open_[tree.query(piece, predicate="intersects").min()] for piece in pieces]
    return [*rooms, *(replace(one, fill=MultiPolygon([piece])) for one, piece in zip(own, pieces, strict=True))]


def _walled(floor: Sequence[Shape], solid: Sequence[Shape]) -> list[Shape]:
    """Rooms with walls as strokes along their borders, less the solids in them, since floor covers solids."""
    tree = shapely.STRtree([shape.fill for shape in solid])
    found = []
    for room in floor:
        inside = [solid[at].fill for at in tree.query(room.fill, predicate="intersects")]
        border = polygons(shapely.buffer(room.fill.boundary, WALL / 2.0, join_style="mitre", cap_style="flat"))
        free = polygons(room.fill.difference(shapely.union_all(inside))) if inside else room.fill
        found.append(replace(room, fill=free, stroke=border, pen=WALL))
    return found


def _between(floor: Sequence[Shape]) -> list[Shape]:
    """The narrow gaps between rooms, as walls."""
    whole = shapely.union_all([shape.fill for shape in floor])
    closed = shapely.buffer(shapely.buffer(whole, _GAP / 2.0, join_style="mitre"), -_GAP / 2.0, join_style="mitre")
    gaps = [gap for gap in polygons(closed.difference(whole)).geoms if gap.area > _SPECK]
    return [Shape(MultiPolygon(gaps), layer="walls", group="gaps", where="the gaps between rooms")] if gaps else []


def _doors(
    parts: Sequence[Tagged], floor: Sequence[Shape], solid: Sequence[Shape], walled: bool, notices: list[str]
) -> list[Shape]:
    """Openings from room to room; a door drawn as an area fills its wall, and stays wall if it leads outside."""
    walls = [part for part in parts if part.role == "walls"]
    lines = [shapely.boundary(part.shape) if part.flat else part.shape for part in walls]
    borders, tree = Walls([shape.fill for shape in floor], lines), shapely.STRtree([shape.fill for shape in floor])
    marks = [part for part in parts if part.role == DOORS_LAYER]
    drawn = [part for part in parts if part.role in (DOORS_LAYER, OUTLINE, ROOM, NO_FLOOR) and part.flat]
    inside = _inside([*(shape.fill for shape in (*solid, *floor)), *(part.area() for part in drawn)])
    found, closed = [], 0
    for part in marks:
        if part.flat:
            in_wall = walled or not floor
            near = tree.query(part.shape, predicate="dwithin", distance=WALL)
            leads_out = not (inside.covers(part.shape) if in_wall else len(near) > 1)
            closed += leads_out
            if not leads_out or in_wall:
                found.append(part.drawn(part.area(), "walls" if leads_out else DOORS_LAYER))
            continue
        mark = shapely.get_parts(part.shape)[0]
        opening = borders.opening(mark, width_of(part.feature.properties) or WIDTH)
        if opening is None:
            closed += 1
        else:
            found.append(part.drawn(MultiPolygon([opening]), DOORS_LAYER))
    if closed:
        notices.append(f"doors that do not lead from room to room stay closed ({closed} of {len(marks)})")
    return found


def _inside(areas: Sequence[MultiPolygon]) -> BaseGeometry:
    """The inside of a building's outer walls."""
    whole = polygons(shapely.union_all(areas))
    filled = shapely.union_all([shapely.Polygon(piece.exterior) for piece in whole.geoms])
    inside = shapely.buffer(filled, -WALL / 2.0)
    shapely.prepare(inside)
    return inside
