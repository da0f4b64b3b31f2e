"""The origin of each robot's knowledge: the robot that sensed it, the links it came over, and its age.

The time since a cell's reading is the age of information (Kaul, Yates and Gruteser, "Real-time status: How often should
one update?", INFOCOM 2012), here of every cell of every robot's map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.lattice import Lattice
from swarmsim.core.state import Moment
from swarmsim.kernels import provenance
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.sharing.codecs import RelayedItems


class MapProvenance:
    """An observer that follows every reading to the maps it reaches; unlike any robot, it sees all messages.

    A piece of its sender's map has the origins that the sender knows when it arrives; with delayed messages these can
    be later than when it was sent.
    """

    def __init__(self, robots: int, lattice: Lattice) -> None:
        shape = (robots, *lattice.shape)
        by = memory.zeros(shape, np.int32)
        #: The origins of each cell, by robot.
        self.origins = provenance.Origins(
            memory.zeros(shape, np.int32), by, memory.zeros(shape, np.uint8),
            *(np.zeros(robots, np.int64) for _ in range(4)),
        )  # fmt: skip
        #: The mean age of what each live robot knows (t, n), in iterations; NaN for the dead.
        self.ages: list[NDArray[np.float64]] = []

    def sample(self, moment: Moment[Maps]) -> None:
        """Take note of one iteration."""
        tiles, accepted, state = moment.readings.tiled, moment.knowledge.accepted, moment.state
        content = accepted.content
        hops = content.hops if isinstance(content, RelayedItems) else np.ones(len(accepted), np.uint8)
        heard = content.values if len(accepted) else np.empty((0, *tiles.values.shape[1:]), np.uint8)
        provenance.trace(
            self.origins, state.iteration + 1, state.alive, tiles.values, tiles.origins, accepted.receivers,
            accepted.senders, heard, content.origins, content.sources, content.sensed, hops,
        )  # fmt: skip
        cells = np.maximum(self.origins.cells, 1)
        age = state.iteration + 1 - self.origins.total / cells
        self.ages.append(np.where(state.alive & (self.origins.cells > 0), age, np.nan))

    def age(self, robot: int) -> NDArray[np.float64]:
        """The age in iterations of a robot's knowledge of each cell (rows, columns); NaN for unknown cells."""
        sensed = self.origins.sensed[robot]
        return np.where(sensed > 0, len(self.ages) - sensed, np.nan)

    def summary(self) -> dict[str, float | int | None]:
        """The mean age over the run and at its end, the mean number of links, and the share sensed by others."""
        known = int(self.origins.cells.sum())
        ages = np.array(self.ages)
        return {
            "information_age": float(np.nanmean(ages)) if np.isfinite(ages).any() else None,
            "information_age_end": float(np.nanmean(ages[-1])) if len(ages) and np.isfinite(ages[-1]).any() else None,
            "information_hops": float(self.origins.links.sum() / known) if known else None,
            "information_heard": float(self.origins.heard.sum() / known) if known else None,
        }
