"""The turns of wandering robots, by their beams' ranges."""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit


@njit(cache=True, error_model="numpy")
def steer_clear(bearings, ranges, alive, turns, clearance, speed, period):
    """Velocities (n, 2), m/s ahead and rad/s, that lead away from anything nearer than `clearance` (m).

    `bearings` (b,) in rad; `ranges` (n, b) in m, infinite or NaN for nothing; `turns` (n,) in rad, the further bend of
    each robot's way. Each beam that ends at r pushes the wanted direction, ahead at first, back along itself by
    clearance / r - 1, the gradient of a potential as in Khatib (1986), over the number of beams in a quarter turn.
    Within a `period` (s) the robot turns to that direction, driving as fast as it points there.
    """
    beams = len(bearings)
    twists = np.zeros((len(alive), 2))
    for i in range(len(alive)):
        if not alive[i]:
            continue
        ahead, aside = math.cos(turns[i]), math.sin(turns[i])
        for b in range(beams):
            if ranges[i, b] < clearance:
                push = 4.0 / beams * (clearance / max(ranges[i, b], 1e-3) - 1.0)
                ahead -= push * math.cos(bearings[b])
                aside -= push * math.sin(bearings[b])
        turn = math.atan2(aside, ahead)
        twists[i, 0] = speed * max(math.cos(turn), 0.0)
        twists[i, 1] = turn / period
    return twists
