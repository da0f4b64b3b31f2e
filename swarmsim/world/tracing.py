"""Polygons from bitmaps, without gaps, and without stairs if pixels are finer than cells."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon


def traced(mask: NDArray[np.bool_], tolerance: float = 0.0) -> MultiPolygon:
    """The polygons that cover the true pixels (rows, columns) of `mask`, in pixels from its lower left corner.

    Row 0 lies at the bottom. Without a tolerance they cover exactly these pixels; with one, in pixels, stairs become
    straight lines that stray no farther than that (Douglas and Peucker 1973, keeping the topology): pixels that touch,
    if only by a corner, still do, so that no gap opens.
    """
    edges = _edges(mask)
    if not len(edges):
        return MultiPolygon()
    arcs = shapely.line_merge(shapely.multilinestrings(edges), directed=True)
    if tolerance > 0.0:
        arcs = shapely.simplify(arcs, tolerance, preserve_topology=True)
    lines = shapely.get_parts(arcs)
    faces = shapely.normalize(shapely.get_parts(shapely.polygonize(lines)))  # outer rings run clockwise
    return MultiPolygon(list(faces[_solid(faces, lines)]))


def _edges(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The straight edges (e, 2, 2) between true and false pixels, each with the true ones on its left."""
    padded = np.pad(mask, 1).astype(np.int8)
    found = []
    for transposed in (False, True):
        grid = padded.T if transposed else padded
        step = np.diff(grid, axis=0)  # at (r, c): how pixel row r + 1 differs from row r, both padded
        # Runs of equal steps along a line are one edge; a line's end is always a column of zeros.
        change = np.diff(np.pad(step, ((0, 0), (1, 1))), axis=1)
        rows, columns = np.nonzero(change)
        values = np.pad(step, ((0, 0), (0, 1)))[rows, columns]
        ends = np.flatnonzero(values != 0)
        line, begin, end, value = rows[ends], columns[ends], columns[ends + 1], values[ends]
        # A run ends where the next one begins, or with zeros, which `nonzero` lists in the same row.
        start = np.where(value > 0, begin, end) if not transposed else np.where(value > 0, end, begin)
        stop = np.where(value > 0, end, begin) if not transposed else np.where(value > 0, begin, end)
        pair = np.stack([np.stack([start, line + 1], 1), np.stack([stop, line + 1], 1)], 1)
        found.append(pair[..., ::-1] if transposed else pair)
    return np.concatenate(found).astype(np.float64) - 1.0


def _solid(faces: NDArray[np.object_], lines: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Which faces lie on the left of the directed lines around them; their outer rings run clockwise."""
    corners, owner = shapely.get_coordinates(lines, return_index=True)
    inner: NDArray[np.bool_] = owner[:-1] == owner[1:]
    left = set(map(bytes, np.ascontiguousarray(np.hstack([corners[:-1], corners[1:]])[inner])))
    solid = []
    for face in faces:
        first, second = np.asarray(face.exterior.coords)[:2]
        solid.append(np.concatenate([second, first]).tobytes() in left)
    return np.array(solid, np.bool_)
