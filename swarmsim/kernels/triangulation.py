"""Angles and lunes of the edges of a triangulation.

All functions that call each other live in this file: numba's cache does not notice edits elsewhere.
"""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit


@njit(cache=True)
def opposite_angles(points, corners, beside):
    """The edges of a triangulation, and the angles at which the corners on either side see each.

    `points` (p, 2), `corners` (t, 3) of each triangle, `beside` (t, 3): the triangle opposite each corner, -1 for
    none. Gives edges (e, 2) and angles (e, 2), 0 to pi; where there is no corner the angle is 0.
    """
    edges = np.empty((3 * len(corners), 2), np.int32)
    angles = np.zeros((len(edges), 2))
    count = 0
    for t in range(len(corners)):
        for c in range(3):
            other = beside[t, c]
            if other > t:
                continue  # its turn comes with the other triangle
            a = corners[t, (c + 1) % 3]
            b = corners[t, (c + 2) % 3]
            edges[count, 0] = a
            edges[count, 1] = b
            angles[count, 0] = _angle(points, corners[t, c], a, b)
            if other >= 0:
                far = corners[other].sum() - a - b
                angles[count, 1] = _angle(points, far, a, b)
            count += 1
    return edges[:count], angles[:count]


@njit(cache=True)
def _angle(points, corner, a, b):
    """The angle, 0 to pi, at a corner between points a and b."""
    ax = points[a, 0] - points[corner, 0]
    ay = points[a, 1] - points[corner, 1]
    bx = points[b, 0] - points[corner, 0]
    by = points[b, 1] - points[corner, 1]
    return math.atan2(abs(ax * by - ay * bx), ax * bx + ay * by)


@njit(cache=True)
def with_empty_lunes(points, edges, slack):
    """The edges (e, 2) between `points` (p, 2) with no point nearer to both ends than these are to each other.

    Nearer means by more than the share `slack` of the edge's length.
    """
    if len(edges) == 0:
        return edges
    axis = 1 if np.ptp(points[:, 1]) > np.ptp(points[:, 0]) else 0
    order = np.argsort(points[:, axis])
    x = points[order, axis]
    y = points[order, 1 - axis]
    place_of = np.empty(len(points), np.int64)
    place_of[order] = np.arange(len(points))
    kept = np.empty_like(edges)
    count = 0
    for e in range(len(edges)):
        i = place_of[edges[e, 0]]
        j = place_of[edges[e, 1]]
        nearer = ((x[j] - x[i]) ** 2 + (y[j] - y[i]) ** 2) * (1.0 - slack) ** 2
        empty = True
        for step in (-1, 1):
            other = i + step
            while empty and 0 <= other < len(order):  # outwards until the way along the axis alone is too long
                along = (x[other] - x[i]) ** 2
                if along >= nearer:
                    break
                if along + (y[other] - y[i]) ** 2 < nearer:
                    empty = (x[other] - x[j]) ** 2 + (y[other] - y[j]) ** 2 >= nearer
                other += step
        if empty:
            kept[count] = edges[e]
            count += 1
    return kept[:count]
