"""What learners observe of their own tiles and of those that they hear."""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit


@njit(cache=True, error_model="numpy")
def look(robots, pose, own, receivers, origins, values, lattice, bounds, farthest, tile, places, heard, tiles, offsets):
    """Fill the observations of some `robots` (a,).

    `pose` (n, 3), `own` (n, rows, columns) tiles; `receivers` (m,), ascending, `origins` (m, 2) and `values` (m, rows,
    columns) of the tiles heard; `lattice` = (x0, y0, cell). Writes `tile` (a, rows, columns); `places` (a, 3), the pose
    with its yaw from -pi to pi, within `bounds` (2, 3); `heard` (a,), how many tiles, at most those that there is room
    for: `tiles` (a, k, rows, columns), nearest first, of equally near ones the first heard, and `offsets` (a, k, 2),
    from the robot to their middles, at most `farthest` (m) to a side. The rest is 0.
    """
    x0, y0, cell = lattice
    rows, columns = own.shape[1:]
    most = tiles.shape[1]
    near = np.empty(most)
    for a in range(len(robots)):
        i = robots[a]
        tile[a] = own[i]
        x, y = pose[i, 0], pose[i, 1]
        turned = (pose[i, 2] + math.pi) % (2.0 * math.pi) - math.pi
        for side, value in enumerate((x, y, turned)):
            places[a, side] = min(max(value, bounds[0, side]), bounds[1, side])
        tiles[a], offsets[a] = 0, 0.0
        found = 0
        for m in range(np.searchsorted(receivers, i), np.searchsorted(receivers, i, side="right")):
            dx = (origins[m, 1] + columns / 2.0) * cell + x0 - x
            dy = (origins[m, 0] + rows / 2.0) * cell + y0 - y
            apart = math.hypot(dx, dy)
            if found == most and (most == 0 or apart >= near[most - 1]):
                continue
            at = min(found, most - 1)
            while at > 0 and near[at - 1] > apart:
                near[at], tiles[a, at], offsets[a, at] = near[at - 1], tiles[a, at - 1], offsets[a, at - 1]
                at -= 1
            near[at], tiles[a, at] = apart, values[m]
            offsets[a, at, 0] = min(max(dx, -farthest), farthest)
            offsets[a, at, 1] = min(max(dy, -farthest), farthest)
            found = min(found + 1, most)
        heard[a] = found
