"""A ring of infra-red beams that fills each robot's tile."""

from __future__ import annotations

import math
from collections.abc import Iterable
from copy import copy
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Building, Setting
from swarmsim.core.state import State, Tiles
from swarmsim.kernels import rays


class IrRing(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Evenly spaced beams around the robot, the first straight ahead, cast against the exact walls."""

    tile: tuple[Annotated[int, Meta(ge=1, le=99)], Annotated[int, Meta(ge=1, le=99)]] = (6, 7)  # rows, columns
    beams: Annotated[int, Meta(ge=1, le=10_000)] = 72
    reach: Annotated[float, Meta(gt=0.0)] = 1.0  # m
    robots: Literal["ignored", "occlude", "occupied"] = "ignored"  # how other robots appear to the beams

    def build(self, setting: Setting, building: Building) -> IrRingSensor:
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
        return IrRingSensor(self, setting, building)


class IrRingSensor:
    """Senses the tiles of the whole swarm in one call."""

    def __init__(self, parameters: IrRing, setting: Setting, building: Building) -> None:
        lattice = setting.lattice
        corner = lattice.cell * math.hypot((parameters.tile[0] + 1) / 2, (parameters.tile[1] + 1) / 2)
        self._reach = min(parameters.reach, corner)  # what lies beyond the tile is not looked for
        side = max(0.5 * self._reach, lattice.cell)
        rows = math.ceil(lattice.rows * lattice.cell / side)
        columns = math.ceil(lattice.columns * lattice.cell / side)
        self._coarse = (lattice.x0, lattice.y0, side, rows, columns)
        self._building = building
        self._prepare()
        angles = np.arange(parameters.beams) * (2.0 * np.pi / parameters.beams)
        self._ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._working = np.arange(parameters.beams)
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

    def sense(self, state: State) -> Tiles:
        """The tiles of all robots, each around its own cell; those of dead robots are all UNKNOWN."""
        parameters = self._parameters
        if self._version != self._building.version:
            self._prepare()
        values = np.empty((state.robots, *parameters.tile), np.uint8)
        origins = np.empty((state.robots, 2), np.int32)
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
        )
        return Tiles(values, origins)
