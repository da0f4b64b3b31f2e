"""Buoys: floating bodies with thrusters, in water that moves."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.crew import Crew, Length

Speed = Annotated[float, Meta(ge=-10.0, le=10.0)]


class Buoy(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Floats with thrusters: they move in any direction through water that carries them along.

    The water flows with `current`, plus eddies as of Taylor and Green (1937), which neither start nor end anywhere: by
    the stream function, u = eddies sin(pi x / s) cos(pi y / s) and v = -eddies cos(pi x / s) sin(pi y / s), with s =
    `eddy_size`. It flows through walls, so worlds should be open water.
    """

    current: tuple[Speed, Speed] = (0.0, 0.0)  # m/s, to the right and up
    eddies: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0  # m/s, fastest flow
    eddy_size: Length = 5.0  # m, side of an eddy
    settling: Annotated[float, Meta(ge=0.01, le=1e3)] = 1.0  # s, in which drag takes 63 % of a speed through the water

    @property
    def sideways(self) -> bool:
        """They can move to the side."""
        return True

    def flow(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The water's velocity (k, 2), m/s, at points (k, 2), m."""
        east, north = math.pi / self.eddy_size * points.T
        found = np.stack([np.sin(east) * np.cos(north), -np.cos(east) * np.sin(north)], axis=1)
        return np.asarray(self.current + self.eddies * found)

    def build(self, context: BuildContext) -> Thrusters:
        """The kinematics of such robots."""
        return Thrusters(self, context.robots)


class Thrusters:
    """Thrust and drag, linear in the speed through the water."""

    columns = (("ahead", "m/s"), ("left", "m/s"), ("turn", "rad/s"))

    def __init__(self, buoy: Buoy, robots: Crew) -> None:
        self._buoy, each = buoy, robots.each
        self._speed, self._mass, self._acceleration = each("speed"), each("mass"), each("acceleration")
        self._arm = each("radius")
        self._inertia = self._mass * (0.5 * (self._arm * self._arm))
        self._wanted = np.zeros((len(self._mass), 3))

    def command(self, twists: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocities through the water (r, 3), scaled down where a thruster would be too weak."""
        asked = np.hypot(twists[:, 0], twists[:, 1]) + self._arm * np.abs(twists[:, 2])
        slower = np.minimum(1.0, self._speed / np.maximum(asked, 1e-300))
        np.multiply(twists, slower[:, None], out=self._wanted)
        return self._wanted

    def approach(self, aims: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocities through the water (r, 3) straight to points, without turning and without regard to the flow."""
        np.multiply(aims[:, :2], (aims[:, 3] / np.maximum(aims[:, 2], 1e-300))[:, None], out=self._wanted[:, :2])
        self._wanted[:, 2] = 0.0
        return self._wanted

    def forces(
        self, moving: NDArray[np.float64], wheels: NDArray[np.float64], wanted: NDArray[np.float64], dt: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The velocity that thrusters drive at (r, 3), and thrust and drag (r, 3).

        In still water a body settles at the thrusters' velocity v: m dv/dt = m (v + flow - velocity) / settling. The
        force is the mean over `dt` of this equation's solution, so the length of sub-steps does not matter.
        """
        most = (self._acceleration * dt)[:, None] / np.column_stack([np.ones((len(wheels), 2)), self._arm])
        wheels += np.clip(wanted - wheels, -most, most)
        cosine, sine = np.cos(moving[:, 2]), np.sin(moving[:, 2])
        driven = np.stack(
            [cosine * wheels[:, 0] - sine * wheels[:, 1], sine * wheels[:, 0] + cosine * wheels[:, 1], wheels[:, 2]],
            axis=1,
        )
        driven[:, :2] += self._buoy.flow(moving[:, :2])
        gained = (driven - moving[:, 3:]) * (-math.expm1(-dt / self._buoy.settling) / dt)
        return wheels, gained * np.stack([self._mass, self._mass, self._inertia], axis=1)
