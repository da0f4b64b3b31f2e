"""Occupancy grids: what each robot believes of each cell (Elfes 1989)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.lattice import Lattice
from swarmsim.core.state import Inbox, Tiles
from swarmsim.kernels import grid


class OccupancyGrids:
    """One log-odds grid and one observed mask per robot.

    A cell that a tile shows as occupied gains logit(`hit`), one shown as free gains logit(`miss`) < 0;
    the sum stays within logit(`lowest`) and logit(`highest`). Cells never observed stay at 0, p = 0.5.
    """

    def __init__(self, robots: int, lattice: Lattice, hit: float, miss: float, lowest: float, highest: float) -> None:
        self.log_odds: NDArray[np.float32] = np.zeros((robots, *lattice.shape), np.float32)
        self.observed: NDArray[np.bool_] = np.zeros((robots, *lattice.shape), np.bool_)
        self._steps = tuple(np.float32(math.log(p / (1.0 - p))) for p in (hit, miss, lowest, highest))

    def update(self, alive: NDArray[np.bool_], tiles: Tiles, inbox: Inbox) -> NDArray[np.int32]:
        """Add every live robot's own tile, then the tiles it heard, in the inbox's order.

        Gives (n + m,): how many cells each robot's own tile, then each message, was the first to show it.
        """
        fresh = np.empty(len(alive) + len(inbox.receivers), np.int32)
        grid.fuse(
            self.log_odds,
            self.observed,
            alive,
            tiles.values,
            tiles.origins,
            inbox.receivers,
            inbox.values,
            inbox.origins,
            *self._steps,
            fresh,
        )
        return fresh
