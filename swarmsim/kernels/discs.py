"""Discs that touch."""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit


@njit(cache=True, error_model="numpy")
def deepest(pose, radii, solid):
    """The deepest overlap of two discs at `pose` (n, 2 or more), as a share of the smaller of their `radii` (n,).

    Those that are not `solid` (n,) do not count. Gives 0 without one, and the two discs, else -1.
    """
    there = np.flatnonzero(solid)
    order = there[np.argsort(pose[there, 0])]
    largest = radii[there].max() if len(there) > 0 else 0.0
    share, first, second = 0.0, -1, -1
    for a in range(len(order)):
        i = order[a]
        for b in range(a + 1, len(order)):
            j = order[b]
            if pose[j, 0] - pose[i, 0] >= radii[i] + largest:
                break
            apart = math.hypot(pose[j, 0] - pose[i, 0], pose[j, 1] - pose[i, 1])
            found = (radii[i] + radii[j] - apart) / min(radii[i], radii[j])
            if found > share:
                share, first, second = found, min(i, j), max(i, j)
    return share, first, second
