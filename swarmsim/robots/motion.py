"""From waypoints to wheel speeds, within the limits of the motors."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import WheelSpeeds
from swarmsim.core.state import Intents
from swarmsim.kernels import drive


class PurePursuit(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Steer towards the path a little ahead, without stopping at waypoints.

    Small enough a distance keeps the robot from cutting corners that a path one cell wide goes around.
    """

    look_ahead: Annotated[float, Meta(gt=0.0)] = 0.05  # m

    def build(self, context: BuildContext) -> WaypointFollower:
        """The follower for a swarm of such robots."""
        return WaypointFollower(self, context)


class WaypointFollower:
    """Follows each robot's waypoints by pure pursuit, or its velocity."""

    def __init__(self, parameters: PurePursuit, context: BuildContext) -> None:
        robots = context.robots
        speed, base, braking = robots.each("speed"), robots.each("wheel_base"), 0.5 * robots.each("acceleration")
        self._ahead, self._traits = parameters.look_ahead, np.column_stack([speed, base, braking])
        count = context.swarm
        self._cursor = np.zeros(count, np.int64)
        self._wanted = np.zeros((count, 2))
        self._waypoints = np.empty((count, 0, 2))
        self._counts = np.zeros(count, np.int32)
        self._turning = np.zeros(count, np.bool_)  # who moves at a velocity ...
        self._twisting = np.zeros((count, 2))  # ... and how fast the wheels turn then

    def follow(self, intents: Intents) -> None:
        """Start on new waypoints."""
        self._waypoints, self._counts = intents.waypoints, intents.counts
        self._cursor[:] = 0
        self._turning[:] = False
        if intents.twists is not None:
            drive.wheels_of(intents.twists, self._traits, self._turning, self._twisting)

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wheel speeds wanted at these poses."""
        drive.pursue(pose, self._waypoints, self._counts, self._cursor, self._ahead, self._traits, self._wanted)
        self._wanted[self._turning] = self._twisting[self._turning]
        return self._wanted

    @property
    def course(self) -> tuple[Any, ...]:
        """What `drive.roll` follows: the arguments from `waypoints` on."""
        return (
            self._waypoints, self._counts, self._cursor, self._ahead, self._traits, self._wanted, self._turning,
            self._twisting,
        )  # fmt: skip
