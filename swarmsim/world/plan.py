"""A floor plan: solid and unmapped areas, spawn areas, and size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from shapely import MultiPolygon

from swarmsim.core.events import Box

SOLID_LAYERS = ("walls", "pillars", "furniture")  #: layers that stop robots and beams
SPAWN_LAYER = "spawn"  #: the layer of the areas in which robots may start
UNKNOWN_LAYER = "unknown"  #: the layer of unmapped areas
DOORS_LAYER = "doors"  #: the layer of shapes that cut openings into solids
FLOOR_LAYER = "floor"  #: the layer of rooms, with walls along their borders; in a drawing only if the user says so
LAYERS = (*SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, DOORS_LAYER, FLOOR_LAYER)


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """The plan of a drawing or a map, in metres, x right, y up; the lattice starts at the page's lower left corner."""

    walls: MultiPolygon  # everything solid, as one
    layers: Mapping[str, MultiPolygon]  # the same, one by one: walls, pillars, furniture
    spawns: Mapping[str, MultiPolygon]  # areas in which robots may start, by name
    page: Box  # left, lower, right, upper
    unknown: MultiPolygon = field(default_factory=MultiPolygon)  # unmapped; also in `walls` if it counts as solid
    notices: tuple[str, ...] = ()  # on ignored contents, in sentences that name the file
    border: MultiPolygon = field(default_factory=MultiPolygon)  # closes an open building; solid, but no wall of it
    openings: tuple[Box, ...] = ()  # doors that were made, for pictures
    painted: MultiPolygon = field(default_factory=MultiPolygon)  # floor stated or painted in the file
    guessed: bool = False  # whether only the file's paint decides what is solid

    @property
    def width(self) -> float:
        """The width of the page, m."""
        return self.page[2] - self.page[0]

    @property
    def height(self) -> float:
        """The height of the page, m."""
        return self.page[3] - self.page[1]
