"""Channels: which messages arrive, and how one channel lies over another."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Delivery, Packets
from swarmsim.core.parts import Links, NetworkChannel
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import State


class Perfect(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Everything arrives, at once and unchanged."""

    @property
    def perfect(self) -> bool:
        """Whether everything arrives, at once."""
        return True

    @property
    def delays(self) -> bool:
        """Whether messages can be on their way for longer than an iteration."""
        return False

    def build(self, context: BuildContext) -> PerfectChannel:
        return PerfectChannel()


class PerfectChannel:
    """Delivers every message within the iteration in which it is sent."""

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """One message for each link."""
        return Delivery(letters(state.iteration, links, sizes), (), state.iteration)


class StackedChannel(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A channel that lies over another, and gets only what that one delivers.

    `over` is the channel below, which may lie over a further one.
    """

    over: Part[NetworkChannel] = Part("channel")

    @property
    def delays(self) -> bool:
        """Whether messages can be on their way for longer than an iteration."""
        return self.over.declares("delays", True)

    def below(self, context: BuildContext) -> NetworkChannel:
        """The channel that this one lies over. Raises InputError, naming the path to the key, if it cannot work."""
        return self.over.build(context, "over")

    def salt(self, context: BuildContext) -> int:
        """The random number that this channel's draws are hashed with.

        It follows from the number of channels below, so that channels of one kind in one stack draw
        independently, and one more on top changes nothing below.
        """
        level = sum(1 for _ in self.over.inside())
        return int(context.streams.open("channel", level - 1).integers(0, 2**64, dtype=np.uint64))


def letters(iteration: int, links: Links, sizes: NDArray[np.int32]) -> Packets:
    """One new message (m, 4) for each link, of its sender's size in bytes."""
    new = np.empty((len(links), 4), np.int32)
    new[:, :2] = links
    new[:, 2] = iteration
    new[:, 3] = sizes[links[:, 1]]
    return new


def in_order(unsorted: Packets) -> Packets:
    """The same messages, sorted by receiver, sender, iteration sent."""
    return unsorted[np.lexsort((unsorted[:, 2], unsorted[:, 1], unsorted[:, 0]))]


def but_lost(delivery: Delivery, reason: str, lost: NDArray[np.bool_]) -> Delivery:
    """The delivery without the messages heard that are marked in `lost` (m,); they are lost for this reason."""
    if not lost.any():
        return delivery
    heard = delivery.heard
    return Delivery(heard[~lost], (*delivery.lost, (reason, heard[lost])), delivery.oldest)
