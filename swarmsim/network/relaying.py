"""Relaying: readings that travel through the network over more than one link."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import ArrayLike, NDArray

from swarmsim.core.parts import Behaviour, Setting
from swarmsim.core.state import Delivery, Inbox, Said, State, Tiles
from swarmsim.network.message import current_tile_bytes, relayed_tile_bytes
from swarmsim.network.sharing import opened


class Relay(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells its own tile, and once more those that it heard for the first time in the last iteration.

    A reading travels over at most `hops` links, one an iteration; with 1 nothing is relayed.
    """

    hops: Annotated[int, Meta(ge=1, le=255)] = 2

    def build(self, setting: Setting, behaviour: Behaviour) -> RelaySharing:
        """The policy."""
        return RelaySharing(setting.robots.count, self.hops)


class RelaySharing:
    """Flooding with a limit of hops; a robot takes in each reading once, and never one of its own."""

    def __init__(self, robots: int, hops: int) -> None:
        self._hops = hops
        self._said: dict[int, Said] = {}
        self._known = KnownReadings(robots)
        nothing = np.empty(0, np.int32)
        tiles, origins = np.empty((0, 0, 0), np.uint8), np.empty((0, 2), np.int32)
        self._relayed = Inbox(nothing, nothing, tiles, origins, nothing, nothing)  # to be said by its receivers

    def say(self, state: State, tiles: Tiles) -> Said:
        """Every live robot's own tile, then those that it relays; the dead say nothing."""
        shape = tiles.values.shape[1:]
        robots = np.flatnonzero(state.alive).astype(np.int32)
        again = _chosen(self._relayed, state.alive[self._relayed.receivers])
        speakers = np.concatenate([robots, again.receivers])
        order = np.argsort(speakers, kind="stable")
        now = np.full(len(robots), state.iteration, np.int32)
        ends = np.searchsorted(speakers[order], np.arange(state.robots), side="right")
        relayed = np.bincount(again.receivers, minlength=state.robots)
        sizes = (current_tile_bytes(*shape) + relayed * relayed_tile_bytes(*shape)) * state.alive
        said = Said(
            np.concatenate([tiles.values[robots], again.values.reshape(-1, *shape)])[order],
            np.concatenate([tiles.origins[robots], again.origins])[order],
            np.concatenate([robots, again.sources])[order],
            np.concatenate([now, again.sensed])[order],
            ends,
            sizes.astype(np.int32),
        )
        self._said[state.iteration] = said
        return said

    def hear(self, delivery: Delivery) -> Inbox:
        """The readings that are news to their receivers, each by the shortest way, ties by the sender's id."""
        inbox, known = opened(self._said, delivery), self._known
        hops = known.hops(inbox.senders, inbox.sources, inbox.sensed) + 1
        keys = known.keys(inbox.receivers, inbox.sources, inbox.sensed)
        news = np.flatnonzero((inbox.sources != inbox.receivers) & ~known.holds(keys))
        news = news[np.lexsort((inbox.senders[news], hops[news], keys[news]))]
        news = np.sort(news[np.unique(keys[news], return_index=True)[1]])
        known.add(keys[news], hops[news])
        heard = _chosen(inbox, news)
        self._relayed = _chosen(heard, hops[news] < self._hops)
        sensed = [said.sensed.min(initial=np.iinfo(np.int32).max) for said in self._said.values()]
        known.forget_before(int(min(*sensed, self._relayed.sensed.min(initial=sensed[0]))))
        return heard


class KnownReadings:
    """Which robot has which reading of the others, and over how many links each came to it.

    A robot tells a reading one time only, so what it told is what this holds of it.
    """

    def __init__(self, robots: int) -> None:
        self._robots = robots
        self._keys = np.empty(0, np.int64)  # rising
        self._hops = np.empty(0, np.int64)

    def keys(self, owners: ArrayLike, sources: ArrayLike, sensed: ArrayLike) -> NDArray[np.int64]:
        """One number for each robot in `owners` and the reading that it has; they rise with `sensed`."""
        when, owner, source = (np.asarray(column, np.int64) for column in (sensed, owners, sources))
        return np.asarray((when * self._robots + owner) * self._robots + source)

    def holds(self, keys: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the robot of each of the `keys` (t,) has the reading."""
        return np.isin(keys, self._keys)

    def hops(
        self, owners: NDArray[np.int32], sources: NDArray[np.int32], sensed: NDArray[np.int32]
    ) -> NDArray[np.int64]:
        """Over how many links readings (t,) came to robots that have them; 0 for a robot's own."""
        hops = np.zeros(len(owners), np.int64)
        others = owners != sources
        keys = self.keys(owners[others], sources[others], sensed[others])
        hops[others] = self._hops[np.searchsorted(self._keys, keys)]
        return hops

    def add(self, keys: NDArray[np.int64], hops: NDArray[np.int64]) -> None:
        """Note new readings (t,)."""
        keys, hops = np.concatenate([self._keys, keys]), np.concatenate([self._hops, hops])
        order = np.argsort(keys, kind="stable")
        self._keys, self._hops = keys[order], hops[order]

    def forget_before(self, sensed: int) -> None:
        """Drop the readings from before an iteration: no copy of them is under way any more."""
        first = np.searchsorted(self._keys, self.keys(0, 0, sensed))
        self._keys, self._hops = self._keys[first:], self._hops[first:]


def _chosen(inbox: Inbox, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Inbox:
    """Some of the tiles of an inbox."""
    return Inbox(*(getattr(inbox, name)[rows] for name in Inbox.__slots__))
