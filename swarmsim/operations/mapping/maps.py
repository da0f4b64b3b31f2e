"""What mapping robots know: an occupancy grid each, and what has changed in it."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import Inbox
from swarmsim.core.parts import Setting
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Auditor, Knowledge, Observations, Record
from swarmsim.kernels import occupancy
from swarmsim.operations.mapping.message import TileItems


@dataclass(frozen=True, slots=True, eq=False)
class Maps(Knowledge):
    """The map of every robot, as the computation holds it: views, which cannot be written to."""

    observed: NDArray[np.bool_]  # (n, rows, columns): which cells each robot's map holds
    log_odds: NDArray[np.float32]  # (n, rows, columns): of being occupied; 0 where nothing is known
    changes: NDArray[np.int32]  # (c, 3): robot, row-major cell, new state UNKNOWN, FREE or OCCUPIED
    news: NDArray[np.int32]  # (n,): cells that what was sensed and heard now has shown to each robot for the first time
    taken: Inbox[TileItems]  # the tiles taken in of what was heard

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """What has changed, and by whose word."""
        return self.changes, self.taken.senders, self.taken.content.sources

    def record(self) -> Record:
        """What has changed: all maps can be put together from it."""
        return Record(lists={"changes": self.changes})

    def of(self, robot: int) -> SimpleNamespace:
        """A robot's map: `observed` and `log_odds` (rows, columns), and the `news` in it."""
        observed, log_odds = self.observed[robot], self.log_odds[robot]
        return SimpleNamespace(observed=observed, log_odds=log_odds, news=int(self.news[robot]))

    @classmethod
    def auditor(cls, setting: Setting) -> MapAuditor:
        """What compares maps with the tiles that were sensed and heard."""
        return MapAuditor(setting)


class MapAuditor(Auditor):
    """Robots can know of a cell only what a tile of their own, or one that they heard, has shown."""

    def __init__(self, setting: Setting) -> None:
        shape = (setting.robots.count, setting.lattice.rows * setting.lattice.columns)
        self._columns = setting.lattice.columns
        self._shown: NDArray[np.bool_] = np.zeros(shape, np.bool_)  # by any tile so far
        self._known: NDArray[np.bool_] = np.zeros(shape, np.bool_)  # as the changes say
        self._counts = np.zeros(shape[0], np.int64)
        self._union = np.zeros(shape[1] // 8, np.uint64)
        self._everywhere = np.full(shape[1] // 8, 0x0101010101010101, np.uint64)

    def audit(self, knowledge: Any, observations: Observations) -> str | None:
        """The first cell that a robot cannot know, or a map that differs from its changes."""
        robots, cells = self._known.shape
        changes = knowledge.changes
        if changes.dtype != np.int32 or changes.ndim != 2 or changes.shape[1] != 3:
            return f"changes: {changes.dtype} of shape {changes.shape}; expected int32 of (c, 3)"
        robot, cell, state = changes.T
        if len(changes) and not (
            0 <= robot.min() <= robot.max() < robots and 0 <= cell.min() <= cell.max() < cells
            and UNKNOWN <= state.min() <= state.max() <= OCCUPIED
        ):  # fmt: skip
            return "changes: a robot, cell or state that there is not"
        self._learn(observations)
        claimed = state >= FREE
        idle = claimed & ~self._shown[robot, cell]
        if idle.any():
            at = int(np.flatnonzero(idle)[0])
            row, column = divmod(int(cell[at]), self._columns)
            return f"robot {robot[at]} claims to know cell ({row}, {column}), which no tile has shown it"
        before = self._known[robot, cell]
        self._known[robot, cell] = claimed
        np.add.at(self._counts, robot, claimed.astype(np.int64) - before)
        if knowledge.observed.shape[0] != robots or knowledge.observed.size != robots * cells:
            return f"observed: shape {knowledge.observed.shape}; expected one grid for each robot"
        words = knowledge.observed.reshape(robots, -1).view(np.uint64)
        held, _ = occupancy.count_observed(words, self._everywhere, self._union)
        wrong = np.flatnonzero(held != self._counts)
        if len(wrong):
            i = int(wrong[0])
            return f"robot {i}'s map holds {held[i]} cells, but its changes say {self._counts[i]}"
        return None

    def _learn(self, observations: Observations) -> None:
        tiles, inbox = observations.readings.tiles, observations.inbox
        assert tiles is not None
        assert inbox is not None
        rows = (len(self._shown), -1, self._columns)
        occupancy.mark(
            self._shown.reshape(rows), observations.alive, tiles.values, tiles.origins,
            inbox.receivers, inbox.content.values, inbox.content.origins,
        )  # fmt: skip

    def forget(self, robots: NDArray[np.int64]) -> None:
        """Their evidence is gone with their maps."""
        self._shown[robots] = False

    def adopt(self, robots: NDArray[np.int64], source: int) -> None:
        """What was shown to another was shown to them."""
        self._shown[robots] |= self._shown[source]
