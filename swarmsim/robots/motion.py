"""From waypoints to wheel commands, within the wheels' limits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import WheelSpeeds
from swarmsim.core.state import Intents
from swarmsim.kernels import drive
from swarmsim.robots.kinematics import TwoWheels, drives_of


class PurePursuit(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Steer towards the path a little ahead, without stopping at waypoints.

    A small distance keeps the robot from cutting corners of a path one cell wide. A car looks ahead at least as far as
    its tightest bend is wide.
    """

    look_ahead: Annotated[float, Meta(gt=0.0)] = 0.05  # m

    def build(self, context: BuildContext) -> WaypointFollower:
        """The follower for a swarm of such robots."""
        return WaypointFollower(self, context)


class Course(NamedTuple):
    """The arguments of `drive.roll` from `waypoints` on."""

    waypoints: NDArray[np.float64]
    counts: NDArray[np.int32]
    cursor: NDArray[np.int64]
    ahead: NDArray[np.float64]
    paces: NDArray[np.float64]
    aims: NDArray[np.float64]
    wanted: NDArray[np.float64]
    turning: NDArray[np.bool_]
    twisting: NDArray[np.float64]
    rims: NDArray[np.float64]
    failing: NDArray[np.bool_]
    laws: NDArray[np.float64]


class Compiled(ABC):
    """A motion whose commands to two wheels the compiled loop of sub-steps can give itself."""

    @abstractmethod
    def course(self, wheels: TwoWheels) -> Course | None:
        """The robots' courses for one period; None if the motion has to be asked after all."""


class WaypointFollower(Compiled):
    """Follows each robot's waypoints by pure pursuit, or its velocity."""

    def __init__(self, parameters: PurePursuit, context: BuildContext) -> None:
        robots, count = context.robots, context.swarm
        self._drives = drives_of(context)
        self._ahead = np.maximum(parameters.look_ahead, self._drives.bends)
        self._paces = np.column_stack([robots.each("speed"), 0.5 * robots.each("acceleration")])
        self._cursor = np.zeros(count, np.int64)
        self._waypoints = np.empty((count, 0, 2))
        self._counts = np.zeros(count, np.int32)
        self._aims = np.zeros((count, 4))
        self._wanted = np.zeros((count, self._drives.width))
        self._turning = np.zeros(count, np.bool_)  # robots that move at a velocity ...
        self._twisting = np.zeros((count, self._drives.width))  # ... and the command for that

    def follow(self, intents: Intents) -> None:
        """Start on new waypoints. Raises InputError for a move to the side by robots that cannot."""
        self._waypoints, self._counts = intents.waypoints, intents.counts
        self._cursor[:] = 0
        self._turning[:] = False
        if intents.twists is not None:
            self._turn(intents.twists)

    def _turn(self, twists: NDArray[np.float64]) -> None:
        """Set velocities (n, 2 or 3)."""
        self._turning[:] = ~np.isnan(twists).any(axis=1)
        wanted = np.zeros((len(twists), 3))
        wanted[:, 0], wanted[:, 2] = twists[:, 0], twists[:, 1]
        if twists.shape[1] > 2:
            wanted[:, 1] = twists[:, 2]
        if not self._turning.all():
            wanted[~self._turning] = 0.0
        if twists.shape[1] > 2:
            for robot in np.flatnonzero((wanted[:, 1] != 0.0) & ~self._drives.sideways).tolist():
                raise InputError(
                    f"kinematics.use: robot {robot} shall move to the side at {wanted[robot, 1]:g} m/s, and is "
                    f"{self._drives.kind_of(robot)!r}; expected 'omni'"
                )
        self._twisting[:] = self._drives.command(wanted)

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The commands wanted at these poses."""
        drive.pursue(pose, self._waypoints, self._counts, self._cursor, self._ahead, self._paces, self._aims)
        self._wanted[:] = self._drives.approach(self._aims)
        self._wanted[self._turning] = self._twisting[self._turning]
        return self._wanted

    def course(self, wheels: TwoWheels) -> Course:
        """The way of each robot, with no failure of its motors."""
        return Course(
            self._waypoints, self._counts, self._cursor, self._ahead, self._paces, self._aims, self._wanted,
            self._turning, self._twisting, wheels.rims,
            np.empty((0, len(self._turning), 2), np.bool_), np.empty((0, 2)),
        )  # fmt: skip
