"""Sharing policies: what robots tell each other."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.parts import Behaviour, Setting
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Delivery, Inbox, Said, State, Tiles
from swarmsim.network.message import current_tile_bytes, map_bytes


class CurrentTile(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells the tile it senses now and nothing else: no history, no relaying, no map."""

    def build(self, setting: Setting, behaviour: Behaviour) -> CurrentTileSharing:
        """The policy."""
        return CurrentTileSharing(setting.robots.count)


class CurrentTileSharing:
    """One tile a message."""

    def __init__(self, robots: int) -> None:
        self._ids = np.arange(robots, dtype=np.int32)
        self._ends = np.arange(1, robots + 1, dtype=np.int64)
        self._sizes = np.empty(0, np.int32)
        self._said: dict[int, Said] = {}

    def say(self, state: State, tiles: Tiles) -> Said:
        """Every robot's own tile; a dead robot's is UNKNOWN, and nobody is linked to it."""
        if len(self._sizes) != len(self._ids):
            self._sizes = np.full(len(self._ids), current_tile_bytes(*tiles.values.shape[1:]), np.int32)
        sensed = np.full(len(self._ids), state.iteration, np.int32)
        said = Said(tiles.values, tiles.origins, self._ids, sensed, self._ends, self._sizes, one_each=True)
        self._said[state.iteration] = said
        return said

    def hear(self, delivery: Delivery) -> Inbox:
        """The tile of each message."""
        return opened(self._said, delivery)


class WholeMap(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells all that it knows: its map as it stands before it takes in what it senses and hears now."""

    def build(self, setting: Setting, behaviour: Behaviour) -> WholeMapSharing:
        """The policy."""
        return WholeMapSharing(behaviour)


class WholeMapSharing:
    """The known cells of a map, cut into tiles that nobody in particular has sensed (source -1).

    Such a tile is belief, not evidence: a receiver fills with it the cells that it does not know, and no others,
    for the reading behind it may have reached the receiver before, or come from the receiver itself.
    """

    def __init__(self, behaviour: Behaviour) -> None:
        self._behaviour = behaviour
        self._said: dict[int, Said] = {}

    def say(self, state: State, tiles: Tiles) -> Said:
        """Every live robot's map; the dead say nothing."""
        # Arithmetic on the values of cells, because it is several times as fast as choosing between them.
        known = np.uint8(OCCUPIED - FREE) * (self._behaviour.log_odds > 0.0) + np.uint8(FREE)
        known *= self._behaviour.observed & state.alive[:, None, None]  # all else is UNKNOWN, 0
        owners, origins, values = pieces(known, tiles.values.shape[1:])
        said = Said(
            values,
            origins,
            np.full(len(owners), -1, np.int32),
            np.full(len(owners), state.iteration, np.int32),
            np.searchsorted(owners, np.arange(state.robots), side="right"),
            map_bytes(_enclosing_cells(known)),
        )
        self._said[state.iteration] = said
        return said

    def hear(self, delivery: Delivery) -> Inbox:
        """The pieces of each map heard."""
        return opened(self._said, delivery)


def pieces(
    maps: NDArray[np.uint8], shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.uint8]]:
    """The `maps` (n, rows, columns) cut into tiles of `shape`, without those that are UNKNOWN all over.

    Gives the row in `maps` (t,), rising, the origins (t, 2) and the values (t, *shape) of the tiles.
    """
    robots, rows, columns = maps.shape
    down, across = -(-rows // shape[0]), -(-columns // shape[1])
    padded = np.full((robots, down * shape[0], across * shape[1]), UNKNOWN, np.uint8)
    padded[:, :rows, :columns] = maps
    cut = padded.reshape(robots, down, shape[0], across, shape[1]).swapaxes(2, 3)
    # Rows first: numpy is slow where it reduces the few cells of a tile's row one by one.
    strips = (padded != UNKNOWN).reshape(robots, down, shape[0], -1).any(axis=2)
    owners, row, column = np.nonzero(strips.reshape(robots, down, across, shape[1]).any(axis=3))
    origins = np.stack([row * shape[0], column * shape[1]], axis=1).astype(np.int32)
    return owners, origins, cut[owners, row, column]


def _enclosing_cells(maps: NDArray[np.uint8]) -> NDArray[np.int32]:
    """How many cells (n,) the smallest rectangles with all known cells of the `maps` (n, rows, columns) have."""
    known = maps != UNKNOWN
    height, width = (_spans(known.any(axis=axis)) for axis in (2, 1))
    return np.asarray(height * width, np.int32)


def _spans(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """From the first to the last of the marked in each row (n, length), both included; 0 where none is."""
    length = marked.shape[1]
    spans = length - marked.argmax(axis=1) - marked[:, ::-1].argmax(axis=1)
    return np.asarray(np.where(marked.any(axis=1), spans, 0))


def opened(said: dict[int, Said], delivery: Delivery) -> Inbox:
    """The tiles in the messages heard, out of what was `said` by iteration, which is then forgotten if all arrived."""
    heard = delivery.heard
    receivers, senders, sent = heard[:, 0], heard[:, 1], heard[:, 2]
    now = next(reversed(said))
    if len(heard) == 0 or sent.min() == now:
        inbox = _taken(said[now], receivers, senders)
    else:
        moments = np.unique(sent)
        parts = [_taken(said[int(t)], receivers[sent == t], senders[sent == t]) for t in moments]
        joined = [np.concatenate([getattr(part, name) for part in parts]) for name in Inbox.__slots__]
        order = np.lexsort([joined[5], joined[1], joined[0]])
        inbox = Inbox(*(column[order] for column in joined))
    for t in [t for t in said if t < min(delivery.oldest, now)]:
        del said[t]
    return inbox


def _taken(said: Said, receivers: np.ndarray, senders: np.ndarray) -> Inbox:
    """What the senders said, message by message, for their receivers."""
    rows = senders
    if not said.one_each:
        starts = np.concatenate([[0], said.ends[:-1]])
        counts = (said.ends - starts)[senders]
        receivers, first = np.repeat(receivers, counts), np.repeat(starts[senders] - np.cumsum(counts) + counts, counts)
        rows, senders = first + np.arange(len(receivers)), np.repeat(senders, counts)
    return Inbox(receivers, senders, said.values[rows], said.origins[rows], said.sources[rows], said.sensed[rows])
