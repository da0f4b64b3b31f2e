"""Which robots see each other past the present walls."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.building import Building
from swarmsim.kernels import rays, sight

MARGIN: Final = 1e-6  # of a square of the coarse grid: rounding must not hide a wall along its border
MOST_SQUARES: Final = 20_000  # of the coarse grid: sorting takes the number of walls times this


class Sight:
    """The walls of a building, sorted by place and re-sorted when they change."""

    def __init__(self, building: Building) -> None:
        self._building = building
        self._prepare()

    def _prepare(self) -> None:
        """Sort the present walls by place, about one per square."""
        walls, self._version = self._building.walls.copy(), self._building.version
        ends = walls.reshape(-1, 2) if len(walls) else np.zeros((1, 2))
        (x0, y0), (width, height) = ends.min(axis=0), np.ptp(ends, axis=0)
        squares = min(max(len(walls), 1), MOST_SQUARES)
        side = max(math.sqrt(width * height / squares), max(width, height) / squares) or 1.0
        coarse = (float(x0), float(y0), side, int(height / side) + 1, int(width / side) + 1)
        self._walls, self._coarse = walls, coarse
        self._start, self._members = rays.bins(walls, MARGIN * side, *coarse)

    def clear(self, pose: NDArray[np.float64], edges: NDArray[np.int32]) -> NDArray[np.int32]:
        """The edges (e, 2) between robots at `pose` (n, 3) that no wall crosses or touches."""
        if self._version != self._building.version:
            self._prepare()
        found: NDArray[np.int32] = sight.in_sight(pose, edges, self._walls, self._start, self._members, self._coarse)
        return found
