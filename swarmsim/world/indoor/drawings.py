"""Drawings from features: plans in metres or degrees, and indoor maps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from swarmsim.core.events import Box
from swarmsim.core.scenario.file import World
from swarmsim.world.indoor.features import Feature, Tagged, layer_named, not_an_area, thick
from swarmsim.world.indoor.levels import chosen, levels_of
from swarmsim.world.indoor.projection import Projection, are_degrees
from swarmsim.world.indoor.storey import storey
from swarmsim.world.indoor.tags import IGNORED, NO_FLOOR, OUTLINE, PLACES, role_of, texts, width_of
from swarmsim.world.plan import DOORS_LAYER, FLOOR_LAYER, LAYERS, SPAWN_LAYER
from swarmsim.world.problems import Problems
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.sheets import sheet

_NAMES: Final = ("layer", "class", "name", "id")  # of properties that may name the layer of a feature
_KINDS: Final = ("category", "indoor", "room", "type")  # the same, for names that the user gives
_ANYWHERE: Final = ("", IGNORED, OUTLINE, NO_FLOOR, DOORS_LAYER, SPAWN_LAYER)  # not enough for a level


def drawn(
    features: Sequence[Feature],
    name: str,
    world: World,
    page: Box | None = None,
    unit: Literal["m", "degrees", ""] = "",
) -> Drawing:
    """A drawing of features, in metres.

    Without a `unit`, coordinates are metres, x right and y up, or degrees if all of them are too small for metres. A
    feature's layer follows from its properties (`layer`, `class`, `name`, `id`), by the names of layers or those that
    the user gives; the tags of indoor maps also mark rooms, walls and doors. Raises InputError with all errors, or with
    the levels to choose from.
    """
    roles = [_role(feature.properties, world) for feature in features]
    indoors = any(role in PLACES if tagged else role == FLOOR_LAYER for role, tagged in roles)
    parts = [
        Tagged(feature, role if indoors or not tagged else "", feature.shape)
        for feature, (role, tagged) in zip(features, roles, strict=True)
    ]
    notices: list[str] = []
    if not unit:
        unit = "degrees" if world.scale is None and _in_degrees(parts, indoors, page) else "m"
    if unit == "degrees":
        parts, page = _projected(parts, indoors, page)
        notices.append("its coordinates are degrees of longitude and latitude, which were turned into metres")
    parts = _on_level(parts, name, world, notices)
    shapes = storey(parts, notices) if indoors else _plain(parts, name, notices)
    return sheet(name, shapes, world, page, unit, notices)


def _role(properties: Mapping[str, object], world: World) -> tuple[str, bool]:
    """A feature's role, and whether it comes from the tags of indoor maps."""
    given = {**world.named, FLOOR_LAYER: (*world.named.get(FLOOR_LAYER, ()), *world.floor)}
    if layer := layer_named(list(texts(properties, (*_NAMES, *_KINDS)).values()), given):
        return layer, False
    own = {layer: [layer] for layer in LAYERS if layer != FLOOR_LAYER and layer not in world.named}
    layer = layer_named(list(texts(properties, _NAMES[:2]).values()), own)
    if not layer and (role := role_of(properties)):
        return role, True
    return layer or layer_named(list(texts(properties, _NAMES[2:]).values()), own), False


def _on_level(parts: list[Tagged], name: str, world: World, notices: list[str]) -> list[Tagged]:
    """The features on the user's level; doors and the like without a level lie on all."""
    places = [part for part in parts if not part.shape.is_empty and part.role not in _ANYWHERE]
    rooms = Counter(level for part in places for level in levels_of(part.feature.properties))
    names: dict[str, list[str]] = {}
    for part in parts:
        own = part.feature.properties
        level = own.get("id")
        if own.get("feature_type") == "level" and isinstance(level, str):
            names[level] = [*_ordinal(own), *_labels(own.get("name")), *_labels(own.get("short_name"))]
    wanted = chosen(world.level, rooms, names, name, notices)
    parts = [part for part in parts if not part.shape.is_empty]
    kept = [part for part in parts if not (on := levels_of(part.feature.properties)) or on & wanted or not wanted]
    if len(wanted) < len(rooms):
        notices.append(f"one of its {len(rooms)} levels is read")
    return kept


def _ordinal(properties: Mapping[str, object]) -> list[str]:
    value = properties.get("ordinal")
    return [f"{value:g}"] if isinstance(value, int | float) and not isinstance(value, bool) else []


def _labels(value: object) -> list[str]:
    texts = list(value.values()) if isinstance(value, dict) else [value]
    return [text for text in texts if isinstance(text, str)]


def _placed(parts: Sequence[Tagged], indoors: bool) -> list[BaseGeometry]:
    """The features that locate the building: floor and walls, or all of a plan without tags."""
    return [part.shape for part in parts if not indoors or part.role not in _ANYWHERE]


def _in_degrees(parts: Sequence[Tagged], indoors: bool, page: Box | None) -> bool:
    """Whether the coordinates have to be degrees: everything is too small for metres, but no line is thin beside it."""
    bounds = shapely.total_bounds(_placed(parts, indoors))
    if not np.isfinite(bounds).all() or not are_degrees(bounds):
        return False
    if page is not None and not are_degrees(np.array(page)):
        return False
    size = max(bounds[2:] - bounds[:2])
    widths = [width_of(part.feature.properties) for part in parts if "Line" in part.shape.geom_type]
    return indoors or not any(width is not None and width < size for width in widths)


def _projected(parts: Sequence[Tagged], indoors: bool, page: Box | None) -> tuple[list[Tagged], Box | None]:
    """The same in metres from the lower left corner of the building with all its levels."""
    left, low, right, high = (float(side) for side in shapely.total_bounds(_placed(parts, indoors)))
    plane = Projection((left + right) / 2.0, (low + high) / 2.0)
    flat = [replace(part, shape=shapely.transform(part.shape, plane.metres)) for part in parts]
    corner = shapely.total_bounds(_placed(flat, indoors))[:2]
    moved = [replace(part, shape=shapely.transform(part.shape, lambda points: points - corner)) for part in flat]
    if page is not None:
        corners = plane.metres(np.array(page).reshape(2, 2)) - corner
        page = (float(corners[0, 0]), float(corners[0, 1]), float(corners[1, 0]), float(corners[1, 1]))
    return moved, page


def _plain(parts: Sequence[Tagged], name: str, notices: list[str]) -> list[Shape]:
    """The shapes of a plan without tags of indoor maps, as drawn."""
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
            shapes.append(part.drawn(area, part.role))
    problems.complain()
    if points:
        notices.append(f"{points} points are passed over: a wall has an area, or is a line with a width")
    return shapes
