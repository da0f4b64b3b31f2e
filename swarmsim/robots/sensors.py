"""A ring of infra-red beams that fills each robot's tile."""

from __future__ import annotations

import math
from collections.abc import Iterable
from copy import copy
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core import chance
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Field, Sensor, Setting
from swarmsim.core.state import Beams, Readings, State, Tiles
from swarmsim.kernels import rays


class IrRing(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Evenly spaced beams around the robot, the first straight ahead, cast against the exact walls."""

    tile: tuple[Annotated[int, Meta(ge=1, le=99)], Annotated[int, Meta(ge=1, le=99)]] = (6, 7)  # rows, columns
    beams: Annotated[int, Meta(ge=1, le=10_000)] = 72  # evenly round the robot
    reach: Annotated[float, Meta(gt=0.0)] = 1.0  # m
    robots: Literal["ignored", "occlude", "occupied"] = "ignored"  # how other robots appear to the beams
    ranges: bool = False  # whether minds are given how far each beam goes besides the tile

    @property
    def margin(self) -> int:
        """How many cells a tile reaches beyond the cell of its robot, at most."""
        return max(self.tile)

    def build(self, setting: Setting) -> IrRingSensor:
        """The sensor for a swarm among these walls."""
        lattice = setting.lattice
        corner = lattice.cell * math.hypot((self.tile[0] + 1) / 2, (self.tile[1] + 1) / 2)
        narrowest = 2.0 * math.pi / self.beams * min(corner, self.reach)
        if narrowest > 0.8 * lattice.cell:
            needed = math.ceil(2.0 * math.pi * min(corner, self.reach) / (0.8 * lattice.cell))
            raise InputError(
                f"beams: {self.beams} beams lie {narrowest:.3g} m apart at the tile's corners and would miss "
                f"cells of {lattice.cell:g} m; at least {needed} are needed"
            )
        return IrRingSensor(self, setting)


class IrRingSensor:
    """Senses the tiles of the whole swarm in one call."""

    def __init__(self, parameters: IrRing, setting: Setting) -> None:
        lattice = setting.lattice
        corner = lattice.cell * math.hypot((parameters.tile[0] + 1) / 2, (parameters.tile[1] + 1) / 2)
        # What lies beyond the tile is looked for only if ranges are asked for.
        self._reach = parameters.reach if parameters.ranges else min(parameters.reach, corner)
        side = max(0.5 * self._reach, lattice.cell)
        rows = math.ceil(lattice.rows * lattice.cell / side)
        columns = math.ceil(lattice.columns * lattice.cell / side)
        self._coarse = (lattice.x0, lattice.y0, side, rows, columns)
        self._building = setting.building
        self._prepare()
        angles = np.arange(parameters.beams) * (2.0 * np.pi / parameters.beams)
        self._ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._working = np.arange(parameters.beams)
        self._bearings = np.where(angles > np.pi, angles - 2.0 * np.pi, angles)
        self._lattice = (lattice.x0, lattice.y0, lattice.cell)
        self._radius = setting.robots.radius
        self._parameters = parameters

    def without(self, beams: Iterable[int]) -> IrRingSensor:
        """The same sensor with these beams dead, counted from 0 straight ahead. Raises InputError for one not there."""
        dead = np.array(sorted(beams), np.int64)
        strange = dead[(dead < 0) | (dead >= self._parameters.beams)]
        if len(strange):
            raise InputError(f"beams: there is no beam {strange[0]}; expected 0 to {self._parameters.beams - 1}")
        left = copy(self)
        kept = ~np.isin(self._working, dead)
        left._ring, left._working = self._ring[kept], self._working[kept]
        return left

    def _prepare(self) -> None:
        """Sort the walls of this moment by place."""
        self._walls, self._version = self._building.walls, self._building.version
        self._near = rays.bins(self._walls, self._reach, *self._coarse)

    def sense(self, state: State) -> Readings:
        """The tiles of all robots, each around its own cell; those of dead robots are all UNKNOWN."""
        parameters = self._parameters
        if self._version != self._building.version:
            self._prepare()
        values = np.empty((state.robots, *parameters.tile), np.uint8)
        origins = np.empty((state.robots, 2), np.int32)
        ranges = np.full((state.robots if parameters.ranges else 0, len(self._ring)), np.inf)
        rays.sense(
            state.pose,
            state.alive,
            self._ring,
            self._reach,
            self._walls,
            *self._near,
            self._building.walkers(),
            self._coarse,
            self._lattice,
            self._radius,
            parameters.robots != "ignored",
            parameters.robots == "occupied",
            values,
            origins,
            ranges,
        )
        beams = Beams(self._bearings[self._working], ranges) if parameters.ranges else None
        return Readings(Tiles(values, origins), beams)


class NoSensor(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots that sense nothing but where they are."""

    @property
    def margin(self) -> int:
        """No cell."""
        return 0

    def build(self, setting: Setting) -> Senseless:
        """The sensor."""
        return Senseless()


class Senseless:
    """Gives nothing."""

    def sense(self, state: State) -> Readings:
        """No readings."""
        return Readings()


class FieldSensor:
    """A sensor that besides samples a scalar field where each robot is, with normal noise."""

    def __init__(self, inner: Sensor, field: Field, period: float, noise: float, salt: int) -> None:
        """`period` (s) of an iteration; `noise` is the standard deviation, in the field's unit."""
        self._inner, self._field, self._period, self._noise, self._salt = inner, field, period, noise, salt

    def sense(self, state: State) -> Readings:
        """The readings, with the field's value where each robot is; NaN for the dead."""
        value = self._field.value(state.iteration * self._period, state.pose[:, :2])
        if self._noise > 0.0:
            value = value + self._noise * chance.normal(self._salt, state.iteration, np.arange(state.robots), 0)
        return replace(self._inner.sense(state), field=np.where(state.alive, value, np.nan))


def with_field(sensor: Sensor, setting: Setting, noise: float) -> Sensor:
    """The sensor, which also samples the setting's field, if there is one; `noise` as in FieldSensor."""
    if setting.scalar_field is None:
        return sensor
    salt = int(setting.streams.open("field noise").integers(0, 2**64, dtype=np.uint64))
    return FieldSensor(sensor, setting.scalar_field, setting.period, noise, salt)
