"""A scenario as a PettingZoo environment, in which some or all robots are agents."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.kinds import Mixed
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.own import array_of
from swarmsim.core.readings import Readings
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Intents, Knowledge, Measured, Moment
from swarmsim.engine.build import BuiltRun, build
from swarmsim.engine.simulation import Perceived
from swarmsim.learning.observed import observed, spaces_of
from swarmsim.robots.kinematics import drives_of

#: Actions of agents: the offset of a goal to go straight to, in m, up to `reach`; a velocity, ahead and turning; or
#: the speeds of the left and the right wheel. All are scaled to -1 to 1 of their maximum.
ACTIONS: Final = ("goal", "twist", "wheels")

ROUNDING: Final = 1e-6  # by which 32-bit actions may exceed their limits

Reward = Callable[[Measured | None, Moment[Knowledge]], NDArray[np.float64]]


Observation = dict[str, NDArray[Any]]  # of one robot, by name


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


class SwarmEnv(ParallelEnv):  # type: ignore[misc]
    """A scenario in which robots are agents: `robot_0`, `robot_1` and so on.

    One step is one iteration. An agent observes its `tile` (rows, columns) of 0 unknown, 1 free and 2 occupied; its
    estimated `pose`, x and y in m and yaw in rad; and its `inbox`: how many others it `heard`, their `tiles` (hears,
    rows, columns) and the tiles' `offsets` (hears, 2) in m from itself. An agent whose robot dies is terminated and
    leaves `agents` for good; all are terminated when the task is done, and truncated at the scenario's limit. Other
    robots follow the scenario's strategy. Agents only drive: their actuators rest.
    """

    metadata: dict[str, object] = {"name": "swarmsim_v0", "render_modes": []}  # noqa: RUF012 (PettingZoo's own)

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
        """A scenario file, with overrides by dotted key.

        `action` is one of ACTIONS, `reward` one of REWARDS or a function like them, `learners` the robots that are
        agents, all by default, `hears` the number of others in an observation, nearest first, and `reach` the
        greatest distance of a goal in m. `observe` names further sensor channels, each with NAME_known, which is 1
        for measured values. Raises InputError for an invalid scenario, or one whose robots sense no tiles.
        """
        if action not in ACTIONS:
            raise InputError(f"action: {action!r}; expected one of {', '.join(ACTIONS)}")
        if isinstance(reward, str) and reward not in REWARDS:
            raise InputError(f"reward: {reward!r}; expected one of {', '.join(REWARDS)}, or a function")
        self._name = str(scenario)
        self._scenario = load(Path(scenario), changes=dict(overrides or {}))
        self._run = build(self._scenario, self._name)
        drives = drives_of(self._run.context)
        if action == "wheels" and drives.names != {"differential"}:
            kinds = " and ".join(map(repr, sorted(drives.names)))
            raise InputError(f"action: 'wheels' is of robots on two wheels, not {kinds}; expected 'goal' or 'twist'")
        count = self._scenario.robots.count
        chosen = list(range(count)) if learners is None else list(learners)
        if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(count)):
            raise InputError(f"learners: {chosen}; expected some of 0 to {count - 1}, each once")
        self._action, self._reward = action, REWARDS[reward] if isinstance(reward, str) else reward
        self._hears, self._reach, self._observe = hears, reach, tuple(observe)
        self._learners = np.array(chosen, np.int64)
        self._robots = {f"robot_{robot}": robot for robot in chosen}
        self.possible_agents: list[str] = list(self._robots)
        self.agents: list[str] = []
        self._seed = self._scenario.seed
        self._fresh = self._scenario.seed
        self._observation_space = self._spaces()
        self._action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)

    def _spaces(self) -> spaces.Dict:
        """The parts of an observation."""
        shape, hears = self._tile_shape(), self._hears
        lattice = self._run.context.lattice
        right, top = lattice.x0 + lattice.columns * lattice.cell, lattice.y0 + lattice.rows * lattice.cell
        room = max(right - lattice.x0, top - lattice.y0)
        low, high = np.array([lattice.x0, lattice.y0]) - room, np.array([right, top]) + room
        self._pose = spaces.Box(np.append(low, -np.pi), np.append(high, np.pi), dtype=np.float64)
        self._offsets = spaces.Box(-4.0 * room, 4.0 * room, (hears, 2), np.float64)
        return spaces.Dict(
            {
                "tile": spaces.Box(0, 2, shape, np.uint8),
                "pose": self._pose,
                "heard": spaces.Discrete(hears + 1),
                "tiles": spaces.Box(0, 2, (hears, *shape), np.uint8),
                "offsets": self._offsets,
                **self._more_spaces(),
            }
        )

    def _tile_shape(self) -> tuple[int, int]:
        channels = self._run.simulation.parts.sensor.channels
        if "tiles" not in channels:
            raise InputError(f"{self._name}: sensor.use: robots that learn need tiles; expected ir-ring")
        rows, columns = channels["tiles.values"].shape
        return rows, columns

    def _more_spaces(self) -> dict[str, spaces.Space[NDArray[np.generic]]]:
        try:
            return spaces_of(self._run.simulation.parts.sensor.channels, self._observe)
        except InputError as problem:
            raise InputError(f"{self._name}: {problem}") from problem

    @property
    def run(self) -> BuiltRun:
        """The current run; a new one after every `reset`."""
        return self._run

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same for all agents."""
        return self._observation_space

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Two numbers from -1 to 1 for all agents."""
        return self._action_space

    def reset(
        self, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, object]]]:
        """Restart the scenario, with this `seed` or, by default, the next one."""
        if seed is not None:
            self._fresh = seed
        self._seed, self._fresh = self._fresh, self._fresh + 1
        scenario = msgspec.structs.replace(self._scenario, seed=self._seed)
        self._run = build(scenario, self._name, self._run.world)
        self._before: Measured | None = None
        self._perceived: Perceived = self._run.simulation.perceive()
        alive = self._perceived.state.alive
        self.agents = [agent for agent, robot in self._robots.items() if alive[robot]]
        return self._observed(self.agents), {agent: {} for agent in self.agents}

    def step(
        self, actions: Mapping[str, NDArray[np.float32]]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, object]],
    ]:
        """Run one iteration with these actions; agents without one stand.

        Raises InputError, which names the agent, for an action outside the action space, and for rewards that are not
        a number per robot.
        """
        simulation = self._run.simulation
        moment = simulation.act(self._perceived, self._intents(actions))
        try:
            rewards = array_of(self._reward(self._before, moment), moment.state.robots)
        except ValueError as problem:
            raise InputError(f"reward: {problem}; expected a number for each of {moment.state.robots} robots") from None
        self._before = moment.measured
        over, finished = simulation.over, simulation.finished
        if not over:
            self._perceived = simulation.perceive()
        alive = self._perceived.state.alive
        acted, robots = self.agents, self._robots
        ended = {agent: finished or not alive[robots[agent]] for agent in acted}
        cut = {agent: over and not ended[agent] for agent in acted}
        infos: dict[str, dict[str, object]] = {agent: {} for agent in acted}
        found = self._observed(acted)
        self.agents = [agent for agent in acted if not (ended[agent] or cut[agent])]
        return found, {agent: float(rewards[robots[agent]]) for agent in acted}, ended, cut, infos

    def _intents(self, actions: Mapping[str, NDArray[np.float32]]) -> Intents:
        simulation, robots = self._run.simulation, self._scenario.robots
        wanted = np.zeros((robots.count, 2))
        for agent, action in actions.items():
            if agent not in self._robots:
                raise InputError(f"actions: {agent!r} is no agent; {nearest(str(agent), self._robots)}")
            wanted[self._robots[agent]] = self._wanted(agent, action)
        if self._action == "goal":
            ways = {
                robot: np.stack([pose, pose + self._reach * wanted[robot]])
                for robot, pose in enumerate(self._perceived.senses.pose[:, :2])
                if robot in self._learners
            }
            fresh = np.zeros(robots.count, np.bool_)
            mine = Intents.along(ways, robots.count, fresh)
        else:
            speed, base = robots.each("speed"), robots.each("wheel_base")
            if self._action == "twist":
                twists = np.stack([wanted[:, 0] * speed, wanted[:, 1] * 2.0 * speed / base], axis=1)
            else:
                left, right = wanted.T * speed
                twists = np.stack([(left + right) / 2.0, (right - left) / base], axis=1)
            mine = Intents.twisting(twists)
        if len(self._learners) == robots.count:
            return mine
        seen = self._perceived
        theirs = simulation.parts.strategy.step(seen.senses, seen.inbox, seen.knowledge)
        others = np.ones(robots.count, np.bool_)
        others[self._learners] = False
        commands = Readings.filled(simulation.parts.actuator.channels, theirs.commands, others).named()
        return replace(_joined(mine, theirs, self._learners), commands=commands)

    def _wanted(self, agent: str, action: object) -> NDArray[np.float64]:
        """An action as two numbers from -1 to 1, clipped for rounding. Raises InputError for anything else."""
        try:
            given = array_of(action, 2)
        except ValueError as problem:
            raise InputError(f"actions[{agent!r}]: {problem}; expected two numbers from -1 to 1") from None
        if not (np.abs(given) <= 1.0 + ROUNDING).all():
            where = f"in iteration {self._perceived.state.iteration}"
            raise InputError(f"actions[{agent!r}]: {given.tolist()} {where}; expected two numbers from -1 to 1")
        return np.clip(given.astype(np.float64), -1.0, 1.0)

    def _observed(self, agents: Sequence[str]) -> dict[str, Observation]:
        return {agent: self._of(self._perceived, self._robots[agent]) for agent in agents}

    def _of(self, seen: Perceived, robot: int) -> Observation:
        tiles, inbox = seen.senses.readings.tiled, _of_tiles(seen.inbox)
        cell, lattice = self._run.context.lattice.cell, self._run.context.lattice
        shape = tiles.values.shape[1:]
        x, y, yaw = seen.senses.pose[robot]
        low, high = np.searchsorted(inbox.receivers, [robot, robot + 1])
        heard = slice(low, high)
        values, corners = getattr(inbox.content, "values", None), getattr(inbox.content, "origins", None)
        told, offsets = np.zeros((self._hears, *shape), np.uint8), np.zeros((self._hears, 2))
        count = 0
        if values is not None and corners is not None and high > low:
            middles = (corners[heard, ::-1] + np.array(shape[::-1]) / 2.0) * cell + (lattice.x0, lattice.y0)
            apart = middles - (x, y)
            nearest = np.argsort(np.hypot(apart[:, 0], apart[:, 1]), kind="stable")[: self._hears]
            count = len(nearest)
            told[:count], offsets[:count] = values[heard][nearest], apart[nearest]
        turned = (yaw + np.pi) % (2.0 * np.pi) - np.pi
        return {
            "tile": tiles.values[robot].copy(),
            "pose": np.clip([x, y, turned], self._pose.low, self._pose.high),
            "heard": np.array(count),
            "tiles": told,
            "offsets": np.clip(offsets, self._offsets.low, self._offsets.high),
            **observed(seen.senses.readings, self._observe, robot),
        }

    def render(self) -> None:
        """Does nothing: record the run and film it, see `run`."""

    def close(self) -> None:
        """Nothing is open."""


S = TypeVar("S", bound=np.generic)


def _of_tiles(inbox: Inbox[MessageBatch]) -> Inbox[MessageBatch]:
    """The received tiles, where groups send several kinds of messages."""
    content = inbox.content
    if not isinstance(content, Mixed):
        return inbox
    tiled = [kind for kind, table in content.tables.items() if {"values", "origins"} <= set(table.__match_args__)]
    return replace(inbox.take(content.kind == tiled[0]), content=content.of(tiled[0])) if tiled else inbox


def _joined(mine: Intents, theirs: Intents, learners: NDArray[np.int64]) -> Intents:
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
