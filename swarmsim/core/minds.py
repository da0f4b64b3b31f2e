"""Minds of one's own: a class whose instances are one robot's mind each, run for the whole swarm.

Nothing of this module has to be imported to write one: `step(self, me)` gets a `Me` and gives what `me.drive(...)` or
`me.go(...)` give, or None to stand still.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, make_dataclass, replace
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Columns, Inbox, PlainCodec, Said
from swarmsim.core.parts import Setting
from swarmsim.core.state import OCCUPIED, Intents, Knowledge, Observations, Record


@dataclass(frozen=True, slots=True, eq=False)
class Intent:
    """What one robot has decided: a velocity or a way."""

    twist: tuple[float, float] | None = None  # m/s ahead, rad/s counter-clockwise
    way: NDArray[np.float64] | None = None  # (w, 2): x, y in m


@dataclass(slots=True, eq=False)
class Me:
    """All that one robot may know in one iteration, its own memory aside; arrays cannot be written to."""

    id: int
    iteration: int
    time: float  # s
    x: float  # m, where it believes itself to be
    y: float  # m
    yaw: float  # rad, counter-clockwise from the x axis
    velocity: NDArray[np.float64]  # (3,): m/s, m/s, rad/s, in the world frame
    tile: NDArray[np.uint8] | None  # (rows, columns): UNKNOWN 0, FREE 1 or OCCUPIED 2; None without such a sensor
    corner: NDArray[np.int32] | None  # (2,): row and column of the tile's lower-left cell
    ranges: NDArray[np.float64] | None  # (b,): m, how far each beam reaches
    bearings: NDArray[np.float64] | None  # (b,): rad from straight ahead
    sample: float | None  # the field's value here, if there is a field
    heard: Sequence[SimpleNamespace]  # what arrived: `sender`, `age` in iterations, and the message's own fields
    knows: Any  # what its computation makes of all that, where that is another part
    lattice: Lattice  # of tiles and maps
    speed: float  # m/s, the most that its wheels do
    radius: float  # m
    random: np.random.Generator  # a stream of its own

    @property
    def walls(self) -> NDArray[np.float64]:
        """The centres (w, 2) in m of the occupied cells of its tile."""
        if self.tile is None or self.corner is None:
            return np.empty((0, 2))
        return self.lattice.centres(np.argwhere(self.tile == OCCUPIED) + self.corner)

    def drive(self, ahead: float, turn: float = 0.0) -> Intent:
        """To move at a velocity until the next iteration: m/s ahead, rad/s counter-clockwise."""
        return Intent(twist=(float(ahead), float(turn)))

    def head(self, yaw: float, ahead: float) -> Intent:
        """To move at `ahead` (m/s) and turn towards a direction (rad) as far as one iteration allows."""
        turn = (yaw - self.yaw + np.pi) % (2.0 * np.pi) - np.pi
        return Intent(twist=(float(ahead), float(turn) / self._period))

    def go(self, way: ArrayLike) -> Intent:
        """To follow waypoints (w, 2) in m, or to go to one place (2,), and stop at the end."""
        return Intent(way=np.asarray(way, np.float64).reshape(-1, 2))

    _period: float = 1.0  # s, of an iteration


@dataclass(frozen=True, slots=True, eq=False)
class OwnMinds(Knowledge):
    """What the minds of somebody's own class know: themselves, and what of it they show."""

    minds: Sequence[Any]  # (n,): one instance for each robot
    shown: Mapping[str, NDArray[np.float64]]  # (n,): the attributes that the class names in `shows`

    def __getattr__(self, name: str) -> NDArray[np.float64]:
        try:
            return self.shown[name]
        except KeyError:
            raise AttributeError(
                f"{name!r} is not shown; the class names in 'shows': {', '.join(self.shown)}"
            ) from None

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All that is shown."""
        return tuple(self.shown.values())

    def record(self) -> Record:
        """A table for each attribute that is shown."""
        return Record(dict(self.shown))

    def of(self, robot: int) -> Any:
        """One robot's mind."""
        return self.minds[robot]


#: The message of minds that say nothing: a header alone.
_SILENCE: Final = make_dataclass(
    "Silence", [("nothing", NDArray[np.float64])], bases=(Columns,), frozen=True, slots=True, eq=False
)


class Swarm:
    """One instance for each robot, and what each of them may know."""

    def __init__(self, make: Callable[[], Any], setting: Setting) -> None:
        robots = setting.robots
        self._make, self._setting = make, setting
        self.minds = [make() for _ in range(robots.count)]
        self._random = [setting.streams.open("mind", robot) for robot in range(robots.count)]

    def each(self, observations: Observations, ask: Callable[[Any, Me], Any]) -> dict[int, Any]:
        """What every live robot's mind answers; what is raised tells whose mind it was."""
        answers = {}
        for me in self._all(observations):
            try:
                answers[me.id] = ask(self.minds[me.id], me)
            except Exception as problem:
                problem.add_note(f"robot {me.id}")
                raise
        return answers

    def _all(self, observations: Observations) -> Iterable[Me]:
        robots, lattice, period = self._setting.robots, self._setting.lattice, self._setting.period
        readings, knowledge = observations.readings, observations.knowledge
        tiles, beams, field = readings.tiles, readings.beams, readings.field
        for i in np.flatnonzero(observations.alive).tolist():
            x, y, yaw = observations.pose[i].tolist()
            yield Me(
                i, observations.iteration, observations.iteration * period, x, y, yaw,
                _kept(observations.velocity[i]),
                None if tiles is None else _kept(tiles.values[i]),
                None if tiles is None else _kept(tiles.origins[i]),
                None if beams is None else _kept(beams.ranges[i]),
                None if beams is None else _kept(beams.bearings),
                None if field is None else float(field[i]),
                _heard(observations.inbox, i, observations.iteration),
                None if knowledge is None else knowledge.of(i),
                lattice, robots.speed, robots.radius, self._random[i], period,
            )  # fmt: skip

    def forget(self, robots: NDArray[np.int64]) -> None:
        """Give robots (r,) new minds."""
        for robot in robots.tolist():
            self.minds[robot] = self._make()

    def adopt(self, robots: NDArray[np.int64], source: int) -> None:
        """Give robots (r,) the memory of another one."""
        for robot in robots.tolist():
            self.minds[robot] = copy.deepcopy(self.minds[source])


def _kept(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


def _heard(inbox: Inbox[Any] | None, robot: int, iteration: int) -> list[SimpleNamespace]:
    """The items of one robot's inbox, each by the names of its columns."""
    if inbox is None:
        return []
    first, end = np.searchsorted(inbox.receivers, [robot, robot + 1]).tolist()
    names = [column.name for column in fields(inbox.content)]
    columns = inbox.content.arrays()
    return [
        SimpleNamespace(
            sender=int(inbox.senders[row]),
            age=iteration - int(inbox.sent[row]),
            **{name: column[row] for name, column in zip(names, columns, strict=True)},
        )
        for row in range(first, end)
    ]


class MindComputation:
    """The half of such minds that says and hears."""

    knows: type[Knowledge] = OwnMinds

    def __init__(self, kind: type, make: Callable[[], Any], setting: Setting) -> None:
        #: Whose contract it is to keep.
        self.written_by = kind
        self._swarm = Swarm(make, setting)
        says = dict(getattr(kind, "says", {}))
        self._shows: tuple[str, ...] = tuple(getattr(kind, "shows", ()))
        self._hears, self._kinds = hasattr(kind, "hear"), {name: np.dtype(dtype) for name, dtype in says.items()}
        if bool(says) != hasattr(kind, "say"):
            raise TypeError(f"{kind.__name__}: expected both 'says', the fields of a message, and 'say', or neither")
        columns = [(name, NDArray[Any]) for name in says]
        self._content: Any = (
            make_dataclass("Message", columns, bases=(Columns,), frozen=True, slots=True, eq=False)
            if says
            else _SILENCE
        )
        self.codec = PlainCodec(self._content(*self._columns({})))

    def _columns(self, answers: dict[int, Any], count: int = 0) -> list[NDArray[Any]]:
        if not self._kinds:
            return [np.empty((count, 0))]
        columns = [np.zeros(count, kind) for kind in self._kinds.values()]
        for robot, answer in answers.items():
            values = [answer[name] for name in self._kinds] if isinstance(answer, Mapping) else np.atleast_1d(answer)
            for column, value in zip(columns, values, strict=True):
                column[robot] = value
        return columns

    def say(self, observations: Observations) -> Said[Any]:
        """What each live robot's mind says; the dead's messages are zeros that nobody hears."""
        answers = self._swarm.each(observations, lambda mind, me: mind.say(me)) if self._kinds else {}
        columns = self._columns(answers, len(observations.alive))
        return Said.each(self._content(*columns), self.codec.size)

    def hear(self, observations: Observations) -> OwnMinds:
        """The minds, after they have heard."""
        if self._hears:
            self._swarm.each(observations, lambda mind, me: mind.hear(me))
        minds = self._swarm.minds
        shown = {name: np.array([float(getattr(mind, name)) for mind in minds]) for name in self._shows}
        return OwnMinds(tuple(minds), shown)

    def forget(self, robots: NDArray[np.int64]) -> None:
        """Give robots (r,) new minds."""
        self._swarm.forget(robots)

    def adopt(self, robots: NDArray[np.int64], source: int) -> None:
        """Give robots (r,) the memory of another one."""
        self._swarm.adopt(robots, source)


class MindStrategy:
    """The half of such minds that decides: of the minds that the computation has or, beside another one, of its own."""

    reads: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def __init__(self, kind: type, make: Callable[[], Any], setting: Setting) -> None:
        #: Whose contract it is to keep.
        self.written_by = kind
        self._kind, self._lattice = kind, setting.lattice
        self._swarm = Swarm(make, setting)
        self._ways: dict[int, bytes] = {}

    def step(self, observations: Observations) -> Intents:
        """What each live robot's mind decides."""
        knowledge = observations.knowledge
        if isinstance(knowledge, OwnMinds) and isinstance(knowledge.minds[0], self._kind):
            self._swarm.minds[:] = knowledge.minds
        decided = self._swarm.each(observations, lambda mind, me: _intent(mind.step(me)))
        count = len(observations.alive)
        ways = {robot: intent.way for robot, intent in decided.items() if intent.way is not None}
        twists, planned = np.zeros((count, 2)), np.zeros(count, np.bool_)
        for robot, intent in decided.items():
            twists[robot] = (np.nan, np.nan) if intent.twist is None else intent.twist
        for robot, way in ways.items():
            planned[robot] = self._ways.get(robot) != way.tobytes()
        self._ways = {robot: way.tobytes() for robot, way in ways.items()}
        here = observations.pose[:, :2]
        from_here = {robot: np.concatenate([here[robot : robot + 1], way]) for robot, way in ways.items()}
        return replace(Intents.along(from_here, count, self._lattice.cells, planned), twists=twists)


def _intent(answer: Any) -> Intent:
    if answer is None:
        return Intent((0.0, 0.0))
    if not isinstance(answer, Intent) or (answer.way is not None and len(answer.way) == 0):
        raise TypeError(f"step gave {answer!r}; expected me.drive(...), me.head(...), me.go(...) or None to stand")
    return answer
