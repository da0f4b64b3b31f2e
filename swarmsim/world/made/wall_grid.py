"""The material of generated buildings: a grid of cells, walls in it, doors in walls."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, affinity

from swarmsim.core.context import WorldContext
from swarmsim.core.errors import InputError
from swarmsim.world import geojson
from swarmsim.world.areas import polygons, united
from swarmsim.world.plan import SPAWN_LAYER, FloorPlan
from swarmsim.world.tracing import traced

Mask = NDArray[np.bool_]  # (rows, columns) of cells

_MOST_CELLS: Final = 25_000_000


class Sized(Protocol):
    """The size of a building."""

    @property
    def width(self) -> float:
        """Outside, from left to right, in m."""
        ...

    @property
    def height(self) -> float:
        """Outside, from bottom to top, in m."""
        ...


class GeneratedPlan:
    """A finished building."""

    def __init__(self, plan: FloorPlan) -> None:
        self._plan = plan

    def draw(self) -> str:
        """Its floor plan as GeoJSON."""
        return geojson.written(self._plan)


class WallGrid:
    """The cells of a building."""

    def __init__(self, size: Sized, site: WorldContext) -> None:
        self._cell = site.cell
        self.rows, self.columns = self.count("height", size.height), self.count("width", size.width)
        if self.rows * self.columns > _MOST_CELLS:
            raise InputError(f"width: more than {_MOST_CELLS} cells; expected a smaller building")
        self.random = site.streams.open("building")

    def count(self, key: str, metres: float) -> int:
        """A length in whole cells. Raises InputError if it is less than one."""
        cells = round(metres / self._cell)
        if cells < 1:
            raise InputError(f"{key}: {metres:g} m is less than a cell of {self._cell:g} m; expected more")
        return cells

    def framed(self, wall: int) -> Mask:
        """An empty building with a wall around it. Raises InputError if nothing else fits in."""
        if min(self.rows, self.columns) <= 2 * wall + 2:
            raise InputError("width: nothing but walls fits in; expected a larger building")
        solid = np.ones((self.rows, self.columns), np.bool_)
        solid[wall:-wall, wall:-wall] = False
        return solid

    def drawn(self, solid: Mask, start: Mask | None = None) -> GeneratedPlan:
        """The building; robots start on the `start` cells (area `spawn`), or anywhere on the `floor`."""

        def metres(mask: Mask) -> MultiPolygon:
            return united([affinity.scale(traced(mask), self._cell, self._cell, origin=(0.0, 0.0))])

        walls, floor = metres(solid), metres(~solid)
        spawn = _middle(floor) if start is None else metres(start)
        layers = {"walls": walls, "pillars": MultiPolygon(), "furniture": MultiPolygon()}
        rows, columns = solid.shape
        page = (0.0, 0.0, columns * self._cell, rows * self._cell)
        return GeneratedPlan(FloorPlan(walls, layers, {SPAWN_LAYER: spawn, "floor": floor}, page))


def _middle(floor: MultiPolygon) -> MultiPolygon:
    """The floor within a circle of a quarter of the building's breadth about a roomy place."""
    piece = max(floor.geoms, key=lambda one: one.area)
    left, low, right, high = piece.bounds
    centre = shapely.maximum_inscribed_circle(piece, tolerance=0.1).coords[0]
    return polygons(floor.intersection(shapely.Point(centre).buffer(0.25 * min(right - left, high - low) + 0.5)))


def strip(solid: Mask, along: int, at: int, wall: int, span: tuple[int, int]) -> Mask:
    """The cells of a wall from row (`along` 0) or column (1) `at` on, between columns or rows `span`."""
    across = slice(at, at + wall)
    return solid[across, slice(*span)] if along == 0 else solid[slice(*span), across]


def cut_door(
    solid: Mask, along: int, at: int, wall: int, span: tuple[int, int], door: int, random: np.random.Generator
) -> None:
    """Open a door at a random place of a wall with floor all along both sides."""
    before, behind = (strip(solid, along, place, 1, span) for place in (at - 1, at + wall))
    clear = ~(before | behind).ravel()
    fits = np.flatnonzero(np.convolve(clear, np.ones(door, np.int64), "valid") == door)
    if len(fits):
        first = int(fits[int(random.integers(len(fits)))])
        cells = strip(solid, along, at, wall, span)
        (cells if along == 0 else cells.T)[:, first : first + door] = False


def open_between(solid: Mask, one: tuple[int, int], other: tuple[int, int], wall: int, passage: int) -> None:
    """Remove the wall between two neighbouring squares of a maze."""
    pitch = wall + passage
    low, left = wall + min(one[0], other[0]) * pitch, wall + min(one[1], other[1]) * pitch
    high = wall + max(one[0], other[0]) * pitch + passage
    solid[low:high, left : wall + max(one[1], other[1]) * pitch + passage] = False
