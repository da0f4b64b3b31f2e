"""Pedestrians: discs that follow waypoints and stop for anything in their way."""

from __future__ import annotations

import math

from swarmsim.kernels.compiling import njit


@njit(cache=True)
def _nears(x, y, to_x, to_y, other_x, other_y, room):
    """Whether a step from (x, y) to (to_x, to_y) brings it nearer to another disc, closer than `room` (m)."""
    after = math.hypot(other_x - to_x, other_y - to_y)
    return after < room and after < math.hypot(other_x - x, other_y - y)


@njit(cache=True)
def _is_blocked(discs, k, to_x, to_y, pose, solid, radius, clearance):
    """Whether a robot or another disc blocks a step of disc k to (to_x, to_y), as in `walk`."""
    for i in range(len(pose)):
        room = discs[k, 2] + radius + clearance
        if solid[i] and _nears(discs[k, 0], discs[k, 1], to_x, to_y, pose[i, 0], pose[i, 1], room):
            return True
    for j in range(len(discs)):
        room = discs[k, 2] + discs[j, 2]
        if j != k and _nears(discs[k, 0], discs[k, 1], to_x, to_y, discs[j, 0], discs[j, 1], room):
            return True
    return False


@njit(cache=True)
def walk(discs, ways, counts, cursor, waited, speed, pose, solid, radius, clearance, dt, velocity):
    """Move every disc straight towards its next waypoint for `dt` (s) at `speed` (m/s), in the order of their rows.

    `discs` (p, 3) are x, y, radius in m; disc k uses the first counts[k] of its waypoints `ways` (p, longest, 2) from
    cursor[k] on. It stands still if its step would lead it closer than `clearance` (m) to a robot, a disc of `radius`
    at `pose` (n, 3) that is `solid` (n,), or into another disc. Writes `discs`, `cursor`, the time `waited` (p,) in s
    since each last moved, and `velocity` (p, 2) in m/s.
    """
    for k in range(len(discs)):
        velocity[k, 0] = 0.0
        velocity[k, 1] = 0.0
        waited[k] += dt
        if cursor[k] >= counts[k]:
            continue
        to_x = ways[k, cursor[k], 0]
        to_y = ways[k, cursor[k], 1]
        far = math.hypot(to_x - discs[k, 0], to_y - discs[k, 1])
        arrives = far <= speed * dt
        if not arrives:
            to_x = discs[k, 0] + (to_x - discs[k, 0]) * speed * dt / far
            to_y = discs[k, 1] + (to_y - discs[k, 1]) * speed * dt / far
        if _is_blocked(discs, k, to_x, to_y, pose, solid, radius, clearance):
            continue
        velocity[k, 0] = (to_x - discs[k, 0]) / dt
        velocity[k, 1] = (to_y - discs[k, 1]) / dt
        discs[k, 0] = to_x
        discs[k, 1] = to_y
        cursor[k] += arrives
        waited[k] = 0.0
