"""Channels: what arrives of what is said."""

from __future__ import annotations

from msgspec import Struct

from swarmsim.core.parts import Links, Setting, Walls
from swarmsim.core.state import Inbox, Tiles


class Perfect(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Everything arrives, at once and unchanged."""

    def build(self, setting: Setting, walls: Walls) -> PerfectChannel:
        """The channel."""
        return PerfectChannel()


class PerfectChannel:
    """Delivers every tile within the iteration in which it was sensed."""

    def deliver(self, iteration: int, links: Links, said: Tiles) -> Inbox:
        """One message for each link."""
        receivers, senders = links[:, 0], links[:, 1]
        return Inbox(receivers, senders, said.values[senders], said.origins[senders])
