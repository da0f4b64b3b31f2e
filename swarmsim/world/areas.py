"""What the paint of a shape covers: a fill its area, a stroke its width along the outline."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, affinity
from svgelements import Matrix

from swarmsim.world.elements import Element, ElementError, quoted
from swarmsim.world.outlines import FLATNESS, Outlines, Points, chord_angle, outlines
from swarmsim.world.styles import Style
from swarmsim.world.viewport import LARGEST, Page

_GRID = 1e-9  # m, coordinates are rounded to it, which welds walls that abut
_BOUNDLESS = 1e12  # user units, beyond which geometry fails before the scale applies
_REFUSED = ("clip-path", "mask", "stroke-dasharray", "vector-effect")  # they change what is solid
_CAPS = {"butt": "flat", "round": "round", "square": "square"}
_JOINS = {"miter": "mitre", "round": "round", "bevel": "bevel"}


def covered(element: Element, style: Style, matrix: Matrix, page: Page) -> MultiPolygon:
    """What a shape covers, in metres, where `matrix` leads from its user units; opacity does not matter."""
    for key in _REFUSED:
        if style[key] != "none":
            raise ElementError(f"{key} is {quoted(style[key])}, which is not understood here; remove it")
    if style["fill"] == style["stroke"] == "none":
        raise ElementError("neither fill nor stroke; a solid thing needs one of them, or move it out of the layer")
    try:
        with np.errstate(all="ignore"):  # overflows are found by looking at the coordinates
            whole = _painted(element, style, matrix, page)
    except shapely.errors.GEOSException as error:
        raise ElementError(f"its geometry cannot be built ({error}); redraw it") from None
    if whole.is_empty:
        raise ElementError("it covers no area; give it an extent, or remove it")
    return whole


def united(geometries: Iterable[shapely.Geometry]) -> MultiPolygon:
    """The union as a MultiPolygon, rounded to the grid."""
    parts = shapely.get_parts(shapely.union_all(list(geometries), grid_size=_GRID))
    return MultiPolygon([part for part in parts if part.geom_type == "Polygon" and part.area > 0.0])


def _painted(element: Element, style: Style, matrix: Matrix, page: Page) -> MultiPolygon:
    """What fill and stroke cover together, in metres."""
    linear, shift = np.array([[matrix.a, matrix.c], [matrix.b, matrix.d]]), np.array([matrix.e, matrix.f])
    stretch, squeeze = np.linalg.svd(linear, compute_uv=False)
    if squeeze <= 1e-9 * max(stretch, 1e-9):
        raise ElementError("its transforms flatten it to a line; no scale in them should be 0")
    lines = outlines(element, page, FLATNESS / stretch)
    for points, _ in lines:
        metres = points @ linear.T + shift
        if not (np.isfinite(metres).all() and np.abs(metres).max() <= LARGEST and np.abs(points).max() < _BOUNDLESS):
            raise ElementError(f"a point lies farther than {LARGEST:g} m from the page; is the scale right?")
    parts = []
    if style["fill"] != "none":
        if element.tag == "line":
            raise ElementError("a line encloses no area; set fill='none' and a stroke, or draw an area")
        parts.append(_filled(lines, style["fill-rule"] == "evenodd", 1e-6 / stretch))
    if style["stroke"] != "none":
        parts.append(_stroked(lines, style, page, FLATNESS / stretch))
    coefficients = [*linear.ravel(), *shift]
    return united([affinity.affine_transform(shapely.union_all(parts), coefficients)])


def _filled(outlines: Outlines, even_odd: bool, gap: float) -> shapely.Geometry:
    """What the outlines enclose by the fill rule; `gap` is how far apart the ends of a closed one may lie."""
    rings = []
    for points, closed in outlines:
        if not closed and np.linalg.norm(points[0] - points[-1]) > gap:
            raise ElementError("its outline is open; close it (Z), or set fill='none' if only its stroke is solid")
        ring = points[np.append(True, np.any(np.diff(points, axis=0), axis=1))]
        if len(ring) >= 3:
            rings.append(np.vstack([ring, ring[:1]]))
    if len(rings) == 1:
        polygon = shapely.Polygon(rings[0])
        if polygon.is_valid:
            return polygon
    # Cut the plane along all rings at once, and ask each piece how often the rings wind around it.
    cuts = shapely.union_all([shapely.LineString(ring) for ring in rings])
    pieces = shapely.get_parts(shapely.polygonize(shapely.get_parts(cuts)))
    inside = shapely.get_coordinates(shapely.point_on_surface(pieces))
    windings = sum((_windings(ring, inside) for ring in rings), np.zeros(len(inside), dtype=np.int64))
    return shapely.union_all(pieces[windings % 2 == 1 if even_odd else windings != 0])


def _windings(ring: Points, points: Points) -> NDArray[np.int64]:
    """How often a closed ring (m + 1, 2) winds around each of the points (n, 2)."""
    start, step = ring[:-1], np.diff(ring, axis=0)
    above = ring[:, 1] > points[:, 1, None]  # (n, m + 1)
    crossing = above[:, 1:].astype(np.int64) - above[:, :-1]
    offset = points[:, None] - start
    side = step[:, 0] * offset[..., 1] - step[:, 1] * offset[..., 0]
    windings: NDArray[np.int64] = np.where(side * crossing > 0.0, crossing, 0).sum(axis=1)
    return windings


def _stroked(outlines: Outlines, style: Style, page: Page, flatness: float) -> shapely.Geometry:
    """What a pen of the stroke's width covers; a mitre beyond its limit is cut at the limit, not bevelled."""
    width = page.units(style["stroke-width"], "stroke-width")
    if not 0.0 < width < _BOUNDLESS:
        raise ElementError(f"stroke-width is {style['stroke-width']!r}; it should be larger than 0")
    limit = page.units(style["stroke-miterlimit"], "stroke-miterlimit")
    try:
        cap, join = _CAPS[style["stroke-linecap"]], _JOINS[style["stroke-linejoin"]]
    except KeyError as key:
        raise ElementError(f"{key} is no stroke-linecap or -linejoin; use {', '.join({**_CAPS, **_JOINS})}") from None
    quarter = math.ceil(math.pi / 2.0 / chord_angle(width / 2.0, flatness))
    lines = []
    for points, closed in outlines:
        ring = closed and len(np.unique(points, axis=0)) >= 3
        lines.append(shapely.LinearRing(points) if ring else shapely.LineString(points))
    pen = {"cap_style": cap, "join_style": join, "mitre_limit": max(limit, 1.0), "quad_segs": min(quarter, 10_000)}
    return shapely.union_all(shapely.buffer(lines, width / 2.0, **pen))
