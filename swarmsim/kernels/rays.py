"""Beams against exact wall segments, and the cells that they prove free or occupied.

All functions that call each other live in this file: numba's cache does not notice edits elsewhere.
"""

from __future__ import annotations

import math

import numpy as np

from swarmsim.kernels.compiling import njit

ENDPOINT_SLACK = 1e-12  # of a segment's length: beams at a shared corner must not slip between two walls
INSIDE = 1e-6  # m behind the surface at which a hit is looked up, so that it falls into the wall's own cell
ROUNDING = 1e-9  # cells: a beam that ends on a cell's edge has crossed that cell
CLIPPED = 0.2  # cells: a beam with a shorter way through a cell says nothing about it


@njit(cache=True, error_model="numpy")
def _cast(x, y, cosines, sines, reach, walls, near, discs, distance, hit):
    """Distance (m) and index of the first surface along each beam from (x, y), as in `cast`."""
    beams = len(cosines)
    for b in range(beams):
        distance[b] = reach
        hit[b] = -1
    for s in near:
        ax = walls[s, 0] - x
        ay = walls[s, 1] - y
        ex = walls[s, 2] - walls[s, 0]
        ey = walls[s, 3] - walls[s, 1]
        across = ax * ey - ay * ex
        for b in range(beams):
            turn = cosines[b] * ey - sines[b] * ex
            along = across / turn
            where = (ax * sines[b] - ay * cosines[b]) / turn
            inside = (where >= -ENDPOINT_SLACK) & (where <= 1.0 + ENDPOINT_SLACK)
            if inside & (along >= 0.0) & (along <= distance[b]):
                distance[b] = along
                hit[b] = s
        if across == 0.0:  # the robot stands on the line of this wall: beams along it meet its nearer end
            for b in range(beams):
                if cosines[b] * ey - sines[b] * ex == 0.0:
                    first = ax * cosines[b] + ay * sines[b]
                    last = first + ex * cosines[b] + ey * sines[b]
                    along = max(min(first, last), 0.0)
                    if max(first, last) >= 0.0 and along <= distance[b]:
                        distance[b] = along
                        hit[b] = s
    for d in range(len(discs)):
        cx = discs[d, 0] - x
        cy = discs[d, 1] - y
        r2 = discs[d, 2] * discs[d, 2]
        apart = cx * cx + cy * cy - r2
        for b in range(beams):
            middle = cx * cosines[b] + cy * sines[b]
            under = middle * middle - apart
            if middle >= 0.0 and under >= 0.0:
                along = max(middle - math.sqrt(under), 0.0)
                if along < distance[b]:
                    distance[b] = along
                    hit[b] = len(walls) + d


@njit(cache=True, error_model="numpy")
def cast(origin, angles, reach, walls, discs):
    """Cast beams from one point.

    `origin` (2,) in m, `angles` (b,) in rad in the world frame, `reach` in m, `walls` (s, 4) as
    x1, y1, x2, y2 and `discs` (d, 3) as x, y, radius, both in m. Gives the distances (b,), at most
    `reach`, and the hits (b,): the wall's row, s + the disc's row, or -1 for nothing within reach.
    Of two walls at the same distance the later row counts.
    """
    distance = np.empty(len(angles))
    hit = np.empty(len(angles), np.int64)
    near = np.arange(len(walls))
    _cast(origin[0], origin[1], np.cos(angles), np.sin(angles), reach, walls, near, discs, distance, hit)
    return distance, hit


@njit(cache=True, error_model="numpy")
def bins(walls, reach, x0, y0, side, rows, columns):
    """For each square of a coarse grid, the walls that a robot inside it could meet within `reach`.

    Gives `start` (rows * columns + 1,) and `members`: square i (row-major) holds
    members[start[i]:start[i + 1]], in rising order.
    """
    start = np.zeros(rows * columns + 1, np.int64)
    members = np.empty(0, np.int64)
    for fill in range(2):
        for s in range(len(walls)):
            west = min(walls[s, 0], walls[s, 2])
            east = max(walls[s, 0], walls[s, 2])
            south = min(walls[s, 1], walls[s, 3])
            north = max(walls[s, 1], walls[s, 3])
            # One more square on each side, so that rounding leaves the choice to the comparison below.
            first_row = max(int(math.floor((south - reach - y0) / side)) - 1, 0)
            last_row = min(int(math.floor((north + reach - y0) / side)) + 1, rows - 1)
            first_column = max(int(math.floor((west - reach - x0) / side)) - 1, 0)
            last_column = min(int(math.floor((east + reach - x0) / side)) + 1, columns - 1)
            for r in range(first_row, last_row + 1):
                for c in range(first_column, last_column + 1):
                    left = x0 + c * side - reach
                    low = y0 + r * side - reach
                    right = left + side + 2 * reach
                    high = low + side + 2 * reach
                    if east >= left and west <= right and north >= low and south <= high:
                        square = r * columns + c
                        if fill == 1:
                            members[start[square]] = s
                            start[square] += 1
                        else:
                            start[square + 1] += 1
        if fill == 0:
            for square in range(rows * columns):
                start[square + 1] += start[square]
            members = np.empty(start[-1], np.int64)
    for square in range(rows * columns, 0, -1):  # filling has moved each start to the next one
        start[square] = start[square - 1]
    start[0] = 0
    return start, members


@njit(cache=True, error_model="numpy")
def _mark(tile, row0, column0, u, v, du, dv, length, reached_wall):
    """Mark as free the cells that a beam crosses whole; u, v and length in cells, v along rows."""
    rows, columns = tile.shape
    column = int(math.floor(u))
    row = int(math.floor(v))
    step_u = 1 if du > 0.0 else -1
    step_v = 1 if dv > 0.0 else -1
    each_u = abs(1.0 / du)
    each_v = abs(1.0 / dv)
    next_u = (column + 1 - u) * each_u if du > 0.0 else (u - column) * each_u
    next_v = (row + 1 - v) * each_v if dv > 0.0 else (v - row) * each_v
    if du == 0.0:
        next_u = math.inf
    if dv == 0.0:
        next_v = math.inf
    entered = 0.0
    while True:
        r = row - row0
        c = column - column0
        if r < 0 or r >= rows or c < 0 or c >= columns:
            return
        leaves = min(next_u, next_v)
        if leaves > length + ROUNDING:
            if reached_wall or length - entered < CLIPPED:
                return
            leaves = length
        if (leaves - entered >= CLIPPED or entered == 0.0) and tile[r, c] == 0:
            tile[r, c] = 1
        if leaves >= length:
            return
        entered = leaves
        if next_u <= next_v:
            column += step_u
            next_u += each_u
        else:
            row += step_v
            next_v += each_v


@njit(cache=True, error_model="numpy")
def _facing(x, y, walls, start, members, coarse, near):
    """Write the walls whose front a robot at (x, y) may see into `near`; gives their number."""
    row = int(math.floor((y - coarse[1]) / coarse[2]))
    column = int(math.floor((x - coarse[0]) / coarse[2]))
    if not (0 <= row < coarse[3] and 0 <= column < coarse[4]):
        return 0
    square = row * int(coarse[4]) + column
    count = 0
    for m in range(start[square], start[square + 1]):
        s = members[m]
        ex = walls[s, 2] - walls[s, 0]
        ey = walls[s, 3] - walls[s, 1]
        if (walls[s, 0] - x) * ey - (walls[s, 1] - y) * ex <= 0.0:  # backs of walls are hidden by fronts
            near[count] = s
            count += 1
    return count


@njit(cache=True, error_model="numpy")
def _behind(walls, s, px, py):
    """The point just behind the surface of wall s at (px, py), and just off the wall's ends.

    So walls on the edges of cells stay in their own cells.
    """
    ex = walls[s, 2] - walls[s, 0]
    ey = walls[s, 3] - walls[s, 1]
    size = math.hypot(ex, ey)
    ex /= size
    ey /= size
    middle = (0.5 * (walls[s, 0] + walls[s, 2]) - px) * ex + (0.5 * (walls[s, 1] + walls[s, 3]) - py) * ey
    slide = INSIDE if middle > 0.0 else -INSIDE
    return px - ey * INSIDE + ex * slide, py + ex * INSIDE + ey * slide


@njit(cache=True, error_model="numpy")
def _square(x, y, coarse):
    """The row and column of the square of a place; beside the grid, of the nearest edge."""
    row = min(max(int(math.floor((y - coarse[1]) / coarse[2])), 0), int(coarse[3]) - 1)
    column = min(max(int(math.floor((x - coarse[0]) / coarse[2])), 0), int(coarse[4]) - 1)
    return row, column


@njit(cache=True, error_model="numpy")
def _by_square(pose, alive, coarse):
    """Live robots as lists, one for each square: the first of each, and the next after each; -1 at the end."""
    first = np.empty(int(coarse[3]) * int(coarse[4]), np.int64)
    following = np.empty(len(pose), np.int64)
    first[:] = -1
    following[:] = -1
    for j in range(len(pose)):
        if alive[j]:
            row, column = _square(pose[j, 0], pose[j, 1], coarse)
            square = row * int(coarse[4]) + column
            following[j] = first[square]
            first[square] = j
    return first, following


@njit(cache=True, error_model="numpy")
def _within(x, y, reach, pose, first, following, coarse, found):
    """Write the ids of live robots in squares within `reach` (m) into `found`, ascending; gives their number."""
    low_row, low_column = _square(x - reach, y - reach, coarse)
    high_row, high_column = _square(x + reach, y + reach, coarse)
    count = 0
    for row in range(low_row, high_row + 1):
        for column in range(low_column, high_column + 1):
            j = first[row * int(coarse[4]) + column]
            while j >= 0:
                at = count
                while at > 0 and found[at - 1] > j:
                    found[at] = found[at - 1]
                    at -= 1
                found[at] = j
                count += 1
                j = following[j]
    return count


@njit(cache=True, error_model="numpy")
def sense(
    pose,
    alive,
    ring,
    reach,
    walls,
    start,
    members,
    movers,
    coarse,
    lattice,
    radii,
    occlude,
    obstacle,
    tiles,
    origins,
    ranges,
):
    """Fill every robot's tile from its ring of beams.

    `pose` (n, 3), `alive` (n,), `ring` (b, 2) cosine and sine of each beam's angle to the heading, `reach`
    in m, `walls` (s, 4) with the solid side on the left; `start` and `members` from `bins`, whose grid is
    `coarse` = (x0, y0, side, rows, columns); `movers` (p, 3), discs as x, y, radius, are obstacles like walls;
    `lattice` = (x0, y0, cell). Robots, discs of `radii` (n,), stop beams if `occlude`, and count as occupied cells if
    `obstacle`. Writes `tiles` (n, rows, columns) and `origins` (n, 2) and, unless `ranges` (n, b) has no rows, the
    lengths of stopped beams into it.

    A cell is free when some beam crosses at least a fifth of a cell of it (or starts there) on its way,
    and occupied, which outweighs free, when some beam ends in it.
    """
    robots, rows, columns = tiles.shape
    beams = len(ring)
    x0, y0, cell = lattice
    distance = np.empty(beams)
    hit = np.empty(beams, np.int64)
    cosines = np.empty(beams)
    sines = np.empty(beams)
    most = np.int64(0)
    for square in range(len(start) - 1):
        most = max(most, start[square + 1] - start[square])
    near = np.empty(most, np.int64)
    discs = np.empty((len(movers) + (robots if occlude else 0), 3))
    around = np.empty(robots if occlude else 0, np.int64)
    first, following = _by_square(pose, alive, coarse) if occlude else (around, around)
    largest = radii.max() if occlude and robots > 0 else 0.0
    for i in range(robots):
        x = pose[i, 0]
        y = pose[i, 1]
        u = (x - x0) / cell
        v = (y - y0) / cell
        origins[i, 0] = _first(v, rows)
        origins[i, 1] = _first(u, columns)
        tiles[i] = 0
        if not alive[i]:
            continue
        facing = _facing(x, y, walls, start, members, coarse, near)
        others = 0
        for m in range(len(movers)):
            if math.hypot(movers[m, 0] - x, movers[m, 1] - y) <= reach + movers[m, 2]:
                discs[others] = movers[m]
                others += 1
        solid = len(walls) + others  # hits from here on are robots
        if occlude:
            found = _within(x, y, reach + largest, pose, first, following, coarse, around)
            for m in range(found):  # in the order of their ids, which decides ties
                j = around[m]
                apart = math.hypot(pose[j, 0] - x, pose[j, 1] - y)
                if j != i and apart <= reach + radii[j]:
                    discs[others, 0] = pose[j, 0]
                    discs[others, 1] = pose[j, 1]
                    discs[others, 2] = radii[j]
                    others += 1
        cos = math.cos(pose[i, 2])
        sin = math.sin(pose[i, 2])
        for b in range(beams):
            cosines[b] = cos * ring[b, 0] - sin * ring[b, 1]
            sines[b] = sin * ring[b, 0] + cos * ring[b, 1]
        _cast(x, y, cosines, sines, reach, walls, near[:facing], discs[:others], distance, hit)
        if len(ranges) > 0:
            for b in range(beams):
                if hit[b] >= 0:
                    ranges[i, b] = distance[b]
        for b in range(beams):
            _mark(tiles[i], origins[i, 0], origins[i, 1], u, v, cosines[b], sines[b], distance[b] / cell, hit[b] >= 0)
        for b in range(beams):
            s = hit[b]
            if s < 0 or (s >= solid and not obstacle):
                continue
            px = x + distance[b] * cosines[b]
            py = y + distance[b] * sines[b]
            if s < len(walls):
                px, py = _behind(walls, s, px, py)
            else:
                px += INSIDE * cosines[b]
                py += INSIDE * sines[b]
            row = int(math.floor((py - y0) / cell)) - origins[i, 0]
            column = int(math.floor((px - x0) / cell)) - origins[i, 1]
            if 0 <= row < rows and 0 <= column < columns:
                tiles[i, row, column] = 2


@njit(cache=True, error_model="numpy")
def _first(position, size):
    """First cell of a window of `size` cells: odd centred on the cell, even on the nearest cell edge."""
    if size % 2 == 1:
        return int(math.floor(position)) - size // 2
    return int(math.floor(position + 0.5)) - size // 2
