"""Occupancy grids: each robot's estimate of each cell (Elfes 1989)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Inbox
from swarmsim.core.readings import Tiles
from swarmsim.kernels import occupancy, trust
from swarmsim.operations.mapping.maps import TileItems


class OccupancyGrids:
    """One log-odds grid and one observed mask per robot.

    A cell that a tile shows as occupied gains logit(`hit`), one shown as free gains logit(`miss`) < 0;
    the sum stays within logit(`lowest`) and logit(`highest`). Cells never observed stay at 0, p = 0.5.
    """

    def __init__(self, robots: int, lattice: Lattice, hit: float, miss: float, lowest: float, highest: float) -> None:
        self.log_odds: NDArray[np.float32] = memory.zeros((robots, *lattice.shape), np.float32)
        self.observed: NDArray[np.bool_] = memory.zeros((robots, *lattice.shape), np.bool_)
        #: The log-odds of `hit`, `miss`, `lowest` and `highest`.
        self.steps = tuple(np.float32(math.log(p / (1.0 - p))) for p in (hit, miss, lowest, highest))

    def update(self, alive: NDArray[np.bool_], tiles: Tiles, inbox: Inbox[TileItems]) -> NDArray[np.int32]:
        """Add every live robot's own tile, then the readings it heard, in the inbox's order.

        Pieces of maps (source -1) come last and fill unknown cells only: the readings behind them may be in the
        receiver's map already, and would be counted twice.

        Gives (n + m,): how many cells each robot's own tile, then each tile heard, was the first to show it.
        """
        if inbox.content.sources.min(initial=0) < 0:
            return self._update_and_fill(alive, tiles, inbox)
        fresh = np.empty(len(alive) + len(inbox.receivers), np.int32)
        occupancy.fuse(
            self.log_odds,
            self.observed,
            alive,
            tiles.values,
            _evidence(tiles),
            tiles.origins,
            inbox.receivers,
            inbox.content.values,
            inbox.content.origins,
            *self.steps,
            fresh,
        )
        return fresh

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Empty the maps of these robots."""
        self.observed[robots] = False
        self.log_odds[robots] = 0.0

    def keep(self, robots: NDArray[np.int64], cells: NDArray[np.bool_]) -> None:
        """Let these robots forget all but some `cells` (n, rows, columns)."""
        self.observed[robots] &= cells[robots]
        self.log_odds[robots] *= cells[robots]

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's map to these robots."""
        self.observed[robots], self.log_odds[robots] = self.observed[source], self.log_odds[source]

    def _update_and_fill(self, alive: NDArray[np.bool_], tiles: Tiles, inbox: Inbox[TileItems]) -> NDArray[np.int32]:
        pieces = inbox.content.sources < 0
        fresh = np.empty(len(alive) + len(pieces), np.int32)
        told = fresh[len(alive) :]
        readings = inbox.take(~pieces)
        added = self.update(alive, tiles, readings)
        fresh[: len(alive)], told[~pieces] = added[: len(alive)], added[len(alive) :]
        filled = np.empty(np.count_nonzero(pieces), np.int32)
        occupancy.fill(
            self.log_odds,
            self.observed,
            inbox.receivers[pieces],
            inbox.content.values[pieces],
            inbox.content.origins[pieces],
            *self.steps,
            filled,
        )
        told[pieces] = filled
        return fresh


_NOTHING = np.empty((0, 0, 0), np.float32)


def _evidence(tiles: Tiles) -> NDArray[np.float32]:
    """The sensor's own evidence on cells (n, rows, columns); no rows if it gives none."""
    return _NOTHING if tiles.evidence is None else tiles.evidence


class QuorumGrids:
    """Occupancy grids of robots that trust their own sensing over messages.

    Messages never change a cell that the robot has sensed itself, and the first time it senses one, all that it has
    heard of it is void. Of other cells it accepts what `quorum` different senders, at any time, have said alike; then
    each further message that agrees counts as usual. With a quorum of 1 any sender will do.

    Senders are told apart by their ids modulo 64, not by the robot that sensed a tile: all robots that relay one
    robot's tile count, and so does every false name.
    """

    def __init__(self, grids: OccupancyGrids, quorum: int) -> None:
        self._grids = grids
        shape = grids.observed.shape
        sets = shape if quorum > 1 else (shape[0], 0, 0)
        free, occupied = (memory.zeros(sets, np.uint64) for _ in range(2))
        self._witnesses = trust.Votes(memory.zeros(shape, np.bool_), free, occupied, quorum)

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """Each robot's occupancy grid (n, rows, columns); a live view."""
        return self._grids.log_odds

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which cells each robot's map holds (n, rows, columns); a live view."""
        return self._grids.observed

    def update(self, alive: NDArray[np.bool_], tiles: Tiles, inbox: Inbox[TileItems]) -> NDArray[np.int32]:
        """Add every live robot's own tile, then what it accepts of the tiles it heard, as `OccupancyGrids` does.

        Gives (n + m,): how many cells each robot's own tile, then each tile heard, was the first to show it.
        """
        fresh = np.empty(len(alive) + len(inbox.receivers), np.int32)
        trust.fuse_warily(
            self.log_odds,
            self.observed,
            self._witnesses,
            alive,
            tiles.values,
            _evidence(tiles),
            tiles.origins,
            inbox.receivers,
            inbox.senders,
            inbox.content.sources < 0,
            inbox.content.values,
            inbox.content.origins,
            *self._grids.steps,
            fresh,
        )
        return fresh

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Empty the maps of these robots, and forget what they were told."""
        self._grids.reset(robots)
        for column in (self._witnesses.own, self._witnesses.free, self._witnesses.occupied):
            column[robots] = 0

    def keep(self, robots: NDArray[np.int64], cells: NDArray[np.bool_]) -> None:
        """Let these robots forget all but some `cells` (n, rows, columns), and what they were told."""
        self._grids.keep(robots, cells)
        for column in (self._witnesses.free, self._witnesses.occupied):
            if column.size:  # a quorum of 1 keeps no record
                column[robots] = 0

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's map to these robots, without its record of senders."""
        self._grids.copy_from(robots, source)
