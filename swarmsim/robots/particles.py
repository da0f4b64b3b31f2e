"""Robots without bodies: points that move exactly as told, through everything, in an arena that may have no edge."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Motion
from swarmsim.core.state import State
from swarmsim.robots.kinematics import drives_of


class Particles(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Self-propelled points for comparison with models without physics: nothing is in their way.

    They stop at the edges of the floor plan's page or, if it is `periodic`, leave at one and enter at the opposite one.
    Wheels obey at once, and between two commands a robot drives an exact arc.
    """

    periodic: bool = False
    substeps: Annotated[int, Meta(ge=1, le=1000)] = 1  # commands within a period; robots that follow ways need several

    def build(self, context: BuildContext) -> PointBodies:
        """The bodies at the robots' starts. Raises InputError for robots without two wheels each."""
        if other := sorted(drives_of(context).names - {"differential"}):
            raise InputError(
                f"use: particles move as on two wheels, not as {' or '.join(map(repr, other))}; expected "
                "physics.use = 'pymunk', or kinematics.use = 'differential'"
            )
        return PointBodies(self, context)


class PointBodies:
    """Unicycles, integrated exactly."""

    def __init__(self, parameters: Particles, context: BuildContext) -> None:
        self._parameters, self._page = parameters, context.building.bounds
        self._base = context.robots.each("wheel_base")
        count = len(context.start)
        self._pose, self._velocity = context.start.copy(), np.zeros((count, 3))
        self._wheels = np.zeros((count, 2))
        self._alive, self._there = np.ones(count, np.bool_), np.ones(count, np.bool_)
        self._retired = np.zeros(count, np.bool_)
        self._iteration = 0

    def state(self) -> State:
        """The robots' present state; the arrays are copies."""
        moving = (self._pose.copy(), self._velocity.copy(), self._wheels.copy())
        return State(self._iteration, *moving, self._alive.copy())

    @property
    def solid(self) -> NDArray[np.bool_]:
        """Which robots (n,) are in the world, alive or crashed."""
        return self._there.copy()

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots (r,) out of the world."""
        self._there[robots] = False
        self.crash(robots)

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Stop robots (r,) for good."""
        self._alive[robots] = False
        self._wheels[robots], self._velocity[robots] = 0.0, 0.0

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put robots (r,) at `pose` (r, 3), at rest and alive again, except retired ones."""
        robots, pose = robots[~self._retired[robots]], pose[~self._retired[robots]]
        self._pose[robots], self._wheels[robots], self._velocity[robots] = pose, 0.0, 0.0
        self._alive[robots], self._there[robots] = True, True

    def push(self, robots: NDArray[np.int64], velocity: tuple[float, float]) -> None:
        """Particles cannot be pushed. Raises InputError."""
        raise InputError("use: particles have no mass, and cannot be pushed; expected physics.use = 'pymunk'")

    def retire(self, robots: NDArray[np.int64]) -> None:
        """Never revive these robots (r,)."""
        self._retired[robots] = True

    def drive(self, motion: Motion, period: float) -> State:
        """The state one period (s) later."""
        dt = period / self._parameters.substeps
        for _ in range(self._parameters.substeps):
            self._wheels[:] = np.where(self._alive[:, None], motion.command(self._pose), 0.0)
            speed = 0.5 * (self._wheels[:, 0] + self._wheels[:, 1])
            turn = (self._wheels[:, 1] - self._wheels[:, 0]) / self._base
            # The chord of an arc is shorter than the arc by sin(a) / a, and points along the heading halfway.
            half = 0.5 * turn * dt
            chord, heading = speed * dt * np.sinc(half / np.pi), self._pose[:, 2] + half
            self._pose[:, 0] += chord * np.cos(heading)
            self._pose[:, 1] += chord * np.sin(heading)
            self._pose[:, 2] += turn * dt
            self._stay_on_page()
        after = self._pose[:, 2]
        self._velocity[:] = np.column_stack([speed * np.cos(after), speed * np.sin(after), turn])
        self._iteration += 1
        return self.state()

    def carry(self, by: NDArray[np.float64]) -> None:
        """Move all live robots along by this (2,), in m."""
        self._pose[self._alive, :2] += by
        self._stay_on_page()

    def _stay_on_page(self) -> None:
        low, size = np.array(self._page[:2]), np.array(self._page[2:]) - np.array(self._page[:2])
        place = self._pose[:, :2] - low
        self._pose[:, :2] = low + (np.mod(place, size) if self._parameters.periodic else np.clip(place, 0.0, size))
