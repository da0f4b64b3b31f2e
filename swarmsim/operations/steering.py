"""From a wanted velocity in the plane to what wheels can do, avoiding walls."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.lattice import Lattice
from swarmsim.core.readings import Tiles
from swarmsim.core.state import OCCUPIED, Intents, Senses

STILL: Final = 0.01  # of the top speed: below it, robots stand


def wrapped(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles in rad, brought to [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def away_from_walls(
    place: NDArray[np.float64], tiles: Tiles | None, lattice: Lattice, clearance: float
) -> NDArray[np.float64]:
    """The push (n, 2) on robots at places (n, 2) away from occupied cells of their tiles nearer than `clearance` (m).

    The gradient of a potential, as in Khatib (1986); 1 at half the clearance from one cell. 0 without tiles.
    """
    count = len(place)
    if tiles is None or clearance == 0.0:
        return np.zeros((count, 2))
    robot, row, column = np.nonzero(tiles.values == OCCUPIED)
    cells = tiles.origins[robot] + np.stack([row, column], axis=1)
    gap = place[robot] - lattice.centres(cells)
    distance = np.maximum(np.hypot(gap[:, 0], gap[:, 1]), 1e-3)
    push = np.maximum(clearance / distance - 1.0, 0.0) / distance
    return np.stack([np.bincount(robot, push * gap[:, axis], minlength=count) for axis in (0, 1)], axis=1)


class Steering:
    """Turns wanted velocities into twists: robots turn on the spot to points behind, on a bend to points ahead.

    Robots that can move to the side take the wanted velocity, and do not turn.
    """

    def __init__(self, context: BuildContext, speed: float | None, clearance: float) -> None:
        """`speed` (m/s) at most, by default two thirds of what wheels can; `clearance` (m) from walls."""
        #: m/s, at most.
        self.speed = speed or context.robots.speed * 2.0 / 3.0
        self._clearance, self._lattice, self._period = clearance, context.lattice, context.period
        self._sideways = context.sideways

    def towards(self, place: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
        """The velocities (n, 2) from places to targets (n, 2) within a period, as far as speed allows."""
        wanted = (target - place) / self._period
        size = np.maximum(np.hypot(wanted[:, 0], wanted[:, 1]), 1e-12)
        return np.asarray(wanted * np.minimum(1.0, self.speed / size)[:, None])

    def intents(self, senses: Senses, wanted: NDArray[np.float64]) -> Intents:
        """The twists for wanted velocities (n, 2) in m/s, avoiding walls; slow and dead robots stand."""
        place = senses.pose[:, :2]
        push = away_from_walls(place, senses.readings.tiles, self._lattice, self._clearance)
        wanted = wanted + self.speed * push
        size = np.hypot(wanted[:, 0], wanted[:, 1])
        turn = wrapped(np.arctan2(wanted[:, 1], wanted[:, 0]) - senses.pose[:, 2])
        ahead = np.minimum(size, self.speed) * np.maximum(np.cos(turn), 0.0)
        moves = senses.alive & (size > STILL * self.speed)
        twists = np.stack([ahead, turn / self._period], axis=1)
        if self._sideways is not None:
            straight = np.minimum(size, self.speed) * np.stack([np.cos(turn), 0.0 * turn, np.sin(turn)])
            twists = np.where(self._sideways[:, None], straight.T, np.pad(twists, ((0, 0), (0, 1))))
        return Intents.twisting(np.where(moves[:, None], twists, 0.0))
