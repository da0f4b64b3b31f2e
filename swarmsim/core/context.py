"""Build contexts of parts: a run, or the site of a generated building."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.building import Building
from swarmsim.core.crew import Crew
from swarmsim.core.kinematics import Drives
from swarmsim.core.lattice import Lattice
from swarmsim.core.processors import Processors
from swarmsim.core.readings import NOTHING, Channels
from swarmsim.core.streams import Streams


class Field(Protocol):
    """A scalar quantity that has a value everywhere in the building, at every time."""

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at a time (s) and at points (k, 2): x, y in m."""
        ...


class Swarm(Protocol):
    """The robots of a scenario."""

    @property
    def count(self) -> int:
        """The number of robots."""
        ...

    def crew(self, ids: NDArray[np.int64]) -> Crew:
        """The bodies of those with these numbers (rows,)."""
        ...


@dataclass(frozen=True, slots=True)
class Gauge:
    """A part's internal number per robot, for probes to read, such as the energy left."""

    name: str  # of the quantity: parts that measure the same use the same
    unit: str
    read: Callable[[], NDArray[np.float64]]  # a copy (n,)


@dataclass(frozen=True, slots=True)
class BuildContext:
    """What every part may know of its run.

    Minds may use only the building's size: all else they have to sense.
    They may use others' starts only to place data received in the others' frames on the lattice.

    A mind may be built for some of the robots, even for one. It has a row for each of `ids`, draws and names robots by
    their numbers, and takes facts about the whole swarm from `swarm` and its keys, never from its number of rows.
    A kinematics is built for the robots that have it. All other parts are built for all robots.
    """

    robots: Crew  # their bodies
    ids: NDArray[np.int64]  # (rows,): numbers of the robots served, in row order
    swarm: int  # number of all robots, counted from 0
    lattice: Lattice
    period: float  # s, one iteration
    streams: Streams
    building: Building
    starts: NDArray[np.float64]  # (N, 3): poses of all robots at the start, by number
    scalar_field: Field | None = None  # to measure besides walls
    rounds: int = 1  # exchanges of messages in an iteration
    broadcasts: bool = False  # whether a message is charged once, however many robots hear it
    number: int = 0  # a fault's place among the scenario's, or a sensor's among its robot's
    actuators: Channels = NOTHING  # of actuators, for all parts but actuators, which are built first
    channels: Channels = NOTHING  # of sensors, for all parts built after them
    gauges: tuple[Gauge, ...] = ()  # for probes, built last
    kinematics: Drives | None = None  # of all robots; None: each has two wheels
    processors: Processors | None = None  # of the robots served, for jobs and what measures them; None: unlimited

    @classmethod
    def of(
        cls,
        robots: Swarm,
        lattice: Lattice,
        period: float,
        streams: Streams,
        building: Building,
        start: NDArray[np.float64] | None = None,
        channels: Channels = NOTHING,
    ) -> Self:
        """The context of a part for all robots, without a field; they start at (n, 3) or, by default, at the origin."""
        ids = np.arange(robots.count)
        poses = np.zeros((robots.count, 3)) if start is None else start
        return cls(robots.crew(ids), ids, robots.count, lattice, period, streams, building, poses, channels=channels)

    def serving(self, ids: NDArray[np.int64]) -> Self:
        """The same for a mind of the robots with these numbers (rows,); needs a context of all robots."""
        return replace(self, robots=self.robots.of(ids), ids=ids)

    @property
    def start(self) -> NDArray[np.float64]:
        """Poses at the start (rows, 3)."""
        return self.starts[self.ids]

    @property
    def sideways(self) -> NDArray[np.bool_] | None:
        """Which of the robots served (rows,) can move sideways; None if none of the swarm can."""
        drives = self.kinematics
        return drives.sideways[self.ids] if drives is not None and drives.sideways.any() else None

    def own_streams(self, purpose: str) -> list[np.random.Generator]:
        """A stream for each robot served, by its number."""
        return [self.streams.open(purpose, robot) for robot in self.ids.tolist()]


@dataclass(frozen=True, slots=True)
class WorldContext:
    """The inputs of a generated building."""

    streams: Streams  # of the world's own seed
    cell: float  # m, side of the lattice's cells
