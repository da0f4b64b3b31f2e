"""Channels: what arrives of what is said."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.parts import Building, Links, Setting
from swarmsim.core.state import Delivery, Letters, State


class Perfect(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Everything arrives, at once and unchanged."""

    def build(self, setting: Setting, building: Building) -> PerfectChannel:
        """The channel."""
        return PerfectChannel()


class PerfectChannel:
    """Delivers every message within the iteration in which it was said."""

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """One message for each link."""
        return Delivery(letters(state.iteration, links, sizes), (), state.iteration)


def letters(iteration: int, links: Links, sizes: NDArray[np.int32]) -> Letters:
    """One new message (m, 4) for each link, of its sender's size in bytes."""
    new = np.empty((len(links), 4), np.int32)
    new[:, :2] = links
    new[:, 2] = iteration
    new[:, 3] = sizes[links[:, 1]]
    return new
