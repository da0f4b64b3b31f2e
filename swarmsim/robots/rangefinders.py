"""Rangefinders that err: noise, blind zones, cones, drop-outs and outliers, and what their readings are worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.readings import Readings
from swarmsim.core.setting import Setting
from swarmsim.core.state import UNKNOWN, State
from swarmsim.kernels import evidence, rays
from swarmsim.robots.suites import checked

if TYPE_CHECKING:
    from swarmsim.robots.sensors import IrRing

ACROSS: Final = 5  # rays that stand for the cone of a beam; odd, so that one is its middle


class RangefinderSensor:
    """Measures how far each beam of each robot goes, with errors, and fills tiles with what that is worth.

    Errors are drawn for the robot, the beam and the iteration, so that one more robot shifts nobody's.
    """

    def __init__(self, parameters: IrRing, setting: Setting) -> None:
        lattice = setting.lattice
        assert parameters.reach is not None
        assert parameters.cone is not None
        assert parameters.step is not None
        self._parameters, self._lattice = parameters, (lattice.x0, lattice.y0, lattice.cell)
        beams = parameters.angles()
        self._working = np.ones(len(beams), np.bool_)
        aside = math.radians(parameters.cone) * (np.linspace(-0.5, 0.5, ACROSS) if parameters.cone else np.zeros(1))
        angles = beams[:, None] + aside
        self._rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (b, s, 2)
        side = max(0.5 * parameters.reach, lattice.cell)
        self._coarse = (
            lattice.x0, lattice.y0, side, math.ceil(lattice.rows * lattice.cell / side),
            math.ceil(lattice.columns * lattice.cell / side),
        )  # fmt: skip
        rounding = parameters.step / math.sqrt(12.0)
        spread = (parameters.error or 0.0, parameters.error_share or 0.0, parameters.error_square or 0.0)
        self._noise = np.array([math.hypot(spread[0], rounding), *spread[1:]])
        self._drawn = np.array(spread)
        purpose = f"sensor {setting.number}" if setting.number else "sensor"  # two on one robot err differently
        self._salt = int(setting.streams.open(purpose).integers(0, 2**64, dtype=np.uint64))
        self.channels = parameters.channels(evidence=True)
        self._building, self._radii = setting.building, setting.robots.each("radius")
        self._prepare()

    def _prepare(self) -> None:
        """Sort the walls of this moment by place."""
        self._walls, self._version = self._building.walls.copy(), self._building.version
        self._near = rays.bins(self._walls, self._parameters.reach, *self._coarse)

    def without(self, beams: Sequence[int]) -> RangefinderSensor:
        """The same sensor with these beams dead, counted from 0. Raises InputError for one not there."""
        left = copy(self)
        left._working = self._working.copy()
        left._working[checked(beams, len(self._working))] = False
        return left

    def sense(self, state: State) -> Readings:
        """The tiles of all robots, each around its own cell, with their evidence; those of dead robots are UNKNOWN."""
        parameters = self._parameters
        if self._version != self._building.version:
            self._prepare()
        seen, origins = self._distances(state, parameters.robots != "ignored")
        readings = self._measured(state, seen)
        if parameters.robots == "occlude":  # what only another robot can have stopped tells nothing of walls
            readings[seen < self._distances(state, False)[0]] = np.nan
        values = np.empty((state.robots, *parameters.shape), np.uint8)
        said = np.empty(values.shape, np.float32)
        evidence.tiles(
            state.pose, state.alive, self._rays, self._rays.shape[1] // 2, readings, parameters.reach, parameters.blind,
            self._noise, parameters.outliers, self._lattice, values, origins, said,
        )  # fmt: skip
        if parameters.frame == "robot":
            values[~held(state.pose, origins, parameters.tile, parameters.shape, self._lattice)] = UNKNOWN
        return Readings(self.channels, (values, origins, said, *((readings,) if parameters.ranges else ())))

    def _distances(self, state: State, occlude: bool) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """How far each beam (n, b) goes before it meets the first thing within its cone, and the tiles' origins."""
        ring = self._rays.reshape(-1, 2)
        values = np.empty((state.robots, *self._parameters.shape), np.uint8)
        origins = np.empty((state.robots, 2), np.int32)
        found = np.full((state.robots, len(ring)), np.inf)
        rays.sense(
            state.pose, state.alive, ring, self._parameters.reach, self._walls, *self._near, self._building.walkers(),
            self._coarse, self._lattice, radii_of(self._radii, state), occlude, occlude, values, origins, found,
        )  # fmt: skip
        return found.reshape(state.robots, *self._rays.shape[:2]).min(axis=2), origins

    def _measured(self, state: State, seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """Readings (n, b) of these distances: infinite for nothing within reach, NaN for none."""
        parameters, salt, at = self._parameters, self._salt, state.iteration
        assert parameters.reach is not None
        assert parameters.blind is not None
        robot, beam = np.arange(state.robots)[:, None], np.arange(len(self._working))
        constant, share, square = self._drawn
        with np.errstate(invalid="ignore"):  # what is infinite stays so
            sigma = np.sqrt(constant**2 + (share * seen) ** 2 + (square * seen**2) ** 2)
            readings = np.where(np.isfinite(seen), seen + sigma * chance.normal(salt, at, robot, beam, 0), np.inf)
        lost = seen < parameters.blind
        if parameters.outliers:
            anywhere = parameters.blind + (parameters.reach - parameters.blind) * chance.uniform(
                salt, at, robot, beam, 3
            )
            readings = np.where(chance.uniform(salt, at, robot, beam, 4) < parameters.outliers, anywhere, readings)
        if parameters.step:
            readings = parameters.step * np.round(readings / parameters.step)
        readings = np.where(readings > parameters.reach, np.inf, readings)
        lost |= readings < parameters.blind
        if parameters.drop_out:
            lost |= chance.uniform(salt, at, robot, beam, 5) < parameters.drop_out
        return np.where(lost | ~self._working | ~state.alive[:, None], np.nan, readings)


def radii_of(radii: NDArray[np.float64], state: State) -> NDArray[np.float64]:
    """The radii (n,) of the robots of a state; of more robots than a sensor was built for, the largest."""
    return radii if len(radii) == state.robots else np.full(state.robots, radii.max())


def held(
    pose: NDArray[np.float64],
    origins: NDArray[np.int32],
    tile: tuple[int, int],
    shape: tuple[int, int],
    lattice: tuple[float, float, float],
) -> NDArray[np.bool_]:
    """Which cells (n, *shape) at `origins` (n, 2) have their centres in a tile that turns with its robot.

    Its `tile[1]` columns run ahead, its `tile[0]` rows to the left, with the robot in the middle.
    """
    x0, y0, cell = lattice
    y = y0 + (origins[:, 0, None, None] + np.arange(shape[0])[:, None] + 0.5) * cell - pose[:, 1, None, None]
    x = x0 + (origins[:, 1, None, None] + np.arange(shape[1]) + 0.5) * cell - pose[:, 0, None, None]
    cos, sin = np.cos(pose[:, 2, None, None]), np.sin(pose[:, 2, None, None])
    ahead, left = x * cos + y * sin, y * cos - x * sin
    return np.asarray((np.abs(ahead) <= 0.5 * tile[1] * cell) & (np.abs(left) <= 0.5 * tile[0] * cell))
