"""Candidates: cells where a source may be, from a coarse choice down to single cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain

Whole = NDArray[np.int64]

NEAR = 0.75  #: how far finer candidates are from a coarser one, at most, in units of its spacing


class SourceCandidates:
    """Levels of candidates: squares of `spacing`, half of it, and so on; the last level is of all cells.

    A square is represented by the free cell nearest to the middle of its free cells.
    """

    def __init__(self, domain: Domain, spacing: float) -> None:
        """Raises InputError for a spacing (m) smaller than a cell."""
        #: The side of a cell, m.
        self.cell = cell = domain.lattice.cell
        if spacing < cell:
            raise InputError(f"spacing: {spacing:g} m is less than a cell, {cell:g} m; expected at least that")
        #: The centres (n, 2) of free cells: x, y in m.
        self.places = domain.lattice.centres(np.argwhere(domain.free))
        low = self.places.min(axis=0) - cell / 2
        sizes = [spacing / 2**level for level in range(math.ceil(math.log2(spacing / cell) - 1e-9))]
        self._sizes = [*sizes, cell]
        self._levels = [*(self._squares(size, low) for size in sizes), np.arange(len(self.places))]

    @property
    def levels(self) -> int:
        """The number of levels."""
        return len(self._levels)

    @property
    def coarse(self) -> Whole:
        """The candidates (c,) of the first level: numbers of free cells."""
        return self._levels[0]

    def finer(self, level: int, cells: Whole) -> Whole:
        """The candidates (c,) of the level after this one near to cells (b,), in rising order."""
        below, reach = self._levels[level + 1], NEAR * self._sizes[level] * (1.0 + 1e-9)
        apart = np.abs(self.places[below][:, None] - self.places[cells]).max(axis=2)
        return np.asarray(below[(apart <= reach).any(axis=1)])

    def _squares(self, size: float, low: NDArray[np.float64]) -> Whole:
        square = np.floor((self.places - low) / size + 1e-9).astype(np.int64)
        _, of = np.unique(square, axis=0, return_inverse=True)
        of = of.ravel()
        middle = np.stack([np.bincount(of, side) for side in self.places.T], axis=1) / np.bincount(of)[:, None]
        away = np.hypot(*(self.places - middle[of]).T)
        order = np.lexsort((np.arange(len(of)), np.round(away, 9), of))
        return np.sort(order[np.unique(of[order], return_index=True)[1]])
