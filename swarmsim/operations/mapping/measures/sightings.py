"""What robots have truly seen of the building, wherever their maps show it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.lattice import Lattice
from swarmsim.core.state import FREE, OCCUPIED, Elapsed, Knowledge
from swarmsim.kernels import occupancy
from swarmsim.recording.measures import share_of


class Sightings:
    """The cells that robots' own tiles have shown, as free or occupied, at their true places."""

    def __init__(self, lattice: Lattice) -> None:
        self._lattice = lattice
        self._shown = memory.zeros((2, *lattice.shape), np.bool_)  # as FREE, and as OCCUPIED

    def add(self, done: Elapsed[Knowledge]) -> None:
        """Take in the tiles of one iteration, each at its robot's true place."""
        tiles, state = done.readings.tiled, done.state
        origins = tiles.origins
        if done.believed is not None and done.believed is not state.pose:
            cells = self._lattice.cells
            origins = (origins - (cells(done.believed[:, :2]) - cells(state.pose[:, :2]))).astype(np.int32)
        live = np.flatnonzero(state.alive)
        values, nobody = tiles.values[live], np.empty(0, np.bool_)
        seen = np.concatenate([values == FREE, values == OCCUPIED]).view(np.uint8)
        kinds = np.repeat(np.arange(2, dtype=np.int32), len(live))
        occupancy.mark(self._shown, nobody, seen[:0], origins[:0], kinds, seen, np.tile(origins[live], (2, 1)))

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which cells any robot has seen (rows, columns)."""
        return np.asarray(self._shown.any(axis=0))

    def agree(self, cells: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Where maps (..., rows, columns) show what some robot has seen there."""
        free, occupied = self._shown
        return np.asarray(((cells == FREE) & free) | ((cells == OCCUPIED) & occupied))

    def share(self, cells: NDArray[np.uint8]) -> float | None:
        """The share of the known cells of a map (rows, columns) that `agree`; None for a map that knows none."""
        return share_of(int(np.count_nonzero(self.agree(cells))), int(np.count_nonzero(cells)))
