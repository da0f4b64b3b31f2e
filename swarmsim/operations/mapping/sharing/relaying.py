"""Relaying: readings that travel through the network over more than one link."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import ArrayLike, NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Inbox
from swarmsim.core.state import Senses
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.sharing.codecs import RelayCodec, RelayedItems, current_tile_bytes, relayed_tile_bytes
from swarmsim.operations.mapping.sharing.policies import tile_shape, tiles_of


class Relay(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells its own tile, and repeats those that it first heard in the last iteration.

    A reading travels over at most `hops` links, one an iteration; with 1 nothing is relayed.
    """

    hops: Annotated[int, Meta(ge=1, le=255)] = 2  # links that a tile travels at most

    def build(self, context: BuildContext) -> RelaySharing:
        return RelaySharing(context, self.hops)


class RelaySharing:
    """Flooding with a limit of hops; a robot takes in each reading once, and never its own."""

    def __init__(self, context: BuildContext, hops: int) -> None:
        self._tile = tile_shape(context)
        self.codec = RelayCodec(self._tile, (hops - 1) * (context.swarm - 1))  # one of each other robot for each age
        self._ids, self._hops = context.ids.astype(np.int32), hops
        self._known = KnownReadings(len(self._ids), context.swarm)
        self._relayed: Inbox[RelayedItems] | None = None  # for its receivers to tell
        self._oldest: dict[int, int] = {}  # of the readings told, by the iteration of telling

    def say(self, senses: Senses, maps: Maps) -> Broadcast[RelayedItems]:
        """Every live robot's own tile, then those that it relays; the dead say nothing."""
        tiles, alive, now = tiles_of(senses), senses.alive, senses.iteration
        robots = np.flatnonzero(alive).astype(np.int32)
        own = RelayedItems(
            tiles.values[robots], tiles.origins[robots], self._ids[robots], np.full(len(robots), now, np.int32),
            np.zeros(len(robots), np.uint8),
        )  # fmt: skip
        relayers, items = robots[:0], own.take(robots[:0])
        if self._relayed is not None:
            again = self._relayed.take(alive[self._relayed.receivers])
            relayers, items = again.receivers, again.content
        speakers = np.concatenate([robots, relayers])
        order = np.argsort(speakers, kind="stable")
        ends = np.searchsorted(speakers[order], np.arange(len(alive)), side="right")
        relayed = np.bincount(relayers, minlength=len(alive))
        sizes = (current_tile_bytes(*self._tile) + relayed * relayed_tile_bytes(*self._tile)) * alive
        content = RelayedItems.joined([own, items]).take(order)
        self._oldest[now] = int(content.sensed.min(initial=now))
        return Broadcast(content, ends, sizes.astype(np.int32))

    def accepted(self, senses: Senses, inbox: Inbox[RelayedItems]) -> Inbox[RelayedItems]:
        """The readings new to their receivers, each by the shortest way, ties by the sender's id."""
        known, items = self._known, inbox.content
        hops = items.hops.astype(np.int64) + 1
        keys = known.keys(inbox.receivers, items.sources, items.sensed)
        news = np.flatnonzero((items.sources != self._ids[inbox.receivers]) & ~known.holds(keys))
        news = news[np.lexsort((inbox.senders[news], hops[news], keys[news]))]
        news = np.sort(news[np.unique(keys[news], return_index=True)[1]])
        known.add(keys[news])
        heard = inbox.take(news)
        heard = replace(heard, content=replace(heard.content, hops=hops[news].astype(np.uint8)))
        self._relayed = heard.take(hops[news] < self._hops)
        now = senses.iteration
        self._oldest = {t: sensed for t, sensed in self._oldest.items() if t >= min(inbox.oldest, now)}
        under_way = min(self._oldest.values(), default=now)
        known.forget_before(int(self._relayed.content.sensed.min(initial=under_way)))
        return heard


class KnownReadings:
    """Which robot has which reading of the others."""

    def __init__(self, rows: int, swarm: int) -> None:
        """For `rows` robots, among all those of the swarm."""
        self._rows, self._swarm = rows, swarm
        self._keys = np.empty(0, np.int64)  # rising

    def keys(self, owners: ArrayLike, sources: ArrayLike, sensed: ArrayLike) -> NDArray[np.int64]:
        """One number for each robot, by its row in `owners`, and its reading; they rise with `sensed`."""
        when, owner, source = (np.asarray(column, np.int64) for column in (sensed, owners, sources))
        return np.asarray((when * self._rows + owner) * self._swarm + source)

    def holds(self, keys: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the robot of each of the `keys` (t,) has the reading."""
        return np.isin(keys, self._keys)

    def add(self, keys: NDArray[np.int64]) -> None:
        """Note new readings (t,)."""
        self._keys = np.sort(np.concatenate([self._keys, keys]))

    def forget_before(self, sensed: int) -> None:
        """Drop the readings from before an iteration: no copy of them is under way any more."""
        self._keys = self._keys[np.searchsorted(self._keys, self.keys(0, 0, sensed)) :]
