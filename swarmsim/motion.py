"""From waypoints to wheel speeds, within the limits of the motors."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.parts import Setting, WheelSpeeds
from swarmsim.core.state import Intents
from swarmsim.kernels import drive


class PurePursuit(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Steer towards the path a little ahead, without stopping at waypoints.

    Small enough a distance keeps the robot from cutting corners that a path one cell wide goes around.
    """

    look_ahead: Annotated[float, Meta(gt=0.0)] = 0.05  # m

    def build(self, setting: Setting) -> WaypointFollower:
        """The follower for a swarm of such robots."""
        return WaypointFollower(self, setting)


class WaypointFollower:
    """Follows each robot's waypoints by pure pursuit."""

    def __init__(self, parameters: PurePursuit, setting: Setting) -> None:
        robots = setting.robots
        self._limits = (parameters.look_ahead, robots.speed, robots.wheel_base, 0.5 * robots.acceleration)
        self._cursor = np.zeros(robots.count, np.int64)
        self._wanted = np.zeros((robots.count, 2))
        self._waypoints = np.empty((robots.count, 0, 2))
        self._counts = np.zeros(robots.count, np.int32)

    def follow(self, intents: Intents) -> None:
        """Start on new waypoints."""
        self._waypoints, self._counts = intents.waypoints, intents.counts
        self._cursor[:] = 0

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wheel speeds wanted at these poses."""
        drive.pursue(pose, self._waypoints, self._counts, self._cursor, *self._limits, self._wanted)
        return self._wanted
