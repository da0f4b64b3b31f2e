"""Sharing policies: what mapping robots tell each other."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Broadcast, Inbox
from swarmsim.core.readings import Tiles
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Senses
from swarmsim.kernels import occupancy
from swarmsim.operations.mapping.maps import Maps, PlainTiles, TileItems
from swarmsim.operations.mapping.sharing.codecs import (
    GOAL,
    GoalCodec,
    GoalItems,
    MapCodec,
    TileCodec,
    current_tile_bytes,
    map_bytes,
    pieces,
)


class CurrentTile(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells only the tile it senses now: no history, no relaying, no map."""

    def build(self, context: BuildContext) -> CurrentTileSharing:
        return CurrentTileSharing(context)


class CurrentTileSharing:
    """One tile per message."""

    def __init__(self, context: BuildContext) -> None:
        tile = tile_shape(context)
        self.codec = TileCodec(tile)
        self._ids = context.ids.astype(np.int32)
        self._ends = np.arange(1, len(self._ids) + 1, dtype=np.int64)
        self._sizes = np.full(len(self._ids), current_tile_bytes(*tile), np.int32)

    def say(self, senses: Senses, maps: Maps) -> Broadcast[TileItems]:
        """Every robot's own tile; a dead robot's is UNKNOWN, and no robot is linked to it."""
        tiles = tiles_of(senses)
        sensed = np.full(len(self._ids), senses.iteration, np.int32)
        items = PlainTiles(tiles.values, tiles.origins, self._ids, sensed)
        return Broadcast(items, self._ends, self._sizes, one_each=True)

    def accepted(self, senses: Senses, inbox: Inbox[TileItems]) -> Inbox[TileItems]:
        return inbox


class WholeMap(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells all that it knows: its map before it takes in this iteration's tiles and messages."""

    def build(self, context: BuildContext) -> WholeMapSharing:
        return WholeMapSharing(context)


class WholeMapSharing:
    """The known cells of a map, cut into tiles without a sensing robot (source -1).

    Such a tile is belief, not evidence: it fills only cells unknown to the receiver, as the reading behind it may
    have reached the receiver before, or come from the receiver itself.
    """

    def __init__(self, context: BuildContext) -> None:
        self._tile = tile_shape(context)
        self.codec = MapCodec(self._tile, context.lattice.shape)

    def say(self, senses: Senses, maps: Maps) -> Broadcast[TileItems]:
        """Every live robot's map; the dead say nothing."""
        known = cells_of(maps)
        known *= senses.alive[:, None, None]  # the dead's are UNKNOWN, 0
        owners, origins, values = pieces(known, self._tile)
        nobody, now = np.full(len(owners), -1, np.int32), np.full(len(owners), senses.iteration, np.int32)
        ends = np.searchsorted(owners, np.arange(len(known)), side="right")
        return Broadcast(PlainTiles(values, origins, nobody, now), ends, map_bytes(enclosing_cells(known)))

    def accepted(self, senses: Senses, inbox: Inbox[TileItems]) -> Inbox[TileItems]:
        return inbox


class TileAndGoal(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells the tile it senses now, the cell that it goes to explore and how far it has to go there.

    Goal and way are those decided in the iteration before: 6 bytes more than the tile alone.
    """

    def build(self, context: BuildContext) -> TileAndGoalSharing:
        return TileAndGoalSharing(context)


class TileAndGoalSharing:
    """One tile and one goal per message."""

    def __init__(self, context: BuildContext) -> None:
        self._tiles, self.codec = CurrentTileSharing(context), GoalCodec(tile_shape(context))
        self._lattice = context.lattice

    def say(self, senses: Senses, maps: Maps) -> Broadcast[GoalItems]:
        """Every robot's own tile and goal; a dead robot's tile is UNKNOWN, and no robot is linked to it."""
        said = self._tiles.say(senses, maps)
        items = GoalItems.of(said.content, *decided_goals(senses, self._lattice))
        return Broadcast(items, said.ends, said.sizes + np.int32(GOAL.size), one_each=True)

    def accepted(self, senses: Senses, inbox: Inbox[GoalItems]) -> Inbox[GoalItems]:
        return inbox


def tile_shape(context: BuildContext) -> tuple[int, int]:
    """Rows and columns of the tiles that robots sense. Raises InputError if their sensor gives none."""
    if "tiles" not in context.channels:
        raise InputError("sensor.use: this sensor gives no tiles, and robots that map need them; expected ir-ring")
    rows, columns = context.channels["tiles.values"].shape
    return rows, columns


def decided_goals(senses: Senses, lattice: Lattice) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The cells (n, 2) that robots chose to explore in the iteration before, -1 for none, and the ways left (n,)."""
    count, decided = len(senses.alive), senses.decided
    if decided is None:
        return np.full((count, 2), -1, np.int32), np.zeros(count, np.int32)
    return lattice.cells_within(decided.goals), np.minimum(decided.counts, 0xFFFF).astype(np.int32)


def tiles_of(senses: Senses) -> Tiles:
    """The tiles that robots sense."""
    return senses.readings.tiled


def cells_of(maps: Maps) -> NDArray[np.uint8]:
    """Every robot's map, each cell UNKNOWN, FREE or OCCUPIED (n, rows, columns)."""
    # Arithmetic on cell values is several times as fast as choosing between them.
    cells = np.uint8(OCCUPIED - FREE) * (maps.log_odds > 0.0) + np.uint8(FREE)
    cells *= maps.observed
    return cells


def mark_sensed(sensed: NDArray[np.bool_], alive: NDArray[np.bool_], tiles: Tiles) -> None:
    """Note in `sensed` (n, rows, columns) what each live robot's own tile shows."""
    nobody = np.empty(0, np.int32)
    occupancy.mark(sensed, alive, tiles.values, tiles.origins, nobody, tiles.values[:0], tiles.origins[:0])


def enclosing_cells(maps: NDArray[np.uint8]) -> NDArray[np.int32]:
    """The number of cells (n,) of the smallest rectangles around all known cells of the `maps` (n, rows, columns)."""
    known: NDArray[np.bool_] = maps != UNKNOWN
    height, width = (_spans(np.asarray(known.any(axis=axis))) for axis in (2, 1))
    return np.asarray(height * width, np.int32)


def _spans(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The span from the first to the last mark in each row (n, length), both included; 0 without any."""
    length = marked.shape[1]
    spans = length - marked.argmax(axis=1) - marked[:, ::-1].argmax(axis=1)
    return np.asarray(np.where(marked.any(axis=1), spans, 0))
