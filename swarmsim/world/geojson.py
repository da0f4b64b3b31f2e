"""Floor plans as polygons: GeoJSON in and out, and WKT in."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import shapely
from shapely import MultiPolygon, affinity
from shapely.geometry.base import BaseGeometry

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.file import World
from swarmsim.world.areas import joined, polygons
from swarmsim.world.indoor.drawings import drawn
from swarmsim.world.indoor.features import Feature, layer_named, not_a_place, not_an_area, thick
from swarmsim.world.indoor.tags import texts
from swarmsim.world.plan import SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, FloorPlan
from swarmsim.world.problems import Problems
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.sheets import sheet
from swarmsim.world.viewport import LARGEST

_NAMES: Final = ("layer", "name", "class", "id")  # of a feature's properties that may name its layer
_MARK: Final = "swarmsim"  # the member that marks collections of `written`
_BORDER: Final = "border"  # the layer of a building's border, only in our own texts
_BEGUN: Final = f'{{"type":"FeatureCollection","{_MARK}":'  # how they begin


def written(plan: FloorPlan) -> str:
    """A floor plan as a GeoJSON FeatureCollection in metres, which `plan_from` turns back into the same plan."""
    shapes = [({"layer": layer}, shape) for layer, shape in plan.layers.items()]
    shapes += [({"layer": SPAWN_LAYER, "id": name}, shape) for name, shape in plan.spawns.items()]
    shapes += [({"layer": UNKNOWN_LAYER}, plan.unknown), ({"layer": _BORDER}, plan.border)]
    features = [
        {"type": "Feature", "properties": properties, "geometry": shapely.geometry.mapping(shape)}
        for properties, shape in shapes
        if not shape.is_empty
    ]
    mark = {
        "plan": 1,
        "notices": list(plan.notices),
        "openings": [list(box) for box in plan.openings],
        "guessed": plan.guessed,
    }
    collection = {"type": "FeatureCollection", _MARK: mark, "bbox": list(plan.page), "features": features}
    if not plan.unknown.is_empty:  # its solid part, traced together with the walls
        collection["solid"] = shapely.geometry.mapping(plan.walls)
    return json.dumps(collection, separators=(",", ":"))


def is_ours(source: str) -> bool:
    """Whether a text comes from `written`, and so holds a whole floor plan."""
    return source.startswith(_BEGUN)


def plan_from(
    source: str,
    name: str,
    scale: float = 1.0,
    across: float | None = None,
    layers: Mapping[str, Sequence[str]] | None = None,
) -> FloorPlan:
    """The floor plan in a text of `written`, exactly; `name`: of the file in messages.

    Older recordings hold texts without its mark, some by other programs, in metres. For those, `scale` multiplies,
    `across` is the width of the page in m, and `layers` gives the layers' names; if no feature has a solid layer, all
    polygons are walls. Raises InputError, with the feature and what would be right.
    """
    table = parsed(source, name)
    ours = _MARK in table
    known: dict[str, Sequence[str]] = {one: [one] for one in (*SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER)}
    if ours:
        known[_BORDER], scale, across = [_BORDER], 1.0, None
    else:
        known.update(layers or {})
    found, points = _areas(table, name, known)
    notices = []
    if points:
        notices.append(f"{points} points are passed over: a wall has an area, or is a line with a width")
    if not ours and not any(layer in SOLID_LAYERS for layer, _ in found):
        count = sum(map(len, found.values()))
        notices.append(f"it has no layer of {', '.join(SOLID_LAYERS)}, so that all {count} shapes are walls")
        found["walls", ""] = found.pop(("", ""), [])
    told = [f"{name}: {notice}" for notice in notices]
    mark = table.get(_MARK)
    if isinstance(mark, dict):
        told = [str(notice) for notice in mark.get("notices") or ()]
    plan = _plan(found, _page(table, name), name, scale, across, told, ours)
    if table.get("solid") is not None:
        plan = replace(plan, walls=polygons(shapely.from_geojson(json.dumps(table["solid"]))))
    if not isinstance(mark, dict):
        return plan
    openings = tuple(_box(box) for box in mark.get("openings") or ())
    boxes = tuple(box for box in openings if box is not None)
    return replace(plan, openings=boxes, guessed=mark.get("guessed") is True)


def _areas(
    table: dict[str, object], name: str, known: Mapping[str, Sequence[str]]
) -> tuple[defaultdict[tuple[str, str], list[MultiPolygon]], int]:
    """The areas of all features, by layer and spawn area, and the number of ignored points. Raises InputError."""
    found: defaultdict[tuple[str, str], list[MultiPolygon]] = defaultdict(list)
    problems, points = Problems(name), 0
    for place, properties, geometry in _features(table, problems):
        if geometry is None:
            continue
        called = list(texts(properties, _NAMES).values())
        shape, wrong = _geometry(geometry)
        wrong = wrong or not_a_place(shape)
        wrong = wrong or not_an_area(shape)
        if not wrong and shape.length == 0.0:
            points += 1
            continue
        area, wrong = (MultiPolygon(), wrong) if wrong else thick(shape, properties.get("width"))
        if wrong:
            problems.add(f"{place}: {wrong}")
            continue
        layer = layer_named(called, known)
        spawn = str(properties.get("id") or properties.get("name") or SPAWN_LAYER) if layer == SPAWN_LAYER else ""
        found[layer, spawn].append(area)
    problems.complain()
    return found, points


def read(source: str, name: str, world: World) -> Drawing:
    """The drawing in the GeoJSON text `source`; `name`: of the file in messages.

    Coordinates are degrees or, if that is impossible, metres, x right and y up. `bbox` is the page, by default the
    extent of the drawing. Raises InputError, with the file, the feature and what would be right.
    """
    table = parsed(source, name)
    page = _page(table, name)
    return drawn(features(table, name), name, world, page, unit="m" if _MARK in table else "")


def features(table: dict[str, object], name: str) -> list[Feature]:
    """The features of a GeoJSON object. Raises InputError with all errors.

    Empty coordinates mean no geometry, as in RFC 7946: such features carry only properties.
    """
    problems, found = Problems(name), []
    for place, properties, geometry in _features(table, problems):
        shape, wrong = (MultiPolygon(), "") if geometry is None else _geometry(geometry)
        wrong = wrong or ("" if shape.is_empty else not_a_place(shape))
        if wrong:
            problems.add(f"{place}: {wrong}")
        else:
            found.append(Feature(properties, shape, place))
    problems.complain()
    return found


def read_wkt(source: str, name: str, world: World) -> Drawing:
    """The drawing in a text of WKT geometries, one in all or one per line; all are walls. Raises InputError."""
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
        wrong = not_a_place(shape) or not_an_area(shape)
        if not wrong and polygons(shape).is_empty:
            wrong = "it has no area; expected polygons"
        if wrong:
            problems.add(f"geometry {number}: {wrong}")
        else:
            walls.append(Shape(polygons(shape), layer="walls", where=f"geometry {number}"))
    problems.complain()
    return sheet(name, walls, world, None, "m", ())


def parsed(source: str, name: str) -> dict[str, object]:
    """The GeoJSON object in a text. Raises InputError."""
    try:
        table = json.loads(source)
    except (ValueError, RecursionError) as problem:
        where = f"line {problem.lineno}, column {problem.colno}: " if isinstance(problem, json.JSONDecodeError) else ""
        raise InputError(f"{name}: {where}not JSON; expected GeoJSON with polygons in metres or degrees") from None
    if not isinstance(table, dict):
        raise InputError(f"{name}: no GeoJSON object; expected a FeatureCollection, a Feature or a geometry")
    return table


def _plan(
    found: Mapping[tuple[str, str], Sequence[MultiPolygon]],
    page: Box | None,
    name: str,
    scale: float,
    across: float | None,
    notices: Sequence[str],
    ours: bool,
) -> FloorPlan:
    """The plan with these shapes by layer and area, scaled if larger than one metre each way."""
    layers = {layer: joined(found.get((layer, ""), ())) for layer in SOLID_LAYERS}
    spawns = {area: joined(shapes) for (layer, area), shapes in found.items() if layer == SPAWN_LAYER}
    unknown, border = (joined(found.get((layer, ""), ())) for layer in (UNKNOWN_LAYER, _BORDER))
    if not ours and all(layer.is_empty for layer in (*layers.values(), unknown, border)):
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
    return FloorPlan(joined(layers.values()), layers, spawns, page, scaled(unknown), tuple(notices), border)


def _features(table: dict[str, object], problems: Problems) -> Iterator[tuple[str, dict[str, object], object]]:
    """Place, properties and geometry, or None, of each feature; notes their errors."""
    features = table.get("features") if table.get("type") == "FeatureCollection" else [table]
    if not isinstance(features, list):
        problems.add("features is not a list; expected a list of features")
        return
    for number, feature in enumerate(features, start=1):
        place = f"feature {number}"
        if not isinstance(feature, dict):
            problems.add(f"{place} is not an object; expected a feature with a geometry")
            continue
        properties = feature.get("properties")
        properties = dict(properties) if isinstance(properties, dict) else {}
        if isinstance(properties.get("tags"), dict):  # as some exports of OpenStreetMap nest them
            properties = {**properties["tags"], **properties}
        for key in ("id", "feature_type"):
            if isinstance(feature.get(key), str):
                properties.setdefault(key, feature[key])
        yield place, properties, feature.get("geometry") if feature.get("type") == "Feature" else feature


def _geometry(geometry: object) -> tuple[BaseGeometry, str]:
    """A geometry, and its error."""
    if not isinstance(geometry, dict):
        return MultiPolygon(), "its geometry is not an object; expected such as a Polygon"
    try:
        shape = shapely.force_2d(shapely.from_geojson(json.dumps(geometry)))
    except (shapely.errors.GEOSException, ValueError, RecursionError):
        shape = None
    if shape is None:
        return MultiPolygon(), "its geometry is not GeoJSON; expected such as a Polygon with closed rings of [x, y]"
    return shape, ""


def _page(table: dict[str, object], name: str) -> Box | None:
    """The page given by `bbox`. Raises InputError."""
    if table.get("bbox") is None:
        return None
    if (box := _box(table["bbox"])) is not None:
        return box
    raise InputError(f"{name}: bbox is not a box; expected [left, lower, right, upper] in m")


def _box(box: object) -> Box | None:
    """A two- or three-dimensional box in two dimensions, if it is one."""
    if isinstance(box, list) and len(box) in (4, 6):
        sides = [float(side) for side in box if isinstance(side, int | float) and not isinstance(side, bool)]
        if len(sides) == len(box) and all(map(math.isfinite, sides)):
            (left, low), (right, high) = sides[:2], sides[len(sides) // 2 :][:2]
            if left < right and low < high:
                return left, low, right, high
    return None
