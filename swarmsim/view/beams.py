"""Lengths of robots' beams, cast again from the recorded poses."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.strtree import STRtree

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.file import Sensors, fitted
from swarmsim.kernels import rays
from swarmsim.recording.reader import Recording
from swarmsim.robots.ring import WholeRing
from swarmsim.robots.sensors import IrRing
from swarmsim.world.arena import Arena
from swarmsim.world.plan import FloorPlan

MARGIN: Final = 1e-6  # m: rounding must not hide a wall that a beam just reaches


class BeamReplay:
    """The beams of infra-red rings without errors, up to the first wall, box or person."""

    def __init__(self, recording: Recording, plan: FloorPlan) -> None:
        scenario = recording.scenario
        self._arena = Arena.open(plan, scenario.grid.cell, 1, scenario.title)
        self._cell = scenario.grid.cell
        rings = [_ring(sensors) for sensors in fitted(scenario)]
        counts = [group.count for group in scenario.robots.groups] if len(rings) > 1 else [scenario.robots.count]
        self._rings = [ring for ring, count in zip(rings, counts, strict=True) for _ in range(count)]
        self._boxes: tuple[Box, ...] = ()
        self._sort(self._arena)

    def lengths(
        self, robot: int, pose: NDArray[np.float64], boxes: tuple[Box, ...], discs: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Lengths (b,) in m of the beams of a robot at `pose` (3,); empty without a ring.

        `discs` (p, 3) are people: x, y, radius in m.
        """
        ring = self._rings[robot]
        if ring is None:
            return np.empty(0)
        if boxes != self._boxes:
            self._boxes = boxes
            self._sort(self._arena.with_boxes(boxes) if boxes else self._arena)
        reach = self.reach(robot)
        within = shapely.box(*(pose[:2] - reach - MARGIN), *(pose[:2] + reach + MARGIN))
        near = self._walls[np.sort(self._places.query(within))]
        distance, _ = rays.cast(pose[:2], ring.angles() + pose[2], reach, near, discs)
        return np.asarray(np.minimum(distance, reach))

    def _sort(self, arena: Arena) -> None:
        """Sort the walls of an arena by place."""
        self._walls = arena.segments
        self._places = STRtree(np.asarray(shapely.linestrings(self._walls.reshape(-1, 2, 2))))

    def bearings(self, robot: int) -> list[float]:
        """The bearings of a robot's beams in rad; empty without a ring."""
        ring = self._rings[robot]
        return [] if ring is None else ring.angles().tolist()

    def reach(self, robot: int) -> float:
        """The greatest length of a robot's beams, in m: as far as its tile reaches."""
        ring = self._rings[robot]
        if ring is None:
            return 0.0
        return min(ring.reach, ring.corner(self._cell))


def _ring(sensors: Sensors) -> WholeRing | None:
    """The first ring among the sensors of a robot."""
    for _, sensor in sensors:
        try:
            part = sensor.parameters
        except InputError:  # third-party code, which pictures do not run
            continue
        if isinstance(part, IrRing):
            return part.whole
    return None
