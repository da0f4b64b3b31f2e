"""How one robot follows a way: by pure pursuit on two wheels, as in a simulation, at the rate of its guard."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Self, final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.charge import Charge
from swarmsim.fleet.adapter import Felt, Pose

Positive = Annotated[float, Meta(gt=0.0)]


class Gait(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What of a robot's body matters for that."""

    speed: Positive = 0.15  # m/s, at a wheel's rim
    base: Positive = 0.10  # m between the wheels
    acceleration: Positive = 1.0  # m/s^2, at a wheel's rim
    look_ahead: Positive = 0.05  # m
    start: Pose | None = None  # where it stands at first, for bodies that tell velocities alone

    @classmethod
    def of(cls, charge: Charge) -> Self:
        """That of a charge's robot."""
        body, start = charge.robots.crew(np.array([charge.robot])), charge.starts[charge.robot]
        speed, base, acceleration = (float(body.each(key)[0]) for key in ("speed", "wheel_base", "acceleration"))
        return cls(speed=speed, base=base, acceleration=acceleration, start=start)


@final
class PursuedWay:
    """Waypoints that are followed."""

    def __init__(self, points: Sequence[tuple[float, float]], gait: Gait, within: float = 0.0) -> None:
        """No points: the robot stands. It may have gone `within` m along the way already."""
        self._points = np.array(points, np.float64).reshape(1, -1, 2)
        self._counts, self._cursor = np.array([len(points)], np.int32), np.zeros(1, np.int64)
        self._ahead = np.array([gait.look_ahead])
        self._paces = np.array([[gait.speed, 0.5 * gait.acceleration]])
        self._rims, self._base = np.array([[gait.speed, gait.base]]), gait.base
        self._begun, self._within = len(points) == 0, within

    def velocity(self, pose: Pose) -> tuple[float, float]:
        """The velocity (m/s ahead, rad/s) wanted at a pose."""
        from swarmsim.kernels import drive  # with numba, which guards of bodies that follow no ways need not load

        aims, wheels = np.zeros((1, 4)), np.zeros((1, 2))
        here = np.array([pose])
        if not self._begun:
            self._cursor[0], self._begun = self._passed(here[0, :2]), True
        drive.pursue(here, self._points, self._counts, self._cursor, self._ahead, self._paces, aims)
        drive.towards(aims, self._rims, wheels)
        left, right = wheels[0].tolist()
        return 0.5 * (left + right), (right - left) / self._base

    def _passed(self, here: NDArray[np.float64]) -> int:
        """The waypoint to begin with, for the robot has gone on while its mind thought.

        It is the nearest of those that it can have reached, or the next if the robot is between the two.
        """
        points = self._points[0]
        steps = np.hypot(*(points[1:] - points[:-1]).T)
        reached = 1 + int((np.cumsum(steps) <= self._within).sum())
        nearest = int(np.hypot(*(points[:reached] - here).T).argmin())
        between = nearest < len(steps) and np.hypot(*(points[nearest + 1] - here)) < steps[nearest]
        return nearest + bool(between)


@final
class Reckoning:
    """The pose of a body: measured or, where only its velocity is, reckoned from where it was; it drifts."""

    def __init__(self, start: Pose | None) -> None:
        self._pose, self._when = start, math.nan

    def at(self, felt: Felt, now: float) -> Pose | None:
        """The pose at a time (s); None if nothing tells it."""
        if felt.pose is not None:
            self._pose = felt.pose
        elif self._pose is not None and felt.velocity is not None and not math.isnan(self._when):
            (x, y, yaw), (ahead, turn), took = self._pose, felt.velocity, now - self._when
            middle = yaw + 0.5 * turn * took
            self._pose = x + ahead * took * math.cos(middle), y + ahead * took * math.sin(middle), yaw + turn * took
        self._when = now
        return self._pose if felt.pose is not None or felt.velocity is not None else None
