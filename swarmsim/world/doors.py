"""Doors of drawings: those drawn as a leaf and the arc of its swing, and those made for closed rooms."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from swarmsim.core.events import Box
from swarmsim.world.areas import joined, polygons
from swarmsim.world.shapes import NOTHING, Line, Shape

LEAF: Final = (0.5, 1.35)  # m, widths of door leaves
SWING: Final = (math.radians(12.0), math.radians(115.0))  # angles of their arcs
SLACK: Final = 0.12  # of a leaf, the error of drawings
THICK: Final = 0.45  # m, the thickest wall that gets a door
CAVITY: Final = 0.35  # m, 2 area / perimeter; closed pieces below it are insides of walls, not rooms
FURNITURE: Final = 8.0  # m2; free-standing closed pieces up to this size are furniture
_CRUMB: Final = 1e-4  # m2
_INTO: Final = 0.02  # m, how far a door reaches into both rooms
STRETCH: Final = 0.3  # m, the shortest piece of wall that gets a door

Points = NDArray[np.float64]  # (n, 2): x, y in m


@dataclass(frozen=True, slots=True)
class _Arc:
    """A piece of a circle in a line."""

    shape: int  # that the line belongs to
    line: int
    first: int  # its corners in that line
    last: int
    centre: Points  # (2,)
    radius: float
    ends: Points  # (2, 2)


@dataclass(frozen=True, slots=True, eq=False)
class MadeDoors:
    """Openings for closed rooms."""

    doors: tuple[shapely.Polygon, ...]
    cuts: BaseGeometry  # all of them together

    def boxes(self) -> tuple[Box, ...]:
        """The box around each of them: left, lower, right and upper edge, in m."""
        return tuple([(left, low, right, high) for left, low, right, high in (door.bounds for door in self.doors)])


def cut_by_symbols(shapes: Sequence[Shape]) -> tuple[list[Shape], list[shapely.Polygon]]:
    """The shapes without door symbols, and for each symbol the rectangle that it opens in the wall.

    A symbol is an arc of 12 to 115 degrees with the radius of a leaf, and the leaf itself: a line, or a thin box, from
    the centre to one of its ends. It opens the wall from the centre to the other end. Both may lie in a gap or over a
    continuous wall.
    """
    arcs = [
        arc
        for number, shape in enumerate(shapes)
        if shape.pen or not shape.stroke.is_empty
        for place, line in enumerate(shape.lines)
        for arc in _arcs(line, number, place)
    ]
    if not arcs:
        return list(shapes), []
    starts, stops, owners = _segments(shapes)
    openings: list[shapely.Polygon] = []
    gone: defaultdict[int, set[tuple[int, int]]] = defaultdict(set)
    walls = shapely.STRtree([shape.stroke if shape.fill.is_empty else shape.fill for shape in shapes])
    for arc in arcs:
        slack = SLACK * arc.radius
        sides = [_leaf(arc.centre, end, starts, stops, slack) for end in arc.ends]
        if not any(len(side) for side in sides):
            continue
        closed = 1 if len(sides[0]) else 0
        if all(len(side) for side in sides):  # both radii are drawn; the wall goes on beyond the closed one
            beyond = arc.centre + (arc.ends - arc.centre) * (1.0 + 2.0 * SLACK)
            hits = [len(_near(walls, place)) for place in beyond]
            own = {arc.shape, *(int(owners[segment][0]) for side in sides for segment in side)}
            middles = 0.5 * (arc.centre + arc.ends)
            if all(hits) and all(
                _near(walls, place) - own for place in middles
            ):  # walls run along both: the corner of a room, as of a shower
                continue
            closed = int(hits[1] >= hits[0])
        leaf = sides[1 - closed]
        openings.append(_opening(arc.centre, arc.ends[closed]))
        gone[arc.shape].update((arc.line, at) for at in range(arc.first, arc.last))
        owned: list[tuple[int, int, int]] = owners[leaf].tolist()
        for shape, line, at in owned:
            gone[shape].add((line, at))
    left = [_without(shape, gone[number]) if number in gone else shape for number, shape in enumerate(shapes)]
    return left, openings


def inward(openings: list[shapely.Polygon], walls: MultiPolygon) -> list[shapely.Polygon]:
    """The openings that do not lead out of the building that `walls` make."""
    if not openings:
        return []
    page = shapely.box(*walls.bounds)
    free = shapely.get_parts(polygons(shapely.difference(page, walls)))
    outside = shapely.union_all([*free[shapely.intersects(free, page.exterior)], shapely.buffer(page, 1.0) - page])
    shapely.prepare(outside)
    return [opening for opening in openings if not outside.intersects(opening)]


def _near(walls: shapely.STRtree, place: Points) -> set[int]:
    """The numbers of the shapes at a place, within the error of drawings."""
    return set(walls.query(shapely.Point(place), predicate="dwithin", distance=_INTO).tolist())


def _arcs(line: Line, shape: int, place: int) -> list[_Arc]:
    """The arcs in a line: runs of corners on one circle, as large as doors are."""
    if len(line) < 4:
        return []
    step = np.diff(line, axis=0)
    across = line[2:] - line[:-2]
    length = np.hypot(*step.T)
    turn = step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # a circle through three points
        curve = 2.0 * turn / (length[:-1] * length[1:] * np.hypot(*across.T))
        radius = 1.0 / np.abs(curve)
    round_ = np.isfinite(radius) & (radius > LEAF[0]) & (radius < LEAF[1])
    found = []
    at = 0
    while at < len(round_):
        stop = at
        while (
            stop < len(round_)
            and round_[stop]
            and curve[stop] * curve[at] > 0.0
            and abs(radius[stop] - radius[at]) < 0.05 * radius[at]
        ):
            stop += 1
        if stop - at >= 2:
            first, last = at, stop + 1
            size = float(np.median(radius[at:stop]))
            swing = float(2.0 * np.arcsin(np.minimum(0.5 * length[first:last] / size, 1.0)).sum())
            if SWING[0] <= swing <= SWING[1]:
                found.append(
                    _Arc(shape, place, first, last, _centre(line[first : last + 1]), size, line[[first, last]])
                )
        at = max(stop, at + 1)
    return found


def _centre(corners: Points) -> Points:
    """The centre of the circle through the first, the middle and the last of some corners."""
    a: Points
    b: Points
    c: Points
    a, b, c = corners[0], corners[len(corners) // 2], corners[-1]
    rows = 2.0 * np.array([b - a, c - a])
    sides = np.array([b @ b - a @ a, c @ c - a @ a])
    return np.asarray(np.linalg.solve(rows, sides))


def _segments(shapes: Sequence[Shape]) -> tuple[Points, Points, NDArray[np.int64]]:
    """The straight pieces of all lines as long as leaves: their ends, and shape, line and place of each."""
    starts, stops, owners = [], [], []
    for number, shape in enumerate(shapes):
        for place, line in enumerate(shape.lines or _leaf_boxes(shape)):
            length = np.hypot(*np.diff(line, axis=0).T)
            fits = np.flatnonzero((length > LEAF[0] * (1.0 - SLACK)) & (length < LEAF[1] * (1.0 + SLACK)))
            starts.append(line[fits])
            stops.append(line[fits + 1])
            owners.append(np.column_stack([np.full_like(fits, number), np.full_like(fits, place), fits]))
    if not starts:
        return np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 3), np.int64)
    return np.concatenate(starts), np.concatenate(stops), np.concatenate(owners)


def _leaf_boxes(shape: Shape) -> tuple[Line, ...]:
    """The outlines of a fill as small as a leaf, of a shape without lines."""
    if not 0.0 < shape.fill.area < LEAF[1] * SLACK:
        return ()
    return tuple(shapely.get_coordinates(part.exterior) for part in shape.fill.geoms)


def _leaf(centre: Points, end: Points, starts: Points, stops: Points, slack: float) -> NDArray[np.int64]:
    """The segments that lead from the hinge to an end of the arc, either way round."""

    def near(points: Points, place: Points) -> NDArray[np.bool_]:
        return np.asarray(np.hypot(*(points - place).T) < slack)

    return np.flatnonzero((near(starts, centre) & near(stops, end)) | (near(stops, centre) & near(starts, end)))


def _opening(hinge: Points, end: Points) -> shapely.Polygon:
    """The rectangle across a wall from the hinge of a door to the end of its closed leaf."""
    along = end - hinge
    across = THICK * np.array([-along[1], along[0]]) / math.hypot(*along)
    return shapely.Polygon([hinge - across, end - across, end + across, hinge + across])


def _without(shape: Shape, gone: set[tuple[int, int]]) -> Shape:
    """A shape without the pen on some pieces of its lines."""
    lines = []
    for place, line in enumerate(shape.lines):
        dropped = sorted(at for number, at in gone if number == place)
        edges = [-1, *dropped, len(line) - 1]
        pieces = [line[before + 1 : after + 1] for before, after in pairwise(edges)]
        lines += [piece for piece in pieces if len(piece) > 1]
    width = shape.pen / 2.0
    stroke = polygons(shapely.union_all([shapely.LineString(line).buffer(width, cap_style="flat") for line in lines]))
    kept = bool(lines) and not (len(gone) >= 2 and shape.fill.area < 0.5 * LEAF[1] * CAVITY)
    return replace(shape, stroke=stroke, lines=tuple(lines), fill=shape.fill if kept else NOTHING)


def make_doors(walls: MultiPolygon, width: float, painted: MultiPolygon = NOTHING) -> MadeDoors:
    """One opening for each closed room, `width` (m) wide if the wall has room for it.

    Rooms are reached from the largest one on. A closed room separated from a reached one by a wall of at most `THICK`
    gets a door in the longest straight stretch of that wall, into the reached room with the most neighbours. Insides of
    walls are not rooms, nor is furniture: small closed pieces that stand free in another. No door leads outwards; rooms
    may be open to the outside if they are mostly `painted` as floor.
    """
    page = shapely.box(*walls.bounds)
    pieces = shapely.get_parts(polygons(shapely.difference(page, walls)))
    outer = shapely.intersects(pieces, page.exterior)
    outer &= shapely.area(shapely.intersection(pieces, painted)) < 0.5 * shapely.area(pieces)
    cavity = ~outer & _is_cavity(pieces)
    free = np.array(
        [not out and stands_free(piece, pieces[~cavity]) for piece, out in zip(pieces, outer, strict=True)], np.bool_
    )
    rooms: list[shapely.Polygon] = list(pieces[~outer & ~cavity & ~free])
    if len(rooms) < 2:
        return MadeDoors((), MultiPolygon())
    closed_to = shapely.union_all(pieces[outer | (free & ~cavity)])
    shapely.prepare(closed_to)
    tree = shapely.STRtree(rooms)
    pairs: list[tuple[int, int]] = tree.query(rooms, predicate="dwithin", distance=THICK).T.tolist()
    neighbours: defaultdict[int, set[int]] = defaultdict(set)
    for i, j in pairs:
        if i != j:
            neighbours[i].add(j)
    reached = {max(range(len(rooms)), key=lambda room: rooms[room].area)}
    doors: list[shapely.Polygon] = []
    tried: set[tuple[int, int]] = set()
    while True:
        choices = [
            (len(neighbours[into]), rooms[into].area, room, into)
            for into in reached
            for room in neighbours[into] - reached
            if (room, into) not in tried
        ]
        if not choices:
            return MadeDoors(tuple(doors), shapely.union_all(doors))
        _, _, room, into = max(choices)
        tried.add((room, into))
        others = [one for number, one in enumerate(rooms) if number not in (room, into)]
        door = _door(rooms[room], rooms[into], width, closed_to, others)
        if door is not None:
            doors.append(door)
            reached.add(room)


def opened(walls: MultiPolygon, cuts: BaseGeometry) -> MultiPolygon:
    """The walls with openings cut into them; beside an opening, the insides of crossed walls are solid."""
    if cuts.is_empty or walls.is_empty:
        return walls
    pieces = shapely.get_parts(polygons(shapely.difference(shapely.box(*walls.bounds), walls)))
    crossed = shapely.area(shapely.intersection(pieces, cuts)) > _CRUMB
    insides = pieces[_is_cavity(pieces) & crossed & ~shapely.intersects(pieces, shapely.box(*walls.bounds).exterior)]
    return polygons(shapely.difference(joined([walls, MultiPolygon(list(insides))]), cuts))


def _is_cavity(pieces: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Which pieces of free space are too narrow for rooms."""
    return np.asarray(2.0 * shapely.area(pieces) < CAVITY * shapely.length(pieces))


def stands_free(piece: shapely.Polygon, pieces: NDArray[np.object_]) -> bool:
    """Whether a closed piece is furniture: small, and alone in a hole of another piece."""
    if piece.area > FURNITURE:
        return False
    inside = piece.representative_point()
    around: shapely.Polygon
    for around in pieces:
        if around is piece or not around.interiors or not shapely.box(*around.bounds).contains(inside):
            continue
        for ring in around.interiors:
            hole = shapely.Polygon(ring)
            if hole.area < 1.6 * piece.area + 1.0 and hole.contains(inside):
                return True
    return False


def _door(
    room: shapely.Polygon,
    into: shapely.Polygon,
    width: float,
    closed_to: BaseGeometry,
    others: list[shapely.Polygon],
) -> shapely.Polygon | None:
    """An opening in the longest straight stretch of wall between two rooms, if there is a place for it."""
    ring = shapely.simplify(room, 0.01).exterior
    outline = np.asarray(ring.coords)
    stretches: list[tuple[float, Points, Points, Points]] = []
    start: Points
    stop: Points
    for start, stop in pairwise(outline):
        length = math.dist(start, stop)
        if length < STRETCH:
            continue
        along: Points = (stop - start) / length
        away = np.array([along[1], -along[0]]) * (1.0 if ring.is_ccw else -1.0)
        strip = shapely.Polygon([start, stop, stop + THICK * away, start + THICK * away])
        for part in polygons(strip.intersection(into)).geoms:
            reach = (shapely.get_coordinates(part) - start) @ along
            stretches.append((float(np.ptp(reach)), start + along * reach.min(), along, away))
    for length, start, along, away in sorted(stretches, key=lambda one: -one[0]):
        if length < STRETCH:
            break
        wide = min(width, 0.8 * length)
        for share in (0.5, 0.3, 0.7, 0.15, 0.85):
            middle: Points = start + along * min(max(share * length, wide / 2.0), length - wide / 2.0)
            sides: list[Points] = [middle - along * wide / 2.0, middle + along * wide / 2.0]
            ways = [shapely.LineString([side, side + THICK * away]).intersection(into) for side in sides]
            if any(way.is_empty for way in ways):
                continue
            deep = max(shapely.Point(side).distance(way) for side, way in zip(sides, ways, strict=True))
            inside, beyond = -_INTO * away, (deep + _INTO) * away
            door = shapely.Polygon([sides[0] + inside, sides[1] + inside, sides[1] + beyond, sides[0] + beyond])
            if not closed_to.intersects(door) and not any(door.intersects(other) for other in others):
                return door
    return None
