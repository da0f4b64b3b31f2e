"""Who is near whom."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def nearest(positions, alive, k):
    """Links from every live robot to its k nearest live others; all of them where there are fewer than k.

    `positions` (n, 2). Gives (m, 2): receiver, sender, sorted. Of others equally far away the one with the
    lower id is nearer.
    """
    robots = len(alive)
    links = np.empty((robots * min(k, max(robots - 1, 0)), 2), np.int32)
    far = np.empty(k)
    who = np.empty(k, np.int32)
    count = 0
    for i in range(robots):
        if not alive[i]:
            continue
        found = 0
        for j in range(robots):
            if j == i or not alive[j]:
                continue
            dx = positions[j, 0] - positions[i, 0]
            dy = positions[j, 1] - positions[i, 1]
            apart = math.sqrt(dx * dx + dy * dy)
            if found == k and (k == 0 or apart >= far[k - 1]):
                continue
            if found < k:
                found += 1
            slot = found - 1
            while slot > 0 and far[slot - 1] > apart:
                far[slot] = far[slot - 1]
                who[slot] = who[slot - 1]
                slot -= 1
            far[slot] = apart
            who[slot] = j
        links[count : count + found, 0] = i
        links[count : count + found, 1] = np.sort(who[:found])
        count += found
    return links[:count]
