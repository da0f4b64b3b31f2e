"""The robots' wheels: two of a differential drive, three omnidirectional ones, or those of a car."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.crew import Crew, Length
from swarmsim.core.kinematics import Drives, Wheels
from swarmsim.kernels import drive, rolling

GRAVITY = 9.81  # m/s^2, only for the traction of a robot's weight


class Differential(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two wheels side by side, each with a motor: robots drive arcs and turn on the spot."""

    def build(self, context: BuildContext) -> TwoWheels:
        """The kinematics of robots with such wheels."""
        return TwoWheels(context.robots)


class Omni(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Three omnidirectional wheels, half a `wheel_base` from the middle: robots move in any direction and turn."""

    @property
    def sideways(self) -> bool:
        """They can move to the side."""
        return True

    def build(self, context: BuildContext) -> ThreeWheels:
        """The kinematics of robots with such wheels."""
        return ThreeWheels(context.robots)


class Car(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two axles, the front one steered: robots drive bends, ahead and backwards, and cannot turn on the spot."""

    wheelbase: Length = 0.10  # m, between the axles; the body's middle is half-way
    steering: Annotated[float, Meta(ge=0.01, le=1.4)] = 0.6  # rad, to each side
    steering_rate: Annotated[float, Meta(gt=0.0, le=1e3)] = 3.0  # rad/s

    @property
    def bend(self) -> float:
        """The radius (m) of the tightest bend of the rear axle."""
        return self.wheelbase / math.tan(self.steering)

    def build(self, context: BuildContext) -> Bicycle:
        """The kinematics of robots with such wheels."""
        return Bicycle(self, context.robots)


def drives_of(context: BuildContext) -> Drives:
    """The kinematics of the swarm that parts are built for; differential by default."""
    return context.kinematics or differential(context.robots, context.swarm)


def differential(robots: Crew, count: int) -> Drives:
    """The kinematics of `count` robots on two wheels each."""
    return Drives([Wheels("differential", TwoWheels(robots), slice(0, count), False, 0.0)])


def inertia(robots: Crew) -> NDArray[np.float64]:
    """The moments of inertia of discs (n,), kg m^2."""
    radius = robots.each("radius")
    return robots.each("mass") * (0.5 * (radius * radius))


def grip(robots: Crew, wheels: int) -> NDArray[np.float64]:
    """The largest push (n,) of one wheel, N; all wheels carry equal weight."""
    return 1.0 / wheels * robots.each("traction") * robots.each("mass") * GRAVITY


class TwoWheels:
    """The differential drive."""

    columns = (("left", "m/s"), ("right", "m/s"))

    def __init__(self, robots: Crew) -> None:
        each, base = robots.each, robots.each("wheel_base")
        #: For `drive.forces`, and for `drive.towards`.
        self.traits = np.column_stack([base, each("mass"), inertia(robots), each("acceleration"), grip(robots, 2)])
        self.rims = np.column_stack([each("speed"), base])
        self._wanted, self._push = np.zeros((len(base), 2)), np.zeros((len(base), 3))

    def command(self, twists: NDArray[np.float64]) -> NDArray[np.float64]:
        """The speeds of both wheels (r, 2); slower, on the same arc, where one is too fast."""
        drive.wheels_of(twists, self.rims, self._wanted)
        return self._wanted

    def approach(self, aims: NDArray[np.float64]) -> NDArray[np.float64]:
        """The speeds of both wheels (r, 2) on an arc to points ahead; robots turn on the spot to points behind."""
        drive.towards(aims, self.rims, self._wanted)
        return self._wanted

    def forces(
        self, moving: NDArray[np.float64], wheels: NDArray[np.float64], wanted: NDArray[np.float64], dt: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Speeds of the rims (r, 2), and the traction of both wheels (r, 3)."""
        drive.forces(moving, wheels, wanted, self._push, dt, self.traits)
        return wheels, self._push


class ThreeWheels:
    """The holonomic drive."""

    columns = (("ahead", "m/s"), ("left", "m/s"), ("turn", "rad/s"))

    def __init__(self, robots: Crew) -> None:
        each, arm = robots.each, 0.5 * robots.each("wheel_base")
        self._traits = np.column_stack(
            [each("speed"), arm, each("mass"), inertia(robots), each("acceleration"), grip(robots, 3)]
        )
        self._wanted, self._push = np.zeros((len(arm), 3)), np.zeros((len(arm), 3))

    def command(self, twists: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocities (r, 3), scaled down in proportion where a wheel would be too fast."""
        rolling.omni_command(twists, self._traits, self._wanted)
        return self._wanted

    def approach(self, aims: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocities (r, 3) straight to points, without turning."""
        rolling.omni_approach(aims, self._wanted)
        return self._wanted

    def forces(
        self, moving: NDArray[np.float64], wheels: NDArray[np.float64], wanted: NDArray[np.float64], dt: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The velocity that wheels roll with (r, 3), and the traction of the three (r, 3)."""
        rolling.omni_forces(moving, wheels, wanted, self._push, dt, self._traits)
        return wheels, self._push


class Bicycle:
    """A car, with each axle's wheels in the middle."""

    columns = (("speed", "m/s"), ("steering", "rad"))

    def __init__(self, car: Car, robots: Crew) -> None:
        each, count = robots.each, len(robots.each("mass"))
        self._traits = np.column_stack(
            [
                each("speed"), *(np.full(count, one) for one in (car.wheelbase, car.steering, car.steering_rate)),
                each("mass"), inertia(robots), each("acceleration"), grip(robots, 2),
            ]
        )  # fmt: skip
        self._backing = np.zeros(count, np.int8)
        self._wanted, self._push = np.zeros((count, 2)), np.zeros((count, 3))

    def command(self, twists: NDArray[np.float64]) -> NDArray[np.float64]:
        """Speeds and steering angles (r, 2); a turn on the spot becomes the tightest bend."""
        rolling.car_command(twists, self._traits, self._wanted)
        return self._wanted

    def approach(self, aims: NDArray[np.float64]) -> NDArray[np.float64]:
        """Speeds and steering angles (r, 2) on an arc to points, after backing out where that is too tight."""
        rolling.car_approach(aims, self._traits, self._backing, self._wanted)
        return self._wanted

    def forces(
        self, moving: NDArray[np.float64], wheels: NDArray[np.float64], wanted: NDArray[np.float64], dt: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Speed and steering angle (r, 2), and the traction of both axles (r, 3)."""
        rolling.car_forces(moving, wheels, wanted, self._push, dt, self._traits)
        return wheels, self._push
