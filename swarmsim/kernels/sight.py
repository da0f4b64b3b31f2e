"""Which pairs of robots have no wall between them.

All functions that call each other live in this file: numba's cache does not notice edits elsewhere.
"""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit


@njit(cache=True)
def in_sight(positions, edges, walls, start, members, coarse):
    """The edges (e, 2) between robots at `positions` (n, 2 or more) that no wall crosses or touches.

    `walls` (s, 4): x1, y1, x2, y2 in m. Square i (row-major) of the grid `coarse` = (x0, y0, side, rows, columns)
    is touched only by the walls members[start[i]:start[i + 1]]; no wall is outside of the grid.
    """
    kept = np.empty_like(edges)
    count = 0
    for e in range(len(edges)):
        i, j = edges[e]
        x1, y1, x2, y2 = positions[i, 0], positions[i, 1], positions[j, 0], positions[j, 1]
        if x2 < x1 or (x2 == x1 and y2 < y1):  # the same line whatever the order of the two, down to the last bit
            x1, y1, x2, y2 = x2, y2, x1, y1
        if _sees(x1, y1, x2, y2, walls, start, members, coarse):
            kept[count] = edges[e]
            count += 1
    return kept[:count]


@njit(cache=True)
def _sees(x1, y1, x2, y2, walls, start, members, coarse):
    """Whether the line from (x1, y1) to (x2, y2), x1 <= x2, meets no wall; walks the squares it crosses."""
    x0, y0, side, rows, columns = coarse
    slope = (y2 - y1) / (x2 - x1) if x2 > x1 else 0.0
    last = min(int(math.floor((x2 - x0) / side)), columns - 1)
    for column in range(max(int(math.floor((x1 - x0) / side)), 0), last + 1):
        enter = y1
        leave = y2
        if x2 > x1:
            enter = y1 + slope * (max(x0 + column * side, x1) - x1)
            leave = y1 + slope * (min(x0 + (column + 1) * side, x2) - x1)
        low = max(int(math.floor((min(enter, leave) - y0) / side)), 0)
        high = min(int(math.floor((max(enter, leave) - y0) / side)), rows - 1)
        for row in range(low, high + 1):
            square = row * columns + column
            for m in range(start[square], start[square + 1]):
                if _meet(x1, y1, x2, y2, walls[members[m]]):
                    return False
    return True


@njit(cache=True)
def _meet(x1, y1, x2, y2, wall):
    """Whether the line from (x1, y1) to (x2, y2), x1 <= x2, meets the wall."""
    wx1, wy1, wx2, wy2 = wall[0], wall[1], wall[2], wall[3]
    if max(wx1, wx2) < x1 or min(wx1, wx2) > x2 or max(wy1, wy2) < min(y1, y2) or min(wy1, wy2) > max(y1, y2):
        return False
    # Walls that share a corner place it on the same side of the line: no line slips between them.
    first = (x2 - x1) * (wy1 - y1) - (y2 - y1) * (wx1 - x1)
    second = (x2 - x1) * (wy2 - y1) - (y2 - y1) * (wx2 - x1)
    if (first > 0.0 and second > 0.0) or (first < 0.0 and second < 0.0):
        return False
    first = (wx2 - wx1) * (y1 - wy1) - (wy2 - wy1) * (x1 - wx1)
    second = (wx2 - wx1) * (y2 - wy1) - (wy2 - wy1) * (x2 - wx1)
    return not ((first > 0.0 and second > 0.0) or (first < 0.0 and second < 0.0))
