"""Which lines without a width are the two sides of a wall, and the space between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.world.shapes import Line

NEAR: Final = (0.05, 0.6)  # m, between the two sides of a wall
_PARALLEL: Final = 0.05  # the sine of the largest angle between them
_SHARE: Final = 0.5  # least share of a line beside its partner
_BORDER: Final = 0.8  # least share of sides in the border of a wall's inside
_LOOSE: Final = 1e-2  # m, curves are compared by chords this close
_TOUCHING: Final = 1e-3  # m
_GAP: Final = 5e-3  # m, of careless drawing: lines this close were meant to meet
_GRID: Final = 1e-6  # m, on which touching lines share a corner
_THINNEST: Final = 0.06  # m, of fills: the leaf of a door is thinner


@dataclass(frozen=True, slots=True, eq=False)
class Cavities:
    """The walls found among lines."""

    paired: NDArray[np.bool_]  # (n,) whether a line is a side or an end of a wall drawn with two lines
    between: NDArray[np.object_]  # (m,) polygons: the insides of such walls
    beside: NDArray[np.int64]  # (m,) the line along the longest piece of the border of each


def cavities(lines: Sequence[Line], others: Sequence[Line] = ()) -> Cavities:
    """The sides of walls among n lines, and the closed insides of these walls.

    A line is a side if another runs parallel to at least half of it, 0.05 to 0.6 m away; its own other side counts, as
    in a narrow rectangle. A line that closes such walls is also a side: up to 0.6 m long, perhaps one of `others`, and
    ending on two sides. Two sides that end beside each other are closed there, and lines that miss each other by 5 mm
    meet. An inside is at most as wide as such walls, and most of its border is sides of walls.
    """
    geometries = np.array([shapely.LineString(line) for line in lines], dtype=object)
    paired = _has_partner(geometries)
    if not paired.any():
        return Cavities(paired, np.empty(0, object), np.empty(0, np.int64))
    sides = shapely.STRtree(geometries[paired])
    paired |= _ends(geometries, sides)
    strange = np.array([shapely.LineString(line) for line in others], dtype=object)
    caps = [*strange[_ends(strange, sides)], *_caps(geometries[paired])]
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all([*geometries, *caps], grid_size=_GRID)]))
    thin = shapely.is_empty(shapely.buffer(faces, -NEAR[1] / 2.0 - _TOUCHING))
    faces = faces[thin & ~shapely.is_empty(shapely.buffer(faces, -_THINNEST / 2.0))]
    inside, beside = _bordered(faces, geometries, paired)
    return Cavities(paired, faces[inside], beside)


def _bordered(
    faces: NDArray[np.object_], lines: NDArray[np.object_], paired: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which faces are mostly bordered by sides of walls, and the line along the longest piece of each border."""
    rings, face = shapely.get_rings(faces, return_index=True)
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    same: NDArray[np.bool_] = ring[1:] == ring[:-1]
    start, end, owner = corners[:-1][same], corners[1:][same], face[ring[1:][same]]
    length: NDArray[np.float64] = np.linalg.norm(end - start, axis=1)
    which = np.flatnonzero(paired)
    middles = shapely.points((start + end) / 2.0)
    piece: NDArray[np.int64]
    found: NDArray[np.int64]
    piece, found = shapely.STRtree(lines[which]).query(middles, predicate="dwithin", distance=_TOUCHING)
    piece, first = np.unique(piece, return_index=True)
    along = np.bincount(owner[piece], length[piece], len(faces))
    inside: NDArray[np.bool_] = along >= _BORDER * np.bincount(owner, length, len(faces))
    order: NDArray[np.int64] = np.lexsort((-length[piece], owner[piece]))
    lead, at = np.unique(owner[piece][order], return_index=True)
    longest = np.zeros(len(faces), np.int64)
    longest[lead] = which[found[first[order[at]]]]
    return inside, longest[inside]


def _has_partner(lines: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Whether parallel lines run beside at least half of each line."""
    if not len(lines):
        return np.zeros(0, np.bool_)
    corners, owner = shapely.get_coordinates(shapely.simplify(lines, _LOOSE), return_index=True)
    same: NDArray[np.bool_] = owner[1:] == owner[:-1]
    start, end, owner = corners[:-1][same], corners[1:][same], owner[1:][same]
    length: NDArray[np.float64] = np.linalg.norm(end - start, axis=1)
    real: NDArray[np.bool_] = length > _TOUCHING
    start, end, owner, length = start[real], end[real], owner[real], length[real]
    along = (end - start) / length[:, None]
    segments = np.asarray(shapely.linestrings(np.stack([start, end], axis=1)))
    one: NDArray[np.int64]
    other: NDArray[np.int64]
    one, other = shapely.STRtree(segments).query(segments, predicate="dwithin", distance=NEAR[1])
    sine: NDArray[np.float64] = along[one, 0] * along[other, 1] - along[one, 1] * along[other, 0]
    one, other = one[(one != other) & (np.abs(sine) < _PARALLEL)], other[(one != other) & (np.abs(sine) < _PARALLEL)]

    def projected(point: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The distance of a point along `one` and beside it, m."""
        offset = point - start[one]
        return (offset * along[one]).sum(axis=1), along[one, 0] * offset[:, 1] - along[one, 1] * offset[:, 0]

    (first, aside), (last, apart) = projected(start[other]), projected(end[other])
    low = np.clip(np.minimum(first, last), 0.0, length[one])
    high = np.clip(np.maximum(first, last), 0.0, length[one])
    gap = np.abs(aside + apart) / 2.0
    kept = (high > low) & (gap >= NEAR[0]) & (gap <= NEAR[1])
    covered = _covered(one[kept], low[kept], high[kept], len(length))
    whole = np.bincount(owner, length, len(lines))
    shared: NDArray[np.bool_] = np.bincount(owner, covered, len(lines)) >= _SHARE * whole
    return shared & (whole > 0.0)


def _covered(
    which: NDArray[np.int64], low: NDArray[np.float64], high: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """The length of the union of intervals, of each of `count` segments, m."""
    order = np.lexsort((low, which))
    which, low, high = which[order], low[order], high[order]
    shift = which * (1.0 + (high.max() if len(high) else 0.0))  # keeps the segments' intervals apart
    reached = np.maximum.accumulate(high + shift)
    before = np.concatenate([[-1.0], reached[:-1]])[: len(low)]
    added = np.maximum(high + shift - np.maximum(low + shift, before), 0.0)
    covered: NDArray[np.float64] = np.bincount(which, added, count).astype(np.float64)
    return covered


def _ends(lines: NDArray[np.object_], sides: shapely.STRtree) -> NDArray[np.bool_]:
    """Whether each line is short and ends on sides of walls."""
    closing = np.zeros(len(lines), np.bool_)
    short = np.flatnonzero(shapely.length(lines) <= NEAR[1] + _TOUCHING) if len(lines) else np.zeros(0, np.int64)
    if len(short):
        ends = np.concatenate([shapely.get_point(lines[short], 0), shapely.get_point(lines[short], -1)])
        held = np.zeros(len(ends), np.bool_)
        held[sides.query(ends, predicate="dwithin", distance=_TOUCHING)[0]] = True
        closing[short] = held[: len(short)] & held[len(short) :]
    return closing


def _caps(sides: NDArray[np.object_]) -> list[shapely.LineString]:
    """Lines from the loose ends of sides to lines that they narrowly miss, or to each other if they end together."""
    tips, ways, own = [], [], []
    for number, side in enumerate(sides):
        corners = shapely.get_coordinates(side)
        if not side.is_closed:
            tips += [corners[0], corners[-1]]
            ways += [corners[0] - corners[1], corners[-1] - corners[-2]]
            own += [number, number]
    if not tips:
        return []
    place, way = np.array(tips), np.array(ways)
    way /= np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None]
    points = np.asarray(shapely.points(place))
    tip, met = shapely.STRtree(sides).query(points, predicate="dwithin", distance=_GAP)
    other: NDArray[np.bool_] = met != np.array(own)[tip]
    tip, met = tip[other], met[other]
    bridges = np.asarray(shapely.shortest_line(points[tip], sides[met]))
    caps = list(bridges[shapely.length(bridges) > _GRID])
    loose = np.setdiff1d(np.arange(len(place)), tip)
    if len(loose) < 2:
        return caps
    one, other = shapely.STRtree(points[loose]).query(points[loose], predicate="dwithin", distance=NEAR[1])
    one, other = loose[one], loose[other]
    step = place[other] - place[one]
    gap: NDArray[np.float64] = np.linalg.norm(step, axis=1)
    across = np.abs((step * way[one]).sum(axis=1)) < 0.5 * gap  # within 30 degrees
    facing = (way[one] * way[other]).sum(axis=1) > 0.9
    good: NDArray[np.bool_] = (gap >= NEAR[0]) & across & facing
    one, other, gap = one[good], other[good], gap[good]
    nearest = {int(end): int(other[one == end][gap[one == end].argmin()]) for end in np.unique(one)}
    return caps + [shapely.LineString(place[[a, b]]) for a, b in nearest.items() if a < b and nearest.get(b) == a]
