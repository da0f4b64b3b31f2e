"""Shapes from features with properties, whatever file holds them: plans in metres, and indoor maps in degrees."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
import shapely
from shapely import MultiPolygon

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario import World
from swarmsim.world.areas import polygons
from swarmsim.world.doorways import WIDTH, Walls
from swarmsim.world.indoor import IGNORED, NO_FLOOR, OPEN, OUTLINE, PLACES, ROOM, kind_of, role_of, width_of
from swarmsim.world.layers import normal
from swarmsim.world.levels import chosen, levels_of
from swarmsim.world.plan import DOORS_LAYER, FLOOR_LAYER, LAYERS, SPAWN_LAYER
from swarmsim.world.problems import Problems
from swarmsim.world.projection import Projection, are_degrees
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.sheets import sheet
from swarmsim.world.viewport import LARGEST

_NAMES: Final = ("layer", "class", "name", "id")  # of properties, which may name the layer of a feature
_KINDS: Final = ("category", "indoor", "room", "type")  # likewise, for names that the user gives
_ANYWHERE: Final = ("", IGNORED, OUTLINE, NO_FLOOR, DOORS_LAYER, SPAWN_LAYER)  # what makes no level
_WALL: Final = 0.1  # m, a wall that is a line without a width
_GAP: Final = 0.5  # m, a gap between rooms that is the wall between them
_SPECK: Final = 1e-3  # m2 of such a gap


@dataclass(frozen=True, slots=True, eq=False)
class Feature:
    """One feature of a map."""

    properties: Mapping[str, Any]
    shape: shapely.Geometry  # in metres or degrees
    where: str  # what messages call it


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A feature, and what it is: a layer of a floor plan, a role, or nothing."""

    feature: Feature
    role: str
    shape: shapely.Geometry  # in m


def drawn(
    features: Sequence[Feature],
    name: str,
    world: World,
    page: Box | None = None,
    unit: Literal["m", "degrees", ""] = "",
) -> Drawing:
    """What features show, in metres.

    Where nothing says the `unit` of their coordinates, these are metres, x right and y up, or degrees if all of it is
    too small for metres. A feature's layer is what its properties say (`layer`, `class`, `name`, `id`), by the names of
    layers or those that the user gives; the tags of indoor maps say as well what is a room, a wall or a door. Raises
    InputError with all that is wrong, or with the levels to choose from.
    """
    if unknown := set(world.layers) - set(LAYERS):
        raise InputError(f"world.layers.{min(unknown)}: no such layer; expected {', '.join(LAYERS)}")
    roles = [_role(feature.properties, world) for feature in features]
    indoors = any(role in PLACES for role, tagged in roles if tagged)
    parts = [
        _Part(feature, role if indoors or not tagged else "", feature.shape)
        for feature, (role, tagged) in zip(features, roles, strict=True)
    ]
    notices: list[str] = []
    parts = _on_level(parts, name, world, notices)
    if not unit:
        unit = "degrees" if world.scale is None and _in_degrees(parts, indoors, page) else "m"
    if unit == "degrees":
        parts, page = _projected(parts, indoors, page)
        notices.append("its coordinates are degrees of longitude and latitude, which were turned into metres")
    shapes = _indoors(parts, notices) if indoors else _plain(parts, name, notices)
    return sheet(name, shapes, world, page, unit, notices)


def thick(shape: shapely.Geometry, width: Any) -> tuple[MultiPolygon, str]:
    """The area of a geometry whose lines are `width` (m) thick, and what is wrong with it."""
    parts = shapely.get_parts(shape)
    lines = [part for part in parts if "Line" in part.geom_type]
    if lines:
        if isinstance(width, bool) or not isinstance(width, int | float) or not 0.0 < width < LARGEST:
            return MultiPolygon(), "a line has no area; give it a property 'width' in m, or draw a polygon"
        wide = shapely.buffer(lines, float(width) / 2.0, cap_style="flat", join_style="mitre", quad_segs=16)
        shape = shapely.union_all([*wide, polygons(shape)])
    return polygons(shape), ""


def not_a_place(shape: shapely.Geometry) -> str:
    """What is wrong with the coordinates of a geometry, or nothing."""
    corners = shapely.get_coordinates(shape)
    if shape.is_empty or not np.isfinite(corners).all():
        return "it is empty, or has a coordinate that is not finite"
    if np.abs(corners).max() > LARGEST:
        return f"a point lies farther than {LARGEST:g} m from the origin; is it in metres?"
    return ""


def not_an_area(shape: shapely.Geometry) -> str:
    """What is wrong with the outlines of a geometry, or nothing."""
    if not shape.is_valid:
        return f"not a valid area ({shapely.is_valid_reason(shape)}); its rings should neither cross nor overlap"
    return ""


def layer_named(called: Sequence[str], layers: Mapping[str, Sequence[str]]) -> str:
    """The layer of what has these names, by the names of each layer, or an empty string."""
    own = set(map(normal, called))
    return next((layer for layer, names in layers.items() if own & set(map(normal, names))), "")


def _role(properties: Mapping[str, Any], world: World) -> tuple[str, bool]:
    """What a feature is, and whether the tags of indoor maps say so."""
    given = {**world.layers, FLOOR_LAYER: [*world.layers.get(FLOOR_LAYER, ()), *world.floor]}
    named = [str(properties[key]) for key in (*_NAMES, *_KINDS) if isinstance(properties.get(key), str)]
    if layer := layer_named(named, given):
        return layer, False
    own = {layer: [layer] for layer in LAYERS if layer != FLOOR_LAYER and layer not in world.layers}
    called = {key: [properties[key]] for key in _NAMES if isinstance(properties.get(key), str)}
    layer = layer_named([*called.get("layer", ()), *called.get("class", ())], own)
    if not layer and (role := role_of(properties)):
        return role, True
    return layer or layer_named([*called.get("name", ()), *called.get("id", ())], own), False


def _on_level(parts: list[_Part], name: str, world: World, notices: list[str]) -> list[_Part]:
    """What lies on the level that the user means; doors and the like without a level lie on all."""
    places = [part for part in parts if not part.shape.is_empty and part.role not in _ANYWHERE]
    rooms = Counter(level for part in places for level in levels_of(part.feature.properties))
    names: dict[str, list[str]] = {}
    for part in parts:
        own = part.feature.properties
        if own.get("feature_type") == "level" and isinstance(own.get("id"), str):
            names[own["id"]] = [*_ordinal(own), *_labels(own.get("name")), *_labels(own.get("short_name"))]
    wanted = chosen(world.level, rooms, names, name, notices)
    parts = [part for part in parts if not part.shape.is_empty]
    kept = [part for part in parts if not (on := levels_of(part.feature.properties)) or on & wanted or not wanted]
    if len(wanted) < len(rooms):
        notices.append(f"one of its {len(rooms)} levels is read")
    return kept


def _ordinal(properties: Mapping[str, Any]) -> list[str]:
    value = properties.get("ordinal")
    return [f"{value:g}"] if isinstance(value, int | float) and not isinstance(value, bool) else []


def _labels(value: Any) -> list[str]:
    texts = list(value.values()) if isinstance(value, dict) else [value]
    return [text for text in texts if isinstance(text, str)]


def _in_degrees(parts: Sequence[_Part], indoors: bool, page: Box | None) -> bool:
    """Whether the coordinates have to be degrees: all is too small for metres, and no line is thin beside that."""
    bounds = shapely.total_bounds([part.shape for part in parts if part.role or not indoors])
    if not np.isfinite(bounds).all() or not are_degrees(bounds):
        return False
    if page is not None and not are_degrees(np.array(page)):
        return False
    size = max(bounds[2:] - bounds[:2])
    widths = [width_of(part.feature.properties) for part in parts if "Line" in part.shape.geom_type]
    return indoors or not any(width is not None and width < size for width in widths)


def _projected(parts: Sequence[_Part], indoors: bool, page: Box | None) -> tuple[list[_Part], Box | None]:
    """The same in metres from the lower left corner of all; what is far away is left out."""
    near = [part for part in parts if part.role or not indoors]
    bounds = shapely.total_bounds([part.shape for part in near])
    plane = Projection(float(bounds[0] + bounds[2]) / 2.0, float(bounds[1] + bounds[3]) / 2.0)
    flat = [shapely.transform(part.shape, plane.metres) for part in near]
    corner = shapely.total_bounds(flat)[:2]
    moved = [
        replace(part, shape=shapely.transform(shape, lambda points: points - corner))
        for part, shape in zip(near, flat, strict=True)
    ]
    if page is not None:
        corners = plane.metres(np.array(page).reshape(2, 2)) - corner
        page = (float(corners[0, 0]), float(corners[0, 1]), float(corners[1, 0]), float(corners[1, 1]))
    return moved, page


def _plain(parts: Sequence[_Part], name: str, notices: list[str]) -> list[Shape]:
    """The shapes of a plan without tags of indoor maps, as they are drawn."""
    problems, shapes, points = Problems(name), [], 0
    for part in parts:
        if wrong := not_an_area(part.shape):
            problems.add(f"{part.feature.where}: {wrong}")
            continue
        if part.shape.length == 0.0:
            points += 1
            continue
        area, wrong = thick(part.shape, part.feature.properties.get("width"))
        if wrong:
            problems.add(f"{part.feature.where}: {wrong}")
        else:
            shapes.append(_shape(part, area, part.role))
    problems.complain()
    if points:
        notices.append(f"{points} points are passed over: a wall has an area, or is a line with a width")
    return shapes


def _indoors(parts: Sequence[_Part], notices: list[str]) -> list[Shape]:
    """The shapes of an indoor map: rooms are floor, and doors openings between them."""
    walled = any(part.role == "walls" and part.feature.properties.get("type") in ("wall", "window") for part in parts)
    solid, rooms, open_, doors, other = [], [], [], [], Counter[str]()
    mended = closed = 0
    for part in parts:
        mended += not part.shape.is_valid
        area = _area(part)
        match part.role:
            case "doors":
                doors.append(part)
            case "floor" if not area.is_empty:
                rooms.append(_shape(part, area, FLOOR_LAYER))
            case "room" if not walled and not area.is_empty:
                rooms.append(_shape(part, area, FLOOR_LAYER))
            case "open" | "outline" if (walled or part.role == OPEN) and not area.is_empty:
                open_.append(_shape(part, area, FLOOR_LAYER))
            case _ if part.role in LAYERS and not area.is_empty:
                solid.append(_shape(part, area, part.role))
            case _ if part.role not in (IGNORED, ROOM, OUTLINE):
                other[kind_of(part.feature.properties)] += 1
    floor = [*rooms, *_joined(open_, rooms, [_area(part) for part in parts if walled and part.role == NO_FLOOR])]
    lines = [
        shapely.boundary(part.shape) if _flat(part.shape) else part.shape for part in parts if part.role == "walls"
    ]
    walls, inside = Walls([shape.fill for shape in floor], lines), _outline([*solid, *floor], parts)
    tree = shapely.STRtree([shape.fill for shape in floor])
    shapely.prepare(inside)
    for part in doors:
        if _flat(part.shape):
            # A door that is drawn as an area fills the wall; one that leads outside is a part of it.
            walls_only = walled or not floor
            near = tree.query(part.shape, predicate="dwithin", distance=_WALL)
            leads_out = not (inside.covers(part.shape) if walls_only else len(near) > 1)
            closed += leads_out
            if not leads_out or walls_only:
                solid.append(_shape(part, _area(part), "walls" if leads_out else DOORS_LAYER))
        elif (opening := walls.opening(_single(part.shape), width_of(part.feature.properties) or WIDTH)) is not None:
            solid.append(_shape(part, MultiPolygon([opening]), DOORS_LAYER))
        else:
            closed += 1
    if mended:
        notices.append(f"{mended} areas with outlines that cross themselves were mended")
    if closed:
        notices.append(f"{closed} of {len(doors)} doors do not lead from room to room and stay closed")
    if other:
        told = ", ".join(f"{kind} {count}" for kind, count in sorted(other.items())[:12])
        notices.append(f"{sum(other.values())} features are neither floor nor wall and are passed over: {told}")
    return [*floor, *_between(floor), *solid]


def _area(part: _Part) -> MultiPolygon:
    shape = part.shape if part.shape.is_valid else shapely.make_valid(part.shape)
    if part.role in (FLOOR_LAYER, OPEN, ROOM, OUTLINE):
        return polygons(shape)
    return thick(shape, width_of(part.feature.properties) or _WALL)[0]


def _flat(shape: shapely.Geometry) -> bool:
    return "Polygon" in shape.geom_type


def _single(shape: shapely.Geometry) -> shapely.Geometry:
    return shapely.get_parts(shape)[0]


def _joined(open_: Sequence[Shape], rooms: Sequence[Shape], stairs: Sequence[MultiPolygon]) -> list[Shape]:
    """Floor that is open towards other floor, in one piece where it touches, without the rooms and stairs in it."""
    whole = shapely.union_all([shape.fill for shape in open_])
    pieces = polygons(whole.difference(shapely.union_all([*(room.fill for room in rooms), *stairs]))).geoms
    tree = shapely.STRtree([shape.fill for shape in open_])
    own = [open_[tree.query(piece, predicate="intersects").min()] for piece in pieces]
    return [replace(shape, fill=MultiPolygon([piece])) for shape, piece in zip(own, pieces, strict=True)]


def _between(floor: Sequence[Shape]) -> list[Shape]:
    """The walls that narrow gaps between rooms are."""
    whole = shapely.union_all([shape.fill for shape in floor])
    closed = shapely.buffer(shapely.buffer(whole, _GAP / 2.0, join_style="mitre"), -_GAP / 2.0, join_style="mitre")
    gaps = [gap for gap in polygons(closed.difference(whole)).geoms if gap.area > _SPECK]
    return [Shape(MultiPolygon(gaps), layer="walls", group="gaps", where="the gaps between rooms")] if gaps else []


def _outline(shapes: Sequence[Shape], parts: Sequence[_Part]) -> shapely.Geometry:
    """What lies inside of a building's outer walls."""
    more = [_area(part) for part in parts if part.role in (DOORS_LAYER, OUTLINE, ROOM, NO_FLOOR) and _flat(part.shape)]
    whole = polygons(shapely.union_all([*(shape.fill for shape in shapes), *more]))
    filled = shapely.union_all([shapely.Polygon(piece.exterior) for piece in whole.geoms])
    return shapely.buffer(filled, -_WALL / 2.0)


def _shape(part: _Part, area: MultiPolygon, layer: str) -> Shape:
    own = part.feature.properties
    spawn = str(own.get("id") or own.get("name") or SPAWN_LAYER) if layer == SPAWN_LAYER else ""
    return Shape(area, layer=layer, group=kind_of(own), spawn=spawn, where=part.feature.where)
