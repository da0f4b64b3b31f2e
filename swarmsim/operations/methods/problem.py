"""What a method is given: equations, a step in time, and the cells of each piece."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Piece, Values
from swarmsim.operations.models.emitters import Forcing
from swarmsim.operations.models.equations import Equations

Cells = NDArray[np.int64]  # numbers of a domain's cells


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Equations, what is given off, and the step in time."""

    equations: Equations
    forcing: Forcing
    dt: float  # s

    def gain(self, fields: Values, cells: Cells, begin: float, end: float) -> Values:
        """The rate (c, k) of all but L u, at these cells (c,) with these fields (c, k), between two times (s)."""
        found = self.equations.inflow[cells].copy()
        found[:, 0] += self.forcing(cells, begin, end)
        reaction = self.equations.reaction
        return found if reaction is None else found + reaction(fields)

    def check_step(self, limit: float, method: str, instead: str) -> None:
        """Raise InputError for a step longer than `limit` (s)."""
        name, value = self.equations.pace
        m = self.equations.order
        if limit <= 0.0:
            raise InputError(
                "model.scheme: no explicit step is stable where values may grow, as with central differences and a "
                'cell Peclet number v h / D over 2; expected "upwind", smaller cells, or a weaker draught'
            )
        if self.dt > limit * (1.0 + 1e-12):
            raise InputError(
                f"dt: {self.dt:g} s is more than {method} steps bear: {name} is {value * self.dt**m:.4g}, and the "
                f"limit is {value * limit**m:.4g} (dt = {limit:.6g} s); expected a shorter step{instead}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """The cells of a piece, as numbers of the domain's cells in rising order."""

    piece: int
    own: Cells  # (c,)
    seen: Cells  # (s,): with those of its halo
    mine: Cells  # (c,): where its own are among those seen
    others: Cells  # (h,): where those of the halo are, in its order
    rim: Cells  # (r,): indices of its own that others see

    @classmethod
    def of(cls, piece: Piece, number: NDArray[np.int64]) -> Self:
        """The patch of a piece, from the numbers (rows, columns) of cells."""
        own, halo = (number[cells[:, 0], cells[:, 1]] for cells in (piece.cells, piece.halo))
        seen = np.sort(np.concatenate([own, halo]))
        return cls(piece.number, own, seen, np.searchsorted(seen, own), np.searchsorted(seen, halo), piece.rim)

    def joined(self, own: Values, around: Values) -> Values:
        """The values (s, k) of all cells seen, from those of its own (c, k) and of the halo (h, k)."""
        found = np.empty((len(self.seen), own.shape[1]))
        found[self.mine], found[self.others] = own, around.reshape(len(self.others), own.shape[1])
        return found

    def rows(self, operator: sparse.csr_array, cells: Cells) -> sparse.csr_array:
        """An operator's rows of some cells, with the columns of the cells seen.

        Raises InputError if they read cells beyond the halo.
        """
        whole = operator[cells]
        found = whole[:, self.seen].tocsr()
        if found.nnz != whole.nnz:
            raise InputError(
                f"method: piece {self.piece} reads {whole.nnz - found.nnz} values beyond its halo; expected halos one "
                "cell wider than the overlap"
            )
        return found
