"""Doors marked by a point or a line on a map, as openings through the walls between two rooms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

WIDTH: Final = 0.9  #: m, default width of a door

_REACH = 0.5  # m, between a door's mark and its wall
_OFFSETS = np.array([0.03, 0.15, 0.3, 0.45, 0.6])  # m from the wall's line, where to look for a room
_BEYOND = 0.17  # m that an opening reaches into a room
_JAMB = 0.05  # m of wall left beside a door at its end
_STRAIGHT = 0.01  # m, bends to ignore: doors are corners of outlines
_ENOUGH = 2  # of three looks through a door that have to see a room on either side
_SHORTEST = 0.3  # m, of a wall with a door


@dataclass(frozen=True, slots=True)
class _Place:
    """A stretch of wall where a door could be."""

    middle: NDArray[np.float64]
    along: NDArray[np.float64]
    width: float  # m
    away: float  # m, from the mark
    parts: bool  # whether it separates two rooms, and does not just stand in one


class Walls:
    """The borders of rooms, and walls drawn as lines, with the rooms on either side."""

    def __init__(self, rooms: Sequence[BaseGeometry], lines: Sequence[BaseGeometry]) -> None:
        self._rooms = shapely.STRtree(list(rooms))
        self._any = bool(len(rooms))
        borders = [shapely.boundary(shapely.simplify(room, _STRAIGHT)) for room in rooms]
        self._ends = _segments([*borders, *lines])
        self._borders = len(_segments(borders))
        self._segments = shapely.STRtree(np.asarray(shapely.linestrings(self._ends)) if len(self._ends) else [])

    def opening(self, mark: BaseGeometry, width: float) -> shapely.Polygon | None:
        """The opening for a door at `mark`, a point or a line as long as the door, from room to room.

        None without a wall, or with a room on one side only: a door that leads outside stays closed. A door at a
        corner moves along the wall that separates two rooms.
        """
        places = self._at_point(mark, width) if isinstance(mark, shapely.Point) else self._at_line(mark)
        rated = [(self._sides(place), place) for place in places]
        if not rated:
            return None
        (seen, (left, right)), place = max(rated, key=lambda one: (one[0][0], -round(one[1].away, 2)))
        if self._any and seen < _ENOUGH:
            return None
        along, across = 0.5 * place.width * place.along, _turned(place.along)
        low, high = place.middle - right * across, place.middle + left * across
        return shapely.Polygon([low - along, low + along, high + along, high - along])

    def _at_point(self, mark: shapely.Point, width: float) -> list[_Place]:
        point = np.array([mark.x, mark.y])
        places = []
        for index in np.sort(self._segments.query(mark, predicate="dwithin", distance=_REACH)):
            start, end = self._ends[index]
            length = float(np.hypot(*(end - start)))
            if length < _SHORTEST:
                continue
            along = (end - start) / length
            wide = min(width, length - 2.0 * _JAMB)
            nearest = float((point - start) @ along)
            at = float(np.clip(nearest, 0.5 * wide + _JAMB, length - 0.5 * wide - _JAMB))
            middle = start + at * along
            off = abs(float((point - start) @ _turned(along)))
            places.append(_Place(middle, along, wide, off + abs(at - nearest), bool(index < self._borders)))
        return places

    def _at_line(self, mark: BaseGeometry) -> list[_Place]:
        corners = shapely.get_coordinates(mark)
        length = float(np.hypot(*(corners[-1] - corners[0])))
        if length < _JAMB:
            return []
        return [_Place(0.5 * (corners[0] + corners[-1]), (corners[-1] - corners[0]) / length, length, 0.0, False)]

    def _sides(self, place: _Place) -> tuple[int, tuple[float, float]]:
        """How many of three looks see one room on the left and another on the right, and their distances."""
        reach = float(_OFFSETS[0] + _BEYOND)
        if not self._any:
            return 0, (reach, reach)
        across = _turned(place.along)
        looks = place.middle + np.outer([-0.4, 0.0, 0.4], place.width * place.along)
        seen: list[tuple[int, int, float]] = []  # looks, room and distance of either side
        for side in (1.0, -1.0):
            points = looks[:, None, :] + side * _OFFSETS[None, :, None] * across
            asked, room = self._rooms.query(shapely.points(points.reshape(-1, 2)), predicate="intersects")
            look, offset = np.divmod(asked, len(_OFFSETS))
            best = (0, -1, 0.0)
            for one in np.unique(room):
                if place.parts and seen and seen[0][1] == one:
                    continue
                first = [_OFFSETS[offset[(look == k) & (room == one)]].min(initial=np.inf) for k in range(3)]
                there = np.isfinite(first)
                far = float(np.max(first, where=there, initial=0.0))
                best = max(best, (int(there.sum()), int(one), far), key=lambda it: (it[0], -it[2]))
            seen.append(best)
        return min(seen[0][0], seen[1][0]), (seen[0][2] + _BEYOND, seen[1][2] + _BEYOND)


def _segments(lines: Sequence[BaseGeometry]) -> NDArray[np.float64]:
    """The straight pieces (k, 2, 2) of lines."""
    parts = shapely.get_parts(shapely.get_parts(np.array(lines, dtype=object)))
    corners, owner = shapely.get_coordinates(parts, return_index=True)
    return (
        np.stack([corners[:-1], corners[1:]], axis=1)[owner[:-1] == owner[1:]] if len(corners) else np.empty((0, 2, 2))
    )


def _turned(along: NDArray[np.float64]) -> NDArray[np.float64]:
    """The direction to the left."""
    return np.array([-along[1], along[0]])
