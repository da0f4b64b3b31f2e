"""Frontiers and shortest paths on occupancy grids (row, column); inside searches a cell is its row-major index."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmsim.kernels.compiling import njit, wrapping

SQRT2 = math.sqrt(2.0)
DROWS = np.array([0, -1, 1, 0, -1, -1, 1, 1])  # west, south, north, east, then the diagonal neighbours ...
DCOLUMNS = np.array([-1, 0, 0, 1, -1, 1, -1, 1])
FRONTIER = -1  # a search's goal: any frontier
NOWHERE = -2  # a search's goal: none, so that all cells in reach are settled
PAUSED = -3  # what a search gives that goes on in the next iteration
BESIDE = np.array([[0, 1], [1, 3], [0, 2], [2, 3]])  # ... and between which two of the first four each lies


class Maps(NamedTuple):
    """The robots' knowledge and memory of each cell; every array is (n, rows, columns)."""

    log_odds: NDArray[np.float32]  # of being occupied
    observed: NDArray[np.bool_]
    barred: NDArray[np.int32]  # the iteration until which a cell is not entered
    shunned: NDArray[np.int32]  # the iteration until which a cell is not chosen as goal


class Patrol(NamedTuple):
    """What patrolling robots need once nothing is left to explore; `seen` is (n, 0, 0) if none patrols."""

    seen: NDArray[np.int32]  # (n, rows, columns): when a cell was last seen, counted from 1; 0 for never
    since: NDArray[np.int32]  # (n,): the iteration in which the goal was chosen for its age; 0 for no such goal


class Rules(NamedTuple):
    """The switches of frontier exploration."""

    x0: float  # m, the lattice's left edge
    y0: float  # m, its lower edge
    cell: float  # m
    footprint: NDArray[np.int32]  # (f, 2): offsets of the cells under a robot centred in its cell, its own first
    span: int  # cells: from how far off the robot explores a frontier in which it does not fit
    neighbours: int  # 4 or 8
    keep: bool  # keep a goal while it is a frontier and can be reached
    patience: int  # iterations without progress that make a robot stuck
    window: int  # steps of its path that a robot can pass in one iteration
    bounded: bool = False  # whether a search may take several iterations, as `Scratch.left` says


@njit(cache=True)
def is_frontier(maps, i, r, c):
    """Whether a cell is known free to robot i, and a cell across an edge unknown (Yamauchi 1997)."""
    rows, columns = maps.observed.shape[1:]
    return (maps.observed[i, r, c] and maps.log_odds[i, r, c] < 0.0) and (
        (r > 0 and not maps.observed[i, r - 1, c])
        or (r + 1 < rows and not maps.observed[i, r + 1, c])
        or (c > 0 and not maps.observed[i, r, c - 1])
        or (c + 1 < columns and not maps.observed[i, r, c + 1])
    )


@njit(cache=True)
def fits(maps, i, now, rules, r, c):
    """Whether robot i may stand in a cell: known free, not barred, and no known wall under its body."""
    rows, columns = maps.observed.shape[1:]
    if r < 0 or r >= rows or c < 0 or c >= columns:
        return False
    if not maps.observed[i, r, c] or maps.log_odds[i, r, c] >= 0.0 or maps.barred[i, r, c] > now:
        return False
    for f in range(1, len(rules.footprint)):
        rf = r + rules.footprint[f, 0]
        cf = c + rules.footprint[f, 1]
        inside = 0 <= rf < rows and 0 <= cf < columns
        if inside and maps.observed[i, rf, cf] and maps.log_odds[i, rf, cf] >= 0.0:
            return False
    return True


@njit(cache=True)
@wrapping
def scramble(value):
    """A well-mixed 64-bit hash of a number (the finaliser of splitmix64, Steele et al. 2014)."""
    z = np.uint64(value) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True)
def _push(work, size, cell, key, rank):
    i = size
    while i > 0:
        up = (i - 1) >> 1
        if work.keys[up] < key or (work.keys[up] == key and work.ranks[up] <= rank):
            break
        work.heap[i] = work.heap[up]
        work.keys[i] = work.keys[up]
        work.ranks[i] = work.ranks[up]
        i = up
    work.heap[i] = cell
    work.keys[i] = key
    work.ranks[i] = rank
    return size + 1


@njit(cache=True)
def _pop(work, size):
    size -= 1
    key = work.keys[size]
    rank = work.ranks[size]
    i = 0
    while True:
        down = 2 * i + 1
        if down >= size:
            break
        beside = down + 1
        if beside < size and (
            work.keys[beside] < work.keys[down]
            or (work.keys[beside] == work.keys[down] and work.ranks[beside] < work.ranks[down])
        ):
            down = beside
        if key < work.keys[down] or (key == work.keys[down] and rank <= work.ranks[down]):
            break
        work.heap[i] = work.heap[down]
        work.keys[i] = work.keys[down]
        work.ranks[i] = work.ranks[down]
        i = down
    work.heap[i] = work.heap[size]
    work.keys[i] = key
    work.ranks[i] = rank
    return size


@njit(cache=True)
def _to_explore(maps, i, now, rules, r, c):
    """The frontier cell that robot i would explore from cell (r, c), or -1.

    That is the cell itself or, where the body does not fit into the frontier, one within `rules.span` cells.
    """
    rows, columns = maps.observed.shape[1:]
    for rf in range(max(0, r - rules.span), min(rows, r + rules.span + 1)):
        for cf in range(max(0, c - rules.span), min(columns, c + rules.span + 1)):
            unexplored = maps.shunned[i, rf, cf] <= now and is_frontier(maps, i, rf, cf)
            if unexplored and ((rf == r and cf == c) or not fits(maps, i, now, rules, rf, cf)):
                return rf * columns + cf
    return -1


@njit(cache=True)
def _remaining(cell, goal, columns, neighbours):
    """Length of the shortest way between two cells of an empty grid, in cells; 0 without a goal."""
    if goal < 0:
        return 0.0
    rows_apart = abs(cell // columns - goal // columns)
    columns_apart = abs(cell % columns - goal % columns)
    if neighbours == 4:
        return float(rows_apart + columns_apart)
    return min(rows_apart, columns_apart) * SQRT2 + float(abs(rows_apart - columns_apart))


@njit(cache=True)
def _search(maps, i, now, rules, start, goal, salt, work):
    """Best-first search over the cells that robot i knows to be free; gives the last cell settled, -1, or PAUSED.

    With a goal this is A* (Hart et al. 1968), without one (FRONTIER) Dijkstra's order up to the first cell from
    which a frontier can be explored, or (NOWHERE) through all cells in reach. A diagonal step costs sqrt(2) and needs
    both cells beside it; the cell of the start need not fit itself. Costs are kept as two counts, so that equally long
    ways compare equal. Where no more cells are `left` it pauses, and the next search from this start goes on there.
    """
    columns = maps.observed.shape[2]
    size = work.paused[0] if work.paused[1] == start else np.int64(0)
    work.paused[0] = 0
    work.number[0] += size == 0
    seen = 2 * work.number[0]
    free = np.zeros(8, np.bool_)
    if size == 0:
        work.straight[start] = 0
        work.diagonal[start] = 0
        work.parent[start] = -1
        work.mark[start] = seen
        size = _push(work, np.int64(0), start, _remaining(start, goal, columns, rules.neighbours), np.uint64(0))
    while size > 0:
        if work.left[0] <= 0:
            work.paused[0] = size
            work.paused[1] = start
            return PAUSED
        work.left[0] -= 1
        here = work.heap[0]
        size = _pop(work, size)
        if work.mark[here] > seen:
            continue
        work.mark[here] = seen + 1
        r = here // columns
        c = here % columns
        if here == goal or (goal == FRONTIER and _to_explore(maps, i, now, rules, r, c) >= 0):
            return here
        for d in range(rules.neighbours):
            if d >= 4 and not (free[BESIDE[d - 4, 0]] and free[BESIDE[d - 4, 1]]):
                continue
            free[d] = fits(maps, i, now, rules, r + DROWS[d], c + DCOLUMNS[d])
            there = here + DROWS[d] * columns + DCOLUMNS[d]
            if not free[d] or work.mark[there] > seen:
                continue
            straight = work.straight[here] + (d < 4)
            diagonal = work.diagonal[here] + (d >= 4)
            cost = straight + diagonal * SQRT2
            if work.mark[there] == seen and cost >= work.straight[there] + work.diagonal[there] * SQRT2:
                continue
            work.straight[there] = straight
            work.diagonal[there] = diagonal
            work.parent[there] = here
            work.mark[there] = seen
            rank = np.uint64(there) if salt == 0 else scramble(np.uint64(there) ^ np.uint64(salt))
            key = cost + _remaining(there, goal, columns, rules.neighbours)
            size = _push(work, size, there, key, rank)
    return -1


@njit(cache=True)
def nearest_frontier(maps, i, now, rules, start, salt, work):
    """The nearest frontier cell that robot i can reach from the cell `start`, and where to explore it from.

    Distance is the length of the way through cells known free. Ties go to the first in row-major order or, with a
    `salt` other than 0, in an order drawn by it. Gives (-1, -1) if there is none, and PAUSED twice as `_search`.
    """
    columns = maps.observed.shape[2]
    stand = _search(maps, i, now, rules, start, np.int64(FRONTIER), salt, work)
    if stand < 0:
        return stand, stand
    return _to_explore(maps, i, now, rules, stand // columns, stand % columns), stand


@njit(cache=True)
def nearest_stale(maps, patrol, i, now, rules, start, salt, work):
    """Of the cells that robot i can reach from `start`, the nearest that is at least half as old as the oldest, or -1.

    The age of a cell counts from when it was last seen. Choosing the very oldest would send robots with equal maps to
    the same cell, and back across the building once one of them has seen it. Ties go to the order that `salt` draws, as
    in `nearest_frontier`. The start itself and cells seen in this iteration (`now`) do not count.
    """
    _search(maps, i, now, rules, start, np.int64(NOWHERE), salt, work)
    settled = 2 * work.number[0] + 1
    seen = patrol.seen[i].reshape(-1)
    oldest = now
    for cell in range(len(seen)):
        if work.mark[cell] == settled and cell != start and seen[cell] < oldest:
            oldest = seen[cell]
    best = -1
    way = 0.0
    rank = np.uint64(0)
    for cell in range(len(seen)):
        if work.mark[cell] != settled or cell == start or seen[cell] >= now or 2 * (now - seen[cell]) < now - oldest:
            continue
        cost = work.straight[cell] + work.diagonal[cell] * SQRT2
        order = np.uint64(cell) if salt == 0 else scramble(np.uint64(cell) ^ np.uint64(salt))
        if best < 0 or cost < way or (cost == way and order < rank):
            best, way, rank = cell, cost, order
    return best


@njit(cache=True)
def a_star(maps, i, now, rules, start, goal, work, path):
    """Write the shortest way from `start` to `goal` into `path`, both included; gives its cells, 0 for none."""
    return traced(_search(maps, i, now, rules, start, goal, np.uint64(0), work), work, path)


@njit(cache=True)
def traced(goal, work, path):
    """Write the way to a cell that the last search has settled into `path`; gives its cells, 0 for no cell."""
    count = 0
    cell = goal
    while cell >= 0:
        count += 1
        cell = work.parent[cell]
    cell = goal
    for step in range(count - 1, -1, -1):
        path[step] = cell
        cell = work.parent[cell]
    return count


def footprint(radius: float) -> NDArray[np.int32]:
    """Offsets (f, 2) of the cells that a disc of `radius` cells, centred in a cell, overlaps; its own first."""
    reach = math.ceil(max(radius - 0.5, 0.0))
    offsets = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, -1).T - reach
    gap = np.maximum(np.abs(offsets) - 0.5, 0.0)  # from the centre to the nearest point of each cell
    under = offsets[np.hypot(gap[:, 0], gap[:, 1]) < max(radius, 0.5)]
    return np.ascontiguousarray(under[np.argsort(np.hypot(under[:, 0], under[:, 1]), kind="stable")], np.int32)
