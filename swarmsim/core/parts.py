"""The seams: one verb each, and the only thing the tick knows of the part behind it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario import Robots
from swarmsim.core.state import Delivery, Event, Inbox, Intents, Moment, Observations, Said, State, Tiles
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


Box = tuple[float, float, float, float]  # left, lower, right, upper edge in m
ANYWHERE: Final[Box] = (-np.inf, -np.inf, np.inf, np.inf)


class Crowd(Protocol):
    """Discs that walk about among the robots."""

    discs: NDArray[np.float64]  # (p, 3): x, y, radius in m, where they are; a live view

    def walk(self, pose: NDArray[np.float64], solid: NDArray[np.bool_], dt: float) -> NDArray[np.float64]:
        """Let `discs` move for one sub-step of `dt` (s); gives the velocities (p, 2), reused by the next call.

        They never step towards a robot that they would touch: robots are at `pose` (n, 3) if they are `solid` (n,).
        """
        ...


@dataclass(slots=True, eq=False)
class Building:
    """What stands where at this moment; parts that prepare anything from it do so again when `version` rises.

    Faults alone change it, by `rebuild` and `admit`. Parts of robots may know its walls and crowds through what they
    measure only.
    """

    walls: Walls
    occupied: NDArray[np.bool_]  # (rows, columns): the truth, without crowds
    domain: NDArray[np.bool_]  # (rows, columns): the cells that make 100 %
    entrance: NDArray[np.float64]  # (c, 2): x, y in m of the cells of the spawn area in which a robot can stand
    survey: Callable[[tuple[Box, ...]], Survey]
    version: int = 0
    page: Box = ANYWHERE  # what boxes have to lie in
    boxes: tuple[Box, ...] = ()  # what stands in it besides its plan
    crowds: list[Crowd] = field(default_factory=list)

    def rebuild(self, boxes: tuple[Box, ...]) -> None:
        """Let these boxes, and no others, stand in the building besides its plan.

        No body may be where a box will be. Raises InputError for a box that `check` refuses and for boxes that leave
        robots no place to stand.
        """
        for box in boxes:
            self.check(box)
        found = self.survey(tuple(sorted(boxes)))
        self.walls, self.occupied, self.domain = found.walls, found.occupied, found.domain
        self.entrance, self.boxes = found.entrance, boxes
        self.version += 1

    def admit(self, crowd: Crowd) -> None:
        """Let a crowd walk about in the building from now on."""
        self.crowds.append(crowd)
        self.version += 1

    def check(self, box: Box, key: str = "box") -> None:
        """Raise InputError, which starts with `key`, unless a box has a size and lies on the page of the plan."""
        left, low, right, high = box
        if not (left < right and low < high):
            raise InputError(f"{key}: {_edges(box)} has no size; expected [left, lower, right, upper] in m")
        page = self.page
        if left < page[0] or low < page[1] or right > page[2] or high > page[3]:
            raise InputError(f"{key}: {_edges(box)} reaches out of the page; expected it within {_edges(page)}")

    def walkers(self) -> NDArray[np.float64]:
        """Where the discs (p, 3) of all crowds are: x, y, radius in m."""
        return np.concatenate([crowd.discs for crowd in self.crowds]) if self.crowds else np.empty((0, 3))


def _edges(box: Box) -> str:
    return "[{:g}, {:g}, {:g}, {:g}]".format(*box)


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What `Building` tells of its walls and cells, found out for one set of boxes."""

    walls: Walls
    occupied: NDArray[np.bool_]
    domain: NDArray[np.bool_]
    entrance: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))


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


class Localisation(Protocol):
    """Tells each robot where it is."""

    def locate(self, state: State, tiles: Tiles) -> tuple[NDArray[np.float64], Tiles]:
        """Each robot's estimate (n, 3) of its pose, and its tile where that estimate puts it."""
        ...


class Sharing(Protocol):
    """Says what robots tell, and what they take in of what they hear."""

    def say(self, state: State, tiles: Tiles) -> Said:
        """The message of every robot in this iteration; a dead robot's holds no tile."""
        ...

    def hear(self, delivery: Delivery) -> Inbox:
        """The tiles in the messages delivered, whenever they were said."""
        ...


class Channel(Protocol):
    """Says what arrives of what was said."""

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What becomes of one new message for each link, of its sender's size (n,) in bytes, and of those under way.

        Each message is, in some iteration, heard or lost exactly once, unless the run ends before.
        """
        ...


class Behaviour(Protocol):
    """Decides what each robot does with what it sensed and heard."""

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which cells each robot's map holds (n, rows, columns); a live view, for faults alone to write."""
        ...

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """Each robot's occupancy grid (n, rows, columns); a live view, for faults alone to write."""
        ...

    @property
    def forgets(self) -> bool:
        """Whether cells of a map can change although no tile of this iteration shows them."""
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

    @property
    def solid(self) -> NDArray[np.bool_]:
        """Whose bodies (n,) are in the world, alive or crashed."""
        ...

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots (r,) out of the world; their rows stay, no longer alive."""
        ...

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Let live robots (r,) stand where they are, no longer alive, as obstacles that can be pushed."""
        ...

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put robots (r,) that are not alive at `pose` (r, 3), at rest and alive again."""
        ...


@dataclass(slots=True)
class Report:
    """What faults tell of the iteration, and what they may know of the run."""

    events: list[Event] = field(default_factory=list)  # since the last iteration
    coverage: float = 0.0  # share of the domain mapped, 0 to 1


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a swarm, one per seam, in their building."""

    sensor: Sensor
    localisation: Localisation
    sharing: Sharing
    topology: Topology
    channel: Channel
    behaviour: Behaviour
    motion: Motion
    bodies: Bodies
    building: Building
    report: Report = field(default_factory=Report)


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
