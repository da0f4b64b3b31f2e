"""The seams: few verbs each, which are all that the tick knows of the part behind it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.building import Building
from swarmsim.core.context import Gauge
from swarmsim.core.events import Event
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Broadcast, C, Codec, Delivery, Inbox, MessageBatch
from swarmsim.core.probes import ProbeTable
from swarmsim.core.processors import Processors
from swarmsim.core.readings import Channels, Readings
from swarmsim.core.state import Done, Intents, JobReport, K_co, Knowledge, Measured, Moment, Senses, State

Links = NDArray[np.int32]  # (m, 2): receiver, sender; sorted by receiver, then sender
WheelSpeeds = NDArray[np.float64]  # (n, 2): left, right, m/s; or the columns of another kinematics
K = TypeVar("K", bound=Knowledge, contravariant=True)  # read by a part


class Generator(Protocol):
    """Makes a building."""

    def draw(self) -> str:
        """Its floor plan: GeoJSON, or SVG, in metres; equal for equal seeds."""
        ...


class Sensor(Protocol):
    """Measures the world around each robot."""

    @property
    def channels(self) -> Channels:
        """The channels it gives, which never change."""
        ...

    def sense(self, state: State) -> Readings:
        """The readings of all robots; a dead robot's are all unknown."""
        ...


class Actuator(Protocol):
    """Carries out commands other than driving, such as lighting an LED."""

    @property
    def channels(self) -> Channels:
        """Its commands and states, which never change; `blank` is the state at rest."""
        ...

    def act(self, commands: Readings, state: State) -> Readings:
        """Its state from the end of this iteration on, from all robots' commands; the dead are at rest.

        Commands may exceed their channel's bounds; the result may not.
        """
        ...


class Localisation(Protocol):
    """Estimates each robot's pose; the error counts as constant within an iteration unless it is Tracking."""

    def locate(self, state: State) -> NDArray[np.float64]:
        """Each robot's estimated pose (n, 3); called once per iteration."""
        ...


@runtime_checkable
class Tracking(Localisation, Protocol):
    """A localisation that also estimates poses between iterations."""

    @property
    def exact(self) -> bool:
        """Whether estimates are always the true poses; otherwise recordings keep them."""
        ...

    def track(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The estimates of robots at `pose` (n, 3), until the next `locate`."""
        ...


class Computation(Protocol[C, K_co]):
    """Turns readings and received messages into knowledge, and composes messages; the only owner of knowledge.

    It may be built for some of the swarm's robots, with a row for each; see `BuildContext`.
    """

    @property
    def knowledge_type(self) -> type[Knowledge]:
        """The kind of knowledge that `hear` returns, which must fit strategies and tasks."""
        ...

    @property
    def codec(self) -> Codec[C]:
        """Its messages' wire format; available from the start."""
        ...

    def say(self, senses: Senses) -> Broadcast[C]:
        """Every robot's message in this iteration, before receiving; messages of the dead are not delivered."""
        ...

    def hear(self, senses: Senses, inbox: Inbox[C]) -> K_co:
        """Every robot's knowledge after its readings and inbox, as read-only views.

        Row i depends only on row i of the senses and on the messages received by row i.
        """
        ...

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase the knowledge of these rows (r,), as at the start."""
        ...

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy the knowledge of the row `source` to these rows (r,)."""
        ...


class Strategy(Protocol[K]):
    """Turns knowledge into intents."""

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """The kind of knowledge it needs; `Knowledge` itself for any."""
        ...

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: K) -> Intents:
        """The intents of all robots; row i depends only on row i of the arguments."""
        ...


@dataclass(frozen=True, slots=True)
class Curve:
    """How a task's main measure is drawn."""

    name: str  # of the measure, among the task's
    label: str  # as on an axis, with its unit
    scale: float = 1.0  # factor from values to that unit
    low: float | None = 0.0  # the ends of the axis in that unit; None: as the values are
    high: float | None = None
    robots: str | None = None  # the per-robot measure that makes a band, in the same unit
    format: str = ".3g"  # of a single value
    rises: bool = True  # whether higher is better

    def __post_init__(self) -> None:
        """Raise ValueError for unusable numbers and formats."""
        if not re.fullmatch(r"(\.\d)?[efg]", self.format):
            raise ValueError(f"a curve's format {self.format!r}; expected such as .2f or .3g")
        if not all(math.isfinite(one) for one in (self.scale, self.low or 0.0, self.high or 0.0)):
            raise ValueError("a curve's scale or end that is not finite")


#: Any computation, strategy or task; whether they fit together is checked when a run is built.
AnyComputation = Computation[Any, Knowledge]
AnyStrategy = Strategy[Any]


class Summary(Protocol[K]):
    """An observer that sums up the run in numbers at its end."""

    def sample(self, moment: Moment[K]) -> None:
        """Note one iteration."""
        ...

    def summary(self) -> dict[str, float | int | None]:
        """The numbers, by name; None where one is not defined."""
        ...


class Task(Protocol[K]):
    """Measures the swarm, and decides when its job is done."""

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """The kind of knowledge it measures; `Knowledge` itself for any."""
        ...

    @property
    def curve(self) -> Curve:
        """How its main measure is drawn."""
        ...

    def measure(self, done: Done[K]) -> Measured:
        """The measurements of an iteration."""
        ...

    def summaries(self) -> Sequence[Summary[K]]:
        """New observers that sum up a whole run."""
        ...


#: Any task, as above.
AnyTask = Task[Any]


class Topology(Protocol):
    """Decides which robot hears which."""

    def links(self, state: State) -> Links:
        """Directed links among live robots: no self link, each pair at most once."""
        ...


class NetworkChannel(Protocol):
    """Decides which messages arrive, and when."""

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """The fate of one new message per link, of its sender's size (n,) in bytes, and of those under way.

        Each message is heard or lost exactly once, unless the run ends first.
        """
        ...


class Motion(Protocol):
    """Turns intents into wheel commands, once per physics sub-step."""

    def follow(self, intents: Intents) -> None:
        """Take up new intents, at the start of an iteration."""
        ...

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The commands at these poses (n, 3): wheel speeds, or those of another kinematics.

        The array is reused by the next call.
        """
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
        """Which bodies (n,) are in the world, alive or crashed."""
        ...

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots (r,) out of the world; their rows stay, no longer alive."""
        ...

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Turn live robots (r,) into dead obstacles that can be pushed."""
        ...

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Revive dead robots (r,) at `pose` (r, 3), at rest, except retired ones."""
        ...

    def push(self, robots: NDArray[np.int64], velocity: tuple[float, float]) -> None:
        """Set the bodies of robots (r,) moving (m/s), as a blow does. Raises InputError if they have no mass."""
        ...

    def retire(self, robots: NDArray[np.int64]) -> None:
        """Never revive these robots (r,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What scheduled events may know between two iterations."""

    iteration: int  # the one that is about to begin
    before: State  # when the last iteration's motion began; at the start of a run, equal to `after`
    after: State  # when it ended, before any events
    progress: float  # 0 to 1: the task's progress in the last iteration


class EventSource(Protocol):
    """A source of scheduled events: a door, a death, an empty battery."""

    def advance(self, now: Tick) -> Sequence[Event]:
        """Fire the due events and return them. Called at the start and once between iterations."""
        ...


class Schedule:
    """All event sources of a run, in the order of registration."""

    def __init__(self, start: State) -> None:
        self._entries: list[EventSource] = []
        self._start = Tick(0, start, start, 0.0)
        self._due: list[Event] = []
        self._held: Callable[[EventSource], EventSource] = lambda happening: happening

    def holding(self, held: Callable[[EventSource], EventSource]) -> Schedule:
        """The same calendar, which wraps each source entered through it."""
        schedule = copy(self)
        schedule._held = held
        return schedule

    def __bool__(self) -> bool:
        """Whether it has any source."""
        return bool(self._entries)

    def enter(self, happening: EventSource) -> None:
        """Register a source and fire its events due at iteration 0. Raises InputError if they are impossible."""
        entry = self._held(happening)
        self._entries.append(entry)
        self._due.extend(entry.advance(self._start))

    def advance(self, now: Tick) -> tuple[Event, ...]:
        """Fire all events due in the coming iteration, and return them."""
        for entry in self._entries if now.iteration else ():
            self._due.extend(entry.advance(now))
        due = tuple(self._due)
        self._due.clear()
        return due


class Exchanges(Protocol):
    """Jobs beside a computation, in the further exchanges of an iteration."""

    @property
    def told(self) -> tuple[JobReport, ...]:
        """What the jobs have found, and what that took, in the present iteration."""
        ...

    @property
    def processors(self) -> Processors:
        """What robots compute them on."""
        ...

    @property
    def tables(self) -> Mapping[str, tuple[ProbeTable, ...]]:
        """What each shows, by its name."""
        ...

    def say_more(self, senses: Senses) -> Broadcast[MessageBatch]:
        """All robots' messages in a further exchange."""
        ...

    def hear_more(self, senses: Senses, inbox: Inbox[MessageBatch]) -> None:
        """All robots take in what they heard in it."""
        ...


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a swarm, one per seam, and the building."""

    actuator: Actuator
    sensor: Sensor
    localisation: Tracking
    computation: AnyComputation
    strategy: AnyStrategy
    topology: Topology
    channel: NetworkChannel
    motion: Motion
    bodies: Bodies
    task: AnyTask
    building: Building
    schedule: Schedule
    lattice: Lattice  # of tiles and maps
    gauges: tuple[Gauge, ...] = ()  # readable by probes
    jobs: Exchanges | None = None  # beside the computation


class Fault(Protocol):
    """Wraps a part or adds events, so that something goes wrong."""

    def install(self, parts: Parts) -> Parts:
        """The same parts with one wrapped, or with more events in their calendar."""
        ...


class Probe(Protocol):
    """Records its own tables of numbers: measured, never fed back."""

    @property
    def tables(self) -> tuple[ProbeTable, ...]:
        """Its tables, known before the run."""
        ...

    def sample(self, moment: Moment[Any]) -> Mapping[str, object]:
        """A row for each of its tables, by name, in a sampled iteration."""
        ...


class Observer(Protocol):
    """Sees every iteration, to record, digest or sum up a run."""

    def sample(self, moment: Moment[Any]) -> None:
        """Note one iteration."""
        ...
