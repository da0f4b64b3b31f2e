"""How far robots must drive at least to cover a share of a building, each by itself or all together.

Spread each cell's weight evenly over its square. What a robot sees of it lies in a rectangle around the robot that is
half a cell larger than the tile on each side, and enters only over the rectangle's leading edges. If a robot's side
edges hold at most `across` and its upper and lower ones at most `along`, with across^2 + along^2 <= 1 wherever it may
be, then driving a cell covers a weight of at most 1, whatever the direction (Cauchy-Schwarz). So N robots that cover
everything have together driven as many cells as all weights sum up to. Cells behind a wall are not on an edge: only
those that free space inside of the rectangle connects with the robot.

Equal weights, 1 / hypot(rows + 1, columns + 1) of the tile, are the area over the rate of sensing. Better ones solve a
linear programme, and are then scaled so that every edge holds: the proof does not rest on the solver.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swarmsim.studies.benchmark.places import Places
from swarmsim.studies.benchmark.solver import worthiest

SHARPER: Final = 2  # programmes solved for the weights


def covering(places: Places, entered: NDArray[np.float64], needed: Sequence[int], robots: int) -> list[float]:
    """A lower bound of how far in cells the robots drive on average until each of these counts of cells is covered.

    `entered` (m,) is how far some robot has to drive before a cell enters its rectangle. Until all have driven r cells,
    only the cells nearer than that are covered; the others take driving on.
    """
    order = np.argsort(entered, kind="stable")
    ways, cells = entered[order], np.arange(len(entered))
    even = 1.0 / math.hypot(*(side + 1 for side in places.window))
    worth = (entered > 0.0).astype(np.float64)
    uneven = weights(places, worth)
    after = uneven[order][::-1].cumsum()[::-1]  # the weight of each cell and all farther ones
    free = int(np.count_nonzero(worth == 0.0))  # cells that may be seen from the starts
    found = []
    for count in needed:
        even_ones = ways + np.maximum(count - cells, 0) * even / robots
        least = np.sort(uneven[worth > 0.0])[: max(count - free, 0)].sum() / robots
        bounds = [float(even_ones[free:count].max(initial=0.0)), float(least)]
        if count == len(cells):
            bounds.append(float((ways + after / robots).max()))
        found.append(max(bounds))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class LeadingEdges:
    """The leading edges of rectangles around places, in one direction."""

    cells: sparse.csr_array  # (e, m): which cells of the domain each may hold, 1 for each
    of: NDArray[np.int64]  # (p, 4): those of each possible place: on two sides, each at either end of the place

    def most(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The largest sum (p,) that an edge of each place holds of values (m,)."""
        return np.asarray((self.cells @ values)[self.of].max(axis=1))


def edges_of(places: Places, axis: int) -> LeadingEdges:
    """The upper and lower edges for axis 0, the left and right ones for axis 1."""
    long, far = (np.array(places.window) + 1)[[1 - axis, axis]].tolist()  # cells of an edge; half cells to it
    where = np.argwhere(places.possible)
    ahead, along = where[:, axis], where[:, 1 - axis]
    index = np.full(places.lattice.shape, -1)
    index[np.divmod(places.domain, places.lattice.columns)] = np.arange(len(places.domain))
    around = np.array(places.sides.shape[1:])
    found = []
    for side in (-far, far):
        line = (ahead + side) // 2
        for later in (0, 1):  # between both, what an edge holds is between what it holds there
            first = (along - long) // 2 + later
            held = np.full((len(where), long), -1)
            for number in range(long):
                pair = (line, first + number) if axis == 0 else (first + number, line)
                which = index[pair]
                spot = where - places.corners[which]
                near = np.flatnonzero((which >= 0) & ((spot >= 0) & (spot < around)).all(axis=1))
                near = near[places.sides[which[near], *spot[near].T]]
                held[near, number] = which[near]
            found.append(held)
    unique, of = np.unique(np.concatenate(found), axis=0, return_inverse=True)
    edge, spot = np.nonzero(unique >= 0)
    cells = sparse.csr_array((np.ones(len(edge)), (edge, unique[edge, spot])), shape=(len(unique), len(places.domain)))
    return LeadingEdges(cells, of.reshape(4, len(where)).T)


def weights(places: Places, worth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of cells (m,), such that driving one cell covers a weight of at most 1.

    They make the sum of weight times `worth` (m,) large. This is a cone programme, solved
    as a series of linear ones. Each linear one leaves every edge at least the room that the last solution takes.
    """
    sides = edges_of(places, 0), edges_of(places, 1)
    matrix = sparse.csc_array(sparse.vstack([one.cells for one in sides]))
    value = worth / math.hypot(*(one.cells.sum(axis=1).max() for one in sides))
    for _ in range(SHARPER):
        most = [one.most(value) for one in sides]
        total = np.maximum(np.hypot(*most), 1e-9)
        limits = []
        for one, load in zip(sides, most, strict=True):
            limit = np.ones(one.cells.shape[0])
            np.minimum.at(limit, one.of, (load / total)[:, None])
            limits.append(limit)
        value = np.where(worth > 0.0, np.maximum(worthiest(worth, matrix, np.concatenate(limits)), 0.0), 0.0)
        value /= max(float(np.hypot(*(one.most(value) for one in sides)).max()), 1e-9)
    return value
