"""Many worlds at once are what each of them is alone."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from conftest import ROOT
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import swarmsim as sw
from swarmsim.core.errors import InputError
from swarmsim.learning import SwarmEnv, WorldsEnv, vector_env

ROOM = ROOT / "scenarios" / "room.toml"
DEATHS = {"faults": [{"use": "crash", "at": 3, "count": 1}, {"use": "remove", "at": 6, "count": 1}]}
SEEN = {
    **DEATHS, "stop.iterations": 12, "network.topology.k": 2,
    "sensors": [{"use": "neighbours", "reach": 9.0}, {"use": "bump"}], "sensor": {"use": "ir-ring"},
}  # fmt: skip


def chosen(random: np.random.Generator, *shape: int) -> np.ndarray:
    return random.uniform(-1.0, 1.0, (*shape, 2)).astype(np.float32)


@pytest.mark.parametrize("action", ["twist", "goal"])
@pytest.mark.parametrize("learners", [[0, 1, 2], [2, 0]])
def test_a_world_among_many_is_the_swarm_alone(action: str, learners: list[int]) -> None:
    """Also those that begin again, with the next seeds of three worlds in turns."""
    keys = {"action": action, "learners": learners, "hears": 1, "reward": "own", "observe": ["neighbours", "bump"]}
    many = vector_env(ROOM, SEEN, worlds=3, **keys)
    alone = [SwarmEnv(ROOM, SEEN, **keys) for _ in range(3)]
    seen, told = many.reset(seed=4)
    single = [env.reset(seed=4 + world)[0] for world, env in enumerate(alone)]
    over, begun, random = [False] * 3, [0] * 3, np.random.default_rng(7)
    for _ in range(30):
        for world, (env, observed) in enumerate(zip(alone, single, strict=True)):
            for row, robot in enumerate(learners):
                assert over[world] or told["alive"][world, row] == (f"robot_{robot}" in env.agents)
                for name, value in observed.get(f"robot_{robot}", {}).items():
                    np.testing.assert_array_equal(seen[name][world, row], value)
        wanted = chosen(random, 3, len(learners))
        seen, rewards, ended, cut, told = many.step(wanted)
        for world, env in enumerate(alone):
            if over[world]:
                begun[world] += 1
                single[world] = env.reset(seed=4 + world + 3 * begun[world])[0]
                assert (rewards[world], ended[world], cut[world], told["_rewards"][world]) == (0.0, False, False, False)
                over[world] = False
                continue
            acts = {f"robot_{robot}": wanted[world, row] for row, robot in enumerate(learners)}
            single[world], gains, _, limit, infos = env.step(acts)
            for row, robot in enumerate(learners):
                if f"robot_{robot}" in gains:
                    assert told["rewards"][world, row] == gains[f"robot_{robot}"]
            for one in infos.values():
                assert one["coverage"] == told["coverage"][world]
            over[world] = not env.agents
            assert (ended[world] or cut[world]) == over[world]
            assert cut[world] == any(limit.values())
            single[world] = {} if over[world] else {agent: single[world][agent] for agent in env.agents}
    assert sum(begun) >= 3


def test_gymnasium_makes_and_wraps_it() -> None:
    many = gymnasium.make_vec("swarmsim/Worlds-v0", num_envs=2, scenario=ROOM, overrides={"stop.iterations": 4})
    assert isinstance(many.unwrapped, WorldsEnv)
    assert many.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    wrapped = RecordEpisodeStatistics(many)
    seen, _ = wrapped.reset(seed=1)
    assert many.observation_space.contains(seen)
    lengths = []
    many.action_space.seed(1)
    for _ in range(11):
        seen, rewards, _, cut, infos = wrapped.step(many.action_space.sample())
        assert many.observation_space.contains(seen)
        assert rewards.shape == (2,)
        lengths += infos["episode"]["l"].tolist() if cut.any() else []
    assert lengths == [4, 4, 4, 4]
    robot = gymnasium.make("swarmsim/Robot-v0", scenario=ROOM, robot=1)
    assert robot.reset(seed=1)[0].keys() == robot.observation_space.keys()
    assert sw.vector_env(ROOM, worlds=1).num_envs == 1


def test_same_seeds_and_actions_give_the_same_bytes() -> None:
    def course(many: WorldsEnv) -> list[np.ndarray]:
        random, found = np.random.default_rng(3), [many.reset(seed=[9, None])[0]["pose"]]
        found += [many.step(chosen(random, 2, 3))[0]["pose"] for _ in range(15)]
        return found

    once, again = (course(vector_env(ROOM, {"seed": 5, "stop.iterations": 6}, worlds=2)) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    alone = SwarmEnv(ROOM)
    for world, seed in enumerate((9, 6)):
        np.testing.assert_array_equal(once[0][world], [one["pose"] for one in alone.reset(seed=seed)[0].values()])


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="num_envs: 0; expected 1 world or more"):
        vector_env(ROOM, worlds=0)
    many = vector_env(ROOM, worlds=2, learners=[2, 1])
    with pytest.raises(InputError, match="step: nothing has begun; expected reset first"):
        many.step(np.zeros((2, 2, 2)))
    with pytest.raises(InputError, match="seed: 3 for 2 worlds; expected one for each, or one number"):
        many.reset(seed=[1, 2, 3])
    many.reset(seed=1)
    with pytest.raises(InputError, match=r"actions: .* shape \(2, 3, 2\); expected 2 x 2 x 2 numbers"):
        many.step(np.zeros((2, 3, 2)))
    for wrong in (np.nan, np.inf, 1.01):
        given = np.zeros((2, 2, 2))
        given[1, 0, 1] = wrong
        with pytest.raises(InputError, match=rf"actions\[1, 0\]: \[0\.0, {wrong}\] for robot 2; expected two numbers"):
            many.step(given)
    many.step(np.full((2, 2, 2), 1.0 + 1e-7))
    with pytest.raises(InputError, match="step: nothing has begun; expected reset first"):
        SwarmEnv(ROOM).step({})


def test_critics_may_see_the_true_state() -> None:
    env = SwarmEnv(ROOM, DEATHS)
    env.reset(seed=1)
    for _ in range(5):
        env.step({})
    state = env.state()
    assert env.state_space.contains(state)
    np.testing.assert_array_equal(state[:, :3], env.run.simulation.state.pose)
    assert state[:, 6].tolist() == env.run.simulation.state.alive.tolist()
    assert not state[:, 6].all()
