"""Sets of cells, as boolean arrays: connected pieces, neighbours, and cells between others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.kernels.flood import steps

Cells = NDArray[np.bool_]  # (rows, columns)


def flood(open_cells: Cells, seeds: Cells) -> NDArray[np.int32]:
    """Steps (rows, columns) between 4-neighbours in `open_cells` from the nearest seed; -1 without a way."""
    hops: NDArray[np.int32] = steps(open_cells, seeds)
    return hops


def spread(open_cells: Cells, labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """The labels (rows, columns), 0 for none, of the nearest labelled cell by steps between 4-neighbours in open cells.

    Ties go to the lowest label.
    """
    width = open_cells.shape[1] + 2
    free = np.pad(open_cells, 1).ravel()
    found = np.pad(np.where(open_cells, labels, 0), 1).astype(np.int32).ravel()
    free[found > 0] = False
    front = np.flatnonzero(found)
    while front.size:
        around = (front[:, None] + (-width, -1, 1, width)).ravel()
        label = found[front].repeat(4)[free[around]]
        around = around[free[around]]
        order = np.lexsort((label, around))
        front, first = np.unique(around[order], return_index=True)
        found[front] = label[order][first]
        free[front] = False
    return found.reshape(-1, width)[1:-1, 1:-1]


def richest_piece(open_cells: Cells, seeds: Cells) -> Cells:
    """The 4-connected piece of `open_cells` with most of `seeds`; the lowest row and column break a tie."""
    best, most = np.zeros_like(seeds), 0
    left = seeds & open_cells
    while left.any():
        first = np.zeros_like(left)
        first.flat[left.argmax()] = True
        piece = flood(open_cells, first) >= 0
        held = int((piece & left).sum())
        if held > most:
            best, most = piece, held
        left &= ~piece
        if left.sum() <= most:
            break
    return best


def grown(cells: Cells) -> Cells:
    """The 4-neighbours of `cells`."""
    padded = np.pad(cells, 1)
    beside: Cells = padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
    return beside


def around(cells: Cells, reach: int) -> Cells:
    """The cells in squares of `reach` cells each way around `cells`."""
    near = cells
    for _ in range(2):  # down, then across
        padded = np.pad(near, ((reach, reach), (0, 0)))
        total = np.cumsum(np.pad(padded, ((1, 0), (0, 0))), axis=0)
        near = (total[2 * reach + 1 :] > total[: -2 * reach - 1]).T
    return near


def rim(cells: Cells) -> Cells:
    """The `cells` on the border of the lattice."""
    outer = cells.copy()
    outer[1:-1, 1:-1] = False
    return outer


def between(occupied: Cells) -> Cells:
    """The free cells with walls both left and right, or both above and below, at any distance."""
    enclosed = np.zeros_like(occupied)
    for axis in (0, 1):
        before = np.logical_or.accumulate(occupied, axis=axis)
        after = np.flip(np.logical_or.accumulate(np.flip(occupied, axis), axis=axis), axis)
        enclosed |= before & after
    return enclosed & ~occupied
