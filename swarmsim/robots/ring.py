"""A ring of beams with all its numbers, and how its tiles lie on the lattice."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.readings import Channels, range_channel, tile_channels
from swarmsim.core.state import State


class WholeRing(Struct, frozen=True, kw_only=True):
    """The keys of an `IrRing`, with those that a scenario leaves out taken from its preset."""

    tile: tuple[int, int]  # rows, columns
    frame: Literal["map", "robot"]
    beams: int
    bearings: tuple[float, ...] | None  # degrees; None: evenly round the robot
    reach: float  # m
    blind: float  # m
    cone: float  # degrees
    error: float  # m
    error_share: float
    error_square: float  # 1/m
    drop_out: float
    outliers: float
    step: float  # m
    robots: Literal["ignored", "occlude", "occupied"]
    ranges: bool

    @property
    def errs(self) -> bool:
        """Whether anything but the number of beams is not ideal."""
        spread = self.error or self.error_share or self.error_square or self.step
        return bool(spread or self.blind or self.cone or self.drop_out or self.outliers)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the tile in cells of the map, with room to turn if it turns."""
        side = math.ceil(math.hypot(*self.tile)) + 1
        return self.tile if self.frame == "map" else (side, side)

    def corner(self, cell: float) -> float:
        """How far the corners of the tile can be from its robot, in m, for cells of a side in m."""
        return cell * math.hypot((self.tile[0] + 1) / 2, (self.tile[1] + 1) / 2)

    def angles(self) -> NDArray[np.float64]:
        """The bearings (b,) of the beams in rad, counter-clockwise from straight ahead, 0 to a whole turn."""
        if self.bearings is not None:
            return np.array([math.radians(bearing) % (2.0 * math.pi) for bearing in self.bearings])
        return np.asarray(np.arange(self.beams) * (2.0 * np.pi / self.beams))

    def channels(self, evidence: bool) -> Channels:
        """The channels of such a ring, with or without its tiles' evidence."""
        angles = self.angles()
        ahead = np.where(angles > np.pi, angles - 2.0 * np.pi, angles)
        ranges = (range_channel(ahead, self.reach),) if self.ranges else ()
        return Channels(*tile_channels(self.shape, evidence), *ranges)


def radii_of(radii: NDArray[np.float64], state: State) -> NDArray[np.float64]:
    """The radii (n,) of the robots of a state; the largest for more robots than the sensor was built for."""
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
