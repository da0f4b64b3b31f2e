"""Rangefinders that err: noise, blind zones, cones, drop-outs and outliers, and the evidence in their readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.readings import Readings
from swarmsim.core.state import UNKNOWN, State
from swarmsim.kernels import evidence, rays
from swarmsim.robots.ring import WholeRing, held, radii_of
from swarmsim.robots.suites import checked

ACROSS: Final = 5  # rays that stand for the cone of a beam; odd, so that one is its middle


class RangefinderSensor:
    """Measures how far each beam of each robot goes, with errors, and fills tiles by the evidence.

    Errors are drawn for the robot, the beam and the iteration, so that one more robot shifts no other's.
    """

    def __init__(self, whole: WholeRing, context: BuildContext) -> None:
        lattice = context.lattice
        self._whole, self._lattice = whole, (lattice.x0, lattice.y0, lattice.cell)
        beams = whole.angles()
        self._working = np.ones(len(beams), np.bool_)
        aside = math.radians(whole.cone) * (np.linspace(-0.5, 0.5, ACROSS) if whole.cone else np.zeros(1))
        angles = beams[:, None] + aside
        self._rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (b, s, 2)
        side = max(0.5 * whole.reach, lattice.cell)
        self._coarse = (
            lattice.x0, lattice.y0, side, math.ceil(lattice.rows * lattice.cell / side),
            math.ceil(lattice.columns * lattice.cell / side),
        )  # fmt: skip
        rounding = whole.step / math.sqrt(12.0)
        spread = (whole.error, whole.error_share, whole.error_square)
        self._noise = np.array([math.hypot(spread[0], rounding), *spread[1:]])
        self._drawn = np.array(spread)
        purpose = f"sensor {context.number}" if context.number else "sensor"  # two on one robot err differently
        self._salt = int(context.streams.open(purpose).integers(0, 2**64, dtype=np.uint64))
        self.channels = whole.channels(evidence=True)
        self._building, self._radii = context.building, context.robots.each("radius")
        self._prepare()

    def _prepare(self) -> None:
        """Sort the present walls by place."""
        self._walls, self._version = self._building.walls.copy(), self._building.version
        self._near = rays.bins(self._walls, self._whole.reach, *self._coarse)

    def without(self, beams: Sequence[int]) -> RangefinderSensor:
        """The same sensor with these beams dead, counted from 0. Raises InputError for one not there."""
        left = copy(self)
        left._working = self._working.copy()
        left._working[checked(beams, len(self._working))] = False
        return left

    def sense(self, state: State) -> Readings:
        """The tiles of all robots, each around its own cell, with their evidence; those of dead robots are UNKNOWN."""
        whole = self._whole
        if self._version != self._building.version:
            self._prepare()
        seen, origins = self._distances(state, whole.robots != "ignored")
        readings = self._measured(state, seen)
        if whole.robots == "occlude":  # what only another robot can have stopped tells nothing of walls
            readings[seen < self._distances(state, False)[0]] = np.nan
        values = np.empty((state.robots, *whole.shape), np.uint8)
        said = np.empty(values.shape, np.float32)
        evidence.tiles(
            state.pose, state.alive, self._rays, self._rays.shape[1] // 2, readings, whole.reach, whole.blind,
            self._noise, whole.outliers, self._lattice, values, origins, said,
        )  # fmt: skip
        if whole.frame == "robot":
            values[~held(state.pose, origins, whole.tile, whole.shape, self._lattice)] = UNKNOWN
        return Readings(self.channels, (values, origins, said, *((readings,) if whole.ranges else ())))

    def _distances(self, state: State, occlude: bool) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """How far each beam (n, b) goes to the first thing within its cone, and the tiles' origins."""
        ring = self._rays.reshape(-1, 2)
        values = np.empty((state.robots, *self._whole.shape), np.uint8)
        origins = np.empty((state.robots, 2), np.int32)
        found = np.full((state.robots, len(ring)), np.inf)
        rays.sense(
            state.pose, state.alive, ring, self._whole.reach, self._walls, *self._near, self._building.walkers(),
            self._coarse, self._lattice, radii_of(self._radii, state), occlude, occlude, values, origins, found,
        )  # fmt: skip
        return found.reshape(state.robots, *self._rays.shape[:2]).min(axis=2), origins

    def _measured(self, state: State, seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """Readings (n, b) of these distances: infinite for nothing within reach, NaN for none."""
        whole, salt, at = self._whole, self._salt, state.iteration
        robot, beam = np.arange(state.robots)[:, None], np.arange(len(self._working))
        constant, share, square = self._drawn
        with np.errstate(invalid="ignore"):  # infinities stay
            sigma = np.sqrt(constant**2 + (share * seen) ** 2 + (square * seen**2) ** 2)
            readings = np.where(np.isfinite(seen), seen + sigma * chance.normal(salt, at, robot, beam, 0), np.inf)
        lost = seen < whole.blind
        if whole.outliers:
            anywhere = whole.blind + (whole.reach - whole.blind) * chance.uniform(salt, at, robot, beam, 3)
            readings = np.where(chance.uniform(salt, at, robot, beam, 4) < whole.outliers, anywhere, readings)
        if whole.step:
            readings = whole.step * np.round(readings / whole.step)
        readings = np.where(readings > whole.reach, np.inf, readings)
        lost |= readings < whole.blind
        if whole.drop_out:
            lost |= chance.uniform(salt, at, robot, beam, 5) < whole.drop_out
        return np.where(lost | ~self._working | ~state.alive[:, None], np.nan, readings)
