"""The cells of a domain, and the faces between them: the ground of finite volumes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain

Whole = NDArray[np.int64]

_SIDES: Final = ((0, 1), (1, 0), (0, -1), (-1, 0))  # rows, columns: right, up, left, down


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """The free cells of a domain, numbered by row, then column, and their sides.

    A wall is *outer* if it belongs to the solid that reaches the edge of the lattice, the edge itself included; the
    others are those of pillars and islands.
    """

    domain: Domain
    number: Whole  # (rows, columns): of each free cell; -1 elsewhere
    pairs: Whole  # (f, 2): cells that share a face, the left or lower one first
    rises: NDArray[np.bool_]  # (f,): whether the second cell of a pair is above, not to the right
    walls: Whole  # (w,): the cell of each face without a free cell beyond
    normals: NDArray[np.float64]  # (w, 2): x, y out of the cell
    outer: NDArray[np.bool_]  # (w,)

    @classmethod
    def of(cls, domain: Domain) -> Self:
        """The faces of a domain. Raises InputError without a free cell."""
        free = np.pad(domain.free, 1)
        if not free.any():
            raise InputError("no free cell to compute on; expected a building with a floor")
        number = np.full(free.shape, -1)
        number[free] = np.arange(free.sum())
        solid, _ = ndimage.label(~free, np.ones((3, 3)))
        cells, pairs, walls = np.argwhere(free), [], []
        for row, column in _SIDES:
            beyond = cells + np.array([row, column])
            there = number[tuple(beyond.T)]
            if row + column > 0:
                pairs.append((np.stack([np.arange(len(cells)), there], axis=1)[there >= 0], row))
            closed = np.flatnonzero(there < 0)
            walls.append((closed, (column, row), solid[tuple(beyond[closed].T)] == solid[0, 0]))
        return cls(
            domain,
            number[1:-1, 1:-1],
            np.concatenate([pair for pair, _ in pairs]),
            np.concatenate([np.full(len(pair), row > 0) for pair, row in pairs]),
            np.concatenate([cell for cell, _, _ in walls]),
            np.concatenate([np.tile(np.array(normal, float), (len(cell), 1)) for cell, normal, _ in walls]),
            np.concatenate([outer for _, _, outer in walls]),
        )

    @property
    def count(self) -> int:
        """The number of free cells."""
        return int(self.domain.free.sum())

    @property
    def places(self) -> NDArray[np.float64]:
        """The centres (n, 2) of the free cells: x, y in m."""
        return self.domain.lattice.centres(np.argwhere(self.domain.free))

    def matrix(
        self, first: NDArray[np.float64], second: NDArray[np.float64], own: NDArray[np.float64]
    ) -> sparse.csr_array:
        """The matrix (n, n) that multiplies pairs' second cells by `first` (f,) in the rows of their first ones.

        `second` (f,) is for the other way; the diagonal is `own` (n,).
        """
        i, j = self.pairs.T
        every = np.arange(self.count)
        rows, columns = np.concatenate([i, j, every]), np.concatenate([j, i, every])
        made = sparse.coo_array((np.concatenate([first, second, own]), (rows, columns)), (self.count, self.count))
        return made.tocsr()

    def summed(self, cells: Whole, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The sum (n,) of values (w,) at each cell."""
        return np.bincount(cells, values, self.count).astype(np.float64)
