"""All robots' maps at any iteration, put together from a recording's changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.recording.reader import Recording


class MapReplay:
    """The maps of a recorded run, moved forward through its iterations."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        shape = (recording.scenario.robots.count, *recording.lattice.shape)
        self.maps: NDArray[np.uint8] = memory.zeros(shape, np.uint8)  # each cell UNKNOWN, FREE or OCCUPIED
        #: How many robots know each cell (rows, columns), and on how many maps it is occupied.
        self.known, self.held_occupied = np.zeros(shape[1:], np.int32), np.zeros(shape[1:], np.int32)
        self.iteration = -1  # the last one that the maps hold

    def advance(self, iteration: int) -> None:
        """Bring the maps to the state they had at the end of `iteration`; it cannot lie behind."""
        if iteration < self.iteration:
            raise ValueError(f"maps are at iteration {self.iteration} already; {iteration} lies behind")
        flat = self.maps.reshape(len(self.maps), -1)
        known, occupied = self.known.reshape(-1), self.held_occupied.reshape(-1)
        for t in range(self.iteration + 1, iteration + 1):
            changes = self._recording.changes(t)
            robot, cell, state = changes[:, 0], changes[:, 1], changes[:, 2]
            before = flat[robot, cell]  # a robot tells each cell at most once in an iteration
            flat[robot, cell] = state
            np.add.at(known, cell, (state != UNKNOWN).astype(np.int32) - (before != UNKNOWN))
            np.add.at(occupied, cell, (state == OCCUPIED).astype(np.int32) - (before == OCCUPIED))
        self.iteration = iteration

    def collective(self) -> NDArray[np.uint8]:
        """The union of all maps (rows, columns): OCCUPIED where a cell is on any robot's map."""
        known = np.where(self.known > 0, np.uint8(FREE), np.uint8(UNKNOWN))
        return np.where(self.held_occupied > 0, np.uint8(OCCUPIED), known)
