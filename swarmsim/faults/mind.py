"""Faults of minds: controllers that freeze, wander at random or start again from nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, Protocol

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.capabilities import CHARTED, Capability, Charted
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, AnyStrategy, Parts
from swarmsim.core.readings import Channels, Column, Readings
from swarmsim.core.state import FREE, OCCUPIED, Intents, Knowledge, Senses, State
from swarmsim.faults.delegate import ComputationDelegate
from swarmsim.faults.effect import TimedFault
from swarmsim.faults.timeline import Robots, Timed, Timeline
from swarmsim.kernels import search

REACH = 1.5  # m, of a random walk unless the scenario says otherwise
NEIGHBOURS = ((0, -1), (-1, 0), (1, 0), (0, 1))  # row and column steps to the cells across an edge


class MindFault(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The controller fails; the robot still senses and talks.

    `frozen`: goal and path stay as they were, so that the robot goes there and stops; it still learns. `random-walk`:
    it walks to one random place after the other, through cells that its map calls free; it still learns. `reboot`:
    it forgets its knowledge and plan, and stands without learning until the fault ends: after one iteration unless
    `duration`, `between` or `duty` says otherwise.
    """

    failure: Literal["frozen", "random-walk", "reboot"]
    reach: Annotated[float, Meta(gt=0.0)] | None = None  # for random-walk: m, the longest way to a place; default 1.5

    @property
    def of_mind(self) -> bool:
        """Whether a robot that is a process of its own has it in its mind."""
        return True

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for a key that its failure does not have."""
        if self.reach is not None and self.failure != "random-walk":
            raise InputError(f"reach: a mind that fails by {self.failure!r} has none; expected failure = 'random-walk'")
        timed: MindFault = self
        if self.failure == "reboot" and self.duration is None and self.between is None and self.duty is None:
            timed = msgspec.structs.replace(self, duration=1)
        confusion: FailureMode = Reboot()
        if self.failure == "frozen":
            confusion = Frozen(context)
        elif self.failure == "random-walk":
            confusion = RandomWalk(context, self.reach or REACH, f"fault mind {context.number}")
        effect = ControllerFault(self.failure, confusion, context.actuators)
        return TimedFault(Timeline(timed, context), effect, context.number)


@dataclass(frozen=True, slots=True)
class Decision:
    """What a failing mind decides for its robot."""

    goal: NDArray[np.float64]  # (2,): x, y in m; NaN for none
    way: NDArray[np.float64]  # (w, 2): the waypoints still ahead, x and y in m
    new: bool  # whether the way has just been chosen
    twist: NDArray[np.float64] | None = None  # (2,): m/s ahead, rad/s, in place of a way
    commands: Mapping[str, Column] = field(default_factory=dict)  # (...): by actuator channel, all others rest


class FailureMode(Protocol):
    """How a failing controller perceives and decides."""

    is_blank: bool  # whether its robots perceive nothing, as if dead

    @property
    def needs(self) -> Capability[Charted] | None:
        """The knowledge it needs."""
        ...

    def begin(self, robots: Robots, computation: AnyComputation, last: Intents | None) -> None:
        """It begins with these robots; `last` is what they decided in the iteration before, if there was one."""
        ...

    def decided(self, robot: int, senses: Senses, knowledge: Knowledge) -> Decision | None:
        """What a live robot does; None: as its strategy has decided."""
        ...


class ControllerFault:
    """Wraps the strategy and, for robots that perceive nothing, the computation."""

    def __init__(self, failure: str, confusion: FailureMode, actuators: Channels) -> None:
        self._failure, self._confusion, self._actuators = failure, confusion, actuators

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts, wrapped. Raises InputError for robots without the knowledge it needs."""
        if self._confusion.needs is not None:
            self._confusion.needs.needed(parts.computation.knowledge_type, f"failure: {self._failure!r}")
        self._computation = parts.computation
        self._mind = FailingMind(parts.strategy, active, self._confusion, self._actuators)
        if self._confusion.is_blank:
            return replace(parts, strategy=self._mind, computation=BlankComputation(parts.computation, active))
        return replace(parts, strategy=self._mind)

    def begin(self, robots: Robots, state: State) -> None:
        """Their minds fail, starting from their last decision."""
        self._confusion.begin(robots, self._computation, self._mind.last)

    def end(self, robots: Robots, state: State) -> Robots:
        """Their minds go on with their present knowledge."""
        return robots


class BlankComputation(ComputationDelegate):
    """A computation that gets neither readings nor messages of some robots."""

    def __init__(self, inner: AnyComputation, active: NDArray[np.bool_]) -> None:
        super().__init__(inner)
        self._active = active

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> Knowledge:
        """The robots' knowledge; failing robots take in nothing."""
        blank = self._active & senses.alive
        if not blank.any():
            return self._inner.hear(senses, inbox)
        deaf = replace(senses, alive=senses.alive & ~blank, readings=senses.readings.blanked(blank))
        return self._inner.hear(deaf, inbox.take(~blank[inbox.receivers]))


class FailingMind:
    """A strategy in which some robots decide differently."""

    def __init__(
        self, inner: AnyStrategy, active: NDArray[np.bool_], confusion: FailureMode, actuators: Channels
    ) -> None:
        self._inner, self._active, self._confusion, self._actuators = inner, active, confusion, actuators
        self._failed = np.zeros_like(active)  # whose decision was not its own in the iteration before
        #: What all robots decided in the iteration before.
        self.last: Intents | None = None

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """The knowledge that the wrapped strategy reads."""
        return self._inner.requires_knowledge

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """The intents of all robots, with those of failing minds replaced."""
        failing = self._active & senses.alive
        perceived = senses
        if self._confusion.is_blank and failing.any():
            perceived = replace(senses, alive=senses.alive & ~failing)
        intents = self._inner.step(perceived, inbox, knowledge)
        if failing.any() or self._failed.any():
            intents = self._replaced(intents, senses, knowledge, failing)
        self._failed, self.last = failing, intents
        return intents

    def _replaced(self, intents: Intents, senses: Senses, knowledge: Knowledge, failing: NDArray[np.bool_]) -> Intents:
        """The same intents, but for the rows of failing minds."""
        decisions = {}
        for robot in np.flatnonzero(failing):
            decision = self._confusion.decided(int(robot), senses, knowledge)
            if decision is not None:
                decisions[robot] = decision
        # A recovered robot resumes an old path, which must be recorded as new.
        planned = intents.planned | (self._failed & ~failing & (intents.counts > 0))
        goals, counts = intents.goals.copy(), intents.counts.copy()
        longest = max([intents.waypoints.shape[1], *(len(decision.way) for decision in decisions.values())])
        waypoints = np.zeros((len(goals), longest, 2))
        waypoints[:, : intents.waypoints.shape[1]] = intents.waypoints
        twists = None if intents.twists is None else intents.twists.copy()
        if twists is not None and self._confusion.is_blank:
            twists[failing] = 0.0
        commands = Readings.filled(self._actuators, intents.commands, ~failing).named()
        for robot, decision in decisions.items():
            for name, row in decision.commands.items():
                commands[name][robot] = row
            if twists is not None:
                twists[robot] = np.nan if decision.twist is None else decision.twist
            goals[robot], counts[robot], planned[robot] = decision.goal, len(decision.way), decision.new
            waypoints[robot] = 0.0
            waypoints[robot, : len(decision.way)] = decision.way
        return Intents(goals, waypoints, counts, planned, twists, commands)


class Frozen:
    """Keeps the goal and path, or the velocity, that it had when it froze."""

    needs, is_blank = None, False

    def __init__(self, context: BuildContext) -> None:
        self._window = window(context)
        self._kept: dict[int, Decision] = {}

    def begin(self, robots: Robots, computation: AnyComputation, last: Intents | None) -> None:
        """They only finish their last decision; without one they stand."""
        for robot in robots:
            goal, way, twist, commands = np.full(2, np.nan), np.empty((0, 2)), None, {}
            if last is not None:
                goal, way = last.goals[robot].copy(), last.waypoints[robot, : last.counts[robot]].copy()
                twist = None if last.twists is None else last.twists[robot].copy()
                commands = {name: column[robot].copy() for name, column in last.commands.items()}
            self._kept[int(robot)] = Decision(goal, way, False, twist, commands)

    def decided(self, robot: int, senses: Senses, knowledge: Knowledge) -> Decision:
        """The rest of the way."""
        kept = self._kept[robot]
        way = ahead(kept.way, senses.pose[robot], self._window)
        self._kept[robot] = replace(kept, way=way)
        return self._kept[robot]


class RandomWalk:
    """Walks to cells drawn among the nearby ones that its map calls free, with a stream for each robot."""

    needs, is_blank = CHARTED, False

    def __init__(self, context: BuildContext, reach: float, purpose: str) -> None:
        """`reach` is the longest way to a place in m; `purpose` names the streams."""
        lattice, robots = context.lattice, context.robots
        self._lattice, self._window = lattice, window(context)
        self._reach = max(1, int(min(reach / lattice.cell, lattice.rows * lattice.columns)))  # steps
        self._pace = lattice.cell / (robots.speed * context.period)  # iterations a step
        self._under = search.footprint(robots.radius / lattice.cell)
        self._streams = [context.streams.open(purpose, robot) for robot in context.ids.tolist()]
        self._walks: dict[int, tuple[Decision, float]] = {}  # and for how many iterations more

    def begin(self, robots: Robots, computation: AnyComputation, last: Intents | None) -> None:
        """They choose a place first."""
        for robot in robots:
            self._walks.pop(int(robot), None)

    def decided(self, robot: int, senses: Senses, knowledge: Knowledge) -> Decision:
        """Continue along the way or, once there, delayed or barred, along another one."""
        pose = senses.pose[robot]
        terrain = self.needs.needed(knowledge, "failure: 'random-walk'").terrain(robot)
        here = self._lattice.cells(pose[:2])
        if robot in self._walks:
            decision, left = self._walks[robot]
            way = ahead(decision.way, pose, self._window)
            cells = self._lattice.cells(way)
            rows, columns = cells[:, 0], cells[:, 1]
            free = bool((terrain[rows, columns] == FREE).all())
            if left > 0.0 and free and (here != self._lattice.cells(decision.goal)).any():
                self._walks[robot] = Decision(decision.goal, way, new=False), left - 1.0
                return self._walks[robot][0]
        cells = self._drawn(robot, here, terrain)
        if len(cells) == 0:
            self._walks.pop(robot, None)
            return Decision(np.full(2, np.nan), np.empty((0, 2)), new=False)
        way = self._lattice.centres(cells)
        walk = Decision(way[-1], way, new=True)
        self._walks[robot] = walk, max(4.0, 2.0 * self._pace * len(cells))
        return walk

    def _drawn(self, robot: int, here: NDArray[np.int64], terrain: NDArray[np.uint8]) -> NDArray[np.int64]:
        """The cells (w, 2) of a shortest way to a cell in reach, all equally likely; none if the robot is shut in."""
        free = _walkable(terrain, self._under)
        start = (int(here[0]), int(here[1]))
        before = {start: start}
        edge = [start]
        steps = 0
        while edge and steps < self._reach:
            steps, found = steps + 1, []
            for row, column in edge:
                for down, right in NEIGHBOURS:
                    cell = (row + down, column + right)
                    inside = 0 <= cell[0] < free.shape[0] and 0 <= cell[1] < free.shape[1]
                    if inside and cell not in before and free[cell]:
                        before[cell] = (row, column)
                        found.append(cell)
            edge = found
        others = list(before)[1:]
        if not others:
            return np.empty((0, 2), np.int64)
        way = [others[self._streams[robot].integers(len(others))]]
        while before[way[-1]] != start:
            way.append(before[way[-1]])
        return np.array(way[::-1], np.int64)


class Reboot:
    """Forgets everything, and acts like a dead robot until it is up again."""

    needs, is_blank = None, True

    def begin(self, robots: Robots, computation: AnyComputation, last: Intents | None) -> None:
        computation.reset(robots)

    def decided(self, robot: int, senses: Senses, knowledge: Knowledge) -> None:
        """None: it stands, as if dead."""


def window(context: BuildContext) -> int:
    """How many waypoints, one per cell, a robot can pass within one iteration, with some to spare."""
    return math.ceil(context.robots.speed * context.period / context.lattice.cell) + 3


def ahead(way: NDArray[np.float64], pose: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """The rest of a way (w, 2) beyond the nearest of its next waypoints; always includes the last one."""
    if len(way) == 0:
        return way
    nearest = int(np.hypot(*(way[:window] - pose[:2]).T).argmin())
    return way[min(nearest + 1, len(way) - 1) :]


def _walkable(terrain: NDArray[np.uint8], under: NDArray[np.int32]) -> NDArray[np.bool_]:
    """The cells (rows, columns) known to be free, with no cell `under` the robot's body known to be occupied."""
    free: NDArray[np.bool_] = terrain == FREE
    span = int(np.abs(under).max(initial=0))
    walls = np.pad(terrain == OCCUPIED, span)
    for row, column in under + span:
        free &= ~walls[row : row + free.shape[0], column : column + free.shape[1]]
    return free
