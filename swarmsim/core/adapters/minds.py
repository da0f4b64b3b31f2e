"""Custom minds: a class with one instance per robot, run for the whole swarm.

Writing one needs no import from here: `step(self, me)` gets a `Me` and returns what `me.drive(...)` or
`me.go(...)` return, or None to stand still.
"""

from __future__ import annotations

import copy
import keyword
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, make_dataclass, replace
from types import SimpleNamespace
from typing import Any, Final, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmsim.core import own
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import nearest
from swarmsim.core.lattice import Lattice
from swarmsim.core.lending import AS_IT_IS, lent
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.own import MisfitError
from swarmsim.core.readings import Readings
from swarmsim.core.renamed import OF_PARTS
from swarmsim.core.state import OCCUPIED, Intents, Knowledge, Record, Senses


@dataclass(frozen=True, slots=True, eq=False)
class Intent:
    """One robot's decision: a velocity or a path, and commands for its actuators."""

    twist: tuple[float, float, float] | None = None  # m/s ahead, rad/s counter-clockwise, m/s to the left
    way: NDArray[np.float64] | None = None  # (w, 2): x, y in m
    commands: Mapping[str, object] = field(default_factory=dict)  # by channel of an actuator

    def also(self, **commands: object) -> Intent:
        """The same with actuator commands, by channel: `me.drive(0.1).also(led=(255, 0, 0))`.

        An actuator without a command rests until the next iteration.
        """
        return replace(self, commands={**self.commands, **commands})


@dataclass(slots=True, eq=False)
class Me:
    """All that one robot may know in one iteration besides its memory; arrays are read-only.

    Other sensors' channels are in `readings`; `me.neighbours` is `me.readings.neighbours`.
    """

    id: int
    iteration: int
    time: float  # s
    x: float  # m, its estimated position
    y: float  # m, its estimated position
    yaw: float  # rad, counter-clockwise from the x axis
    velocity: NDArray[np.float64]  # (3,): m/s, m/s, rad/s, in the world frame
    tile: NDArray[np.uint8] | None  # (rows, columns): UNKNOWN 0, FREE 1 or OCCUPIED 2; None without such a sensor
    corner: NDArray[np.int32] | None  # (2,): row and column of the tile's lower-left cell
    ranges: NDArray[np.float64] | None  # (b,): m, how far each beam reaches
    bearings: NDArray[np.float64] | None  # (b,): rad from straight ahead
    sample: float | None  # the field's value here, if there is a field
    heard: Sequence[SimpleNamespace]  # what arrived: `sender`, `age` in iterations, and the message's own fields
    knowledge: Any  # from its computation, where that is another part
    lattice: Lattice  # of tiles and maps
    speed: float  # m/s, its wheels' top speed
    radius: float  # m
    random: np.random.Generator  # its own stream
    readings: SimpleNamespace  # its other sensors' data, by channel
    #: Messages of another kind from other groups: as `heard`, by the group's name.
    others: Mapping[str, Sequence[SimpleNamespace]]

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any sensor's data
        found = {} if name == "readings" else vars(self.readings)  # not there during construction
        if name not in found:
            raise AttributeError(f"'Me' object has no attribute {name!r}", name=name, obj=self)
        return found[name]

    def __dir__(self) -> list[str]:
        """All attributes, other sensors' channels included."""
        return [*object.__dir__(self), *vars(self.readings)]

    @property
    def walls(self) -> NDArray[np.float64]:
        """The centres (w, 2) in m of the occupied cells of its tile."""
        if self.tile is None or self.corner is None:
            return np.empty((0, 2))
        return self.lattice.centres(np.argwhere(self.tile == OCCUPIED) + self.corner)

    def drive(self, ahead: float, turn: float = 0.0, left: float = 0.0) -> Intent:
        """Move at a velocity until the next iteration: m/s ahead, rad/s counter-clockwise, m/s to the left.

        Raises ValueError unless all are finite, and for sideways motion of a robot that cannot do it.
        """
        aside = _number("drive", "left", left)
        if aside and not self._sideways:
            wrong = f"left: {aside:g} m/s, but this robot cannot move to the side"
            raise MisfitError(f"me.drive: {wrong}; expected 0, or kinematics.use = 'omni'")
        return Intent(twist=(_number("drive", "ahead", ahead), _number("drive", "turn", turn), aside))

    def head(self, yaw: float, ahead: float) -> Intent:
        """Move at `ahead` (m/s) and turn towards a direction (rad) as far as one iteration allows.

        Raises ValueError unless both are finite numbers.
        """
        turn = (_number("head", "yaw", yaw) - self.yaw + np.pi) % (2.0 * np.pi) - np.pi
        return Intent(twist=(_number("head", "ahead", ahead), float(turn) / self._period, 0.0))

    def go(self, way: ArrayLike) -> Intent:
        """Follow waypoints (w, 2) in m, or go to one place (2,), and stop at the end.

        Raises ValueError unless they are finite and name at least one place.
        """
        one = len(np.shape(way)) == 1
        try:
            places = own.array_of([way] if one and not isinstance(way, np.ma.MaskedArray) else way, None, 2)
        except ValueError as problem:
            raise MisfitError(f"me.go: {problem}; expected a place (2,) or waypoints (w, 2), in m") from None
        if len(places) == 0 or not np.isfinite(places).all():
            raise MisfitError(f"me.go: {own.brief(way)}; expected one place at least, all of them finite, in m")
        return Intent(way=places.astype(np.float64))

    _period: float = 1.0  # s, of an iteration
    _sideways: bool = False  # whether it can move to the side


class RobotMind(Protocol):
    """One robot's mind, an instance of a user's class; one with `message_fields` must have `say`."""

    def say(self, me: Me) -> object:
        """Its message to others."""
        ...

    def hear(self, me: Me) -> object:
        """Take in received messages; optional."""
        ...

    def step(self, me: Me) -> object:
        """What it decides."""
        ...


T = TypeVar("T")  # what minds answer
S = TypeVar("S", bound=np.generic)

#: Attributes of `Me`, which a sensor cannot use as channel names; `ranges` belongs to the ring.
OF_ME: Final = frozenset(name for name in dir(Me) if not name.startswith("_")) - {"ranges"}


def _number(verb: str, name: str, value: object) -> float:
    try:
        return own.finite(value)
    except ValueError as problem:
        raise MisfitError(f"me.{verb}: {name}: {problem}; expected a finite number") from None


@dataclass(frozen=True, slots=True, eq=False)
class OwnMinds(Knowledge):
    """Knowledge of a user's minds: the instances, and the attributes they show."""

    minds: Sequence[RobotMind] = field(metadata=AS_IT_IS)  # (n,): one instance for each robot
    shown: Mapping[str, NDArray[np.float64]]  # (n,): the attributes that the class names in `recorded`

    def __getattr__(self, name: str) -> NDArray[np.float64]:
        try:
            return self.shown[name]
        except KeyError:
            raise AttributeError(
                f"{name!r} is not shown; the class names in 'recorded': {', '.join(self.shown)}"
            ) from None

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All shown attributes."""
        return tuple(self.shown.values())

    def record(self) -> Record:
        """A table for each shown attribute."""
        return Record(dict(self.shown))

    def of(self, robot: int) -> RobotMind:
        """One robot's mind."""
        return self.minds[robot]


_NUMBERS: Final = ("f8", "f4", "i8", "i4", "i2", "i1", "u8", "u4", "u2", "u1", "?")  # types of message fields
#: The message of silent minds: only a header.
_SILENCE: Final = make_dataclass(
    "Silence", [("nothing", NDArray[np.float64])], bases=(MessageBatch,), frozen=True, slots=True, eq=False
)


class Minds:
    """One instance per robot, and what each may know."""

    def __init__(self, make: Callable[[], RobotMind], context: BuildContext) -> None:
        self._make, self._context = make, context
        #: The robots' numbers, by row.
        self.ids: list[int] = context.ids.tolist()
        self.minds = [make() for _ in self.ids]
        self._random = context.own_streams("mind")

    def each(
        self,
        senses: Senses,
        ask: Callable[[RobotMind, Me], T],
        inbox: Inbox[MessageBatch] | None = None,
        knowledge: Knowledge | None = None,
    ) -> dict[int, T]:
        """Every live robot's answer, by row; errors name the robot.

        There is no inbox before they have spoken, and no knowledge before they have received.
        """
        answers: dict[int, T] = {}
        for row, me in self._all(senses, inbox, knowledge):
            try:
                answers[row] = ask(self.minds[row], me)
            except BaseException as problem:
                problem.add_note(f"robot {me.id}")
                raise
        return answers

    def _all(
        self, senses: Senses, inbox: Inbox[MessageBatch] | None, knowledge: Knowledge | None
    ) -> Iterable[tuple[int, Me]]:
        robots, lattice, period = self._context.robots, self._context.lattice, self._context.period
        readings, now = senses.readings, senses.iteration
        tiles, beams, field = readings.tiles, readings.beams, readings.field
        sideways = self._context.sideways
        for i in np.flatnonzero(senses.alive).tolist():
            x, y, yaw = senses.pose[i].tolist()
            yield i, Me(
                self.ids[i], now, now * period, x, y, yaw,
                _kept(senses.velocity[i]),
                None if tiles is None else _kept(tiles.values[i]),
                None if tiles is None else _kept(tiles.origins[i]),
                None if beams is None else _kept(beams.ranges[i]),
                None if beams is None else _kept(beams.bearings),
                None if field is None else float(field[i]),
                [] if inbox is None else _heard(inbox, i, now),
                None if knowledge is None else knowledge.of(i),
                lattice, robots.speed, robots.radius, self._random[i], _read(readings, i, self.ids[i]),
                self._others(inbox, i, now), period, sideways is not None and bool(sideways[i]),
            )  # fmt: skip

    def _others(self, inbox: Inbox[MessageBatch] | None, row: int, now: int) -> dict[str, list[SimpleNamespace]]:
        """What one robot received from each group with another kind of message."""
        found: dict[str, list[SimpleNamespace]] = {name: [] for name in self._context.robots.names}
        for name, heard in ({} if inbox is None else inbox.others).items():
            found[name] = _heard(heard, row, now)
        return found

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Give robots (r,) new minds."""
        for robot in robots.tolist():
            self.minds[robot] = self._make()

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's memory to robots (r,)."""
        for robot in robots.tolist():
            self.minds[robot] = copy.deepcopy(self.minds[source])


#: Channels that `Me` offers under other names.
_SHOWN: Final = ("tiles.values", "tiles.origins", "tiles.evidence", "ranges", "field")
_NONE: Final = SimpleNamespace()


def _read(readings: Readings, row: int, robot: int) -> SimpleNamespace:
    """One robot's other sensor data: numbers, arrays, and the used rows of ragged channels."""
    if all(name in _SHOWN for name in readings.channels.places):
        return _NONE
    found: dict[str, object] = {}
    counts = {channel.count for channel in readings.channels}
    for channel, column in zip(readings.channels, readings.columns, strict=True):
        first, end = channel.robots or (robot, robot + 1)
        if channel.name in _SHOWN or channel.name in counts or not first <= robot < end:
            continue
        name = channel.name.replace(".", "_") if channel.group else channel.name.partition(".")[0]
        mine = column[row] if not channel.count else column[row][: int(readings[channel.count][row])]
        found[name] = _kept(mine) if channel.shape else mine.item()
    return SimpleNamespace(**found)


def _kept(array: NDArray[S]) -> NDArray[S]:
    view = array.view()
    view.flags.writeable = False
    return view


def _heard(inbox: Inbox[MessageBatch], robot: int, iteration: int) -> list[SimpleNamespace]:
    """The items of one robot's inbox, with their columns as attributes."""
    first, end = np.searchsorted(inbox.receivers, [robot, robot + 1]).tolist()
    names = [column.name for column in fields(inbox.content)]
    columns = inbox.content.arrays()
    return [
        SimpleNamespace(
            sender=int(inbox.senders[row]),
            age=iteration - int(inbox.sent[row]),
            **{name: _item(column[row]) for name, column in zip(names, columns, strict=True)},
        )
        for row in range(first, end)
    ]


def _item(value: object) -> object:
    return _kept(value) if isinstance(value, np.ndarray) else value


class MindComputation:
    """The part of custom minds that sends and receives."""

    knowledge_type: type[Knowledge] = OwnMinds

    def __init__(self, kind: type, make: Callable[[], RobotMind], context: BuildContext) -> None:
        #: The class or function named in messages about broken contracts.
        self.written_by = kind
        #: The sensor channels it requires.
        self.requires = _required(kind)
        self._swarm = Minds(make, context)
        self._kinds = _said(kind)
        #: The attributes of minds that are recorded.
        self.recorded = _shown(kind)
        self._hears = callable(getattr(kind, "hear", None))
        columns = [(name, NDArray[np.generic]) for name in self._kinds]
        self._content: Callable[..., MessageBatch] = (
            make_dataclass("Message", columns, bases=(MessageBatch,), frozen=True, slots=True, eq=False)
            if columns
            else _SILENCE
        )
        self.codec = PlainCodec(self._content(*self._columns({})))

    def _columns(self, answers: dict[int, dict[str, NDArray[np.generic]]], count: int = 0) -> list[NDArray[np.generic]]:
        if not self._kinds:
            return [np.empty((count, 0))]
        columns = {name: np.zeros(count, kind) for name, kind in self._kinds.items()}
        for robot, answer in answers.items():
            for name, value in answer.items():
                columns[name][robot] = value
        return list(columns.values())

    def _answer(self, mind: RobotMind, me: Me) -> dict[str, NDArray[np.generic]]:
        """A mind's message, by the names in `message_fields`. Raises MisfitError."""
        found, names = mind.say(me), list(self._kinds)
        if not isinstance(found, Mapping):
            values = [found]
            if isinstance(found, tuple | list) or (type(found) is np.ndarray and found.shape == (len(names),)):
                values = list(found)
            if len(values) != len(names):
                wrong = f"{len(values)} value{'s' * (len(values) != 1)}, {own.brief(found)}"
                raise self._misfit(f"{wrong}; expected {len(names)}, as 'says' names them: {', '.join(names)}")
            found = dict(zip(names, values, strict=True))
        for name in found:
            if name not in self._kinds:
                raise self._misfit(f"{own.brief(name)}, which 'says' does not name; {nearest(str(name), self._kinds)}")
        if missing := [name for name in names if name not in found]:
            raise self._misfit(f"no {', '.join(missing)}; expected all that 'says' names: {', '.join(names)}")
        return {name: self._value(name, value) for name, value in found.items()}

    def _value(self, name: str, value: object) -> NDArray[np.generic]:
        """A value in its field's type. Raises MisfitError for one that the type cannot hold exactly."""
        kind = self._kinds[name]
        try:
            return own.kept_as(kind.base, value, *kind.shape)
        except ValueError as problem:
            raise self._misfit(f"{name}: {problem}; expected a number of type {kind}") from None

    def _misfit(self, wrong: str) -> MisfitError:
        return MisfitError(f"say gave {wrong}", self.written_by, "say")

    def say(self, senses: Senses) -> Broadcast[MessageBatch]:
        """Each live robot's message; dead robots' messages are zeros and never received."""
        answers = self._swarm.each(senses, self._answer) if self._kinds else {}
        columns = self._columns(answers, len(senses.alive))
        return Broadcast.each(self._content(*columns), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> OwnMinds:
        """The minds, after they have received."""
        if self._hears:
            self._swarm.each(senses, lambda mind, me: mind.hear(me), inbox)
        minds = self._swarm.minds
        shown = {name: np.array([self._attribute(i, name) for i in range(len(minds))]) for name in self.recorded}
        return OwnMinds(tuple(minds), shown)

    def _attribute(self, robot: int, name: str) -> float:
        """A mind's shown value. Raises MisfitError if it is missing or no number."""
        mind = self._swarm.minds[robot]
        try:
            return own.number_of(getattr(mind, name))
        except AttributeError:
            ours = {"message_fields", "recorded", "requires"}
            has = [
                one for one in dir(mind) if one[0] != "_" and one not in ours and not callable(getattr(mind, one, len))
            ]
            wrong = f"has no {name!r}, which 'recorded' names; {nearest(name, dict.fromkeys(has))}"
        except ValueError as problem:
            wrong = f"shows {name!r}: {problem}; expected a number"
        raise MisfitError(f"robot {self._swarm.ids[robot]} {wrong}", self.written_by, "recorded")

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Give robots (r,) new minds."""
        self._swarm.reset(robots)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's memory to robots (r,)."""
        self._swarm.copy_from(robots, source)


def _said(kind: type) -> dict[str, np.dtype[np.generic]]:
    """The message fields that a class of minds declares, by name. Raises MisfitError for a wrong declaration."""
    says = getattr(kind, "message_fields", {})
    if not isinstance(says, Mapping):
        raise MisfitError(
            f"message_fields is {own.brief(says)}; expected names with their types, as in {{'x': 'f8'}}",
            kind,
            "message_fields",
        )
    if bool(says) != callable(getattr(kind, "say", None)):
        raise MisfitError(
            f"{kind.__name__}: expected both 'message_fields', the fields of a message, and 'say', or neither",
            kind,
            "say",
        )
    taken = {"sender", "age", *(name for name in dir(MessageBatch) if not name.startswith("_"))}
    kinds: dict[str, np.dtype[np.generic]] = {}
    for name, dtype in says.items():
        if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
            raise MisfitError(
                f"message_fields: {own.brief(name)} cannot be a field; expected a name such as 'x'",
                kind,
                "message_fields",
            )
        if name in taken:
            raise MisfitError(
                f"message_fields: {name!r} is what messages have besides; expected another name", kind, "message_fields"
            )
        try:
            kinds[name] = np.dtype(dtype)
        except (TypeError, ValueError):
            near = nearest(str(dtype), dict.fromkeys(_NUMBERS))
            raise MisfitError(
                f"message_fields: {name}: no type is called {own.brief(dtype)}; {near}", kind, "message_fields"
            ) from None
        if kinds[name].base.kind not in "fiub":
            wrong = (
                f"message_fields: {name}: {own.brief(dtype)} holds no numbers; expected one of {', '.join(_NUMBERS)}"
            )
            raise MisfitError(wrong, kind, "message_fields")
    return kinds


def _required(kind: type) -> tuple[str, ...]:
    """The channels that a class of minds needs. Raises MisfitError unless they are names."""
    for old, kinds in (("says", Mapping), ("shows", tuple)):
        if isinstance(getattr(kind, old, None), kinds):
            raise MisfitError(f"{old} is called {OF_PARTS[old]} now", kind, old)
    requires = getattr(kind, "requires", ())
    if not isinstance(requires, tuple | list) or not all(isinstance(name, str) for name in requires):
        raise MisfitError(f"requires is {own.brief(requires)}; expected names, as in ('tiles',)", kind, "requires")
    return tuple(requires)


def _shown(kind: type) -> tuple[str, ...]:
    """The attributes that a class of minds shows. Raises MisfitError unless they are attribute names."""
    shows = getattr(kind, "recorded", ())
    names = shows if isinstance(shows, tuple | list) else ()
    if (shows and not names) or not all(isinstance(name, str) for name in names):
        raise MisfitError(f"recorded is {own.brief(shows)}; expected names, as in ('energy',)", kind, "recorded")
    for name in names:
        if name in dir(OwnMinds):
            raise MisfitError(
                f"recorded: {name!r} is what a task finds otherwise; expected another name", kind, "recorded"
            )
        if callable(getattr(kind, name, None)):
            raise MisfitError(f"recorded: {name!r} is a method; expected attributes that are numbers", kind, "recorded")
    return tuple(names)


class MindStrategy:
    """The part of custom minds that decides: on the computation's minds or, beside another computation, on its own."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def __init__(self, kind: type, make: Callable[[], RobotMind], context: BuildContext) -> None:
        #: The class or function named in messages about broken contracts.
        self.written_by = kind
        #: The sensor channels it requires.
        self.requires = _required(kind)
        self._kind, self._actuators = kind, context.actuators
        self._swarm = Minds(make, context)
        self._ways: dict[int, bytes] = {}
        self._columns = 2 if context.sideways is None else 3

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """Each live robot's decision."""
        known = knowledge if isinstance(knowledge, OwnMinds) else lent(knowledge)
        if isinstance(knowledge, OwnMinds) and isinstance(knowledge.minds[0], self._kind):
            self._swarm.minds[:] = knowledge.minds
        decided = self._swarm.each(senses, self._intent, inbox, known)
        count = len(senses.alive)
        ways = {robot: intent.way for robot, intent in decided.items() if intent.way is not None}
        twists, planned = np.zeros((count, self._columns)), np.zeros(count, np.bool_)
        for robot, intent in decided.items():
            twists[robot] = np.nan if intent.twist is None else intent.twist[: self._columns]
        for robot, way in ways.items():
            planned[robot] = self._ways.get(robot) != way.tobytes()
        self._ways = {robot: way.tobytes() for robot, way in ways.items()}
        here = senses.pose[:, :2]
        from_here = {robot: np.concatenate([here[robot : robot + 1], way]) for robot, way in ways.items()}
        commands = {channel.name: channel.blanks(count) for channel in self._actuators}
        for robot, intent in decided.items():
            for name, row in intent.commands.items():
                commands[name][robot] = row
        return replace(Intents.along(from_here, count, planned), twists=twists, commands=commands)

    def _intent(self, mind: RobotMind, me: Me) -> Intent:
        answer = mind.step(me)
        if answer is None:
            return Intent((0.0, 0.0, 0.0))
        if not isinstance(answer, Intent):
            raise MisfitError(
                f"step gave {own.brief(answer)}; expected me.drive(...), me.head(...), me.go(...) or None to stand",
                self._kind, "step",
            )  # fmt: skip
        try:
            told = {name: self._actuators.command(name, value) for name, value in answer.commands.items()}
        except ValueError as problem:
            raise MisfitError(f"step gave {problem}", self._kind, "step") from None
        return replace(answer, commands=told) if told else answer
