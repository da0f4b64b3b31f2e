"""Everybody's map at any iteration, rebuilt from the tiles and links of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.behaviours.collective_mapping import CollectiveMapping
from swarmsim.behaviours.mapping import OccupancyGrids
from swarmsim.core import registry
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Inbox, Tiles
from swarmsim.recording import Recording


class MapReplay:
    """The occupancy grids of a recorded run, moved forward through its iterations."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        p = registry.part("behaviour", recording.scenario.behaviour)
        if not isinstance(p, CollectiveMapping):
            p = CollectiveMapping()
        count = recording.scenario.robots.count
        self.grids = OccupancyGrids(count, recording.lattice, p.hit, p.miss, p.lowest, p.highest)
        self.iteration = -1  # the last one that the maps hold

    def advance(self, iteration: int) -> None:
        """Bring the maps to the state they had after mapping in `iteration`; it cannot lie behind."""
        if iteration < self.iteration:
            raise ValueError(f"maps are at iteration {self.iteration} already; {iteration} lies behind")
        recording = self._recording
        for t in range(self.iteration + 1, iteration + 1):
            values, origins, links = recording["tiles"][t], recording["origins"][t], recording.links(t)
            receivers, senders = links[:, 0], links[:, 1]
            inbox = Inbox(receivers, senders, values[senders], origins[senders])
            self.grids.update(recording["alive"][t], Tiles(values, origins), inbox)
        self.iteration = iteration

    def collective(self) -> NDArray[np.uint8]:
        """The union of all maps (rows, columns): OCCUPIED where any robot that saw the cell believes so."""
        union = np.full(self._recording.lattice.shape, UNKNOWN, np.uint8)
        union[self.grids.observed.any(axis=0)] = FREE
        union[(self.grids.observed & (self.grids.log_odds > 0.0)).any(axis=0)] = OCCUPIED
        return union
