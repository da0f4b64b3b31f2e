"""The knowledge of mapping robots: an occupancy grid each, and its changes."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, fields
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Knowledge, Record, Senses
from swarmsim.kernels import checks, occupancy


@dataclass(frozen=True, slots=True, eq=False)
class TileItems(MessageBatch, ABC):
    """The tiles in messages."""

    PROVENANCE: ClassVar[tuple[str, ...]] = ("sources", "sensed")
    SOURCE: ClassVar = "sources"
    SILENT: ClassVar = {"values": UNKNOWN}

    values: NDArray[np.uint8]  # (t, rows, columns)
    origins: NDArray[np.int32]  # (t, 2): row and column of each tile's lower-left cell
    sources: NDArray[np.int32]  # (t,): the robot that sensed it; -1 for a piece of the sender's map
    sensed: NDArray[np.int32]  # (t,): the iteration in which it was sensed


@dataclass(frozen=True, slots=True, eq=False)
class PlainTiles(TileItems):
    """Tiles only."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Other robots' frames of reference, as found by robots that started without knowing each other's places."""

    known: NDArray[np.bool_]  # (n, N): whether each robot can place the data of each of the swarm
    #: (n, N, 3): its true error in placing them: a turn about the grid's corner (rad), then rows and columns (cells).
    #: All are 0 where it is right.
    errors: NDArray[np.float64]
    places: NDArray[np.int32]  # (n, N): where their maps left room for each other's at the last comparison; 0: never
    withdrawn: NDArray[np.int32]  # (n,): frames that each once knew and then no longer, or elsewhere
    spoilt: NDArray[np.bool_]  # (n,): robots that forget, in this iteration, what they have not ...
    sensed: NDArray[np.bool_]  # (n, rows, columns): ... sensed themselves

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """(n, N): robots that have compared their maps, where the first does not know the second's frame."""
        return np.asarray((self.places > 0) & ~self.known)

    def views(self) -> Frames:
        """Views of the same arrays: readers may be kept from writing while the sharing policy still does."""
        return Frames(*(getattr(self, field.name).view() for field in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Maps(Knowledge):
    """The map of every robot, as the computation holds it: read-only views."""

    observed: NDArray[np.bool_]  # (n, rows, columns): which cells each robot's map holds
    log_odds: NDArray[np.float32]  # (n, rows, columns): of being occupied; 0 where unknown
    changes: NDArray[np.int32]  # (c, 3): robot, row-major cell, new state UNKNOWN, FREE or OCCUPIED
    new_cells: NDArray[np.int32]  # (n,): cells that each robot first learned of now, by sensing or hearing
    accepted: Inbox[TileItems]  # the tiles heard and taken in, where the robot places them
    frames: Frames | None = None  # None: all know each other's places from the start

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """The changes, and their sources."""
        return self.changes, self.accepted.senders, self.accepted.content.sources

    def record(self) -> Record:
        """The changes: all maps can be put together from them."""
        return Record(lists={"changes": self.changes}, of_robots=("changes",))

    def of(self, robot: int) -> SimpleNamespace:
        """A robot's map: `observed` and `log_odds` (rows, columns), and the `news` in it."""
        observed, log_odds = self.observed[robot], self.log_odds[robot]
        return SimpleNamespace(observed=observed, log_odds=log_odds, new_cells=int(self.new_cells[robot]))

    def terrain(self, robot: int) -> NDArray[np.uint8]:
        """A robot's map (rows, columns): UNKNOWN, FREE where it is more likely free than not, else OCCUPIED."""
        known = np.where(self.log_odds[robot] < 0.0, np.uint8(FREE), np.uint8(OCCUPIED))
        return np.asarray(known * self.observed[robot], np.uint8)

    @classmethod
    def auditor(cls, context: BuildContext) -> MapAuditor:
        """The check of maps against the tiles sensed and heard."""
        return MapAuditor(context)


class MapAuditor:
    """Robots can know a cell only from a tile of their own, or one that they heard."""

    def __init__(self, context: BuildContext) -> None:
        shape = (len(context.ids), context.lattice.rows * context.lattice.columns)
        self._columns = context.lattice.columns
        self._shown: NDArray[np.bool_] = memory.zeros(shape, np.bool_)  # by any tile so far
        self._known: NDArray[np.bool_] = memory.zeros(shape, np.bool_)  # as the changes say
        self._words = self._known.view(np.uint64)

    def audit(self, knowledge: Knowledge, senses: Senses, inbox: Inbox[MessageBatch]) -> str | None:
        """The first cell that a robot cannot know, or a map that contradicts its changes.

        Every change is checked at once, since measures and recordings use changes; whole maps, which strategies use,
        are checked in turns.
        """
        if not isinstance(knowledge, Maps):
            return f"{type(knowledge).__name__}; expected Maps"
        changes, observed = knowledge.changes, knowledge.observed
        if changes.dtype != np.int32 or changes.ndim != 2 or changes.shape[1] != 3:
            return f"changes: {changes.dtype} of shape {changes.shape}; expected int32 of (c, 3)"
        if observed.dtype != np.bool_ or observed.shape[0] != len(self._known) or observed.size != self._known.size:
            return f"observed: {observed.dtype} of shape {observed.shape}; expected one grid of bool for each robot"
        wrong_word = self._learn(knowledge, senses, inbox)
        if wrong_word is not None:
            return wrong_word
        words = observed.reshape(len(observed), -1).view(np.uint64)
        wrong, at = checks.audit(changes, self._shown, self._known, self._words, words, senses.iteration)
        if wrong == 1:
            return f"changes[{at}]: {changes[at].tolist()}: a robot, cell or state that does not exist"
        if wrong == 2:
            row, column = divmod(int(changes[at, 1]), self._columns)
            return f"robot {changes[at, 0]} claims to know cell ({row}, {column}), which no tile has shown it"
        if wrong == 3:
            held, told = (int(np.count_nonzero(cells[at])) for cells in (observed, self._known))
            return f"robot {at}'s map holds {held} cells, but its changes say {told}"
        return None

    def _learn(self, knowledge: Maps, senses: Senses, inbox: Inbox[MessageBatch]) -> str | None:
        """Note the cells shown; for robots that place tiles by an estimate, at those places."""
        tiles = senses.readings.tiled
        if knowledge.frames is not None:
            heard = set(zip(inbox.receivers.tolist(), inbox.senders.tolist(), strict=True))
            inbox = knowledge.accepted
            for pair in zip(inbox.receivers.tolist(), inbox.senders.tolist(), strict=True):
                if pair not in heard:
                    return f"accepted: robot {pair[0]} took in what robot {pair[1]} has not told it"
        content: Any = inbox.content  # third-party ones have the needed columns of TileItems
        rows = (len(self._shown), -1, self._columns)
        occupancy.mark(
            self._shown.reshape(rows), senses.alive, tiles.values, tiles.origins,
            inbox.receivers, content.values, content.origins,
        )  # fmt: skip
        return None

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Their evidence is gone with their maps."""
        self._shown[robots] = False

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Cells shown to another robot count as shown to them."""
        self._shown[robots] |= self._shown[source]
