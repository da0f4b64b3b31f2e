"""The evidence of one range reading on the cells along its beam, by Bayes' rule from the rangefinder's errors."""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit

PASSED = 2.0 / 3.0  # probability that a beam gets through an occupied cell
STOPPED = 0.5 * (1.0 - PASSED)  # that an unknown cell stops a beam
FAINT = 0.5 * PASSED / (1.0 - STOPPED)  # that a cell is occupied although a beam got through it: 0.4
CLIPPED = 0.2  # cells: a beam with a shorter way through a cell says nothing about it
SURE = 3.5  # log-odds, the most that one reading, or a whole tile, gives a cell for a wall ...
CLEAR = -2.0  # ... and against one
OCCUPIED = 2.0  # log-odds from which a tile calls a cell occupied: about those of `hit`, which hearers add
FREE = -0.35  # and free: about those of `miss`
ON_EDGE = 0.5  # probability that a surface lies on the edge of its cell, as for walls drawn on the lattice
FINEST = 1e-3  # m, the least standard deviation used
ROOT = math.sqrt(2.0 * math.pi)
STEPS = 64  # cells along a beam at most


@njit(cache=True, error_model="numpy")
def _sigma(distance, noise):
    """Standard deviation (m) of a reading at a distance (m); `noise` as in `tiles`."""
    square = noise[2] * distance * distance
    return math.sqrt(noise[0] * noise[0] + noise[1] * noise[1] * distance * distance + square * square)


@njit(cache=True, error_model="numpy")
def _below(x):
    """The standard normal distribution function."""
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


@njit(cache=True, error_model="numpy")
def _likelihood(near, far, reading, blind, reach, noise, outliers):
    """Density (1/m) of a finite reading, or probability of none (inf), if a surface lies in [near, far).

    It lies at `near` with probability ON_EDGE, and else anywhere.
    """
    edge = near >= blind
    near = max(near, blind)
    if far <= near:
        return 0.0
    first = max(_sigma(near, noise), FINEST)
    sigma = max(_sigma(0.5 * (near + far), noise), FINEST)
    share = ON_EDGE if edge else 0.0
    if reading == math.inf:
        beyond = share * (1.0 - _below((reach - near) / first))
        beyond += (1.0 - share) * (1.0 - _below((reach - 0.5 * (near + far)) / sigma))
        return (1.0 - outliers) * beyond
    away = (reading - near) / first
    spread = (_below((far - reading) / sigma) - _below((near - reading) / sigma)) / (far - near)
    density = share * math.exp(-0.5 * away * away) / (first * ROOT) + (1.0 - share) * spread
    return (1.0 - outliers) * density + outliers / (reach - blind)


@njit(cache=True, error_model="numpy")
def _along(u, v, du, dv, limit, rows, columns, edges):
    """The cells that a beam from (u, v), in cells, crosses up to `limit` cells away, and where it enters and leaves.

    Writes `rows` and `columns`, and the distances (cells) at which each is left to `edges`; gives their number.
    """
    column = int(math.floor(u))
    row = int(math.floor(v))
    step_u = 1 if du > 0.0 else -1
    step_v = 1 if dv > 0.0 else -1
    each_u = abs(1.0 / du) if du != 0.0 else math.inf
    each_v = abs(1.0 / dv) if dv != 0.0 else math.inf
    next_u = (column + 1 - u) * each_u if du > 0.0 else (u - column) * each_u if du < 0.0 else math.inf
    next_v = (row + 1 - v) * each_v if dv > 0.0 else (v - row) * each_v if dv < 0.0 else math.inf
    count = 0
    while count < STEPS:
        rows[count] = row
        columns[count] = column
        edges[count] = min(next_u, next_v)
        count += 1
        if edges[count - 1] >= limit:
            break
        if next_u <= next_v:
            column += step_u
            next_u += each_u
        else:
            row += step_v
            next_v += each_v
    return count


@njit(cache=True, error_model="numpy")
def tiles(pose, alive, rays, axis, readings, reach, blind, noise, outliers, lattice, values, origins, evidence):
    """Fill every robot's tile from the range readings of its beams.

    `rays` (b, s, 2) are cosine and sine of the s directions within each beam's cone, to the heading, the one at index
    `axis` its middle; `readings` (n, b) in m, infinite where nothing was met, NaN where there is no reading; `noise`
    (3,) gives the standard deviation of a reading at d: sqrt(n0^2 + (n1 d)^2 + (n2 d^2)^2) m; `outliers` is the share
    of readings that are anything between `blind` and `reach` (m). `lattice` = (x0, y0, cell).

    Along a ray, cell j is the first to stop the beam with probability STOPPED (1 - STOPPED)^j: every cell is occupied
    with probability 1/2, and an occupied one, perhaps only at a corner, lets a beam pass with probability PASSED; its
    surface is on the cell's edge with probability ON_EDGE, or else anywhere in it. The likelihood of the reading for
    each j is the forward model's; Bayes' rule gives the probability that each cell is occupied, and its log-odds are
    the reading's evidence (Thrun, Burgard, Fox, Probabilistic Robotics, 2005, sections 6.3 and 9.3). Off its middle, a
    beam's cone gives evidence only of free cells. Beams err independently, so their log-odds add, up to CLEAR and SURE.

    Writes `evidence` (n, rows, columns), log-odds, and `values`, which mark only sufficiently certain cells. A robot's
    own cell is free.
    """
    robots, height, width = values.shape
    x0, y0, cell = lattice
    rows = np.empty(STEPS, np.int64)
    columns = np.empty(STEPS, np.int64)
    edges = np.empty(STEPS)
    weights = np.empty(STEPS + 1)
    limit = min((reach + 3.0 * _sigma(reach, noise)) / cell, float(STEPS))
    for i in range(robots):
        values[i] = 0
        evidence[i] = 0.0
        if not alive[i]:
            continue
        u = (pose[i, 0] - x0) / cell
        v = (pose[i, 1] - y0) / cell
        cos = math.cos(pose[i, 2])
        sin = math.sin(pose[i, 2])
        for b in range(rays.shape[0]):
            if math.isnan(readings[i, b]):
                continue
            for s in range(rays.shape[1]):
                du = cos * rays[b, s, 0] - sin * rays[b, s, 1]
                dv = sin * rays[b, s, 0] + cos * rays[b, s, 1]
                count = _along(u, v, du, dv, limit, rows, columns, edges)
                _weigh(cell * edges, count, readings[i, b], reach, blind, noise, outliers, weights)
                before = 0.0
                total = weights[:count].sum() + weights[count]
                for k in range(1, count):
                    entered = edges[k - 1]
                    r = rows[k] - origins[i, 0]
                    c = columns[k] - origins[i, 1]
                    here = weights[k]
                    after = total - before - here
                    if 0 <= r < height and 0 <= c < width and edges[k] - entered >= CLIPPED and total > 0.0:
                        chance = (here + 0.5 * before + FAINT * after) / total
                        said = math.log(max(chance, 1e-6) / max(1.0 - chance, 1e-6))
                        if s == axis or said < 0.0:
                            evidence[i, r, c] += said
                    before += here
        for r in range(height):
            for c in range(width):
                said = min(max(evidence[i, r, c], CLEAR), SURE)
                if r + origins[i, 0] == int(math.floor(v)) and c + origins[i, 1] == int(math.floor(u)):
                    said = CLEAR
                evidence[i, r, c] = said
                values[i, r, c] = 2 if said >= OCCUPIED else 1 if said <= FREE else 0


@njit(cache=True, error_model="numpy")
def _weigh(edges, count, reading, reach, blind, noise, outliers, weights):
    """Joint weight of the reading with each cell being the first to stop the beam, and last, with none."""
    open_ = 1.0
    weights[0] = 0.0  # the robot stands in the first cell
    for k in range(1, count):
        likely = _likelihood(edges[k - 1], edges[k], reading, blind, reach, noise, outliers)
        if edges[k - 1] >= reach and reading == math.inf:
            likely = 1.0 - outliers
        weights[k] = open_ * STOPPED * likely
        open_ *= 1.0 - STOPPED
    weights[count] = open_ * (1.0 - outliers if reading == math.inf else outliers / (reach - blind))
