"""Horizontal sections of solids made of triangles."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from swarmsim.world.areas import polygons

SHEET: Final = 0.02  # m, thickness given to a surface without a volume
_DIGITS: Final = 6  # of a section's corners, in m


def section(corners: NDArray[np.float64], triangles: NDArray[np.int64], height: float) -> MultiPolygon:
    """The section, at a height, of solids with these corners (n, 3) and triangles (m, 3), all in m.

    Solids that share no corner are united. Surfaces that enclose nothing count as sheets.
    """
    above = corners[:, 2] > height  # a corner at this height counts as below: each triangle is cut or is not
    share = above[triangles].sum(axis=1)
    cut: NDArray[np.float64] = triangles[(share == 1) | (share == 2)]
    if not len(cut):
        return MultiPolygon()
    edges = np.sort(cut[:, [[0, 1], [1, 2], [2, 0]]], axis=2)  # sorted, so that neighbours cut theirs at the same point
    crossing = above[edges[:, :, 0]] != above[edges[:, :, 1]]
    low, high = corners[edges[crossing][:, 0]], corners[edges[crossing][:, 1]]
    part = (height - low[:, 2]) / (high[:, 2] - low[:, 2])
    points = np.round(low[:, :2] + part[:, None] * (high - low)[:, :2], _DIGITS).reshape(-1, 2, 2)
    lines = np.asarray(shapely.linestrings(points))
    body = _bodies(triangles, len(corners))[cut[:, 0]]
    real = shapely.length(lines) > 0.0
    lines, body = lines[real], body[real]
    found = [_enclosed(lines[body == one]) for one in np.unique(body)]
    return polygons(shapely.union_all(found))


def _bodies(triangles: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The number of the body that each of `count` corners belongs to."""
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    links = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    numbers: NDArray[np.int64] = connected_components(links, directed=False)[1].astype(np.int64)
    return numbers


def _enclosed(lines: NDArray[np.object_]) -> BaseGeometry:
    """The section of one body, where a ring within another is a hole, and its loose lines as sheets."""
    faces, cuts, dangles, _ = shapely.polygonize_full([shapely.union_all(lines)])
    area: BaseGeometry = MultiPolygon()
    outer = [shapely.Polygon(face.exterior) for face in shapely.get_parts(faces)]
    for ring in sorted(outer, key=lambda ring: -ring.area):
        area = shapely.symmetric_difference(area, ring)
    loose = [line for part in (cuts, dangles) for line in shapely.get_parts(part)]
    return shapely.union_all([area, *shapely.buffer(loose, SHEET / 2.0, cap_style="flat")])
