"""Free space that robots cannot reach, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.world.arena import TOUCH, Arena, place_in, spot
from swarmsim.world.cells import Cells

_CRUMB: Final = 1e-6  # m2; smaller pieces lie where two walls nearly meet
_ROOMY: Final = 2.0  # m2; pockets above it may be rooms
_ROOMS: Final = 0.05  # of the floor; more than this behind narrow gaps deserves a warning


@dataclass(frozen=True, slots=True, eq=False)
class Unreached:
    """The space that robots of one size cannot reach from one spawn area."""

    pockets: NDArray[np.object_]  # polygons without any way in, the largest first
    narrow: NDArray[np.object_]  # polygons behind gaps narrower than the robot, the largest first
    coarse: NDArray[np.float64]  # (n, 2): x, y in m of cells that a body could reach, but no chain of free cells does
    start: shapely.Point  # a reached place
    home: shapely.Polygon  # the free space around it

    def notices(self, arena: Arena, radius: float) -> list[str]:
        """For the user, in sentences that name the world; `radius` of the robot in m."""
        told = []
        floor = self.home.area
        if len(self.pockets):
            one = len(self.pockets) == 1
            largest = self.pockets[0]
            count = f"{len(self.pockets)} pocket{'' if one else 's'} of {_m2(shapely.area(self.pockets).sum())}"
            which = (
                f"at {place_in(largest)}" if one else f"in all (the largest {_m2(largest.area)} at {place_in(largest)})"
            )
            told.append(f"{count} {which} cannot be entered and {'does' if one else 'do'} not count")
            if largest.area > _ROOMY:
                told[-1] += f"; if {'it is a room' if one else 'some are rooms'}, world.doors = 0.9 makes doors"
            if shapely.area(self.pockets).sum() > floor:
                told[-1] += "; that is more than the floor: world.spawn says where robots start"
        behind = float(shapely.area(self.narrow).sum())
        if behind:
            some = "place lies" if len(self.narrow) == 1 else "places lie"
            told.append(
                f"{len(self.narrow)} {some} behind gaps narrower than a robot of {2.0 * radius:g} m and "
                f"{'does' if len(self.narrow) == 1 else 'do'} not count: {_m2(behind)} in all, the largest at "
                f"{place_in(self.narrow[0])}"
            )
            if behind > _ROOMS * floor:
                told[-1] += (
                    f"; that is {100.0 * behind / floor:.0f} % of the floor, so that the robot or the scale may be "
                    "wrong"
                )
        if len(self.coarse):
            cell = arena.lattice.cell
            told.append(
                f"{len(self.coarse)} cells, {_m2(len(self.coarse) * cell**2)}, do not count: a robot fits through to "
                f"them, near {spot(*self.coarse[0])}, but cells of {cell:g} m are too coarse for the passage"
            )
            if len(self.coarse) * cell**2 > _ROOMS * floor:
                told[-1] += (
                    f"; that is {100.0 * len(self.coarse) * cell**2 / floor:.0f} % of the floor: take smaller ones"
                )
        return [f"{arena.name}: {sentence}" for sentence in told]

    def refuse(self, arena: Arena, radius: float, spawn: str) -> None:
        """Raise InputError if it includes a room: a place with more room to move than the robot's own area."""
        rooms = [(self.narrow, True), (self.pockets, False)]
        found = [(piece, narrow) for pieces, narrow in rooms for piece in pieces if _roomy(piece, radius)]
        if found:
            room, narrow = max(found, key=lambda one: one[0].area)
            if not narrow:
                raise InputError(
                    f"{arena.name}: the room at {place_in(room)}, {room.area:.3g} m2, has no way to spawn area "
                    f'{spawn!r}; give it a door, or fill it, or pass it over with world.pockets = "ignore"'
                )
            raise InputError(
                f"{arena.name}: a robot of {2 * radius:g} m is wider than every door to the room at {place_in(room)}, "
                f"{room.area:.3g} m2; the widest way there is {_widest(self.home, room, self.start, radius):.3f} "
                "m; widen it, or take a smaller robot"
            )
        if len(self.coarse):
            raise InputError(
                f"{arena.name}: no chain of free cells leads to the room at {spot(*self.coarse[0])}, though a robot of "
                f"{2 * radius:g} m fits through; cells of {arena.lattice.cell:g} m are too coarse for its door: widen "
                "it, or place it on cell edges"
            )


def unreached(arena: Arena, reachable: Cells, radius: float, spawn: str) -> Unreached:
    """The space that robots of `radius` (m) cannot reach, given the `reachable` cells (rows, columns).

    Raises InputError if a robot could slip out of the building through a gap narrower than a cell.
    """
    left, right, low, high = arena.lattice.extent
    around = 4.0 * radius  # room for the robot to drive around the building
    free = shapely.box(left - around, low - around, right + around, high + around).difference(arena.solid)
    pieces = shapely.get_parts(free)
    start = shapely.Point(arena.lattice.centres(np.argwhere(reachable)[0]))
    outside = shapely.bounds(pieces)[:, 0] < left
    own = shapely.distance(pieces, start).argmin()
    rooms = shapely.get_parts(shapely.buffer(pieces[own], TOUCH - radius, quad_segs=8))
    nearest = shapely.distance(rooms, start).argmin()
    home, beyond = rooms[nearest], shapely.bounds(rooms)[:, 0] < left
    if beyond[nearest]:
        raise InputError(
            f"{arena.name}: the outline is open: a robot of {2 * radius:g} m can slip out of spawn area {spawn!r} "
            "through a gap narrower than a cell; close the gaps between the outer walls, or say world.border = true"
        )
    lost = ~beyond & (shapely.area(rooms) >= math.pi * radius**2)
    lost[nearest] = False
    closed = ~outside & (shapely.area(pieces) > _CRUMB)
    closed[own] = False
    narrow, coarse = shapely.buffer(rooms[lost], radius, quad_segs=16), _coarse(arena, reachable, home, radius)
    return Unreached(_by_size(pieces[closed]), _by_size(narrow), coarse, start, pieces[own])


def _coarse(arena: Arena, reachable: Cells, home: shapely.Polygon, radius: float) -> NDArray[np.float64]:
    """The centres (n, 2) of cells in rooms that the body could reach within `home`, but not by free cells.

    A room has at least two by two cells; less is a niche along a slanted wall.
    """
    left = arena.standing(radius) & ~reachable
    blocks = left[:-1, :-1] & left[1:, :-1] & left[:-1, 1:] & left[1:, 1:]
    rooms = np.zeros_like(left)
    for down in (slice(None, -1), slice(1, None)):
        for across in (slice(None, -1), slice(1, None)):
            rooms[down, across] |= blocks
    corners = arena.lattice.centres(np.argwhere(rooms))
    shapely.prepare(home)
    return np.asarray(corners[shapely.intersects_xy(home, *corners.T)])


def _by_size(shapes: NDArray[np.object_]) -> NDArray[np.object_]:
    return shapes[np.argsort(-shapely.area(shapes), kind="stable")]


def _roomy(piece: shapely.Polygon, radius: float) -> bool:
    parts = shapely.get_parts(shapely.buffer(piece, TOUCH - radius))
    return bool(len(parts)) and float(shapely.area(parts).max()) >= math.pi * radius**2


def _m2(area: float) -> str:
    """An area for people."""
    return f"{area:.2f} m2" if area < 10.0 else f"{area:.1f} m2"


def _widest(piece: shapely.Polygon, room: shapely.Polygon, start: shapely.Point, radius: float) -> float:
    """The width (m) of the widest disc, narrower than 2 `radius`, that gets from `start` to `room` in `piece`."""
    low, high = 0.0, radius
    inner = room.buffer(TOUCH - radius)
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        parts = shapely.get_parts(shapely.buffer(piece, -middle, quad_segs=64))
        if any(part.intersects(inner) and part.intersects(start) for part in parts):
            low = middle
        else:
            high = middle
    return 2.0 * low
