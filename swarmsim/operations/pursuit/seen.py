"""Robots of another group seen nearby, and their places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.state import Senses

NEEDS = ("neighbours", "neighbours_group")  # the sensors' channels that this reads


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """All sightings of robots of one group, for each robot the nearest first."""

    seers: NDArray[np.int64]  # (s,): the rows of the robots that see them, ascending
    distance: NDArray[np.float64]  # (s,): m
    place: NDArray[np.float64]  # (s, 2): m, by the seers' estimated positions

    def take(self, items: NDArray[np.bool_]) -> Seen:
        """Some of them."""
        return Seen(self.seers[items], self.distance[items], self.place[items])


def seen(senses: Senses, group: int) -> Seen:
    """The live robots' sightings of the group of this number."""
    told, groups = senses.readings["neighbours"], senses.readings["neighbours_group"]
    used = np.arange(told.shape[1]) < senses.readings["neighbours_count"][:, None]
    seers, rank = np.nonzero(used & (groups == group) & senses.alive[:, None])
    distance, bearing = told[seers, rank, 0], told[seers, rank, 1]
    direction = senses.pose[seers, 2] + bearing
    ahead = distance[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    return Seen(seers, distance, senses.pose[seers, :2] + ahead)
