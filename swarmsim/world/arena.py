"""A world opened for a run: exact walls for beams and bodies, and the truth about every cell."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry
from shapely.strtree import STRtree

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.lattice import Lattice
from swarmsim.world.areas import joined
from swarmsim.world.boundary import boundary, shares
from swarmsim.world.cells import Cells, around, between, flood, grown, richest_piece, rim
from swarmsim.world.plan import SPAWN_LAYER, FloorPlan

_SLIVER = 1e-6  # of a cell; an overlap of walls with a cell below it is rounding, not wall
TOUCH = 1e-9  #: m, a body this close to a wall still counts as clear of it
_MOST_CELLS = 25_000_000  # beyond it, the drawing's millimetres were read as metres


@dataclass(frozen=True, slots=True, eq=False)
class Arena:
    """Walls, free space and spawn areas of one world on one lattice."""

    name: str  # the world's name in messages
    plan: FloorPlan
    solid: MultiPolygon  # walls, the border of an open building, and boxes in it
    lattice: Lattice
    occupied: Cells  # whether walls cover any of a cell
    unmapped: Cells  # whether part of a cell is unmapped; such cells never count
    segments: NDArray[np.float64]  # (s, 4): x1, y1, x2, y2 in m; solid wall lies on the left

    @classmethod
    def open(cls, plan: FloorPlan, cell: float, margin: int, name: str) -> Arena:
        """The arena of `plan` with cells of side `cell` (m), whose edges lie on multiples of it from the page's corner.

        The lattice covers page and walls, and `margin` (1 or more) further cells on each side, so that a tile around a
        robot inside never leaves it. More columns on the right fill the last word. Raises InputError for more cells
        than a run can hold.
        """
        if margin < 1:
            raise ValueError(f"margin is {margin} cells; the border of the lattice has to be outside of the walls")
        corner = np.array([plan.page[0], plan.page[1]] * 2)
        bounds = (shapely.total_bounds([shapely.box(*plan.page), plan.walls, plan.border]) - corner) / cell
        low = np.floor(bounds[:2] + _SLIVER).astype(np.int64) - margin
        high = np.ceil(bounds[2:] - _SLIVER).astype(np.int64) + margin
        columns, rows = (int(count) for count in high - low)
        columns += -columns % Lattice.WORD
        if rows * columns > _MOST_CELLS:
            raise InputError(
                f"{name}: {plan.width:g} m x {plan.height:g} m in cells of {cell:g} m are {rows * columns} cells, more"
                f" than {_MOST_CELLS}; is the scale right? Say world.width = METRES, or take larger cells"
            )
        lattice = Lattice(corner[0] + float(low[0]) * cell, corner[1] + float(low[1]) * cell, cell, rows, columns)
        solid = joined([plan.walls, plan.border])
        segments = boundary(solid)
        unmapped = shares(boundary(plan.unknown), lattice) > _SLIVER
        return cls(name, plan, solid, lattice, shares(segments, lattice) > _SLIVER, unmapped, segments)

    def area_name(self, spawn: str) -> str:
        """The name of the scenario's spawn area; by default `spawn`, or else the largest.

        Raises InputError for an unknown name.
        """
        spawns = self.plan.spawns
        if not spawns:
            raise InputError(
                f"{self.name}: no free space to start in; expected world.spawn = [x, y, width, height] in m"
            )
        if not spawn:
            spawn = SPAWN_LAYER if SPAWN_LAYER in spawns else max(spawns, key=lambda name: spawns[name].area)
        if spawn not in spawns:
            near = difflib.get_close_matches(spawn, spawns, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(f"{self.name}: no spawn area {spawn!r}; {hint}it has {', '.join(sorted(spawns))}")
        return spawn

    @lru_cache(maxsize=16)  # noqa: B019 - worlds are few, and a study keeps them anyway
    def spawn_cells(self, spawn: str) -> Cells:
        """The free cells (rows, columns) whose centres lie in the spawn area.

        Parts of an area over walls and pillars do not count. Raises InputError if there is no such area, if walls
        cover half of it or more (then it was drawn in the wrong place), or if no cell is free.
        """
        spawn = self.area_name(spawn)
        area = self.plan.spawns[spawn]
        buried = area.intersection(self.plan.walls)
        if buried.area >= 0.5 * area.area:
            raise InputError(
                f"{self.name}: spawn area {spawn!r} lies in a wall at {place_in(buried)}: "
                f"{buried.area:.3g} of its {area.area:.3g} m2 are solid; move it onto the floor"
            )
        shapely.prepare(area)
        x, y = np.moveaxis(self._centres(), -1, 0)
        cells: Cells = shapely.contains_xy(area, x, y) & ~self.occupied
        if not cells.any():
            raise InputError(
                f"{self.name}: spawn area {spawn!r} at {place_in(area)} holds the centre of no free cell of "
                f"{self.lattice.cell:g} m; make it larger"
            )
        cells.flags.writeable = False
        return cells

    def floor(self, spawn: str) -> Cells:
        """The free cells (rows, columns) that are 4-connected to the spawn area, for a robot of any size.

        If the area touches several unconnected pieces of floor, the one with most of it counts.
        Raises InputError as `spawn_cells` does, and if the outline of the world is open.
        """
        spawn = self.area_name(spawn)
        seeds = self.spawn_cells(spawn)
        floor = richest_piece(~self.occupied, seeds)
        if rim(floor).any():
            raise InputError(f"{self.name}: {self._leak(seeds & floor, spawn)}")
        return floor

    def reachable(self, spawn: str, radius: float) -> Cells:
        """The cells (rows, columns) that a robot of `radius` (m) can reach from the spawn area.

        They are free, a disc of `radius` at their centre is clear of all walls, and they are 4-connected to the spawn
        area through such cells. Raises InputError as `floor` does, and if the robot fits nowhere in the spawn area.
        """
        spawn = self.area_name(spawn)
        self.floor(spawn)
        fits = self.standing(radius)
        seeds = self.spawn_cells(spawn) & fits
        if not seeds.any():
            raise InputError(
                f"{self.name}: a robot of {2 * radius:g} m does not fit anywhere in spawn area {spawn!r} at "
                f"{place_in(self.plan.spawns[spawn])}; make the area larger or the robot smaller"
            )
        return richest_piece(fits, seeds)

    @lru_cache(maxsize=16)  # noqa: B019 - as above
    def standing(self, radius: float) -> Cells:
        """The free cells (rows, columns) at whose centre a disc of `radius` (m) is clear of all walls."""
        reach = math.ceil(radius / self.lattice.cell)  # beyond it, no occupied cell is in the way
        close = around(self.occupied, reach) & ~self.occupied
        edges = STRtree(np.asarray(shapely.linestrings(self.segments.reshape(-1, 2, 2))))
        places = np.argwhere(close)
        touching, _ = edges.query(
            shapely.points(self.lattice.centres(places)), predicate="dwithin", distance=radius - TOUCH
        )
        fits = ~self.occupied
        fits[tuple(places[touching].T)] = False
        fits.flags.writeable = False
        return fits

    def explorable(self, reachable: Cells, observed: Cells) -> Cells:
        """The cells (rows, columns) that can be explored.

        `reachable` comes from the method of that name, `observed` are the cells seen from the centres of these. Cells
        that can be explored are the observed free cells 4-connected to reachable ones through free cells, and the
        observed wall cells 4-adjacent to those.
        """
        free = (flood(~self.occupied, reachable) >= 0) & observed & ~self.unmapped
        found: Cells = free | (grown(free) & self.occupied & observed)
        return found

    def with_boxes(self, boxes: Sequence[Box]) -> Arena:
        """The same world on the same lattice with these further boxes, which lie on its page."""
        walls = shapely.union_all([self.solid, *(shapely.box(*box) for box in boxes)])
        segments = boundary(walls)
        solid = MultiPolygon(list(shapely.get_parts(walls)))
        return replace(self, solid=solid, occupied=shares(segments, self.lattice) > _SLIVER, segments=segments)

    def still_reachable(self, before: Cells, home: Cells, boxes: Sequence[Box], radius: float) -> Cells:
        """The cells that a robot of `radius` (m) could reach `before` and still can with this world's boxes.

        They form one 4-connected piece, the one with most of the cells of `home`, the spawn area, or the largest if
        none of that is left; rooms that the boxes cut off are left out. Raises InputError if no cell is left.
        """
        fits = before & ~self.occupied
        centres = self._centres()
        for left, low, right, high in boxes:
            aside = np.maximum(np.maximum(left - centres[..., 0], centres[..., 0] - right), 0.0)
            above = np.maximum(np.maximum(low - centres[..., 1], centres[..., 1] - high), 0.0)
            fits &= np.hypot(aside, above) >= radius - TOUCH
        if not fits.any():
            raise InputError(f"box: {len(boxes)} boxes leave no place in {self.name} where a robot could stand")
        return richest_piece(fits, fits & home if (fits & home).any() else fits)

    def _centres(self) -> NDArray[np.float64]:
        """The centres (rows, columns, 2) of all cells, in m."""
        return self.lattice.centres(np.moveaxis(np.indices(self.lattice.shape), 0, -1))

    def _spot(self, cell: ArrayLike) -> str:
        """The centre of a cell (row, column), as messages write it."""
        return spot(*self.lattice.centres(np.asarray(cell)).tolist())

    def _leak(self, seeds: Cells, spawn: str) -> str:
        """Where the floor leaks out of the walls: the place between walls nearest to the spawn area."""
        hops = flood(~self.occupied, seeds)
        passages = between(self.occupied)
        outside = flood(~self.occupied & ~passages, rim(~self.occupied)) >= 0
        if (seeds & outside).any():
            place = self._spot(np.argwhere(seeds & outside)[0])
            return f"spawn area {spawn!r} lies outside of the walls at {place}; move it inside"
        gaps = grown(outside) & passages & (hops >= 0)
        place = self._spot(np.argwhere(gaps & (hops == hops[gaps].min()))[0])
        return (
            f"the outline is open near {place}: from spawn area {spawn!r} the floor runs out of the walls there; "
            "close the gap, or let world.border = true close it"
        )


def place_in(shape: BaseGeometry) -> str:
    """A point inside `shape`, as messages write it."""
    point = shape.centroid if shape.contains(shape.centroid) else shape.point_on_surface()
    return spot(point.x, point.y)


def spot(x: float, y: float) -> str:
    """A point (m), as messages write it."""
    return f"({x:.2f} m, {y:.2f} m)"
