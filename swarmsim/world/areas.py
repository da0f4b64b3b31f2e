"""The area that a shape's paint covers: a fill its inside, a stroke its width along the outline."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, affinity
from shapely.geometry.base import BaseGeometry
from svgelements import Matrix

from swarmsim.world.elements import Element, ElementError
from swarmsim.world.outlines import FLATNESS, Outlines, Points, chord_angle, outlines
from swarmsim.world.styles import Style
from swarmsim.world.viewport import LARGEST, Page

_GRID = 1e-9  # m, coordinates are rounded to it, which welds walls that abut
_BOUNDLESS = 1e12  # user units, beyond which geometry fails before the scale applies
_MANY = 1000  # shapes; beyond it, only those that touch are united
_CAPS: Final[dict[str, Literal["flat", "round", "square"]]] = {"butt": "flat", "round": "round", "square": "square"}
_JOINS: Final[dict[str, Literal["mitre", "round", "bevel"]]] = {
    "miter": "mitre",
    "miter-clip": "mitre",
    "arcs": "mitre",
    "round": "round",
    "bevel": "bevel",
}
_UNSCALED = "non-scaling-stroke"
_FEW = 20_000  # corners of an outline; up to it, any number of crossings is accepted
_MOST_CROSSINGS = 2_000_000
_MOST_STEPS = 2_000_000_000  # pieces that an outline cuts itself into, times its corners


class OutOfReachError(ElementError):
    """A shape has a point too far from the page."""

    def __init__(self, low: Points, high: Points) -> None:
        super().__init__(f"a point lies farther than {LARGEST:g} m from the page; is the scale right?")
        self._low, self._high = low, high  # its extent, m

    def off(self, size: tuple[float, float]) -> bool:
        """Whether all of the shape lies off a page of this width and height (m)."""
        return bool((self._high < 0.0).any() or (self._low > size).any())


def covered(
    element: Element, style: Style, matrix: Matrix, page: Page, paints: tuple[bool, bool]
) -> tuple[MultiPolygon, MultiPolygon, Outlines, float]:
    """The areas of a shape's fill and stroke, in metres, for those in `paints`; `matrix` leads from user units.

    A fill closes open outlines, as in SVG; shapes without extent cover nothing. Dashes count as whole lines. Also gives
    the outlines and the pen's width, in m.
    """
    try:
        with np.errstate(all="ignore"):  # the coordinates are checked for overflows
            return _painted(element, style, matrix, page, paints)
    except shapely.errors.GEOSException as error:
        raise ElementError(f"its geometry cannot be built ({error}); redraw it") from None


def united(geometries: Iterable[BaseGeometry]) -> MultiPolygon:
    """The union as a MultiPolygon, rounded to the grid."""
    shapes = np.array(list(geometries), dtype=object)
    if len(shapes) < _MANY:
        return polygons(shapely.union_all(shapes, grid_size=_GRID))
    # Most of many shapes touch no other: they need no union, which takes much longer than this check.
    piece = connected(shapes)
    order = np.argsort(piece, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(piece[order])) + 1)
    alone = np.array([group[0] for group in groups if len(group) == 1], np.int64)
    parts = list(shapely.set_precision(shapes[alone], _GRID))
    parts += [shapely.union_all(shapes[group], grid_size=_GRID) for group in groups if len(group) > 1]
    return MultiPolygon([part for shape in parts for part in polygons(shape).geoms])


def connected(shapes: NDArray[np.object_]) -> NDArray[np.int32]:
    """The number (n,) of the connected piece that each of some shapes (n,) belongs to."""
    from scipy import sparse  # slow to import, and only some drawings need it

    one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    links = sparse.coo_array((np.ones(len(one), np.bool_), (one, other)), shape=(len(shapes), len(shapes)))
    return np.asarray(sparse.csgraph.connected_components(links, directed=False)[1])


def joined(shapes: Iterable[MultiPolygon]) -> MultiPolygon:
    """The union of valid shapes; a single one stays unchanged."""
    solid = [shape for shape in shapes if not shape.is_empty]
    return solid[0] if len(solid) == 1 else united(solid) if solid else MultiPolygon()


def polygons(geometry: BaseGeometry) -> MultiPolygon:
    """The polygons in a geometry, without points and lines."""
    if isinstance(geometry, shapely.Polygon):
        return MultiPolygon([geometry] if geometry.area > 0.0 else [])
    parts = shapely.get_parts(geometry)
    while any(part.geom_type == "GeometryCollection" for part in parts):
        parts = shapely.get_parts(parts)
    flat = shapely.get_parts(parts)
    return MultiPolygon([part for part in flat if part.geom_type == "Polygon" and part.area > 0.0])


def lines_of(outlines: Outlines) -> tuple[Points, ...]:
    """The outlines as lines; closed ones end where they begin."""
    return tuple(
        np.vstack([points, points[:1]]) if closed and (points[0] != points[-1]).any() else points
        for points, closed in outlines
    )


def _painted(
    element: Element, style: Style, matrix: Matrix, page: Page, paints: tuple[bool, bool]
) -> tuple[MultiPolygon, MultiPolygon, Outlines, float]:
    numbers: tuple[float, float, float, float, float, float]
    numbers = matrix.a, matrix.b, matrix.c, matrix.d, matrix.e, matrix.f
    a, b, c, d, e, f = numbers
    stretch, squeeze = _stretched(a, b, c, d)
    lines = outlines(element, page, FLATNESS / max(stretch, 1e-12))
    if squeeze <= 1e-9 * max(stretch, 1e-9):
        return MultiPolygon(), MultiPolygon(), [], 0.0  # flattened to a line
    placed: Outlines = []
    for points, closed in lines:
        x, y = points[:, 0], points[:, 1]
        placed.append((np.column_stack([a * x + c * y + e, b * x + d * y + f]), closed))
    if not placed:
        return MultiPolygon(), MultiPolygon(), [], 0.0
    corners = placed[0][0] if len(placed) == 1 else np.concatenate([points for points, _ in placed])
    if not np.isfinite(corners).all():
        raise ElementError(f"a point lies farther than {LARGEST:g} m from the page; is the scale right?")
    if np.abs(corners).max() > LARGEST or any(np.abs(points).max() >= _BOUNDLESS for points, _ in lines):
        raise OutOfReachError(corners.min(axis=0), corners.max(axis=0))
    coefficients = [a, c, b, d, e, f]
    fill = stroke = MultiPolygon()
    pen = 0.0
    if paints[0] and element.tag != "line":
        simply = _simply_filled(lines, placed)
        if simply is None:
            filled = _filled(lines, style["fill-rule"] == "evenodd")
            simply = polygons(affinity.affine_transform(filled, coefficients))
        fill = simply
    if paints[1]:
        unscaled = style["vector-effect"] == _UNSCALED
        width = _pen(style, page)
        pen = width * (page.pen if unscaled else math.sqrt(stretch * squeeze))
        if unscaled:
            stroke = polygons(_stroked(placed, style, page, FLATNESS, pen))
        else:
            stroked = _stroked(lines, style, page, FLATNESS / stretch, width)
            stroke = polygons(affinity.affine_transform(stroked, coefficients))
    return fill, stroke, placed, pen


@lru_cache(maxsize=1024)
def _stretched(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """The largest and the least stretch of a matrix."""
    stretch, squeeze = np.linalg.svd(np.array([[a, c], [b, d]]), compute_uv=False)
    return float(stretch), float(squeeze)


def _simply_filled(lines: Outlines, placed: Outlines) -> MultiPolygon | None:
    """The inside of a single outline that does not cross itself; None for any other."""
    if len(lines) != 1:
        return None
    points, corners = lines[0][0], placed[0][0]
    moves: NDArray[np.bool_] = (points[1:] != points[:-1]).any(axis=1)
    if not moves.all():
        corners = corners[np.append(True, moves)]
    if len(corners) < 3:
        return MultiPolygon()
    polygon = shapely.Polygon(corners)
    return polygons(polygon) if polygon.is_valid else None


def _filled(outlines: Outlines, even_odd: bool) -> BaseGeometry:
    """The inside of the outlines by the fill rule."""
    rings = []
    for points, _ in outlines:
        ring = points[np.append(True, np.any(np.diff(points, axis=0), axis=1))]
        if len(ring) >= 3:
            rings.append(np.vstack([ring, ring[:1]]))
    _check_crossings(rings)
    # Cut the plane along all rings at once, and count the rings' windings around each piece.
    cuts = shapely.union_all([shapely.LineString(ring) for ring in rings])
    pieces = shapely.get_parts(shapely.polygonize(shapely.get_parts(cuts)))
    if len(pieces) * sum(map(len, rings)) > _MOST_STEPS:
        raise ElementError(
            f"its outline of {sum(map(len, rings))} corners cuts itself into {len(pieces)} pieces; simplify it"
        )
    inside = shapely.get_coordinates(shapely.point_on_surface(pieces))
    windings = sum((_windings(ring, inside) for ring in rings), np.zeros(len(inside), dtype=np.int64))
    return shapely.union_all(pieces[windings % 2 == 1 if even_odd else windings != 0])


def _check_crossings(rings: list[Points]) -> None:
    """Raise ElementError for outlines that cross themselves very often, by a sample of their segments."""
    ends = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]) if rings else np.empty((0, 2, 2))
    if len(ends) <= _FEW:
        return
    segments: NDArray[np.object_] = np.asarray(shapely.linestrings(ends))
    sample = segments[:: len(segments) // 1000]
    met = len(shapely.STRtree(segments).query(sample, predicate="intersects")[0])
    crossings = 0.5 * (met / len(sample) - 3.0) * len(segments)  # each meets itself and those before and after it
    if crossings > _MOST_CROSSINGS:
        raise ElementError(
            f"its outline of {len(segments)} corners crosses itself about {crossings:.1g} times, more than "
            f"{_MOST_CROSSINGS}; simplify it"
        )


def _windings(ring: Points, points: Points) -> NDArray[np.int64]:
    """How often a closed ring (m + 1, 2) winds around each of the points (n, 2)."""
    start, step = ring[:-1], np.diff(ring, axis=0)
    windings = np.empty(len(points), np.int64)
    point: Points
    for i, point in enumerate(points):
        above: NDArray[np.bool_] = ring[:, 1] > point[1]
        crossing = above[1:].astype(np.int64) - above[:-1]
        offset = point - start
        side = step[:, 0] * offset[:, 1] - step[:, 1] * offset[:, 0]
        windings[i] = crossing[side * crossing > 0.0].sum()
    return windings


def _pen(style: Style, page: Page) -> float:
    """The width of a stroke in user units."""
    width = page.units(style["stroke-width"], "stroke-width")
    if width < 0.0 or width >= _BOUNDLESS:
        raise ElementError(f"stroke-width is {style['stroke-width']!r}; it should be 0 or larger")
    return width


def _stroked(outlines: Outlines, style: Style, page: Page, flatness: float, width: float) -> BaseGeometry:
    """The area under a pen of this width; a mitre beyond its limit is cut there."""
    limit = page.units(style["stroke-miterlimit"], "stroke-miterlimit")
    try:
        cap, join = _CAPS[style["stroke-linecap"]], _JOINS[style["stroke-linejoin"]]
    except KeyError as key:
        raise ElementError(f"{key} is no stroke-linecap or -linejoin; use {', '.join({**_CAPS, **_JOINS})}") from None
    if width == 0.0:
        return MultiPolygon()
    quarter = math.ceil(math.pi / 2.0 / chord_angle(width / 2.0, flatness))
    parts = []
    for points, closed in outlines:
        ring = closed and len(np.unique(points, axis=0)) >= 3
        line = shapely.LinearRing(points) if ring else shapely.LineString(points)
        if line.length == 0.0 and cap == "flat":
            continue
        around = shapely.buffer(
            line,
            width / 2.0,
            quad_segs=min(quarter, 10_000),
            cap_style=cap,
            join_style=join,
            mitre_limit=max(limit, 1.0),
        )
        parts.append(around)
    return shapely.union_all(parts)
