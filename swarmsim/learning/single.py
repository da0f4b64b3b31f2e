"""One robot of a scenario as a Gymnasium environment; all others follow the scenario's strategy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Unpack

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swarmsim.learning.environment import Observation, SwarmEnv
from swarmsim.learning.learned import Learning


class RobotEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """The environment of `SwarmEnv` for one robot: the same observations, actions and rewards."""

    metadata: dict[str, object] = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own)

    def __init__(
        self,
        scenario: str | Path,
        overrides: Mapping[str, object] | None = None,
        *,
        robot: int = 0,
        **learning: Unpack[Learning],
    ) -> None:
        """As for `SwarmEnv`; `robot` is the learner, and its own gain the reward by default. Raises InputError."""
        keys: Learning = {"reward": "own", **learning, "learners": [robot]}
        self.swarm = SwarmEnv(scenario, overrides, **keys)
        (self._agent,) = self.swarm.possible_agents
        self.observation_space = self.swarm.observation_space(self._agent)
        self.action_space = self.swarm.action_space(self._agent)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[Observation, dict[str, object]]:
        """Restart the scenario, as `SwarmEnv.reset`."""
        super().reset(seed=seed)
        observed, infos = self.swarm.reset(seed, options)
        return observed[self._agent], infos[self._agent]

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, object]]:
        """Run one iteration of the whole swarm. Raises InputError for an action outside the action space."""
        observed, rewards, ended, cut, infos = self.swarm.step({self._agent: action})
        agent = self._agent
        return observed[agent], rewards[agent], ended[agent], cut[agent], infos[agent]
