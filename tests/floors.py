"""Small floors to solve equations on, and matrices of them that are put together cell by cell, in another way."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from swarmsim.core.jobs import Domain
from swarmsim.core.lattice import Lattice
from swarmsim.jobs.alone import alone
from swarmsim.jobs.pieces import bisected
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob


def floor(rows=12, columns=12, cell=0.15, pillars=()) -> Domain:
    """A rectangle without some rows and columns (top left lower right)."""
    free = np.ones((rows, columns), bool)
    for low, left, high, right in pillars:
        free[low:high, left:right] = False
    return Domain(Lattice(0.0, 0.0, cell, rows, columns), free)


def rooms() -> Domain:
    """Two rooms with a door between them, a pillar, and a bay."""
    return floor(18, 26, pillars=((0, 12, 7, 13), (10, 12, 18, 13), (5, 4, 8, 7), (0, 20, 3, 26)))


def places(domain: Domain) -> np.ndarray:
    """The centres of the free cells."""
    return Faces.of(domain).places


def nothing(cells, begin, end) -> np.ndarray:
    """No source at all."""
    return np.zeros(len(cells))


def solved(model, method, domain, start, dt, times, count=1, forcing=nothing, cut=None) -> np.ndarray:
    """The field (n,) after `times` steps in time, in `count` pieces or in those of `cut`."""
    problem = Problem(model.on(domain), forcing, dt)
    pieces = bisected(domain, count, method.halo) if cut is None else cut
    return answer(ModelJob.on(problem, method, domain, pieces, times * method.exchanges), domain, start)


def answer(job: ModelJob, domain: Domain, start) -> np.ndarray:
    """The field (n,) that a job gives from a start (n,)."""
    number = Faces.of(domain).number
    its = [number[tuple(piece.cells.T)] for piece in job.cut]
    found = np.full(len(start), np.nan)
    for piece, cells, state in zip(job.cut, its, alone(job, job.cut, [start[cells] for cells in its]), strict=True):
        found[cells] = job.answer(piece, state)
    return found


def laplacian(domain: Domain, fixed: float | None = None) -> tuple[sparse.csc_array, np.ndarray]:
    """laplace(u) = A u + b, one cell after the other: a fixed wall is as far away as half a cell."""
    cells = [tuple(cell) for cell in np.argwhere(domain.free).tolist()]
    number = {cell: place for place, cell in enumerate(cells)}
    matrix, right = sparse.dok_array((len(cells), len(cells))), np.zeros(len(cells))
    for (row, column), place in number.items():
        for beside in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
            if beside in number:
                matrix[place, place] -= 1.0
                matrix[place, number[beside]] += 1.0
            elif fixed is not None:
                matrix[place, place] -= 2.0
                right[place] += 2.0 * fixed
    return matrix.tocsc() / domain.lattice.cell**2, right / domain.lattice.cell**2


def orders(errors, steps) -> np.ndarray:
    """The orders of convergence between one step size and the next."""
    return np.diff(np.log(errors)) / np.diff(np.log(steps))
