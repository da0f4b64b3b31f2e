"""The square cells that truth, tiles and occupancy grids share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Lattice:
    """A rectangle of square cells; row 0 lies at the smallest y, column 0 at the smallest x.

    The cell in row r and column c covers x in [x0 + c cell, x0 + (c + 1) cell); y with r.
    """

    WORD: ClassVar[int] = 8  #: columns are a multiple of this, so that a boolean grid can be read as 64-bit words

    x0: float  # m, left edge of column 0
    y0: float  # m, lower edge of row 0
    cell: float  # m
    rows: int
    columns: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper edge in metres, in matplotlib's order."""
        return self.x0, self.x0 + self.columns * self.cell, self.y0, self.y0 + self.rows * self.cell

    def cells(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The (row, column) of each point of `points` (..., 2), given as x, y in metres."""
        scaled = (np.asarray(points) - (self.x0, self.y0)) / self.cell
        return np.floor(scaled).astype(np.int64)[..., ::-1]

    def cells_within(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        """The same; -1, -1 for points outside or NaN."""
        found = np.floor((np.asarray(points) - (self.x0, self.y0)) / self.cell)[..., ::-1]
        inside = ((found >= 0.0) & (found < self.shape)).all(axis=-1, keepdims=True)
        return np.where(inside, found, -1.0).astype(np.int32)

    def centres(self, cells: NDArray[np.integer]) -> NDArray[np.float64]:
        """The x, y in metres of the centre of each (row, column) of `cells` (..., 2)."""
        return (np.asarray(cells)[..., ::-1] + 0.5) * self.cell + (self.x0, self.y0)
