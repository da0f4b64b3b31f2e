"""The origin and age of each robot's knowledge of each cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmsim.kernels.compiling import njit

UNSEEN = -1  # the sensor of a cell that no robot has sensed


class Origins(NamedTuple):
    """The latest reading behind each cell of each robot's map, and sums over the cells that have one."""

    sensed: NDArray[np.int32]  # (n, rows, columns): the iteration in which it was sensed, from 1; 0: never
    by: NDArray[np.int32]  # (n, rows, columns): the robot that sensed it; UNSEEN
    hops: NDArray[np.uint8]  # (n, rows, columns): links that it came over; 0 is the robot's own
    cells: NDArray[np.int64]  # (n,): cells with a reading
    total: NDArray[np.int64]  # (n,): sum of `sensed` over them
    links: NDArray[np.int64]  # (n,): sum of `hops`
    heard: NDArray[np.int64]  # (n,): cells known from another robot's reading


@njit(cache=True)
def _set(origins, i, r, c, sensed, by, hops):
    before = origins.sensed[i, r, c]
    if before == 0:
        origins.cells[i] += 1
    elif origins.by[i, r, c] != i:
        origins.heard[i] -= 1
    origins.total[i] += sensed - before
    origins.links[i] += hops - np.int64(origins.hops[i, r, c])
    if by != i:
        origins.heard[i] += 1
    origins.sensed[i, r, c] = sensed
    origins.by[i, r, c] = by
    origins.hops[i, r, c] = hops


@njit(cache=True)
def trace(origins, now, alive, tiles, corners, receivers, senders, heard, heard_corners, sources, sensed, hops):
    """Update the origins by an iteration: own tiles (n, ...), then the messages taken in.

    `now` counts from 1, `sensed` (m,) from 0; `hops` (m,) are the links over which each tile has come. Of two readings
    the later counts, of equally late ones that over fewer links. A piece of the sender's map (`sources` -1) fills cells
    without a reading at the receiver with the sender's own, one link further.
    """
    rows, columns = origins.sensed.shape[1:]
    height, width = tiles.shape[1:]
    for m in range(len(receivers)):
        if sources[m] >= 0:
            continue
        i, s = receivers[m], senders[m]
        for a in range(height):
            for b in range(width):
                r, c = heard_corners[m, 0] + a, heard_corners[m, 1] + b
                if heard[m, a, b] == 0 or r < 0 or r >= rows or c < 0 or c >= columns:
                    continue
                if origins.sensed[i, r, c] == 0 and origins.sensed[s, r, c] > 0:
                    links = min(np.int64(origins.hops[s, r, c]) + 1, 255)
                    _set(origins, i, r, c, origins.sensed[s, r, c], origins.by[s, r, c], links)
    for i in range(len(alive)):
        if not alive[i]:
            continue
        for a in range(height):
            for b in range(width):
                r, c = corners[i, 0] + a, corners[i, 1] + b
                if tiles[i, a, b] != 0 and 0 <= r < rows and 0 <= c < columns:
                    _set(origins, i, r, c, now, i, 0)
    for m in range(len(receivers)):
        if sources[m] < 0:
            continue
        i, when = receivers[m], sensed[m] + 1
        for a in range(height):
            for b in range(width):
                r, c = heard_corners[m, 0] + a, heard_corners[m, 1] + b
                if heard[m, a, b] == 0 or r < 0 or r >= rows or c < 0 or c >= columns:
                    continue
                known = origins.sensed[i, r, c]
                if known < when or (known == when and origins.hops[i, r, c] > hops[m]):
                    _set(origins, i, r, c, when, sources[m], np.int64(hops[m]))
