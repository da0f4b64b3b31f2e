"""Features with properties, from any format, and their areas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from swarmsim.world.areas import polygons
from swarmsim.world.indoor.tags import FLOORS, kind_of, width_of
from swarmsim.world.layers import normal
from swarmsim.world.plan import SPAWN_LAYER
from swarmsim.world.shapes import Shape
from swarmsim.world.viewport import LARGEST

WALL: Final = 0.1  #: m, thickness of an indoor map's wall drawn as a line without a width


@dataclass(frozen=True, slots=True, eq=False)
class Feature:
    """One feature of a map."""

    properties: Mapping[str, object]
    shape: BaseGeometry  # in metres or degrees
    where: str  # its name in messages


@dataclass(frozen=True, slots=True, eq=False)
class Tagged:
    """A feature and its role: a layer of a floor plan, a role of indoor maps, or none."""

    feature: Feature
    role: str
    shape: BaseGeometry  # in m

    @property
    def flat(self) -> bool:
        """Whether it is drawn as an area."""
        return "Polygon" in self.shape.geom_type

    def area(self) -> MultiPolygon:
        """Its area on an indoor map: self-crossing outlines are repaired, and walls have a width."""
        shape = self.shape if self.shape.is_valid else shapely.make_valid(self.shape)
        if self.role in FLOORS:
            return polygons(shape)
        return thick(shape, width_of(self.feature.properties) or WALL)[0]

    def drawn(self, area: MultiPolygon, layer: str) -> Shape:
        """Its shape in a drawing."""
        own = self.feature.properties
        spawn = str(own.get("id") or own.get("name") or SPAWN_LAYER) if layer == SPAWN_LAYER else ""
        return Shape(area, layer=layer, group=kind_of(own), spawn=spawn, where=self.feature.where)


def thick(shape: BaseGeometry, width: object) -> tuple[MultiPolygon, str]:
    """The area of a geometry with lines `width` (m) thick, and its error."""
    parts = shapely.get_parts(shape)
    lines = [part for part in parts if "Line" in part.geom_type]
    if lines:
        if isinstance(width, bool) or not isinstance(width, int | float) or not 0.0 < width < LARGEST:
            return MultiPolygon(), "a line has no area; give it a property 'width' in m, or draw a polygon"
        wide = shapely.buffer(lines, float(width) / 2.0, cap_style="flat", join_style="mitre", quad_segs=16)
        shape = shapely.union_all([*wide, polygons(shape)])
    return polygons(shape), ""


def not_a_place(shape: BaseGeometry) -> str:
    """The error in a geometry's coordinates, or empty."""
    corners = shapely.get_coordinates(shape)
    if shape.is_empty or not np.isfinite(corners).all():
        return "it is empty, or has a coordinate that is not finite"
    if np.abs(corners).max() > LARGEST:
        return f"a point lies farther than {LARGEST:g} m from the origin; is it in metres?"
    return ""


def not_an_area(shape: BaseGeometry) -> str:
    """The error in a geometry's outlines, or empty."""
    if not shape.is_valid:
        return f"not a valid area ({shapely.is_valid_reason(shape)}); its rings should neither cross nor overlap"
    return ""


def layer_named(called: Sequence[str], layers: Mapping[str, Sequence[str]]) -> str:
    """The layer for something with these names, by the names of each layer, or an empty string."""
    own = set(map(normal, called))
    return next((layer for layer, names in layers.items() if own & set(map(normal, names))), "")
