"""Indoor maps of OpenStreetMap as XML: nodes, ways and multipolygons with simple indoor tagging."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import World
from swarmsim.world.indoor.drawings import drawn
from swarmsim.world.indoor.features import Feature
from swarmsim.world.indoor.tags import PLACES, role_of
from swarmsim.world.markup import Node, parsed
from swarmsim.world.problems import Problems
from swarmsim.world.shapes import Drawing

_EXPECTED: Final = "a map of OpenStreetMap (.osm) with indoor tags"
_MULTI: Final = ("multipolygon", "boundary")
_Nodes = dict[str | None, NDArray[np.float64]]  # longitude and latitude by id


def read(path: Path, world: World) -> Drawing:
    """The drawing of an OSM XML file, by its indoor tags.

    Rooms, areas and corridors are floor; `door` tags on their outlines are doors. Raises InputError with all errors,
    each with its line.
    """
    root, name = parsed(path, "osm", _EXPECTED), str(path)
    problems = Problems(name)
    elements = [element for element in root if element.get("action") != "delete" and element.get("visible") != "false"]
    nodes = _nodes(elements, problems)
    ways = {
        element.get("id"): [child.get("ref") for child in element.iterchildren("nd")]
        for element in elements
        if element.tag == "way"
    }
    found, broken = [], 0
    for element in elements:
        tags = {tag.get("k", ""): tag.get("v", "") for tag in element.iterchildren("tag")}
        role = role_of(tags)
        if not role or element.tag not in ("node", "way", "relation"):
            continue
        where = f"line {element.sourceline}: {element.tag} {element.get('id')}"
        shape: BaseGeometry | None
        if element.tag == "node":
            shape = shapely.Point(nodes[element.get("id")]) if element.get("id") in nodes else None
        elif element.tag == "way":
            solid = role != "walls" or tags.get("area") == "yes"
            shape = _way(ways[element.get("id")], nodes, area=solid)
        else:
            shape = _multipolygon(element, ways, nodes) if tags.get("type") in _MULTI else None
        if shape is None:
            broken += 1
        else:
            found.append(Feature(tags, shape, where))
    problems.complain()
    if not any(role_of(feature.properties) in PLACES for feature in found):
        raise InputError(f"{name}: nothing in it has a tag indoor=room, area, corridor or wall; expected {_EXPECTED}")
    drawing = drawn(found, name, world, unit="degrees")
    if not broken:
        return drawing
    lost = f"ways and relations with nodes or ways that the file does not hold are passed over ({broken})"
    return replace(drawing, notices=(*drawing.notices, lost))


def _nodes(elements: Sequence[Node], problems: Problems) -> _Nodes:
    """Longitude and latitude of each node."""
    found: _Nodes = {}
    for element in elements:
        if element.tag == "node":
            try:
                place = float(element.get("lon", "")), float(element.get("lat", ""))
            except ValueError:
                place = math.nan, math.nan
            if abs(place[0]) <= 180.0 and abs(place[1]) < 90.0:
                found[element.get("id")] = np.array(place)
            else:
                problems.add(f"line {element.sourceline}: a node without a place; expected lon and lat in degrees")
    return found


def _way(refs: Sequence[str | None], nodes: _Nodes, *, area: bool) -> BaseGeometry | None:
    """The area of a closed way, or its line; None if it lacks nodes."""
    if len(refs) < 2 or not all(ref in nodes for ref in refs):
        return None
    points = np.array([nodes[ref] for ref in refs])
    if area and refs[0] == refs[-1] and len(refs) >= 4:
        return shapely.Polygon(points)
    return shapely.LineString(points)


def _multipolygon(element: Node, ways: dict[str | None, list[str | None]], nodes: _Nodes) -> BaseGeometry | None:
    """The outer rings of a relation without its inner ones; None if it lacks ways or nodes, or a ring is open."""
    rings: dict[bool, list[BaseGeometry]] = {True: [], False: []}
    for member in element.iterchildren("member"):
        if member.get("type") == "way":
            line = _way(ways.get(member.get("ref"), ()), nodes, area=False)
            if line is None:
                return None
            rings[member.get("role") != "inner"].append(line)
    outer, inner = (
        shapely.union_all(shapely.get_parts(shapely.polygonize(shapely.get_parts(shapely.union_all(rings[out])))))
        for out in (True, False)
    )
    return None if outer.is_empty else outer.difference(inner)
