"""Faults of minds: controllers that freeze, wander at random or start again from nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Protocol

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Behaviour, Parts, Setting
from swarmsim.core.state import UNKNOWN, Inbox, Intents, Observations, State, Tiles
from swarmsim.faults.body import forget
from swarmsim.faults.effect import TimedFault
from swarmsim.faults.timeline import Robots, Timed, Timeline, described
from swarmsim.kernels import grid

REACH = 1.5  # m, of a random walk unless the scenario says otherwise
NEIGHBOURS = ((0, -1), (-1, 0), (1, 0), (0, 1))  # row and column steps to the cells across an edge


class Mind(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The controller fails; the robot still senses and talks.

    `frozen`: goal and path stay as they were, so that the robot goes there and stands; it still maps. `random-walk`:
    it walks to one random place after the other, through cells that its own map calls free; it still maps. `reboot`:
    it forgets its map and its plan, and stands without mapping until the fault ends: after one iteration unless
    `lasts`, `between` or `duty` says otherwise.
    """

    failure: Literal["frozen", "random-walk", "reboot"]
    reach: Annotated[float, Meta(gt=0.0)] | None = None  # for random-walk: m, the longest way to a place; default 1.5

    def build(self, setting: Setting, number: int) -> TimedFault:
        """The fault; raises InputError for a key that its failure does not have."""
        if self.reach is not None and self.failure != "random-walk":
            raise InputError(f"reach: a mind that fails by {self.failure!r} has none; expected failure = 'random-walk'")
        timed: Mind = self
        if self.failure == "reboot" and self.lasts is None and self.between is None and self.duty is None:
            timed = msgspec.structs.replace(self, lasts=1)
        confusion: Confusion = Reboot()
        if self.failure == "frozen":
            confusion = Frozen(setting)
        elif self.failure == "random-walk":
            confusion = RandomWalk(setting, self.reach or REACH, f"fault mind {number}")
        effect = MindFailure(self.failure, confusion)
        return TimedFault(Timeline(timed, setting, number), effect, described(self, "mind"))


@dataclass(frozen=True, slots=True)
class Decision:
    """What a failing mind decides for its robot."""

    goal: NDArray[np.int64]  # (2,): row and column; -1, -1 for none
    way: NDArray[np.float64]  # (w, 2): the waypoints still ahead, x and y in m
    new: bool  # whether the way has just been chosen


class Confusion(Protocol):
    """What one failure puts in the place of sound perception and decisions."""

    def begin(self, robots: Robots, behaviour: Behaviour, last: Intents | None) -> None:
        """It begins with these robots, whose minds decided `last` in the iteration before, if there was one."""
        ...

    def perceived(self, observations: Observations, robots: NDArray[np.bool_]) -> Observations:
        """What the behaviour is shown while these `robots` (n,) fail."""
        ...

    def decided(self, robot: int, pose: NDArray[np.float64], behaviour: Behaviour) -> Decision | None:
        """What a live robot that believes to be at `pose` (3,) does; None for what its behaviour has decided."""
        ...


class MindFailure:
    """Wraps the behaviour."""

    def __init__(self, failure: str, confusion: Confusion) -> None:
        self.words = (f"mind {failure}", f"mind {failure} over")
        self._confusion = confusion

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the behaviour wrapped."""
        self._mind = FailingMind(parts.behaviour, active, self._confusion)
        return replace(parts, behaviour=self._mind)

    def begin(self, robots: Robots, state: State) -> None:
        """Their minds fail from what they have decided last."""
        self._mind.begin(robots)

    def end(self, robots: Robots, state: State) -> Robots:
        """Their minds go on with what they know by then."""
        return robots


class FailingMind:
    """Behaviour of which some robots perceive or decide something else."""

    def __init__(self, inner: Behaviour, active: NDArray[np.bool_], confusion: Confusion) -> None:
        self._inner, self._active, self._confusion = inner, active, confusion
        self._failed = np.zeros_like(active)  # whose decision was not its own in the iteration before
        self._last: Intents | None = None

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which cells each robot's map holds (n, rows, columns)."""
        return self._inner.observed

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """Each robot's occupancy grid (n, rows, columns)."""
        return self._inner.log_odds

    @property
    def forgets(self) -> bool:
        """Whether cells of a sound robot's map can change although no tile shows them."""
        return self._inner.forgets

    def begin(self, robots: Robots) -> None:
        """These robots fail from the next iteration on."""
        self._confusion.begin(robots, self._inner, self._last)

    def step(self, observations: Observations) -> Intents:
        """The intents of all robots, with those of failing minds replaced."""
        failing = self._active & observations.alive
        intents = self._inner.step(self._confusion.perceived(observations, failing))
        if failing.any() or self._failed.any():
            intents = self._replaced(intents, observations, failing)
        self._failed, self._last = failing, intents
        return intents

    def _replaced(self, intents: Intents, observations: Observations, failing: NDArray[np.bool_]) -> Intents:
        """The same intents, but for the rows of failing minds."""
        decisions = {}
        for robot in np.flatnonzero(failing):
            decision = self._confusion.decided(int(robot), observations.pose[robot], self._inner)
            if decision is not None:
                decisions[robot] = decision
        # Whoever comes to its senses follows a path that may have been planned long ago but is new to everyone else.
        planned = intents.planned | (self._failed & ~failing & (intents.counts > 0))
        goals, counts = intents.goals.copy(), intents.counts.copy()
        longest = max([intents.waypoints.shape[1], *(len(decision.way) for decision in decisions.values())])
        waypoints = np.zeros((len(goals), longest, 2))
        waypoints[:, : intents.waypoints.shape[1]] = intents.waypoints
        for robot, decision in decisions.items():
            goals[robot], counts[robot], planned[robot] = decision.goal, len(decision.way), decision.new
            waypoints[robot] = 0.0
            waypoints[robot, : len(decision.way)] = decision.way
        return Intents(goals, waypoints, counts, planned)


class Frozen:
    """Keeps to the goal and the path of the moment at which it froze."""

    def __init__(self, setting: Setting) -> None:
        self._window = _window(setting)
        self._kept: dict[int, Decision] = {}

    def begin(self, robots: Robots, behaviour: Behaviour, last: Intents | None) -> None:
        """What they decided last is all they will do; without it they stand."""
        for robot in robots:
            goal, way = np.array([-1, -1]), np.empty((0, 2))
            if last is not None:
                goal, way = last.goals[robot].copy(), last.waypoints[robot, : last.counts[robot]].copy()
            self._kept[int(robot)] = Decision(goal, way, new=False)

    def perceived(self, observations: Observations, robots: NDArray[np.bool_]) -> Observations:
        """Everything: a frozen mind still maps."""
        return observations

    def decided(self, robot: int, pose: NDArray[np.float64], behaviour: Behaviour) -> Decision:
        """What is left of the way."""
        kept = self._kept[robot]
        self._kept[robot] = Decision(kept.goal, _ahead(kept.way, pose, self._window), new=False)
        return self._kept[robot]


class RandomWalk:
    """Walks to cells drawn among those that are near on its own map, with a stream for each robot."""

    def __init__(self, setting: Setting, reach: float, purpose: str) -> None:
        """`reach` is the longest way to a place in m; `purpose` names the streams."""
        lattice, robots = setting.lattice, setting.robots
        self._lattice, self._window = lattice, _window(setting)
        self._reach = max(1, int(min(reach / lattice.cell, lattice.rows * lattice.columns)))  # steps
        self._pace = lattice.cell / (robots.speed * setting.period)  # iterations a step
        self._under = grid.footprint(robots.radius / lattice.cell)
        self._streams = [setting.streams.open(purpose, robot) for robot in range(robots.count)]
        self._walks: dict[int, tuple[Decision, float]] = {}  # and for how many iterations more

    def begin(self, robots: Robots, behaviour: Behaviour, last: Intents | None) -> None:
        """They choose a place first."""
        for robot in robots:
            self._walks.pop(int(robot), None)

    def perceived(self, observations: Observations, robots: NDArray[np.bool_]) -> Observations:
        """Everything: a wanderer still maps."""
        return observations

    def decided(self, robot: int, pose: NDArray[np.float64], behaviour: Behaviour) -> Decision:
        """On along the way or, once there, delayed or barred, along another one."""
        here = self._lattice.cells(pose[:2])
        if robot in self._walks:
            decision, left = self._walks[robot]
            way = _ahead(decision.way, pose, self._window)
            rows, columns = self._lattice.cells(way).T
            free = behaviour.observed[robot, rows, columns] & (behaviour.log_odds[robot, rows, columns] < 0.0)
            if left > 0.0 and free.all() and (here != decision.goal).any():
                self._walks[robot] = Decision(decision.goal, way, new=False), left - 1.0
                return self._walks[robot][0]
        cells = self._drawn(robot, here, behaviour)
        if len(cells) == 0:
            self._walks.pop(robot, None)
            return Decision(np.array([-1, -1]), np.empty((0, 2)), new=False)
        walk = Decision(cells[-1], self._lattice.centres(cells), new=True)
        self._walks[robot] = walk, max(4.0, 2.0 * self._pace * len(cells))
        return walk

    def _drawn(self, robot: int, here: NDArray[np.int64], behaviour: Behaviour) -> NDArray[np.int64]:
        """The cells (w, 2) of a shortest way to one of the cells in reach, each as likely; none if it is shut in."""
        free = _walkable(behaviour.observed[robot], behaviour.log_odds[robot], self._under)
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
    """Forgets everything, and is to its behaviour as a dead robot until it is up again."""

    def begin(self, robots: Robots, behaviour: Behaviour, last: Intents | None) -> None:
        """Their maps are empty."""
        forget(behaviour, robots)

    def perceived(self, observations: Observations, robots: NDArray[np.bool_]) -> Observations:
        """Neither their tiles nor what they hear, so that nothing is mapped; their plans are dropped with life."""
        if not robots.any():
            return observations
        values = observations.tiles.values.copy()
        values[robots] = UNKNOWN
        inbox = observations.inbox
        taken = ~robots[inbox.receivers]
        kept = Inbox(*(getattr(inbox, name)[taken] for name in Inbox.__slots__))
        tiles = Tiles(values, observations.tiles.origins)
        return replace(observations, alive=observations.alive & ~robots, tiles=tiles, inbox=kept)

    def decided(self, robot: int, pose: NDArray[np.float64], behaviour: Behaviour) -> None:
        """Nothing of its own: as if dead, it stands."""


def _window(setting: Setting) -> int:
    """How many waypoints, one a cell, a robot can pass within one iteration, with some to spare."""
    return math.ceil(setting.robots.speed * setting.period / setting.lattice.cell) + 3


def _ahead(way: NDArray[np.float64], pose: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """What is left of a way (w, 2) beyond the nearest of its next waypoints, its last one always."""
    if len(way) == 0:
        return way
    nearest = int(np.hypot(*(way[:window] - pose[:2]).T).argmin())
    return way[min(nearest + 1, len(way) - 1) :]


def _walkable(
    observed: NDArray[np.bool_], log_odds: NDArray[np.float32], under: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """The cells (rows, columns) known to be free, with no cell `under` the robot's body known to be occupied."""
    free = observed & (log_odds < 0.0)
    span = int(np.abs(under).max(initial=0))
    walls = np.pad(observed & ~free, span)
    for row, column in under + span:
        free &= ~walls[row : row + free.shape[0], column : column + free.shape[1]]
    return free
