"""The boundary of walls: their directed edges, and the share of each cell that they enclose."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from swarmsim.core.lattice import Lattice


def boundary(walls: BaseGeometry) -> NDArray[np.float64]:
    """The edges (s, 4) of all rings, with the solid side on the left."""
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(walls)))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    edges = np.hstack([corners[:-1], corners[1:]])[ring[:-1] == ring[1:]]
    kept: NDArray[np.float64] = edges[np.any(edges[:, :2] != edges[:, 2:], axis=1)]
    return kept


def shares(segments: NDArray[np.float64], lattice: Lattice) -> NDArray[np.float64]:
    """The share (rows, columns) of each cell that lies to the left of the closed boundary `segments`.

    Green's theorem, cell by cell, as font rasterisers use it: an edge that climbs by dy in a cell takes dy times its
    distance from the right side of the cell, and dy of full width from every cell further right.
    """
    start = (segments[:, :2] - (lattice.x0, lattice.y0)) / lattice.cell
    step = (segments[:, 2:] - segments[:, :2]) / lattice.cell
    # Cut every edge where it crosses a line of the lattice, so that each piece lies in one cell.
    owners, times = [np.arange(len(start)).repeat(2)], [np.tile([0.0, 1.0], len(start))]
    for axis in (0, 1):
        ends = np.sort(np.stack([start[:, axis], start[:, axis] + step[:, axis]]), axis=0)
        first = np.floor(ends[0]).astype(np.int64) + 1
        counts = np.maximum(np.ceil(ends[1]).astype(np.int64) - first, 0)
        owner = np.arange(len(start)).repeat(counts)
        line = np.arange(counts.sum()) - (counts.cumsum() - counts).repeat(counts) + first[owner]
        owners.append(owner)
        times.append((line - start[owner, axis]) / step[owner, axis])
    owner, time = np.concatenate(owners), np.clip(np.concatenate(times), 0.0, 1.0)
    order = np.lexsort((time, owner))
    owner, time = owner[order], time[order]
    whole: NDArray[np.bool_] = owner[:-1] == owner[1:]
    owner, begin, end = owner[:-1][whole], time[:-1][whole], time[1:][whole]
    middle = start[owner] + step[owner] * (0.5 * (begin + end))[:, None]
    climb = step[owner, 1] * (end - begin)
    cells = np.floor(middle).astype(np.int64)
    column, row = cells[:, 0], cells[:, 1]
    share = np.zeros(lattice.shape)
    beyond = np.zeros(lattice.shape)
    np.add.at(share, (row, column), -climb * (column + 1.0 - middle[:, 0]))
    np.add.at(beyond, (row, column), -climb)
    covered: NDArray[np.float64] = share + beyond.cumsum(axis=1) - beyond
    return covered
