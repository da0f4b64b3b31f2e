"""Floor plans as polygons: GeoJSON in and out, in metres, and WKT in."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, affinity

from swarmsim.core.errors import InputError
from swarmsim.world.areas import joined, polygons
from swarmsim.world.layers import normal
from swarmsim.world.plan import FLOOR_LAYER, LAYERS, SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, FloorPlan
from swarmsim.world.problems import Problems
from swarmsim.world.viewport import LARGEST

_NAMES = ("layer", "name", "class", "id")  # of a feature's properties, which may name its layer


def written(plan: FloorPlan) -> str:
    """A floor plan as a GeoJSON FeatureCollection in metres, from which `read` makes the same plan again."""
    shapes = [({"layer": layer}, shape) for layer, shape in plan.layers.items() if not shape.is_empty]
    shapes += [({"layer": SPAWN_LAYER, "id": name}, shape) for name, shape in plan.spawns.items()]
    if not plan.unknown.is_empty:
        shapes.append(({"layer": UNKNOWN_LAYER}, plan.unknown))
    features = [
        {"type": "Feature", "properties": properties, "geometry": shapely.geometry.mapping(shape)}
        for properties, shape in shapes
    ]
    collection = {"type": "FeatureCollection", "bbox": list(plan.page), "features": features}
    if not plan.unknown.is_empty:  # what of it is solid too, traced in one with the walls
        collection["solid"] = shapely.geometry.mapping(plan.walls)
    return json.dumps(collection, separators=(",", ":"))


def read(
    source: str,
    name: str,
    scale: float = 1.0,
    across: float | None = None,
    layers: Mapping[str, Sequence[str]] | None = None,
) -> FloorPlan:
    """The floor plan in the GeoJSON text `source`; `name` is what messages call the file.

    Coordinates are metres, x right and y up. A feature's layer is what its properties say (`layer`, `name`, `class` or
    `id`), by the names of layers or those in `layers`; where no feature has a solid layer, all polygons are walls. A
    line is as thick as its property `width` (m) says. `bbox` is the page; without one, what is drawn is.

    Raises InputError, with the file, the feature and what would be right.
    """
    try:
        table = json.loads(source)
    except (ValueError, RecursionError) as problem:
        where = f"line {problem.lineno}, column {problem.colno}: " if isinstance(problem, json.JSONDecodeError) else ""
        raise InputError(f"{name}: {where}not JSON; expected GeoJSON with polygons in metres") from None
    if not isinstance(table, dict):
        raise InputError(f"{name}: no GeoJSON object; expected a FeatureCollection, a Feature or a geometry")
    unknown = set(layers or {}) - set(LAYERS)
    if unknown:
        raise InputError(f"world.layers.{min(unknown)}: no such layer; expected {', '.join(LAYERS)}")
    problems = Problems(name)
    notices: list[str] = []
    shapes = list(
        _shapes(table, {**{one: [one] for one in LAYERS if one != FLOOR_LAYER}, **(layers or {})}, problems, notices)
    )
    problems.complain()
    says_solid = any(layer in SOLID_LAYERS for layer, _, _ in shapes)
    found: defaultdict[tuple[str, str], list[shapely.Geometry]] = defaultdict(list)
    for layer, area, shape in shapes:
        if layer or not says_solid:
            found[layer or "walls", area if layer == SPAWN_LAYER else ""].append(shape)
    if not says_solid:
        notices.append(f"it has no layer of {', '.join(SOLID_LAYERS)}, so that all {len(shapes)} shapes are walls")
    plan = _plan(found, _page(table, name), name, scale, across, notices)
    solid = table.get("solid")
    return plan if solid is None else replace(plan, walls=polygons(shapely.from_geojson(json.dumps(solid))))


def read_wkt(source: str, name: str, scale: float = 1.0, across: float | None = None) -> FloorPlan:
    """The floor plan in a text of WKT geometries, one or one in each line; all are walls. Raises InputError."""
    shapes, problems = [], Problems(name)
    try:
        shapes = [shapely.from_wkt(source)]
    except shapely.errors.GEOSException:
        for number, line in enumerate(source.splitlines(), start=1):
            if line.strip():
                try:
                    shapes.append(shapely.from_wkt(line))
                except shapely.errors.GEOSException:
                    problems.add(f"line {number}: not WKT; expected such as POLYGON ((0 0, 4 0, 4 3, 0 0))")
    walls = []
    for number, shape in enumerate(shapes, start=1):
        wrong = _fault(shape)
        if wrong:
            problems.add(f"geometry {number}: {wrong}")
        else:
            walls.append(polygons(shape))
    problems.complain()
    return _plan({("walls", ""): walls}, None, name, scale, across, [])


def _plan(
    found: Mapping[tuple[str, str], Sequence[shapely.Geometry]],
    page: tuple[float, float, float, float] | None,
    name: str,
    scale: float,
    across: float | None,
    notices: Sequence[str],
) -> FloorPlan:
    """The plan with these shapes by layer and area, of which what is larger than one metre each way is multiplied."""
    layers = {layer: joined(found.get((layer, ""), ())) for layer in SOLID_LAYERS}
    spawns = {area: joined(shapes) for (layer, area), shapes in found.items() if layer == SPAWN_LAYER}
    unknown = joined(found.get((UNKNOWN_LAYER, ""), ()))
    if all(layer.is_empty for layer in layers.values()) and unknown.is_empty:
        raise InputError(f"{name}: nothing in it is solid; expected polygons, or lines with a width")
    page = page or shapely.union_all([*layers.values(), *spawns.values(), unknown]).bounds
    factor = scale if across is None else across / (page[2] - page[0])
    page = (page[0] * factor, page[1] * factor, page[2] * factor, page[3] * factor)
    if not max(map(abs, page)) <= LARGEST:
        raise InputError(f"{name}: a point lies farther than {LARGEST:g} m from the origin; is the scale right?")

    def scaled(shape: MultiPolygon) -> MultiPolygon:
        return shape if factor == 1.0 else affinity.scale(shape, factor, factor, origin=(0.0, 0.0))

    layers = {layer: scaled(shape) for layer, shape in layers.items()}
    spawns = {area: scaled(shape) for area, shape in spawns.items()}
    told = tuple(f"{name}: {notice}" for notice in notices)
    return FloorPlan(joined(layers.values()), layers, spawns, page, scaled(unknown), told)


def _shapes(
    table: dict[str, Any], layers: Mapping[str, Sequence[str]], problems: Problems, notices: list[str]
) -> Iterator[tuple[str, str, shapely.Geometry]]:
    """Layer, id and shape of each feature; tells what is wrong with them, and what is passed over."""
    features = table.get("features") if table.get("type") == "FeatureCollection" else [table]
    if not isinstance(features, list):
        problems.add("features is no list; expected a list of features")
        return
    points = 0
    for number, feature in enumerate(features, start=1):
        place = f"feature {number}"
        if not isinstance(feature, dict):
            problems.add(f"{place} is no object; expected a feature with a geometry")
            continue
        properties = feature.get("properties")
        properties = dict(properties) if isinstance(properties, dict) else {}
        if isinstance(feature.get("id"), str):
            properties.setdefault("id", feature["id"])
        if feature.get("type") == "Feature" and feature.get("geometry") is None:
            continue
        geometry = feature.get("geometry") if feature.get("type") == "Feature" else feature
        called = [str(properties[key]) for key in _NAMES if isinstance(properties.get(key), str)]
        layer = next((one for one in layers if any(normal(c) in map(normal, layers[one]) for c in called)), "")
        area = str(properties.get("id") or properties.get("name") or SPAWN_LAYER)
        shape, wrong = _shape(geometry, properties.get("width"))
        if wrong:
            problems.add(f"{place}: {wrong}")
        elif shape is None:
            points += 1
        else:
            yield layer, area, shape
    if points:
        notices.append(f"{points} points are passed over: a wall has an area, or is a line with a width")


def _shape(geometry: Any, width: Any) -> tuple[shapely.Geometry | None, str]:
    """The area of a geometry, None for points, and what is wrong with it."""
    if not isinstance(geometry, dict):
        return None, "its geometry is no object; expected such as a Polygon"
    try:
        shape = shapely.force_2d(shapely.from_geojson(json.dumps(geometry)))
    except (shapely.errors.GEOSException, ValueError, RecursionError):
        return None, "its geometry is not GeoJSON; expected such as a Polygon with closed rings of [x, y]"
    if shape is None:
        return None, "its geometry is not GeoJSON; expected such as a Polygon with closed rings of [x, y]"
    wrong = _fault(shape, lines=True)
    if wrong:
        return None, wrong
    if shape.length == 0.0:
        return None, ""
    parts = shapely.get_parts(shape)
    lines = [part for part in parts if "Line" in part.geom_type]
    if lines:
        if isinstance(width, bool) or not isinstance(width, int | float) or not 0.0 < width < LARGEST:
            return None, "a line has no area; give it a property 'width' in m, or draw a polygon"
        thick = shapely.buffer(lines, float(width) / 2.0, cap_style="flat", join_style="mitre", quad_segs=16)
        shape = shapely.union_all([*thick, polygons(shape)])
    return polygons(shape), ""


def _fault(shape: shapely.Geometry, lines: bool = False) -> str:
    """What is wrong with a geometry, or nothing."""
    corners = shapely.get_coordinates(shape)
    if shape.is_empty or not np.isfinite(corners).all():
        return "it is empty, or has a coordinate that is not finite"
    if np.abs(corners).max() > LARGEST:
        return f"a point lies farther than {LARGEST:g} m from the origin; is it in metres?"
    if not shape.is_valid:
        return f"not a valid area ({shapely.is_valid_reason(shape)}); its rings should neither cross nor overlap"
    if not lines and polygons(shape).is_empty:
        return "it has no area; expected polygons"
    return ""


def _page(table: dict[str, Any], name: str) -> tuple[float, float, float, float] | None:
    """The page that `bbox` says. Raises InputError."""
    box = table.get("bbox")
    if box is None:
        return None
    if isinstance(box, list) and len(box) in (4, 6):
        sides = [float(side) for side in box if isinstance(side, int | float) and not isinstance(side, bool)]
        if len(sides) == len(box) and all(map(math.isfinite, sides)):
            (left, low), (right, high) = sides[:2], sides[len(sides) // 2 :][:2]
            if left < right and low < high:
                return left, low, right, high
    raise InputError(f"{name}: bbox is no box; expected [left, lower, right, upper] in m")
