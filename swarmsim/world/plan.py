"""A floor plan: what is solid, what is unmapped, where robots may start, and how large it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from shapely import MultiPolygon

from swarmsim.core.events import Box

SOLID_LAYERS = ("walls", "pillars", "furniture")  #: layers that stop robots and beams
SPAWN_LAYER = "spawn"  #: the layer whose elements are the areas in which robots may start
UNKNOWN_LAYER = "unknown"  #: the layer of what a map does not know
DOORS_LAYER = "doors"  #: the layer of what cuts an opening into what is solid
FLOOR_LAYER = "floor"  #: the layer of rooms, which have walls along their borders; a drawing's only if the user says so
LAYERS = (*SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, DOORS_LAYER, FLOOR_LAYER)


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """What a drawing or a map says, in metres, x right and y up; the lattice starts at its page's lower left corner."""

    walls: MultiPolygon  # everything solid, as one
    layers: Mapping[str, MultiPolygon]  # the same, one by one: walls, pillars, furniture
    spawns: Mapping[str, MultiPolygon]  # areas in which robots may start, by name
    page: Box  # left, lower, right, upper
    unknown: MultiPolygon = field(default_factory=MultiPolygon)  # unmapped; in `walls` as well where it counts as solid
    notices: tuple[str, ...] = ()  # what was passed over, in sentences that name the file
    border: MultiPolygon = field(default_factory=MultiPolygon)  # what closes an open building; solid, but no wall of it
    openings: tuple[Box, ...] = ()  # doors that were made, for pictures
    painted: MultiPolygon = field(default_factory=MultiPolygon)  # what the file says or paints as floor
    guessed: bool = False  # whether nothing in the file says what is solid, so that its paint alone decides

    @property
    def width(self) -> float:
        """The width of the page, m."""
        return self.page[2] - self.page[0]

    @property
    def height(self) -> float:
        """The height of the page, m."""
        return self.page[3] - self.page[1]
