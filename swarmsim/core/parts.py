"""The seams: one verb each, and the only thing the tick knows of the part behind it."""

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
from swarmsim.core.readings import Channels, Readings
from swarmsim.core.state import Done, Intents, K_co, Knowledge, Measured, Moment, Senses, State

Links = NDArray[np.int32]  # (m, 2): receiver, sender; sorted by receiver, then sender
WheelSpeeds = NDArray[np.float64]  # (n, 2): left, right, m/s; or the columns of another kinematics
K = TypeVar("K", bound=Knowledge, contravariant=True)  # what a part reads


class Generator(Protocol):
    """Makes a building."""

    def draw(self) -> str:
        """Its floor plan: GeoJSON, or SVG, in metres; equal for equal seeds."""
        ...


class Sensor(Protocol):
    """Measures the world around each robot."""

    @property
    def channels(self) -> Channels:
        """What it gives, which does not change."""
        ...

    def sense(self, state: State) -> Readings:
        """The readings of all robots; of a dead robot all is unknown."""
        ...


class Actuator(Protocol):
    """Does what robots decide besides driving, such as shining in a colour."""

    @property
    def channels(self) -> Channels:
        """What it takes and what it then is, which does not change; `blank` is how it rests."""
        ...

    def act(self, commands: Readings, state: State) -> Readings:
        """What it is from the end of this iteration on, by what everybody has decided, which is at rest for the dead.

        Commands may lie beyond the bounds of their channel; what is given may not.
        """
        ...


class Localisation(Protocol):
    """Tells each robot where it is; taken to err, by as much until the next iteration, unless it is Tracking."""

    def locate(self, state: State) -> NDArray[np.float64]:
        """Each robot's estimate (n, 3) of its pose; to be asked once in each iteration."""
        ...


@runtime_checkable
class Tracking(Localisation, Protocol):
    """A localisation that tells as well where robots believe they are on their way to the next iteration."""

    @property
    def exact(self) -> bool:
        """Whether estimates are the true poses in the whole run; else recordings keep them."""
        ...

    def track(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where robots at `pose` (n, 3) believe they are, until they are located again."""
        ...


class Computation(Protocol[C, K_co]):
    """What robots compute from what they sense and hear, and what they say of it: it alone owns what they know.

    It may be built for any of the swarm's robots, and then has a row for each of these; see `BuildContext`.
    """

    @property
    def knowledge_type(self) -> type[Knowledge]:
        """What kind of knowledge `hear` gives: that of the strategies and tasks that go with it."""
        ...

    @property
    def codec(self) -> Codec[C]:
        """What its messages look like on the air; there from the start."""
        ...

    def say(self, senses: Senses) -> Broadcast[C]:
        """The message of every robot in this iteration, before it has heard anything; nobody hears the dead."""
        ...

    def hear(self, senses: Senses, inbox: Inbox[C]) -> K_co:
        """What every robot knows once it has taken in its readings and its inbox; views, which cannot be written to.

        Row i follows from row i of what is sensed and from what is received in row i alone.
        """
        ...

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Let the robots of these rows (r,) know nothing any more, as at the start."""
        ...

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give the robots of these rows (r,) what that of the row `source` knows."""
        ...


class Strategy(Protocol[K]):
    """What robots do with what they know."""

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """What kind of knowledge it needs; `Knowledge` itself if any will do."""
        ...

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: K) -> Intents:
        """The intents of all robots, of which row i follows from row i of what is given alone."""
        ...


@dataclass(frozen=True, slots=True)
class Curve:
    """How the measure that a task is about is drawn."""

    name: str  # of the measure, among those that the task gives
    label: str  # as on an axis, with its unit
    scale: float = 1.0  # what values are multiplied by to have that unit
    low: float | None = 0.0  # the ends of the axis in that unit; None: as the values are
    high: float | None = None
    robots: str | None = None  # the measure of single robots that makes a band, of the same unit
    format: str = ".3g"  # of a single value
    rises: bool = True  # whether more is better

    def __post_init__(self) -> None:
        """Raise ValueError for numbers and formats that nothing can be drawn by."""
        if not re.fullmatch(r"(\.\d)?[efg]", self.format):
            raise ValueError(f"a curve's format {self.format!r}; expected such as .2f or .3g")
        if not all(math.isfinite(one) for one in (self.scale, self.low or 0.0, self.high or 0.0)):
            raise ValueError("a curve's scale or end that is not finite")


#: Any computation, strategy or task, whatever it says or reads: that they go together is checked when a run is built.
AnyComputation = Computation[Any, Knowledge]
AnyStrategy = Strategy[Any]


class Summary(Protocol[K]):
    """An observer that has the run in numbers at its end."""

    def sample(self, moment: Moment[K]) -> None:
        """Take note of one iteration."""
        ...

    def summary(self) -> dict[str, float | int | None]:
        """The numbers, by name; None where one is not defined."""
        ...


class Task(Protocol[K]):
    """What is measured of the swarm, and when it has done what it was asked."""

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """What kind of knowledge it measures; `Knowledge` itself if any will do."""
        ...

    @property
    def curve(self) -> Curve:
        """What is drawn of it."""
        ...

    def measure(self, done: Done[K]) -> Measured:
        """What is measured in an iteration."""
        ...

    def summaries(self) -> Sequence[Summary[K]]:
        """New probes, which sum a whole run up."""
        ...


#: Any task, as above.
AnyTask = Task[Any]


class Topology(Protocol):
    """Says who hears whom."""

    def links(self, state: State) -> Links:
        """Directed links among live robots: no self link, each pair at most once."""
        ...


class NetworkChannel(Protocol):
    """Says what arrives of what was said."""

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What becomes of one new message for each link, of its sender's size (n,) in bytes, and of those under way.

        Each message is, in some iteration, heard or lost exactly once, unless the run ends before.
        """
        ...


class Motion(Protocol):
    """Turns intents into what wheels shall do, once per physics sub-step."""

    def follow(self, intents: Intents) -> None:
        """Take up new intents, at the start of an iteration."""
        ...

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The commands wanted at these poses (n, 3): wheel speeds or, of other kinematics, theirs.

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
        """Whose bodies (n,) are in the world, alive or crashed."""
        ...

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots (r,) out of the world; their rows stay, no longer alive."""
        ...

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Let live robots (r,) stand where they are, no longer alive, as obstacles that can be pushed."""
        ...

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put robots (r,) that are not alive at `pose` (r, 3), at rest and alive again, but for those retired."""
        ...

    def push(self, robots: NDArray[np.int64], velocity: tuple[float, float]) -> None:
        """Give the bodies of robots (r,) a velocity (m/s), as a blow does. Raises InputError if they have no mass."""
        ...

    def retire(self, robots: NDArray[np.int64]) -> None:
        """Let nothing bring these robots (r,) back that are out, or will be."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """The time between two iterations, as what happens then may know it."""

    iteration: int  # the one that is about to begin
    before: State  # when the last iteration's motion began; at the start of a run, as `after`
    after: State  # when it ended, and nothing had happened since
    progress: float  # 0 to 1: how much of the task was done in the last iteration


class EventSource(Protocol):
    """Something that happens at times of its own: a door, a death, an empty battery."""

    def advance(self, now: Tick) -> Sequence[Event]:
        """Let whatever is due happen; gives what did. To be asked once between any two iterations, and at the start."""
        ...


class Schedule:
    """All that happens in a run, in the order in which it was entered."""

    def __init__(self, start: State) -> None:
        self._entries: list[EventSource] = []
        self._start = Tick(0, start, start, 0.0)
        self._due: list[Event] = []
        self._held: Callable[[EventSource], EventSource] = lambda happening: happening

    def holding(self, held: Callable[[EventSource], EventSource]) -> Schedule:
        """The same calendar, in which something else stands for each of those that are entered by this way."""
        schedule = copy(self)
        schedule._held = held
        return schedule

    def __bool__(self) -> bool:
        """Whether anything can ever happen."""
        return bool(self._entries)

    def enter(self, happening: EventSource) -> None:
        """Add something, and let happen what is due at the start. Raises InputError if that cannot be."""
        entry = self._held(happening)
        self._entries.append(entry)
        self._due.extend(entry.advance(self._start))

    def advance(self, now: Tick) -> tuple[Event, ...]:
        """Let everything happen that is due in the iteration about to begin; gives what did."""
        for entry in self._entries if now.iteration else ():
            self._due.extend(entry.advance(now))
        due = tuple(self._due)
        self._due.clear()
        return due


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a swarm, one per seam, in their building."""

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
    gauges: tuple[Gauge, ...] = ()  # what can be read off them


class Fault(Protocol):
    """Something that goes wrong in one of the parts."""

    def install(self, parts: Parts) -> Parts:
        """The same parts, one of them wrapped, or something more in their calendar."""
        ...


class Probe(Protocol):
    """Records tables of numbers of its own: measured, never fed back."""

    @property
    def tables(self) -> tuple[ProbeTable, ...]:
        """What it records, known before the run."""
        ...

    def sample(self, moment: Moment[Any]) -> Mapping[str, object]:
        """A row of each of its tables, by the table's name, in an iteration in which it is asked."""
        ...


class Observer(Protocol):
    """Looks at every iteration: what records, digests or sums up a run."""

    def sample(self, moment: Moment[Any]) -> None:
        """Take note of one iteration."""
        ...
