"""A world opened for a run: exact walls for beams and bodies, and the truth about every cell."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.strtree import STRtree

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.lattice import Lattice
from swarmsim.world.boundary import boundary, shares
from swarmsim.world.cells import Cells, around, between, flood, grown, richest_piece, rim
from swarmsim.world.plan import SPAWN_LAYER, FloorPlan

_SLIVER = 1e-6  # of a cell; an overlap of walls with a cell below it is rounding, not wall
_TOUCH = 1e-9  # m, a body this close to a wall still counts as clear of it
_MOST_CELLS = 25_000_000  # beyond it, somebody drew millimetres as metres
_NAMED = 5  # how many cells a message names


@dataclass(frozen=True, slots=True, eq=False)
class Arena:
    """Walls, free space and spawn areas of one world on one lattice."""

    name: str  # what messages call the world
    plan: FloorPlan
    lattice: Lattice
    occupied: Cells  # whether walls cover any of a cell
    unmapped: Cells  # whether any of a cell is what nobody knows; such cells never count
    segments: NDArray[np.float64]  # (s, 4): x1, y1, x2, y2 in m; solid wall lies on the left

    @classmethod
    def open(cls, plan: FloorPlan, cell: float, margin: int, name: str) -> Arena:
        """The arena of `plan` with cells of side `cell` (m), whose edges lie on multiples of it from the page's corner.

        The lattice covers page and walls, and `margin` cells more on each side, so that a tile around a robot
        inside never leaves it; it is 1 or more. More columns on the right fill the last word. Raises InputError if
        that is more cells than a run can hold.
        """
        if margin < 1:
            raise ValueError(f"margin is {margin} cells; the border of the lattice has to be outside of the walls")
        corner = np.array([plan.page[0], plan.page[1]] * 2)
        bounds = (shapely.total_bounds([shapely.box(*plan.page), plan.walls]) - corner) / cell
        low = np.floor(bounds[:2] + _SLIVER).astype(np.int64) - margin
        high = np.ceil(bounds[2:] - _SLIVER).astype(np.int64) + margin
        columns, rows = (int(count) for count in high - low)
        columns += -columns % Lattice.WORD
        if rows * columns > _MOST_CELLS:
            raise InputError(
                f"{name}: {plan.width:g} m x {plan.height:g} m in cells of {cell:g} m are {rows * columns} cells, more"
                f" than {_MOST_CELLS}; check the scale (one user unit is one metre) and the cell"
            )
        lattice = Lattice(corner[0] + float(low[0]) * cell, corner[1] + float(low[1]) * cell, cell, rows, columns)
        segments = boundary(plan.walls)
        unmapped = shares(boundary(plan.unknown), lattice) > _SLIVER
        return cls(name, plan, lattice, shares(segments, lattice) > _SLIVER, unmapped, segments)

    def area_name(self, spawn: str) -> str:
        """The name of the spawn area that a scenario means; if it leaves it out, `spawn`, or else the largest.

        Raises InputError if there is none of that name.
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

    def spawn_cells(self, spawn: str) -> Cells:
        """The free cells (rows, columns) whose centres lie in the spawn area.

        An area may run over walls and pillars, where it does not count. Raises InputError if there is no such
        area, if walls cover half of it or more (then it was drawn in the wrong place), or if no cell is free.
        """
        spawn = self.area_name(spawn)
        area = self.plan.spawns[spawn]
        buried = area.intersection(self.plan.walls)
        if buried.area >= 0.5 * area.area:
            raise InputError(
                f"{self.name}: spawn area {spawn!r} lies in a wall at {_place(buried)}: "
                f"{buried.area:.3g} of its {area.area:.3g} m2 are solid; move it onto the floor"
            )
        shapely.prepare(area)
        x, y = np.moveaxis(self._centres(), -1, 0)
        cells: Cells = shapely.contains_xy(area, x, y) & ~self.occupied
        if not cells.any():
            raise InputError(
                f"{self.name}: spawn area {spawn!r} at {_place(area)} holds the centre of no free cell of "
                f"{self.lattice.cell:g} m; make it larger"
            )
        return cells

    def floor(self, spawn: str) -> Cells:
        """The free cells (rows, columns) that are 4-connected to the spawn area, whatever the robot's size.

        Where the area touches several unconnected pieces of floor, the one that holds most of it counts.
        Raises InputError as `spawn_cells` does, and if the outline of the world is open.
        """
        spawn = self.area_name(spawn)
        seeds = self.spawn_cells(spawn)
        floor = richest_piece(~self.occupied, seeds)
        if rim(floor).any():
            raise InputError(f"{self.name}: {self._leak(seeds & floor, spawn)}")
        return floor

    def reachable(self, spawn: str, radius: float) -> Cells:
        """The cells (rows, columns) that a robot of `radius` (m) can get to from the spawn area.

        They are free, a disc of `radius` at their centre is clear of all walls, and they are 4-connected to the
        spawn area through such cells. Raises InputError as `floor` does, and if the robot fits nowhere in the
        spawn area, if a room has no way to it, or if the robot is wider than every door on that way. Places with
        less room to move than the robot's own area are no rooms.
        """
        spawn = self.area_name(spawn)
        self.floor(spawn)
        fits = self.standing(radius)
        seeds = self.spawn_cells(spawn) & fits
        if not seeds.any():
            raise InputError(
                f"{self.name}: a robot of {2 * radius:g} m does not fit anywhere in spawn area {spawn!r} at "
                f"{_place(self.plan.spawns[spawn])}; make the area larger or the robot smaller"
            )
        reachable = richest_piece(fits, seeds)
        home = self._room_of(reachable, radius, spawn)
        self._check_chain(fits & ~reachable, home, radius)
        return reachable

    def standing(self, radius: float) -> Cells:
        """The free cells (rows, columns) at whose centre a disc of `radius` (m) is clear of all walls."""
        reach = math.ceil(radius / self.lattice.cell)  # farther from every occupied cell, nothing is in the way
        close = around(self.occupied, reach) & ~self.occupied
        edges = STRtree(shapely.linestrings(self.segments.reshape(-1, 2, 2)))
        places = np.argwhere(close)
        touching, _ = edges.query(
            shapely.points(self.lattice.centres(places)), predicate="dwithin", distance=radius - _TOUCH
        )
        fits = ~self.occupied
        fits[tuple(places[touching].T)] = False
        return fits

    def coverage_domain(self, reachable: Cells, observed: Cells) -> Cells:
        """The cells (rows, columns) whose observation is 100 %.

        `reachable` is what the method of that name gives, `observed` the cells seen from the centres of these. The
        domain is the observed free cells that are 4-connected to reachable ones through free cells, and the wall
        cells 4-adjacent to those. Raises InputError, with the cells, if one of them is never observed.
        """
        floor = flood(~self.occupied, reachable) >= 0
        free = floor & observed & ~self.unmapped
        domain: Cells = free | (grown(free) & self.occupied)
        missed = np.argwhere(domain & ~observed)
        if len(missed):
            named = ", ".join(f"row {r} column {c} {self._spot((r, c))}" for r, c in missed[:_NAMED])
            raise InputError(
                f"{self.name}: 100 % is unattainable: no reachable place shows {len(missed)} wall cells that border "
                f"the floor: {named}{', ...' if len(missed) > _NAMED else ''}; "
                "widen the passage or straighten the wall there"
            )
        return domain

    def with_boxes(self, boxes: Sequence[Box]) -> Arena:
        """The same world on the same lattice with boxes standing in it besides; they lie on its page."""
        walls = shapely.union_all([self.plan.walls, *(shapely.box(*box) for box in boxes)])
        segments = boundary(walls)
        plan = replace(self.plan, walls=shapely.multipolygons(shapely.get_parts(walls)))
        return Arena(self.name, plan, self.lattice, shares(segments, self.lattice) > _SLIVER, self.unmapped, segments)

    def still_reachable(self, before: Cells, home: Cells, boxes: Sequence[Box], radius: float) -> Cells:
        """What the boxes in this world leave of the cells that a robot of `radius` (m) could reach `before`.

        These are 4-connected to one piece, the one with most of the cells of `home`, the spawn area, or the largest
        where none of that is left; rooms that the boxes cut off are left out. Raises InputError if no cell is left.
        """
        fits = before & ~self.occupied
        centres = self._centres()
        for left, low, right, high in boxes:
            aside = np.maximum(np.maximum(left - centres[..., 0], centres[..., 0] - right), 0.0)
            above = np.maximum(np.maximum(low - centres[..., 1], centres[..., 1] - high), 0.0)
            fits &= np.hypot(aside, above) >= radius - _TOUCH
        if not fits.any():
            raise InputError(f"box: {len(boxes)} boxes leave no place in {self.name} where a robot could stand")
        return richest_piece(fits, fits & home if (fits & home).any() else fits)

    def domain_left(self, reachable: Cells, observed: Cells) -> Cells:
        """As `coverage_domain`, but what is never observed is left out instead of refused."""
        free = (flood(~self.occupied, reachable) >= 0) & observed & ~self.unmapped
        domain: Cells = free | (grown(free) & self.occupied & observed)
        return domain

    def _centres(self) -> NDArray[np.float64]:
        """The centres (rows, columns, 2) of all cells, in m."""
        return self.lattice.centres(np.moveaxis(np.indices(self.lattice.shape), 0, -1))

    def _spot(self, cell: ArrayLike) -> str:
        """The centre of a cell (row, column), as messages write it."""
        x, y = self.lattice.centres(np.asarray(cell))
        return f"({x:.2f} m, {y:.2f} m)"

    def _leak(self, seeds: Cells, spawn: str) -> str:
        """Where the floor runs out of the walls: the place between walls that is nearest to the spawn area."""
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
            "close the gap"
        )

    def _room_of(self, reachable: Cells, radius: float, spawn: str) -> shapely.Polygon:
        """Where the centre of the robot can be, however driven; raises InputError if rooms are left over."""
        left, right, low, high = self.lattice.extent
        around = 4.0 * radius  # room for the robot to drive around the building
        free = shapely.box(left - around, low - around, right + around, high + around).difference(self.plan.walls)
        start = shapely.points(self.lattice.centres(np.argwhere(reachable)[0]))
        rooms = shapely.get_parts(shapely.buffer(free, _TOUCH - radius))
        near = shapely.distance(rooms, start)
        home = rooms[near.argmin()]
        outside = shapely.bounds(rooms)[:, 0] < left
        if outside[near.argmin()]:
            raise InputError(
                f"{self.name}: the outline is open: a robot of {2 * radius:g} m can slip out of spawn area {spawn!r} "
                "through a gap narrower than a cell; close the gaps between the outer walls"
            )
        lost = rooms[~outside & (rooms != home) & (shapely.area(rooms) >= math.pi * radius**2)]
        if len(lost):
            room = lost[shapely.area(lost).argmax()]
            pieces = shapely.get_parts(free)
            piece = pieces[shapely.intersects(pieces, room)][0]
            if not piece.intersects(start):
                raise InputError(
                    f"{self.name}: the room at {_place(room)}, {piece.area:.3g} m2, has no way to spawn area "
                    f"{spawn!r}; give it a door, or fill it"
                )
            raise InputError(
                f"{self.name}: a robot of {2 * radius:g} m is wider than every door to the room at {_place(room)}, "
                f"{room.buffer(radius).area:.3g} m2; the widest way there is {_widest(piece, room, start, radius):.3f} "
                "m; widen it, or take a smaller robot"
            )
        return home

    def _check_chain(self, unreached: Cells, home: shapely.Polygon, radius: float) -> None:
        """Raises InputError if the body could get from `home` to a room, but not from free cell to free cell.

        A room has two by two cells; less is a niche along a slanted wall, which is left out of the domain.
        """
        blocks = unreached[:-1, :-1] & unreached[1:, :-1] & unreached[:-1, 1:] & unreached[1:, 1:]
        corners = np.argwhere(blocks)
        corners = corners[shapely.intersects_xy(home, *self.lattice.centres(corners).T)]
        if len(corners):
            raise InputError(
                f"{self.name}: no chain of free cells leads to the room at {self._spot(corners[0])}, though a robot of "
                f"{2 * radius:g} m fits through; cells of {self.lattice.cell:g} m are too coarse for its door: widen "
                "it, or place it on cell edges"
            )


def _place(shape: shapely.Geometry) -> str:
    """A point inside `shape`, as messages write it."""
    point = shape.centroid if shape.contains(shape.centroid) else shape.point_on_surface()
    return f"({point.x:.2f} m, {point.y:.2f} m)"


def _widest(piece: shapely.Polygon, room: shapely.Polygon, start: shapely.Point, radius: float) -> float:
    """The width (m) of the widest disc, narrower than 2 `radius`, that gets from `start` to `room` in `piece`."""
    low, high = 0.0, radius
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        parts = shapely.get_parts(shapely.buffer(piece, -middle, quad_segs=64))
        if any(part.intersects(room) and part.intersects(start) for part in parts):
            low = middle
        else:
            high = middle
    return 2.0 * low
