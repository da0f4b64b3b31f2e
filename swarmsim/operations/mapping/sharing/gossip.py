"""Gossip: besides its tile each robot tells one piece of its map per iteration, so that its knowledge spreads."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, FrameError, Inbox
from swarmsim.core.state import FREE, OCCUPIED, Senses
from swarmsim.operations.mapping.maps import Maps, PlainTiles, TileItems
from swarmsim.operations.mapping.sharing.codecs import (
    GOAL,
    GoalItems,
    current_tile_bytes,
    pack,
    pack_cells,
    pack_goal,
    packed_bytes,
    unpack,
    unpack_cells,
    unpack_goal,
)
from swarmsim.operations.mapping.sharing.policies import decided_goals, tile_shape, tiles_of

#: Before the cells of a piece of map: the row and column of its lower-left cell (2 bytes each, signed), big-endian.
PIECE: Final = struct.Struct(">hh")


def piece_bytes(rows: int, columns: int) -> int:
    """The bytes that a piece of its sender's map adds to a message: PIECE and the cells; 15 bytes for 6 x 7."""
    return PIECE.size + packed_bytes(rows * columns)


class Gossip(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells its tile and, of its map cut into tiles, the piece that has waited longest since it changed.

    Once all changes have been told, it starts again with the piece told longest ago. A piece is belief, not evidence:
    it fills only cells unknown to the receiver, as in sharing whole maps. So knowledge spreads through the network like
    a rumour (Demers et al. 1987), in messages of constant length. With `goals` each robot also tells the cell that it
    goes to explore and how far it has to go there, as in `tile-and-goal`: 6 bytes more.
    """

    goals: bool | None = None  # default: false

    def build(self, context: BuildContext) -> GossipSharing:
        return GossipSharing(context, bool(self.goals))


class GossipSharing:
    """A tile and a piece of map per message, and a goal if robots tell theirs."""

    def __init__(self, context: BuildContext, goals: bool = False) -> None:
        self.codec = GossipCodec(tile_shape(context), goals)
        self._goals, self._lattice = goals, context.lattice
        self._ids = context.ids.astype(np.int32)
        self._robots = np.arange(len(self._ids), dtype=np.int32)  # their rows
        self._grid, self._tile = context.lattice.shape, tile_shape(context)
        self._across = -(-self._grid[1] // self._tile[1])  # pieces of a map, side by side
        shape = len(self._ids), -(-self._grid[0] // self._tile[0]) * self._across
        self._changed, self._told = (memory.zeros(shape, np.int32) for _ in range(2))  # iterations from 1; 0: never

    def say(self, senses: Senses, maps: Maps) -> Broadcast[TileItems]:
        """Every live robot's own tile, then a piece of its map; the dead say nothing."""
        tiles, alive, now = tiles_of(senses), senses.alive, senses.iteration
        robot, cell = maps.changes[:, 0], maps.changes[:, 1]
        row, column = np.divmod(cell, self._grid[1])
        self._changed[robot, row // self._tile[0] * self._across + column // self._tile[1]] = now + 1
        tellers, pieces = self._chosen(alive)
        self._told[tellers, pieces] = now + 1
        corners = np.stack(np.divmod(pieces, self._across), axis=1) * np.array(self._tile)
        speakers = np.concatenate([self._robots[alive], tellers])
        order = np.argsort(speakers, kind="stable")
        items = PlainTiles(
            np.concatenate([tiles.values[alive], self._cells(maps, tellers, corners)])[order],
            np.concatenate([tiles.origins[alive], corners.astype(np.int32)])[order],
            np.concatenate([self._ids[alive], np.full(len(tellers), -1, np.int32)])[order],
            np.full(len(order), now, np.int32),
        )
        sizes = alive * np.int32(current_tile_bytes(*self._tile))
        sizes[tellers] += np.int32(piece_bytes(*self._tile))
        ends = np.searchsorted(speakers[order], self._robots, side="right")
        if not self._goals:
            return Broadcast(items, ends, sizes)
        goals, left = decided_goals(senses, self._lattice)
        told, whose = items.sources >= 0, speakers[order]
        with_goals = GoalItems.of(items, np.where(told[:, None], goals[whose], np.int32(-1)), left[whose] * told)
        return Broadcast(with_goals, ends, sizes + alive * np.int32(GOAL.size))

    def _chosen(self, alive: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Which robots have a piece to tell, and which one: first news, then anything known."""
        never = np.iinfo(np.int32).max
        is_news = self._changed > self._told
        waiting = np.where(is_news, self._changed, never)
        known = np.where(self._changed > 0, self._told, never)
        pieces = np.where(is_news.any(axis=1), waiting.argmin(axis=1), known.argmin(axis=1))
        tellers = self._robots[alive & (self._changed[self._robots, pieces] > 0)]
        return tellers, pieces[tellers]

    def _cells(self, maps: Maps, robots: NDArray[np.int32], corners: NDArray[np.int64]) -> NDArray[np.uint8]:
        """One tile of each of these robots' maps (r,) from these corners (r, 2) on; UNKNOWN beyond the grid."""
        where = corners[:, :, None, None] + np.indices(self._tile)
        rows, columns = where[:, 0], where[:, 1]
        inside = (rows < self._grid[0]) & (columns < self._grid[1])
        at = robots[:, None, None], np.minimum(rows, self._grid[0] - 1), np.minimum(columns, self._grid[1] - 1)
        states = np.where(maps.log_odds[at] > 0.0, np.uint8(OCCUPIED), np.uint8(FREE))
        return np.asarray(states * (maps.observed[at] & inside), np.uint8)

    def accepted(self, senses: Senses, inbox: Inbox[TileItems]) -> Inbox[TileItems]:
        return inbox


class GossipCodec:
    """One robot's current tile, its goal if robots tell theirs, then a piece of its map if it has one to tell."""

    def __init__(self, shape: tuple[int, int], goals: bool = False) -> None:
        """`shape` of the tiles, in rows and columns; `goals`: whether robots tell theirs."""
        self._shape, self._goals = shape, goals
        #: Bytes of the longest message.
        self.longest = current_tile_bytes(*shape) + goals * GOAL.size + piece_bytes(*shape)

    def pack(self, sender: int, iteration: int, items: TileItems) -> bytes:
        """The message; its first item is the sender's own tile."""
        pieces = zip(items.origins[1:].tolist(), items.values[1:], strict=True)
        told = b"".join(PIECE.pack(row, column) + pack_cells(cells) for (row, column), cells in pieces)
        goal = pack_goal(items.goals[0], items.left[0]) if isinstance(items, GoalItems) else b""
        return pack(sender, iteration, items.origins[0], items.values[0]) + goal + told

    def unpack(self, data: bytes) -> tuple[int, int, TileItems]:
        """Its sender, iteration, tile, goal and piece of map. Raises FrameError."""
        own = current_tile_bytes(*self._shape)
        sender, iteration, origin, tile = unpack(data[:own], self._shape)
        origins, values, sources = [origin], [tile], [sender]
        piece = own + self._goals * GOAL.size
        whole = piece + piece_bytes(*self._shape)
        if len(data) not in (piece, whole):
            raise FrameError(f"{len(data)} bytes; expected {piece}, or {whole} with a piece of map")
        if len(data) > piece:
            origins.append(np.array(PIECE.unpack_from(data, piece), np.int32))
            values.append(unpack_cells(data[piece + PIECE.size :], self._shape))
            sources.append(-1)
        sensed = np.full(len(values), iteration, np.int32)
        items = PlainTiles(np.array(values), np.array(origins), np.array(sources, np.int32), sensed)
        if not self._goals:
            return sender, iteration, items
        goals, left = np.full((len(values), 2), -1, np.int32), np.zeros(len(values), np.int32)
        goals[0], left[0] = unpack_goal(data, own)
        return sender, iteration, GoalItems.of(items, goals, left)
