"""A scenario with learners, arrays in and arrays out: what environments of one world or of many are made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, TypedDict, TypeVar

import msgspec
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.kinds import Mixed
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.own import array_of
from swarmsim.core.readings import Column, Readings
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Intents, Knowledge, Measured, Moment
from swarmsim.engine.build import BuiltRun, build
from swarmsim.engine.simulation import Perceived
from swarmsim.kernels import inboxes
from swarmsim.learning.observed import observed, spaces_of
from swarmsim.robots.kinematics import drives_of

#: Actions of agents: the offset of a goal to go straight to, in m, up to `reach`; a velocity, ahead and turning; or
#: the speeds of the left and the right wheel. All are scaled to -1 to 1 of their maximum.
ACTIONS: Final = ("goal", "twist", "wheels")

ROUNDING: Final = 1e-6  # by which 32-bit actions may exceed their limits

Reward = Callable[[Measured | None, Moment[Knowledge]], NDArray[np.float64]]
Observations = dict[str, Column]  # of some robots, (robots, ...) or (worlds, robots, ...), by name


def progress(before: Measured | None, moment: Moment[Knowledge]) -> NDArray[np.float64]:
    """The swarm's gain in the task's first measure, equal for all robots; a decrease counts if lower is better."""
    name = next(iter(moment.measured.values))
    gain = moment.measured.values[name] - (0.0 if before is None else before.values[name])
    return np.full(moment.state.robots, gain)


def own(before: Measured | None, moment: Moment[Knowledge]) -> NDArray[np.float64]:
    """Each robot's gain in the first per-robot measure; for coverage, the new cells on its own map."""
    name = next(iter(moment.measured.robots))
    values = np.asarray(moment.measured.robots[name], np.float64)
    return np.asarray(values - (0.0 if before is None else np.asarray(before.robots[name], np.float64)))


#: Rewards by name: from an iteration's measures and the previous ones (None in the first), one per robot.
REWARDS: Final[Mapping[str, Reward]] = {"progress": progress, "own": own}


class Learning(TypedDict, total=False):
    """What is learned, by which robots, from what.

    `action` is one of ACTIONS, by default "twist", `reward` one of REWARDS or a function like them, `learners` the
    robots that are agents, all by default, `hears` the number of others in an observation, by default 5, nearest first,
    and `reach` the greatest distance of a goal in m, by default 1. `observe` names further sensor channels, each with
    NAME_known, which is 1 for measured values.
    """

    action: str
    reward: str | Reward
    learners: Sequence[int] | None
    hears: int
    reach: float
    observe: Sequence[str]


class LearnedRun:
    """A scenario's run, one after another, in which learners act."""

    def __init__(
        self,
        scenario: str | Path,
        overrides: Mapping[str, object] | None = None,
        *,
        action: str = "twist",
        reward: str | Reward = "progress",
        learners: Sequence[int] | None = None,
        hears: int = 5,
        reach: float = 1.0,
        observe: Sequence[str] = (),
    ) -> None:
        """A scenario file, with overrides by dotted key, and what is learned, as in `Learning`.

        Raises InputError for an invalid scenario, or one whose robots sense no tiles.
        """
        if action not in ACTIONS:
            raise InputError(f"action: {action!r}; expected one of {', '.join(ACTIONS)}")
        if isinstance(reward, str) and reward not in REWARDS:
            raise InputError(f"reward: {reward!r}; expected one of {', '.join(REWARDS)}, or a function")
        self.name = str(scenario)
        self.scenario = load(Path(scenario), changes=dict(overrides or {}))
        self.run: BuiltRun = build(self.scenario, self.name)
        drives = drives_of(self.run.context)
        if action == "wheels" and drives.names != {"differential"}:
            kinds = " and ".join(map(repr, sorted(drives.names)))
            raise InputError(f"action: 'wheels' is of robots on two wheels, not {kinds}; expected 'goal' or 'twist'")
        self._robots = count = self.scenario.robots.count
        self._speed, self._base = self.scenario.robots.each("speed"), self.scenario.robots.each("wheel_base")
        chosen = list(range(count)) if learners is None else list(learners)
        if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(count)):
            raise InputError(f"learners: {chosen}; expected some of 0 to {count - 1}, each once")
        self._action, self._reward = action, REWARDS[reward] if isinstance(reward, str) else reward
        self._hears, self._reach, self._observe = hears, reach, tuple(observe)
        #: The robots that learn.
        self.learners = np.array(chosen, np.int64)
        #: One robot's observations.
        self.space = self._spaces()

    def _spaces(self) -> spaces.Dict:
        sensed, lattice = self.run.simulation.parts.sensor.channels, self.run.context.lattice
        if "tiles" not in sensed:
            raise InputError(f"{self.name}: sensor.use: robots that learn need tiles; expected ir-ring")
        shape, hears = sensed["tiles.values"].shape, self._hears
        right, top = lattice.x0 + lattice.columns * lattice.cell, lattice.y0 + lattice.rows * lattice.cell
        room = max(right - lattice.x0, top - lattice.y0)
        low, high = np.array([lattice.x0, lattice.y0]) - room, np.array([right, top]) + room
        self._bounds = np.array([[*low, -np.pi], [*high, np.pi]])
        self._farthest = 4.0 * room
        self._place = (lattice.x0, lattice.y0, lattice.cell)
        try:
            more = spaces_of(sensed, self._observe)
        except InputError as problem:
            raise InputError(f"{self.name}: {problem}") from problem
        return spaces.Dict(
            {
                "tile": spaces.Box(0, 2, shape, np.uint8),
                "pose": spaces.Box(*self._bounds, dtype=np.float64),
                "heard": spaces.Discrete(hears + 1),
                "tiles": spaces.Box(0, 2, (hears, *shape), np.uint8),
                "offsets": spaces.Box(-self._farthest, self._farthest, (hears, 2), np.float64),
                **more,
            }
        )

    def begin(self, seed: int) -> None:
        """Start again with this seed."""
        self.run = build(msgspec.structs.replace(self.scenario, seed=seed), self.name, self.run.world)
        self.before: Measured | None = None
        self.perceived: Perceived = self.run.simulation.perceive()

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Which learners live."""
        return self.perceived.state.alive[self.learners]

    def act(self, wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Run one iteration with the robots' actions (robots, 2), -1 to 1, and give all robots' rewards.

        Raises InputError for rewards that are not a number per robot.
        """
        simulation = self.run.simulation
        moment = simulation.act(self.perceived, self._intents(wanted))
        try:
            rewards = np.asarray(array_of(self._reward(self.before, moment), self._robots), np.float64)
        except ValueError as problem:
            raise InputError(f"reward: {problem}; expected a number for each of {self._robots} robots") from None
        self.before = moment.measured
        if not simulation.over:
            self.perceived = simulation.perceive()
        return rewards

    def _intents(self, wanted: NDArray[np.float64]) -> Intents:
        simulation, count = self.run.simulation, self._robots
        if self._action == "goal":
            places = self.perceived.senses.pose[:, :2]
            ways = {
                robot: np.stack([places[robot], places[robot] + self._reach * wanted[robot]])
                for robot in sorted(self.learners.tolist())
            }
            mine = Intents.along(ways, count, np.zeros(count, np.bool_))
        else:
            speed, base = self._speed, self._base
            if self._action == "twist":
                twists = np.stack([wanted[:, 0] * speed, wanted[:, 1] * 2.0 * speed / base], axis=1)
            else:
                left, right = wanted.T * speed
                twists = np.stack([(left + right) / 2.0, (right - left) / base], axis=1)
            mine = Intents.twisting(twists)
        if len(self.learners) == count:
            return mine
        seen = self.perceived
        theirs = simulation.parts.strategy.step(seen.senses, seen.inbox, seen.knowledge)
        others = np.ones(count, np.bool_)
        others[self.learners] = False
        commands = Readings.filled(simulation.parts.actuator.channels, theirs.commands, others).named()
        return replace(joined(mine, theirs, self.learners), commands=commands)

    def observations(self, *worlds: int) -> Observations:
        """Arrays (learners, ...) to observe into, of as many `worlds` if that is given; all 0."""
        return {
            name: np.zeros((*worlds, len(self.learners), *(space.shape or ())), space.dtype)
            for name, space in self.space.items()
        }

    def observe(self, into: Observations) -> None:
        """Write what the learners observe into arrays (learners, ...)."""
        senses, inbox = self.perceived.senses, _of_tiles(self.perceived.inbox)
        own = senses.readings.tiled.values
        values, origins = getattr(inbox.content, "values", None), getattr(inbox.content, "origins", None)
        receivers = inbox.receivers
        if values is None or origins is None:
            receivers, origins, values = receivers[:0], np.empty((0, 2), np.int32), own[:0]
        inboxes.look(
            self.learners, senses.pose, own, receivers, origins, values, self._place, self._bounds, self._farthest,
            into["tile"], into["pose"], into["heard"], into["tiles"], into["offsets"],
        )  # fmt: skip
        for name, column in observed(senses.readings, self._observe, self.learners).items():
            into[name][:] = column


S = TypeVar("S", bound=np.generic)


def _of_tiles(inbox: Inbox[MessageBatch]) -> Inbox[MessageBatch]:
    """The received tiles, where groups send several kinds of messages."""
    content = inbox.content
    if not isinstance(content, Mixed):
        return inbox
    tiled = [kind for kind, table in content.tables.items() if {"values", "origins"} <= set(table.__match_args__)]
    return replace(inbox.take(content.kind == tiled[0]), content=content.of(tiled[0])) if tiled else inbox


def joined(mine: Intents, theirs: Intents, learners: NDArray[np.int64]) -> Intents:
    """Intents merged from two sources, by robot."""
    longest = max(mine.waypoints.shape[1], theirs.waypoints.shape[1])
    pads = [np.pad(one.waypoints, ((0, 0), (0, longest - one.waypoints.shape[1]), (0, 0))) for one in (mine, theirs)]
    width = max(2 if one.twists is None else one.twists.shape[1] for one in (mine, theirs))

    def twists(one: Intents) -> NDArray[np.float64]:
        """Velocities with the larger number of columns."""
        found = np.full((len(one.counts), 2), np.nan) if one.twists is None else one.twists
        return np.pad(found, ((0, 0), (0, width - found.shape[1])))

    def both(first: NDArray[S], second: NDArray[S]) -> NDArray[S]:
        column = second.copy()
        column[learners] = first[learners]
        return column

    return Intents(
        both(mine.goals, theirs.goals), both(*pads), both(mine.counts, theirs.counts),
        both(mine.planned, theirs.planned),
        both(twists(mine), twists(theirs)),
    )  # fmt: skip
