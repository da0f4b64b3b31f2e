"""What a real body tells, in the channels that a mind was built for."""

from __future__ import annotations

import math
from typing import final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.readings import Channel, Channels, Column
from swarmsim.fleet.adapter import Felt, Pose
from swarmsim.kernels import rays

_POST = 1e-4  # m, the radius of what stands where a beam ends
_TILES = ("tiles.values", "tiles.origins")
_MADE = ("ranges", "beams", "reach")  # what bodies with beams tell


@final
class BodySenses:
    """Turns what a body feels into readings.

    A channel takes the body's values of the same name. Beams, as the adapter `ros2` tells them, also make `ranges` at
    the bearings that the mind has, and tiles, as the simulated ring of beams makes them: among posts that stand where
    the beams end.
    """

    def __init__(self, channels: Channels, lattice: Lattice) -> None:
        self._channels, self._lattice = channels, lattice

    def check(self, felt: Felt) -> None:
        """Raise InputError for a body that does not tell what the mind senses."""
        beams = set(_MADE) <= set(felt.values)
        for one in self._channels:
            if not (one.name in felt.values or (beams and (one.name in _TILES or (one.name == "ranges" and one.axis)))):
                told = ", ".join(felt.values) or "nothing but where it is"
                raise InputError(f"--adapter: this mind senses {one.name}, and the body tells {told}; expected both")

    def readings(self, felt: Felt, pose: Pose) -> tuple[Column, ...]:
        """A row of each channel; without a measurement where the body tells none."""
        tile = self._tile(felt, pose)
        return tuple(tile.get(one.name, self._reading(one, felt)) for one in self._channels)

    def _reading(self, channel: Channel, felt: Felt) -> Column:
        blank: Column = channel.blanks(1)[0]
        told = np.array(felt.values.get(channel.name, ()))
        if channel.name == "ranges" and "beams" in felt.values and len(told):
            bearings = _bearings(felt)
            away = np.abs(_wrapped(np.array(channel.axis)[:, None] - bearings))
            found = told[away.argmin(axis=1)]
            told = np.where(away.min(axis=1) <= abs(felt.values["beams"][1]), found, np.nan)
        if len(told) != blank.size:
            return blank
        held = np.where(np.isinf(told) & (channel.empty == math.inf), np.inf, np.clip(told, channel.low, channel.high))
        if not channel.dtype.startswith("f"):
            held = np.where(np.isfinite(held), held, channel.empty)
        return held.astype(channel.dtype).reshape(channel.shape)

    def _tile(self, felt: Felt, pose: Pose) -> dict[str, Column]:
        """The tile that beams make, by the names of its channels; none if the mind has none."""
        wanted = set(_TILES) <= set(self._channels.places) and _TILES[0] not in felt.values
        if not wanted or not set(_MADE) <= set(felt.values):
            return {}
        rows, columns = self._channels[_TILES[0]].shape
        lattice, (x, y, yaw) = self._lattice, pose
        corner = lattice.cell * math.hypot((rows + 1) / 2, (columns + 1) / 2)
        reach = min(felt.values["reach"][0], corner)
        ranges, bearings = np.array(felt.values["ranges"]), _bearings(felt)
        bearings, ranges = bearings[~np.isnan(ranges)], ranges[~np.isnan(ranges)]
        posts = _ends(pose, bearings[ranges < reach], ranges[ranges < reach])
        values, origins = np.empty((1, rows, columns), np.uint8), np.empty((1, 2), np.int32)
        ring = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
        rays.sense(
            np.array([[x, y, yaw]]), np.ones(1, np.bool_), ring, reach,
            np.empty((0, 4)), np.zeros(2, np.int64), np.empty(0, np.int64), posts, (x - 1.0, y - 1.0, 2.0, 1, 1),
            (lattice.x0, lattice.y0, lattice.cell), np.zeros(1), False, False, values, origins, np.empty((0, 0)),
        )  # fmt: skip
        return {_TILES[0]: values[0], _TILES[1]: origins[0]}


def _bearings(felt: Felt) -> NDArray[np.float64]:
    """The bearing (rad) of each beam."""
    first, step = felt.values["beams"]
    return np.asarray(first + step * np.arange(len(felt.values["ranges"])), np.float64)


def _wrapped(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((angles + math.pi) % (2.0 * math.pi) - math.pi)


def _ends(pose: Pose, bearings: NDArray[np.float64], ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    """A thin post (x, y, radius in m) at the end of each beam."""
    angles, away = bearings + pose[2], ranges + _POST
    return np.stack(
        [pose[0] + away * np.cos(angles), pose[1] + away * np.sin(angles), np.full(len(away), _POST)], axis=1
    )
