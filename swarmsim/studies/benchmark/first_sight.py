"""How far robots must drive at least before a cell comes into view.

Ways are bounded by a function of places whose slope is nowhere above 1, which is checked triangle by triangle: neither
the lattice nor the search behind it is trusted.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from swarmsim.studies.benchmark.places import Places

TIGHT: Final = 1.0 + 1e-9  # a slope, with allowance for rounding
#: Steps of a search between the corners of places, one of each pair of opposite ones: rows and columns, and the places
#: that it crosses, as rows and columns from the corner. A step along an edge crosses either of two.
STEPS: Final = (
    ((0, 1), ((0, 0), (-1, 0))), ((1, 0), ((0, 0), (0, -1))), ((1, 1), ((0, 0),)), ((1, -1), ((0, -1),)),
    ((1, 2), ((0, 0), (0, 1))), ((2, 1), ((0, 0), (1, 0))), ((1, -2), ((0, -1), (0, -2))),
    ((2, -1), ((0, -1), (1, -1))),
)  # fmt: skip
#: The largest slope of the length of ways of such steps: between straight and knight's moves.
SLOPE: Final = math.hypot(1.0, math.sqrt(5.0) - 2.0)
#: Halves of a place by its corners, those of either diagonal; the right angle is at the one in the middle.
TRIANGLES: Final = ((0, 1, 3), (0, 2, 3), (1, 0, 2), (1, 3, 2))
ROUNDS: Final = 1000  # of mending slopes


def distances(places: Places) -> NDArray[np.float64]:
    """A lower bound of the way in cells (2 rows, 2 columns) from the nearest start to any point of each place.

    It is the least corner value of a function that is linear on both triangles of every possible place, has nowhere a
    slope above 1, and is at most 0 at every start. Such a function grows along no way by more than its length.
    """
    corners = _ways(places) / SLOPE
    for _ in range(ROUNDS):  # the slope is too large where ways of different steps meet
        before = corners.copy()
        old = _corners(before)
        slopes = np.stack([2.0 * np.hypot(old[m] - old[i], old[k] - old[m]) for i, m, k in TRIANGLES])
        turned = slopes[2:].max(axis=0) < slopes[:2].max(axis=0)  # the diagonal that makes the slopes smaller
        slopes *= places.possible & np.stack([~turned, ~turned, turned, turned])
        if slopes.max() <= TIGHT:
            break
        for triangle, slope in zip(TRIANGLES, slopes, strict=True):
            steep = slope > TIGHT
            three = np.stack([old[corner][steep] for corner in triangle])
            least = three.min(axis=0)
            for corner, value in zip(triangle, least + (three - least) / slope[steep], strict=True):
                now = _corners(corners)[corner]
                now[steep] = np.minimum(now[steep], value)
    else:
        corners = before / slopes.max()
    a, b, c, d = _corners(corners)
    rows, columns = np.floor(places.starts).astype(int).T
    least = np.minimum(np.minimum(a, b), np.minimum(c, d))
    most = np.maximum(np.maximum(a, b), np.maximum(c, d))
    return np.where(places.possible, least - most[rows, columns].max(), np.inf)


def _corners(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Views of the values at the four corners of each place: lower left, lower right, upper left, upper right."""
    return values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]


def _ways(places: Places) -> NDArray[np.float64]:
    """The length in cells (2 rows + 1, 2 columns + 1) of ways of STEPS from the starts to corners of places."""
    rows, columns = np.array(places.possible.shape) + 1
    possible = np.pad(places.possible, 2)
    nodes = np.arange(rows * columns).reshape(rows, columns)
    ends = []
    for (down, across), crossed in STEPS:
        fine = [possible[2 + r : 2 + r + rows, 2 + c : 2 + c + columns] for r, c in crossed]
        open_ = fine[0] | fine[1] if down * across == 0 else np.logical_and.reduce(fine)
        first = nodes[open_]
        ends.append(
            np.stack([first, first + down * columns + across, np.full(len(first), 0.5 * math.hypot(down, across))])
        )
    for row, column in places.starts.tolist():
        near = [(int(row) + r, int(column) + c) for r in (0, 1) for c in (0, 1)]
        ends.append(
            np.array([(rows * columns, r * columns + c, 0.5 * math.hypot(r - row, c - column)) for r, c in near]).T
        )
    first, second, length = np.hstack(ends)
    count = rows * columns + 1
    graph = sparse.csr_array((length, (first.astype(int), second.astype(int))), shape=(count, count))
    found = csgraph.dijkstra(graph, directed=False, indices=count - 1)[:-1].reshape(rows, columns)
    return np.asarray(np.where(np.isfinite(found), found, 0.0))


def first_sights(places: Places, ways: NDArray[np.float64], margin: int) -> NDArray[np.float64]:
    """A lower bound of the way in cells (m,) from the nearest start to where each cell of the domain comes into view.

    `ways` are `distances`. With a `margin` of 0, that is: into the tile; with 1, into the rectangle half a cell larger.
    """
    skip = 2 - 2 * margin
    inner = places.sides[:, skip : places.sides.shape[1] - skip, skip : places.sides.shape[2] - skip]
    around = np.lib.stride_tricks.sliding_window_view(ways, inner.shape[1:])
    nearest = np.where(inner, around[tuple((places.corners + skip).T)], np.inf).min(axis=(1, 2))
    return np.asarray(np.maximum(nearest, 0.0))
