"""A scenario as a PettingZoo environment, in which some or all robots are agents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.own import array_of
from swarmsim.core.readings import Column
from swarmsim.engine.build import BuiltRun
from swarmsim.learning.learned import ROUNDING, LearnedRun, Learning

Observation = dict[str, Column]  # of one robot, by name
Infos = dict[str, dict[str, object]]


class SwarmEnv(ParallelEnv):  # type: ignore[misc]
    """A scenario in which robots are agents: `robot_0`, `robot_1` and so on.

    One step is one iteration. An agent observes its `tile` (rows, columns) of 0 unknown, 1 free and 2 occupied; its
    estimated `pose`, x and y in m and yaw in rad; and its `inbox`: how many others it `heard`, their `tiles` (hears,
    rows, columns) and the tiles' `offsets` (hears, 2) in m from itself. An agent whose robot dies is terminated and
    leaves `agents` for good; all are terminated when the task is done, and truncated at the scenario's limit. Other
    robots follow the scenario's strategy. Agents only drive: their actuators rest. `infos` have the task's measures.
    """

    metadata: dict[str, object] = {"name": "swarmsim_v0", "render_modes": []}  # noqa: RUF012 (PettingZoo's own)

    def __init__(
        self, scenario: str | Path, overrides: Mapping[str, object] | None = None, **learning: Unpack[Learning]
    ) -> None:
        """A scenario file, with overrides by dotted key, and what is learned, as in `Learning`.

        Raises InputError for an invalid scenario, or one whose robots sense no tiles.
        """
        self.world = LearnedRun(scenario, overrides, **learning)
        self._robots = {f"robot_{robot}": robot for robot in self.world.learners.tolist()}
        self._rows = {agent: row for row, agent in enumerate(self._robots)}
        self.possible_agents: list[str] = list(self._robots)
        self.agents: list[str] = []
        self._fresh = self.world.scenario.seed
        self._action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        #: Every robot's true pose (x, y in m, yaw in rad), its rates in m/s and rad/s, and whether it lives.
        self.state_space = spaces.Box(-np.inf, np.inf, (self.world.scenario.robots.count, 7), np.float64)

    @property
    def run(self) -> BuiltRun:
        """The current run; a new one after every `reset`."""
        return self.world.run

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same for all agents."""
        return self.world.space

    def action_space(self, agent: str) -> spaces.Space[Column]:
        """Two numbers from -1 to 1 for all agents."""
        return self._action_space

    def state(self) -> NDArray[np.float64]:
        """All robots' true states (robots, 7), for critics that may know more than agents: see `state_space`."""
        state = self.world.perceived.state
        return np.column_stack([state.pose, state.velocity, state.alive])

    def reset(
        self, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[dict[str, Observation], Infos]:
        """Restart the scenario, with this `seed` or, by default, the next one."""
        seed = self._fresh if seed is None else seed
        self._fresh = seed + 1
        self.world.begin(seed)
        self.agents = [agent for agent, alive in zip(self._robots, self.world.alive, strict=True) if alive]
        return self._observed(self.agents), {agent: {} for agent in self.agents}

    def step(
        self, actions: Mapping[str, NDArray[np.float32]]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Run one iteration with these actions; agents without one stand.

        Raises InputError, which names the agent, for an action outside the action space, for rewards that are not a
        number per robot, and before the first `reset`.
        """
        if not hasattr(self.world, "perceived"):
            raise InputError("step: nothing has begun; expected reset first")
        rewards = self.world.act(self._wanted(actions))
        simulation, acted = self.run.simulation, self.agents
        alive = dict(zip(self._robots, self.world.alive.tolist(), strict=True))
        ended = {agent: bool(simulation.finished or not alive[agent]) for agent in acted}
        cut = {agent: simulation.over and not ended[agent] for agent in acted}
        measures: dict[str, object] = {} if self.world.before is None else dict(self.world.before.values)
        found = self._observed(acted)
        self.agents = [agent for agent in acted if not (ended[agent] or cut[agent])]
        told = {agent: float(rewards[self._robots[agent]]) for agent in acted}
        return found, told, ended, cut, {agent: dict(measures) for agent in acted}

    def _wanted(self, actions: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float64]:
        """All robots' actions (robots, 2), from -1 to 1. Raises InputError for any other."""
        wanted = np.zeros((self.world.scenario.robots.count, 2))
        for agent in actions.keys() - self._robots.keys():
            raise InputError(f"actions: {agent!r} is no agent; {nearest(str(agent), self._robots)}")
        rows = [self._robots[agent] for agent in actions]
        plain = all(type(one) is np.ndarray and one.shape == (2,) and one.dtype.kind == "f" for one in actions.values())
        if rows and plain:
            wanted[rows] = [*actions.values()]
        if not plain or not (np.abs(wanted) <= 1.0 + ROUNDING).all():  # then one by one, to say whose is wrong
            wanted[rows] = [self._one(*action) for action in actions.items()]
        return np.clip(wanted, -1.0, 1.0)

    def _one(self, agent: str, action: object) -> NDArray[np.generic]:
        try:
            given = array_of(action, 2)
        except ValueError as problem:
            raise InputError(f"actions[{agent!r}]: {problem}; expected two numbers from -1 to 1") from None
        if not (np.abs(given) <= 1.0 + ROUNDING).all():
            where = f"in iteration {self.world.perceived.state.iteration}"
            raise InputError(f"actions[{agent!r}]: {given.tolist()} {where}; expected two numbers from -1 to 1")
        return given

    def _observed(self, agents: list[str]) -> dict[str, Observation]:
        arrays = self.world.observations()
        self.world.observe(arrays)
        return {agent: {name: column[self._rows[agent]] for name, column in arrays.items()} for agent in agents}

    def render(self) -> None:
        """Does nothing: record the run and film it, see `run`."""

    def close(self) -> None:
        """Nothing is open."""
