"""An exploring robot's choices: its frontiers in pieces, and the ways of all robots it knows of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmsim.kernels.compiling import njit
from swarmsim.kernels.search import DCOLUMNS, DROWS, _to_explore, fits, scramble


class Found(NamedTuple):
    """Pieces of frontier, nearest first."""

    goals: NDArray[np.int32]  # (p,): the frontier cell of each that is nearest
    stands: NDArray[np.int32]  # (p,): the cell to explore it from
    sizes: NDArray[np.int32]  # (p,): cells of the piece
    unknown: NDArray[np.int32]  # (p,): unknown cells within the sensor's reach of the frontier cell
    costs: NDArray[np.int32]  # (1 + h, p): of the ways there, from the robot first; FAR where there is none
    present: int  # the piece that the robot was going for, -1 for none


STRAIGHT = 5  # the cost of a step across an edge, and across a corner: about 1 to sqrt(2) in whole numbers,
DIAGONAL = 7  # so that cells can be settled bucket by bucket (Borgefors 1986, Dial 1969)
BUCKETS = 8
BESIDE = np.array([[0, 1], [0, 2], [1, 3], [2, 3]])  # between which two of west, south, north, east a diagonal lies
FAR = np.iinfo(np.int32).max


class Ground(NamedTuple):
    """Working memory of surveys of one grid."""

    stands: NDArray[np.bool_]  # (rows + 2, columns + 2): where the robot could stand; False in the margin
    cost: NDArray[np.int32]  # (all of them,): of the way there, FAR where there is none
    own: NDArray[np.int32]  # (all of them,): the same of the robot itself
    buckets: NDArray[np.int32]  # (8, all of them): cells to settle, by their cost modulo 8
    piece: NDArray[np.int32]  # (cells,): the piece of frontier that a cell belongs to, from 1 on
    stack: NDArray[np.int32]  # (cells,)


def ground(rows: int, columns: int) -> Ground:
    """Working memory for grids of this shape."""
    cells, framed = rows * columns, (rows + 2) * (columns + 2)
    cost, own = np.zeros((2, framed), np.int32)
    piece, stack = np.zeros((2, cells), np.int32)
    return Ground(
        np.zeros((rows + 2, columns + 2), np.bool_), cost, own, np.zeros((BUCKETS, framed), np.int32), piece, stack
    )


@njit(cache=True)
def _find_stands(maps, i, now, rules, stands):
    """Note in `stands` (rows + 2, columns + 2), with a margin, where robot i could stand."""
    rows, columns = maps.observed.shape[1:]
    stands[:] = False
    for r in range(rows):
        for c in range(columns):
            if maps.observed[i, r, c]:
                stands[r + 1, c + 1] = fits(maps, i, now, rules, r, c)


@njit(cache=True)
def _spread(stands, start, neighbours, cost, buckets):
    """Write the cost of the way from `start` to each cell into `cost`; cells are those of `stands`, margin included."""
    wide = stands.shape[1]
    flat = stands.reshape(-1)
    cost[:] = FAR
    filled = np.zeros(BUCKETS, np.int64)
    cost[start] = 0
    buckets[0, 0] = start
    filled[0] = 1
    straight = np.array([-1, -wide, wide, 1])
    diagonal = np.array([-wide - 1, wide - 1, -wide + 1, wide + 1])
    free = np.zeros(4, np.bool_)
    at = 0
    waiting = 1
    while waiting > 0:
        bucket = at % BUCKETS
        waiting -= filled[bucket]
        for k in range(filled[bucket]):
            here = buckets[bucket, k]
            if cost[here] != at:
                continue
            whole = at + STRAIGHT
            into = whole % BUCKETS
            for d in range(4):
                there = here + straight[d]
                free[d] = flat[there]
                if free[d] and cost[there] > whole:
                    cost[there] = whole
                    buckets[into, filled[into]] = there
                    filled[into] += 1
                    waiting += 1
            if neighbours == 4:
                continue
            whole = at + DIAGONAL
            into = whole % BUCKETS
            for d in range(4):
                there = here + diagonal[d]
                if cost[there] > whole and flat[there] and free[BESIDE[d, 0]] and free[BESIDE[d, 1]]:
                    cost[there] = whole
                    buckets[into, filled[into]] = there
                    filled[into] += 1
                    waiting += 1
        filled[bucket] = 0
        at += 1


@njit(cache=True)
def _cut(log_odds, observed, shunned, now, grain, piece, stack):
    """Number the pieces of one robot's frontier: cells that touch, and lie in the same square of `grain` cells."""
    rows, columns = observed.shape
    piece[:] = 0
    for r in range(rows):
        for c in range(columns):
            if not observed[r, c] or log_odds[r, c] >= 0.0 or shunned[r, c] > now:
                continue
            if (
                (r > 0 and not observed[r - 1, c])
                or (r + 1 < rows and not observed[r + 1, c])
                or (c > 0 and not observed[r, c - 1])
                or (c + 1 < columns and not observed[r, c + 1])
            ):
                piece[r * columns + c] = -1  # of none yet
    count = 0
    for cell in range(rows * columns):
        if piece[cell] >= 0:
            continue
        count += 1
        piece[cell] = count
        stack[0] = cell
        size = 1
        while size > 0:
            size -= 1
            r0 = stack[size] // columns
            c0 = stack[size] % columns
            for d in range(8):
                r = r0 + DROWS[d]
                c = c0 + DCOLUMNS[d]
                if r < 0 or r >= rows or c < 0 or c >= columns or piece[r * columns + c] >= 0:
                    continue
                if r // grain == r0 // grain and c // grain == c0 // grain:
                    piece[r * columns + c] = count
                    stack[size] = r * columns + c
                    size += 1
    return count


@njit(cache=True)
def _unknown_around(maps, i, cell, reach):
    """How many cells within `reach` cells of one robot i does not know."""
    rows, columns = maps.observed.shape[1:]
    r0 = cell // columns
    c0 = cell % columns
    count = 0
    for r in range(max(0, r0 - reach), min(rows, r0 + reach + 1)):
        for c in range(max(0, c0 - reach), min(columns, c0 + reach + 1)):
            near = (r - r0) * (r - r0) + (c - c0) * (c - c0) <= reach * reach
            if near and not maps.observed[i, r, c]:
                count += 1
    return count


def disc(reach: int) -> int:
    """How many cells lie within `reach` cells of one, itself included."""
    return int(np.count_nonzero(np.hypot(*(np.indices((2 * reach + 1, 2 * reach + 1)) - reach)) <= reach))


@njit(cache=True)
def _framed(cell, columns):
    """The index of a cell on a grid with a margin of one cell."""
    return (cell // columns + 1) * (columns + 2) + cell % columns + 1


@njit(cache=True)
def survey(maps, i, now, rules, here, others, before, grain, reach, salt, work):
    """The pieces of frontier that robot i can reach from the cell `here`.

    Frontiers are cut at the lines of a grid of `grain` cells. `others` (h,) are the cells of other robots, `before` the
    robot's last goal, -1 for none, `reach` its sensor's reach in cells; `salt` draws the order of equally near pieces.
    """
    rows, columns = maps.observed.shape[1:]
    _find_stands(maps, i, now, rules, work.stands)
    _spread(work.stands, _framed(here, columns), rules.neighbours, work.own, work.buckets)
    count = _cut(maps.log_odds[i], maps.observed[i], maps.shunned[i], now, grain, work.piece, work.stack)
    goal = np.full(count, -1, np.int32)
    stand = np.full(count, -1, np.int32)
    size = np.zeros(count, np.int32)
    nearest = np.full(count, FAR, np.int32)
    rank = np.zeros(count, np.uint64)
    for cell in range(rows * columns):
        if work.piece[cell] > 0:
            size[work.piece[cell] - 1] += 1
        cost = work.own[_framed(cell, columns)]
        if cost == FAR or (rules.span == 0 and work.piece[cell] == 0):
            continue
        target = cell
        if rules.span > 0:
            target = _to_explore(maps, i, now, rules, cell // columns, cell % columns)
        if target < 0 or work.piece[target] == 0:
            continue
        piece = work.piece[target] - 1
        order = scramble(np.uint64(cell) ^ np.uint64(salt))
        if cost < nearest[piece] or (cost == nearest[piece] and order < rank[piece]):
            nearest[piece] = cost
            rank[piece] = order
            goal[piece] = target
            stand[piece] = cell
    drawn = np.argsort(rank)
    drawn = drawn[np.argsort(nearest[drawn], kind="mergesort")]
    reached = drawn[nearest[drawn] < FAR]
    costs = np.empty((1 + len(others), len(reached)), np.int32)
    unknown = np.empty(len(reached), np.int32)
    present = -1
    for p in range(len(reached)):
        costs[0, p] = nearest[reached[p]]
        unknown[p] = _unknown_around(maps, i, goal[reached[p]], reach)
        if before >= 0 and work.piece[before] == reached[p] + 1:
            present = p
    if len(reached) > 0:
        for h in range(len(others)):
            _spread(work.stands, _framed(others[h], columns), rules.neighbours, work.cost, work.buckets)
            for p in range(len(reached)):
                costs[1 + h, p] = work.cost[_framed(stand[reached[p]], columns)]
    return Found(goal[reached], stand[reached], size[reached], unknown, costs, present)


@njit(cache=True)
def descend(maps, i, now, rules, here, others, found, reach, work):
    """The piece of frontier at which a walk from the cell `here`, always to the lowest neighbour, never back, ends.

    The potential of a cell falls by size / way for each piece and rises by reach - way for each of the `others` (h,)
    within `reach` cells, as in `choosing.PotentialField`. Gives the nearest piece if the walk has nowhere to go.
    """
    columns = maps.observed.shape[2]
    wide = columns + 2
    potential = np.zeros(work.stands.size)
    for p in range(len(found.goals)):
        _spread(work.stands, _framed(found.stands[p], columns), rules.neighbours, work.cost, work.buckets)
        for cell in range(len(potential)):
            if 0 < work.cost[cell] < FAR:
                potential[cell] -= found.sizes[p] * STRAIGHT / work.cost[cell]
    for h in range(len(others)):
        _spread(work.stands, _framed(others[h], columns), rules.neighbours, work.cost, work.buckets)
        for cell in range(len(potential)):
            if work.cost[cell] < reach * STRAIGHT:
                potential[cell] += reach - work.cost[cell] / STRAIGHT
    ends = np.full(work.stands.size, -1, np.int32)
    for p in range(len(found.goals)):
        ends[_framed(found.stands[p], columns)] = p
    passed = np.zeros(work.stands.size, np.bool_)
    flat = work.stands.reshape(-1)
    at = _framed(here, columns)
    while ends[at] < 0:
        passed[at] = True
        lowest = -1
        for d in range(rules.neighbours):
            there = at + DROWS[d] * wide + DCOLUMNS[d]
            if not flat[there] or passed[there]:
                continue
            if d >= 4 and not (flat[at + DROWS[d] * wide] and flat[at + DCOLUMNS[d]]):
                continue
            if ends[there] >= 0:
                return ends[there]
            if lowest < 0 or potential[there] < potential[lowest]:
                lowest = there
        if lowest < 0:
            return 0
        at = lowest
    return ends[at]
