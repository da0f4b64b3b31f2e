"""The arrays that describe a swarm at one moment; row i is robot i in all of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import SimpleNamespace
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.building import Building
from swarmsim.core.context import BuildContext
from swarmsim.core.events import Event
from swarmsim.core.messages import Delivery, Inbox, MessageBatch
from swarmsim.core.readings import Column, Readings

UNKNOWN = 0  #: value of a cell not observed
FREE = 1  #: value of a cell observed to be empty
OCCUPIED = 2  #: value of a cell in which a beam ended
STEP = 0.1  # m between waypoints of a straight path: about the look-ahead of motions


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Bodies at the start of an iteration."""

    iteration: int
    pose: NDArray[np.float64]  # (n, 3): x, y in m, yaw in rad, counter-clockwise
    velocity: NDArray[np.float64]  # (n, 3): m/s, m/s, rad/s, in the world frame
    wheels: NDArray[np.float64]  # (n, 2 or more): rim speed of the left and right wheel, m/s, or see `core.kinematics`
    alive: NDArray[np.bool_]  # (n,)
    actuators: Readings = field(default_factory=Readings)  # their current states, by channel; the dead's are at rest

    @property
    def robots(self) -> int:
        """Number of rows, dead robots included."""
        return len(self.alive)


@dataclass(frozen=True, slots=True)
class Record:
    """The recorded data of one iteration, by table name."""

    rows: Mapping[str, object] = field(default_factory=dict)  # one row each, of the same shape in every iteration
    lists: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)  # (c, ...): any number of rows
    of_robots: tuple[str, ...] = ()  # the lists whose first column is the row of a robot


class Auditor(Protocol):
    """Checks that knowledge follows from readings and received messages."""

    def audit(self, knowledge: Knowledge, senses: Senses, inbox: Inbox[MessageBatch]) -> str | None:
        """What is wrong with a computation's knowledge, given its readings and inbox, or None."""
        ...

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Note that robots (r,) were reset."""
        ...

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Note that robots (r,) got another one's knowledge."""
        ...


class Trusting:
    """Accepts all knowledge."""

    def audit(self, knowledge: Knowledge, senses: Senses, inbox: Inbox[MessageBatch]) -> str | None:
        """Nothing is ever wrong."""
        return None

    def reset(self, robots: NDArray[np.int64]) -> None:
        """There is nothing to note."""

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """There is nothing to note."""


class Knowledge(ABC):
    """The robots' knowledge after sensing and receiving; the only copy that others read."""

    __slots__ = ()

    @abstractmethod
    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All of it, or its changes in this iteration, for the digest."""

    @abstractmethod
    def record(self) -> Record:
        """Its part in the recording."""

    def of(self, robot: int) -> object:
        """One robot's knowledge, for minds written for one robot; None if it cannot be separated."""
        return None

    @classmethod
    def auditor(cls, context: BuildContext) -> Auditor:
        """The checker of a third-party computation for one run."""
        return Trusting()


@dataclass(frozen=True, slots=True, eq=False)
class JobReport:
    """What a job has found after an iteration, and what that took."""

    name: str
    knowledge: Knowledge
    sent: int = 0  # bytes that robots said, each message once
    heard: int = 0  # bytes that robots heard

    def record(self) -> Record:
        """The job's own data, and its bytes."""
        found = self.knowledge.record()
        bytes_of = {f"{self.name}_bytes_sent": self.sent, f"{self.name}_bytes_heard": self.heard}
        return Record({**found.rows, **bytes_of}, found.lists, found.of_robots)


@dataclass(frozen=True, slots=True)
class Traffic:
    """What robots said in an iteration."""

    offered: int  # messages, one for each link on which something was said
    sent: int  # bytes, each robot's message once, however many hear it


K_co = TypeVar("K_co", bound=Knowledge, covariant=True)


@dataclass(frozen=True, slots=True, eq=False)
class Estimates(Knowledge, ABC):
    """Knowledge made of a few numbers per robot: every field of a subclass is an array (n, ...)."""

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All fields, in order."""
        return tuple(getattr(self, field.name) for field in fields(self))

    def record(self) -> Record:
        """A table for each field, under its name."""
        return Record({field.name: getattr(self, field.name) for field in fields(self)})

    def of(self, robot: int) -> SimpleNamespace:
        """The robot's row of every field."""
        return SimpleNamespace(**{field.name: getattr(self, field.name)[robot] for field in fields(self)})


@dataclass(frozen=True, slots=True, eq=False)
class Senses:
    """What minds know in an iteration before receiving; a robot may use only its own row.

    There is a row for each robot that the mind was built for: row i is robot `BuildContext.ids[i]`.
    """

    iteration: int
    pose: NDArray[np.float64]  # (n, 3): each robot's estimate of its own pose: x, y in m, yaw in rad
    velocity: NDArray[np.float64]  # (n, 3): m/s, m/s, rad/s, in the world frame
    alive: NDArray[np.bool_]  # (n,)
    readings: Readings
    decided: Intents | None = None  # each robot's decision in the previous iteration; None in the first


@dataclass(frozen=True, slots=True, eq=False)
class Intents:
    """Every robot's decision until the next iteration: a path to follow or, in `twists`, a velocity.

    An actuator without a command in `commands` rests.
    """

    goals: NDArray[np.float64]  # (n, 2): x, y in m, in the robot's estimated frame; NaN for none
    waypoints: NDArray[np.float64]  # (n, longest, 2): x, y in m, the path still ahead of each robot
    counts: NDArray[np.int32]  # (n,): how many of its waypoints each robot uses
    planned: NDArray[np.bool_]  # (n,): whether the path is new in this iteration
    #: (n, 2): m/s ahead, rad/s; (n, 3): also m/s to the left; NaN rows follow waypoints; None: all do.
    twists: NDArray[np.float64] | None = None
    commands: Mapping[str, Column] = field(default_factory=dict)  # (n, ...): for actuators, by channel

    @classmethod
    def twisting(cls, twists: NDArray[np.float64]) -> Intents:
        """All robots move at a velocity (n, 2): m/s ahead, rad/s counter-clockwise; or (n, 3), with m/s to the left."""
        count = len(twists)
        goals, counts = np.full((count, 2), np.nan), np.zeros(count, np.int32)
        return cls(goals, np.zeros((count, 1, 2)), counts, np.zeros(count, np.bool_), twists)

    @classmethod
    def along(
        cls,
        ways: Mapping[int, NDArray[np.float64]],
        robots: int,
        planned: NDArray[np.bool_],
    ) -> Intents:
        """Some robots follow paths (w, 2) in m to their ends, the others stand.

        Long straight pieces get intermediate points, since a motion steers for the next waypoint in an arc.
        """
        dense = {robot: _in_steps(way) for robot, way in ways.items()}
        longest = max((len(way) for way in dense.values()), default=1)
        goals, counts = np.full((robots, 2), np.nan), np.zeros(robots, np.int32)
        waypoints = np.zeros((robots, longest, 2))
        for robot, way in dense.items():
            waypoints[robot, : len(way)], counts[robot], goals[robot] = way, len(way), way[-1]
        return cls(goals, waypoints, counts, planned)

    def record(self) -> Record:
        """Goals and velocities; paths are recorded when they are new."""
        return Record({"goals": self.goals, **({} if self.twists is None else {"twists": self.twists})})


def _in_steps(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """A path (w, 2) with points added, at most STEP apart."""
    length = np.hypot(*np.diff(way, axis=0).T)
    counts = np.maximum(1, np.ceil(length / STEP)).astype(int)
    pieces = [
        start + (end - start) * (np.arange(1, count + 1)[:, None] / count)
        for start, end, count in zip(way[:-1], way[1:], counts, strict=True)
    ]
    return np.concatenate([way[:1], *pieces])


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A task's measurements in one iteration."""

    values: Mapping[str, float]  # of the swarm, by name; the main one first
    robots: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)  # (n,): of each robot, by name
    progress: float = 0.0  # 0 to 1: how much of the task is done
    finished: bool = False

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All measures, in order."""
        return (np.array([*self.values.values(), self.progress]), *self.robots.values())

    def record(self) -> Record:
        """A table for each measure, under its name."""
        return Record({**{name: float(value) for name, value in self.values.items()}, **self.robots})


@dataclass(frozen=True, slots=True, eq=False)
class Elapsed(ABC, Generic[K_co]):
    """The course of one iteration."""

    state: State  # at the start of the iteration, when robots sensed
    events: tuple[Event, ...]  # at its start, or at the run's end
    building: Building
    readings: Readings  # placed by the robots' estimated poses
    links: NDArray[np.int32]  # (m, 2): receiver, sender
    delivery: Delivery
    inbox: Inbox[MessageBatch]
    knowledge: K_co  # after this iteration
    intents: Intents
    believed: NDArray[np.float64] | None = None  # (n, 3): estimated poses; None: the true ones
    people: NDArray[np.float64] | None = None  # (p, 3): x, y, radius in m; None: there are none
    jobs: tuple[JobReport, ...] = ()
    traffic: Traffic | None = None  # None: a message on each link, of unknown size


@dataclass(frozen=True, slots=True, eq=False)
class Done(Elapsed[K_co]):
    """One iteration, as tasks measure it."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment(Elapsed[K_co]):
    """One iteration, as probes see it: measured, never fed back."""

    measured: Measured = Measured({})
