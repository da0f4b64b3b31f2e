"""The seams: one verb each, and the only thing the tick knows of the part behind it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario import Robots
from swarmsim.core.state import Event, Inbox, Intents, Moment, Observations, State, Tiles
from swarmsim.core.streams import Streams

Links = NDArray[np.int32]  # (m, 2): receiver, sender; sorted by receiver, then sender
WheelSpeeds = NDArray[np.float64]  # (n, 2): left, right, m/s
Walls = NDArray[np.float64]  # (s, 4): x1, y1, x2, y2 in m, the solid side on the left


@dataclass(frozen=True, slots=True)
class Setting:
    """What every part may know of the run it is built for; it tells nothing of the building's inside."""

    robots: Robots
    lattice: Lattice
    period: float  # s, one iteration
    streams: Streams


class Sensor(Protocol):
    """Turns the world around each robot into a tile."""

    def sense(self, state: State) -> Tiles:
        """The tiles (n, rows, columns) of all robots; a dead robot's tile is all UNKNOWN."""
        ...


class Topology(Protocol):
    """Says who hears whom."""

    def links(self, state: State) -> Links:
        """Directed links among live robots: no self link, each pair at most once."""
        ...


class Channel(Protocol):
    """Says what arrives of what was said."""

    def deliver(self, iteration: int, links: Links, said: Tiles) -> Inbox:
        """The messages heard in this iteration."""
        ...


class Behaviour(Protocol):
    """Decides what each robot does with what it sensed and heard."""

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which cells each robot's map holds (n, rows, columns); a live view, for faults alone to write."""
        ...

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """Each robot's occupancy grid (n, rows, columns); a live view, to be read only."""
        ...

    def step(self, observations: Observations) -> Intents:
        """The intents of all robots, of which row i follows from row i of what is given alone."""
        ...


class Motion(Protocol):
    """Turns intents into wheel speeds, once per physics sub-step."""

    def follow(self, intents: Intents) -> None:
        """Take up new intents, at the start of an iteration."""
        ...

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wheel speeds wanted at these poses (n, 3); the array is reused by the next call."""
        ...


class Bodies(Protocol):
    """Moves the swarm through the world."""

    def drive(self, motion: Motion, period: float) -> State:
        """The state one period (s) later, with `motion` asked at every sub-step."""
        ...

    def state(self) -> State:
        """The state now."""
        ...

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take live robots (r,) out of the world for good; their rows stay, no longer alive."""
        ...


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a swarm, one per seam, and what they have to report since the last iteration."""

    sensor: Sensor
    topology: Topology
    channel: Channel
    behaviour: Behaviour
    motion: Motion
    bodies: Bodies
    events: list[Event] = field(default_factory=list)


class Fault(Protocol):
    """Something that goes wrong in one of the parts."""

    def install(self, parts: Parts) -> Parts:
        """The same parts, one of them wrapped."""
        ...


class Probe(Protocol):
    """Something that looks at every iteration."""

    def sample(self, moment: Moment) -> None:
        """Take note of one iteration."""
        ...
