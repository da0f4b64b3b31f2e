"""A channel on which all robots share the air: frames that overlap where they are received are lost."""

from __future__ import annotations

import math
from typing import Annotated, Final

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.messages import Delivery
from swarmsim.core.parts import Links, NetworkChannel
from swarmsim.core.state import State
from swarmsim.kernels import air
from swarmsim.network.channel import StackedChannel, but_lost
from swarmsim.network.radios import RADIOS, Access, RadioKind

SAVED: Final = 3600.0  # s over which a limit on the time on the air is counted (ETSI EN 300 220-1, 5.4)
DOUBLED: Final = 2  # times that the longest wait doubles: from 3 to 5 backoff exponents (IEEE 802.15.4-2020, 6.2.5.1)


class Contention(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots share the air: a frame that another one overlaps at its receiver is lost, and so is a busy radio's.

    Each robot sends once in an iteration, for all its receivers, from a random time on. `aloha`: whatever the others
    do (Abramson 1970). `slotted`: the same, at the beginning of a slot as long as the longest of these frames (Roberts
    1975). `csma`: it listens first, and tries again later if it hears a frame (non-persistent; Kleinrock and Tobagi
    1975); it does not hear those that are out of its `reach`. Walls do not shield. Messages longer than the radio's
    frames are cut into several, sent one after another.
    """

    radio: str | None = None  # one that can be bought, which sets all but `reach`; see `swarmsim radio airtime`
    bytes_per_second: Annotated[float, Meta(gt=0.0)] | None = None  # on the air, of a radio of one's own
    overhead: Annotated[float, Meta(ge=0.0)] = 0.0  # bytes on the air besides each message, of a radio of one's own
    access: Access | None = None  # default: that of the radio, or aloha
    reach: Annotated[float, Meta(gt=0.0)] | None = None  # m within which a frame disturbs, and is noticed; default: any
    retries: Annotated[int, Meta(ge=0, le=16)] = 4  # how often a robot listens again, with csma
    backoff: Annotated[float, Meta(gt=0.0)] = 0.00224  # s, the longest wait before the first of these; then it doubles
    duty: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None  # share of an hour on the air; default: the radio's

    def build(self, context: BuildContext) -> ContendedChannel:
        """The channel, which loses messages for the reasons "collision", "busy", "duty" and "too long".

        Raises InputError unless there is one radio, of a known name or of one's own.
        """
        return ContendedChannel(self.below(context), self, self._radio(), context, self.salt(context))

    def _radio(self) -> RadioKind:
        if (self.radio is None) == (self.bytes_per_second is None):
            raise InputError("radio: expected a radio's name or bytes_per_second, and not both")
        if self.radio is None:
            rate = float(self.bytes_per_second or math.nan)
            return RadioKind(2**31, lambda length: (self.overhead + length) / rate, "the scenario")
        if self.radio not in RADIOS:
            raise InputError(f"radio: {self.radio!r} is not known; {nearest(self.radio, RADIOS)}")
        if self.overhead:
            raise InputError(f"overhead: that of {self.radio!r} is known; expected it with bytes_per_second")
        return RADIOS[self.radio]


class ContendedChannel:
    """The air of one iteration after another."""

    def __init__(
        self, below: NetworkChannel, keys: Contention, radio: RadioKind, context: BuildContext, salt: int
    ) -> None:
        self._below, self._keys, self._radio, self._salt = below, keys, radio, salt
        self._access, self._period = keys.access or radio.access, context.period
        self._duty = radio.duty if keys.duty is None else keys.duty
        self._left = np.full(context.swarm, self._duty * SAVED)  # s on the air that each robot may still use
        self._longest = keys.backoff * 2.0 ** np.minimum(np.arange(keys.retries), DOUBLED)

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What the channel below delivers, less what is lost on the air."""
        found = self._below.deliver(state, links, sizes)
        airtime = self._airtimes(state, links, sizes, found)
        self._left = np.minimum(self._left + self._duty * self._period, self._duty * SAVED)
        found = self._silenced(found, airtime, "too long", airtime > self._period)
        found = self._silenced(found, airtime, "duty", airtime > self._left)
        begins, around = self._begins(state, airtime), self._period
        if self._access == "csma":
            around = 0.0  # who listens waits for its turn, past the end if need be
            found = self._silenced(found, airtime, "busy", np.isnan(begins) & (airtime > 0.0))
        self._left -= airtime
        reach = math.inf if self._keys.reach is None else self._keys.reach
        places = np.ascontiguousarray(state.pose[:, :2])
        ends = found.heard[:, 0].copy(), found.heard[:, 1].copy()
        return but_lost(found, "collision", air.collided(*ends, begins, airtime, places, reach, around))

    def _airtimes(self, state: State, links: Links, sizes: NDArray[np.int32], found: Delivery) -> NDArray[np.float64]:
        """How long each robot (n,) is on the air; those that nobody listens to are as well. Empty messages are not."""
        said = np.unique(found.heard[:, [1, 2, 3]], axis=0)[:, [0, 2]]
        unheard = np.flatnonzero(state.alive & (np.bincount(links[:, 1], minlength=state.robots) == 0))
        said = np.concatenate([said, np.column_stack([unheard, sizes[unheard]])])
        lengths, which = np.unique(said[:, 1], return_inverse=True)
        times = np.array([self._radio.airtime_of(length) if length else 0.0 for length in lengths.tolist()])
        airtime = np.zeros(state.robots)
        np.add.at(airtime, said[:, 0], times[which.reshape(-1)])
        return airtime

    def _begins(self, state: State, airtime: NDArray[np.float64]) -> NDArray[np.float64]:
        """When each robot (n,) begins to send, in s; NaN for one that never finds the air free."""
        robots = np.arange(state.robots)
        drawn = chance.uniform(self._salt, state.iteration, robots, 0)
        if self._access == "slotted":
            slot = airtime.max(initial=0.0) or self._period
            return np.asarray(np.floor(drawn * max(math.floor(self._period / slot), 1)) * slot)
        if self._access == "aloha":
            return drawn * self._period
        tries = np.arange(1, self._keys.retries + 1)
        waits = chance.uniform(self._salt, state.iteration, robots[:, None], tries) * self._longest
        reach = math.inf if self._keys.reach is None else self._keys.reach
        places = np.ascontiguousarray(state.pose[:, :2])
        begins: NDArray[np.float64] = air.listen_first(
            drawn * self._period, airtime, waits, places, reach, self._radio.turnaround
        )
        return begins

    def _silenced(
        self, found: Delivery, airtime: NDArray[np.float64], reason: str, robots: NDArray[np.bool_]
    ) -> Delivery:
        """The delivery without what these `robots` (n,) would have said; they are not on the air."""
        airtime[robots] = 0.0
        return but_lost(found, reason, robots[found.heard[:, 1]])
