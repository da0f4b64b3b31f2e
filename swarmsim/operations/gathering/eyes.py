"""What robots sense of a field, and in which cell they take themselves to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.state import Senses


class Eyes:
    """The latest sample of each robot served."""

    def __init__(self, context: BuildContext, number: NDArray[np.int64]) -> None:
        """`number` (rows, columns) is that of each cell of the floor; -1 elsewhere."""
        self._lattice, self._number = context.lattice, number
        self._rows = {robot: row for row, robot in enumerate(context.ids.tolist())}
        self._cells, self._values = np.full(len(self._rows), -1), np.zeros(len(self._rows))

    def look(self, senses: Senses) -> None:
        """Read all sensors."""
        place, value = senses.pose[:, :2], np.asarray(senses.readings["field"], np.float64)
        cells = self._lattice.cells_within(place)
        inside = (cells >= 0).all(axis=1) & np.isfinite(value)
        self._cells, self._values = np.full(len(place), -1), value
        self._cells[inside] = self._number[tuple(cells[inside].T)]

    def of(self, robot: int) -> tuple[int, float]:
        """The cell and the value of a robot's sample; no cell, -1, if it has none."""
        row = self._rows[robot]
        return int(self._cells[row]), float(self._values[row])
