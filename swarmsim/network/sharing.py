"""Sharing policies: what robots tell each other."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from swarmsim.core.parts import Behaviour, Setting
from swarmsim.core.state import Delivery, Inbox, Said, State, Tiles
from swarmsim.network.message import current_tile_bytes


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
        self._said: dict[int, Said] = {}

    def say(self, state: State, tiles: Tiles) -> Said:
        """Every robot's own tile; a dead robot's is UNKNOWN, and nobody is linked to it."""
        size = current_tile_bytes(*tiles.values.shape[1:])
        said = Said(
            tiles.values,
            tiles.origins,
            self._ids,
            np.full(len(self._ids), state.iteration, np.int32),
            self._ends,
            np.full(len(self._ids), size, np.int32),
        )
        self._said[state.iteration] = said
        return said

    def hear(self, delivery: Delivery) -> Inbox:
        """The tile of each message."""
        return opened(self._said, delivery)


def opened(said: dict[int, Said], delivery: Delivery) -> Inbox:
    """The tiles in the messages heard, out of what was `said` by iteration, which is then forgotten if all arrived."""
    heard = delivery.heard
    receivers, senders, sent = heard[:, 0], heard[:, 1], heard[:, 2]
    now = next(reversed(said))
    if len(heard) == 0 or sent.min() == now:
        inbox = _taken(said[now], receivers, senders)
    else:
        moments = np.unique(sent)
        pieces = [_taken(said[int(t)], receivers[sent == t], senders[sent == t]) for t in moments]
        joined = [np.concatenate([getattr(piece, name) for piece in pieces]) for name in Inbox.__slots__]
        order = np.lexsort([joined[5], joined[1], joined[0]])
        inbox = Inbox(*(column[order] for column in joined))
    for t in [t for t in said if t < min(delivery.oldest, now)]:
        del said[t]
    return inbox


def _taken(said: Said, receivers: np.ndarray, senders: np.ndarray) -> Inbox:
    """What the senders said, message by message, for their receivers."""
    starts = np.concatenate([[0], said.ends[:-1]])
    if len(said.values) == len(said.ends) and (said.ends - starts == 1).all():
        rows = senders
    else:
        counts = (said.ends - starts)[senders]
        receivers, first = np.repeat(receivers, counts), np.repeat(starts[senders] - np.cumsum(counts) + counts, counts)
        rows, senders = first + np.arange(len(receivers)), np.repeat(senders, counts)
    return Inbox(receivers, senders, said.values[rows], said.origins[rows], said.sources[rows], said.sensed[rows])
