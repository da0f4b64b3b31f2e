"""Many worlds of one scenario as a Gymnasium vector environment: arrays of worlds and robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.own import array_of
from swarmsim.core.readings import Column
from swarmsim.learning.learned import ROUNDING, LearnedRun, Learning, Observations

Infos = dict[str, Column]


class WorldsEnv(VectorEnv[Observations, NDArray[np.float32], Column]):
    """Independent worlds of one scenario, each with its own seed, in which all learners of a world act at once.

    Observations are those of `SwarmEnv`, as arrays (worlds, learners, ...) by name; actions are (worlds, learners, 2).
    A world's reward is the mean of its learners', whose own are `infos["rewards"]` (worlds, learners); `infos["alive"]`
    (worlds, learners) tells who lives, and the task's measures are (worlds,) each. The dead observe nothing, and what
    they are told to do does nothing. A world is terminated when its task is done or no learner lives, and truncated at
    the scenario's limit; the next step begins it again with a new seed, as Gymnasium's NEXT_STEP.
    """

    metadata: dict[str, object] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 (Gymnasium's own)

    def __init__(
        self,
        scenario: str | Path,
        overrides: Mapping[str, object] | None = None,
        *,
        num_envs: int = 1,
        **learning: Unpack[Learning],
    ) -> None:
        """`num_envs` worlds of a scenario, with overrides by dotted key, and what is learned, as in `Learning`.

        Raises InputError for an invalid scenario, one whose robots sense no tiles, and no world.
        """
        if num_envs < 1:
            raise InputError(f"num_envs: {num_envs}; expected 1 world or more")
        self.num_envs = num_envs
        self.worlds = [LearnedRun(scenario, overrides, **learning) for _ in range(num_envs)]
        first = self.worlds[0]
        self._learners = len(first.learners)
        self.single_observation_space = spaces.Dict(
            {name: _of_all(space, self._learners) for name, space in first.space.items()}
        )
        self.single_action_space = spaces.Box(-1.0, 1.0, (self._learners, 2), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeds = first.scenario.seed + np.arange(num_envs)
        self._over = np.zeros(num_envs, np.bool_)
        self._begun = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, object] | None = None
    ) -> tuple[Observations, Infos]:
        """Begin all worlds again: with seeds from `seed` on, or one for each; by default with those that come next.

        With options={"reset_mask": (worlds,)} only these.
        """
        mask = np.ones(self.num_envs, np.bool_) if options is None else np.asarray(options.get("reset_mask", True))
        if isinstance(seed, int | np.integer):
            self._seeds = int(seed) + np.arange(self.num_envs)
        elif seed is not None:
            if len(seed) != self.num_envs:
                raise InputError(f"seed: {len(seed)} for {self.num_envs} worlds; expected one for each, or one number")
            self._seeds = np.array([old if new is None else new for old, new in zip(self._seeds, seed, strict=True)])
        for world in np.flatnonzero(np.broadcast_to(mask, self.num_envs)).tolist():
            self._begin(world)
        self._begun = True
        return self._observed(), {"alive": self._alive(), "_alive": np.ones(self.num_envs, np.bool_)}

    def _begin(self, world: int) -> None:
        """Begin a world again; its seeds are those of all worlds, in turns."""
        self.worlds[world].begin(int(self._seeds[world]))
        self._seeds[world] += self.num_envs
        self._over[world] = False

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observations, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Infos]:
        """Run one iteration of each world, and begin those again that were over, with reward 0.

        Raises InputError for actions that are no numbers from -1 to 1, and before the first `reset`.
        """
        if not self._begun:
            raise InputError("step: nothing has begun; expected reset first")
        wanted, count = self._wanted(actions), self.num_envs
        rewards, goes_on = np.zeros((count, self._learners)), ~self._over
        ended, cut = np.zeros((2, count), np.bool_)
        measures: dict[str, NDArray[np.float64]] = {}
        for number, world in enumerate(self.worlds):
            if not goes_on[number]:
                self._begin(number)
                continue
            all_robots = np.zeros((world.scenario.robots.count, 2))
            all_robots[world.learners] = wanted[number]
            rewards[number] = world.act(all_robots)[world.learners]
            simulation = world.run.simulation
            ended[number] = simulation.finished or not world.alive.any()
            cut[number] = simulation.over and not ended[number]
            for name, value in world.before.values.items() if world.before else ():
                measures.setdefault(name, np.zeros(count))[number] = value
        self._over = ended | cut
        told = {"alive": self._alive(), "rewards": rewards, **measures}
        infos = {key: value for name, column in told.items() for key, value in ((name, column), (f"_{name}", goes_on))}
        return self._observed(), rewards.mean(axis=1), ended, cut, infos

    def _wanted(self, actions: object) -> NDArray[np.float64]:
        try:
            given = array_of(actions, self.num_envs, self._learners, 2)
        except ValueError as problem:
            raise InputError(f"actions: {problem}; expected {self.num_envs} x {self._learners} x 2 numbers") from None
        wrong = np.argwhere(~(np.abs(given) <= 1.0 + ROUNDING).all(axis=2))
        if len(wrong):
            world, row = wrong[0].tolist()
            robot = self.worlds[world].learners[row]
            raise InputError(
                f"actions[{world}, {row}]: {given[world, row].tolist()} for robot {robot}; "
                "expected two numbers from -1 to 1"
            )
        return np.clip(given.astype(np.float64), -1.0, 1.0)

    def _observed(self) -> Observations:
        arrays = self.worlds[0].observations(self.num_envs)
        for number, world in enumerate(self.worlds):
            world.observe({name: column[number] for name, column in arrays.items()})
        return arrays

    def _alive(self) -> NDArray[np.bool_]:
        return np.stack([world.alive for world in self.worlds])


def _of_all(space: spaces.Space[Column], learners: int) -> spaces.Space[Column]:
    """One robot's space, for all learners of a world."""
    if isinstance(space, spaces.Discrete):
        return spaces.MultiDiscrete(np.full(learners, space.n))
    return batch_space(space, learners)


def vector_env(
    scenario: str | Path, overrides: Mapping[str, object] | None = None, *, worlds: int, **learning: Unpack[Learning]
) -> WorldsEnv:
    """Independent worlds of one scenario as a Gymnasium vector environment: see `swarmsim.learning.WorldsEnv`.

    `scenario` is a file or a shipped name, with `overrides` by dotted key. There are so many `worlds` of it; `learning`
    says what is learned, as in `swarmsim.learning.learned.Learning`. Raises InputError for an invalid scenario, one
    whose robots sense no tiles, and no world.
    """
    return WorldsEnv(scenario, overrides, num_envs=worlds, **learning)


gymnasium.register("swarmsim/Robot-v0", entry_point="swarmsim.learning:RobotEnv")
gymnasium.register("swarmsim/Worlds-v0", vector_entry_point="swarmsim.learning:WorldsEnv")
