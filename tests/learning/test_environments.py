"""Environments: the checks of PettingZoo and Gymnasium themselves, and that they are the same engine."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from conftest import ROOT
from gymnasium.utils.env_checker import check_env

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.learning import ACTIONS, RobotEnv, SwarmEnv
from swarmsim.learning.learned import joined
from swarmsim.recording.digests import Digests

with warnings.catch_warnings():  # it warns of its own environments when it is imported
    warnings.simplefilter("ignore")
    from pettingzoo.test import parallel_api_test, parallel_seed_test

ROOM = ROOT / "scenarios" / "room.toml"
DEATHS = {"faults": [{"use": "crash", "at": 3, "count": 1}, {"use": "remove", "at": 6, "count": 1}]}


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_pettingzoo_finds_nothing_wrong(action: str) -> None:
    parallel_api_test(SwarmEnv(ROOM, {**DEATHS, "stop.iterations": 30}, action=action), num_cycles=80)
    parallel_seed_test(lambda: SwarmEnv(ROOM, DEATHS, action=action), num_cycles=25)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_gymnasium_finds_nothing_wrong() -> None:
    check_env(RobotEnv(ROOM, {"stop.iterations": 40}), skip_render_check=True)


def still(env: SwarmEnv) -> dict[str, np.ndarray]:
    return {agent: np.zeros(2, np.float32) for agent in env.agents}


def test_who_dies_is_terminated_once_and_leaves() -> None:
    env = SwarmEnv(ROOM, DEATHS)
    env.reset(seed=1)
    left = [len(env.agents)]
    gone: list[str] = []
    for _ in range(8):
        _, rewards, ended, cut, _ = env.step(still(env))
        assert set(rewards) == set(ended) == set(cut)
        gone += [agent for agent, over in ended.items() if over]
        left.append(len(env.agents))
    assert left == [3, 3, 3, 2, 2, 2, 1, 1, 1]
    assert len(gone) == len(set(gone)) == 2
    assert not set(gone) & set(env.agents)


def test_agents_are_truncated_at_the_limit_and_terminated_when_the_task_is_done() -> None:
    env = SwarmEnv(ROOM, {"stop.iterations": 4})
    env.reset(seed=1)
    for _ in range(3):
        assert env.step(still(env))[2:4] == (dict.fromkeys(env.agents, False),) * 2
    _, _, ended, cut, _ = env.step(still(env))
    assert (set(ended.values()), set(cut.values()), env.agents) == ({False}, {True}, [])
    env = SwarmEnv(ROOM, {"task.share": 0.01})
    env.reset(seed=1)
    _, _, ended, cut, _ = env.step(still(env))
    assert (set(ended.values()), set(cut.values()), env.agents) == ({True}, {False}, [])


def test_observations_are_tile_pose_and_inbox_of_the_engine() -> None:
    two = {"network.topology.k": 2}
    env = SwarmEnv(ROOM, two, hears=2)
    observed, _ = env.reset(seed=5)
    inbox, seen = env.world.perceived.inbox, env.world.perceived.senses
    for robot, agent in enumerate(env.agents):
        mine = observed[agent]
        assert env.observation_space(agent).contains(mine)
        np.testing.assert_array_equal(mine["tile"], seen.readings.tiles.values[robot])
        np.testing.assert_allclose(mine["pose"], seen.pose[robot])
        senders = inbox.senders[inbox.receivers == robot]
        assert mine["heard"] == len(senders) == 2
        places = seen.pose[senders, :2] - seen.pose[robot, :2]
        order = np.argsort(np.hypot(*places.T))
        assert np.abs(mine["offsets"] - places[order]).max() <= 0.08  # half a cell
        np.testing.assert_array_equal(mine["tiles"], seen.readings.tiles.values[senders[order]])
    few, _ = SwarmEnv(ROOM, two, hears=1).reset(seed=5)
    assert few["robot_0"]["heard"] == 1
    np.testing.assert_array_equal(few["robot_0"]["tiles"][0], observed["robot_0"]["tiles"][0])


@pytest.mark.parametrize(("action", "wanted"), [("twist", (1.0, 0.0)), ("wheels", (1.0, 1.0)), ("goal", (0.0, 0.0))])
def test_actions_move_robots_as_they_say(action: str, wanted: tuple[float, float]) -> None:
    env = SwarmEnv(ROOT / "scenarios" / "worlds" / "warehouse.toml", action=action)
    env.reset(seed=2)
    before = env.run.simulation.state.pose.copy()
    for _ in range(3):
        env.step({agent: np.array(wanted, np.float32) for agent in env.agents})
    moved = env.run.simulation.state.pose - before
    along = moved[:, 0] * np.cos(before[:, 2]) + moved[:, 1] * np.sin(before[:, 2])
    if action == "goal":
        assert np.abs(moved[:, :2]).max() < 0.02
    else:
        assert np.median(along) == pytest.approx(3 * 0.15, abs=0.1)


def test_turning_wheels_and_twists_are_the_same() -> None:
    places = []
    for action, wanted in (("twist", (0.0, 1.0)), ("wheels", (-1.0, 1.0))):
        env = SwarmEnv(ROOM, action=action)
        env.reset(seed=1)
        env.step({agent: np.array(wanted, np.float32) for agent in env.agents})
        places.append(env.run.simulation.state.pose)
    np.testing.assert_allclose(places[0], places[1], atol=1e-9)


def test_rewards_are_gains_and_can_be_of_ones_own() -> None:
    env = SwarmEnv(ROOM)
    env.reset(seed=1)
    sums = sum(env.step(still(env))[1]["robot_0"] for _ in range(3))
    assert sums == pytest.approx(env.world.before.values["coverage"])
    env = SwarmEnv(ROOM, reward="own")
    env.reset(seed=1)
    _, rewards, *_ = env.step(still(env))
    np.testing.assert_allclose(list(rewards.values()), env.world.before.robots["covered"])
    env = SwarmEnv(ROOM, reward=lambda before, moment: -np.arange(3.0))
    env.reset(seed=1)
    assert list(env.step(still(env))[1].values()) == [0.0, -1.0, -2.0]


def test_the_others_follow_the_scenarios_own_strategy() -> None:
    """An environment without learners that act is the run itself: what a learner does not do, the strategy does."""
    env = RobotEnv(ROOM, robot=2)
    env.reset(seed=3)
    digests, plain = Digests(), Digests()
    run = build(load(ROOM, ["seed=3"]), str(ROOM)).simulation
    for _ in range(20):
        perceived = env.swarm.world.perceived
        theirs = env.swarm.run.simulation.parts.strategy.step(perceived.senses, perceived.inbox, perceived.knowledge)
        env.swarm.run.simulation.act(perceived, joined(theirs, theirs, np.array([2])), [digests])
        env.swarm.world.perceived = env.swarm.run.simulation.perceive()
        run.tick([plain])
    np.testing.assert_array_equal(env.swarm.run.simulation.state.pose, run.state.pose)


def test_one_group_learns_and_the_other_follows_its_own_strategy() -> None:
    pursuit = ROOT / "scenarios" / "operations" / "pursuit.toml"
    env = SwarmEnv(pursuit, {"seed": 3, "stop.iterations": 30}, learners=range(6))
    env.reset(seed=3)
    moved = False
    for _ in range(10):
        perceived = env.world.perceived
        theirs = env.run.simulation.parts.strategy.step(perceived.senses, perceived.inbox, perceived.knowledge)
        env.step(still(env))
        decided = env.run.simulation._decided
        np.testing.assert_array_equal(decided.twists[6:], theirs.twists[6:])
        np.testing.assert_array_equal(decided.twists[:6], 0.0)
        moved |= bool(decided.twists[6:].any())
    assert moved


def test_tiles_are_heard_of_a_group_that_says_them_alone() -> None:
    """The third robot says where it is: a message of another kind."""
    mind = {"computation": {"use": "positions"}, "strategy": {"use": "stand"}}
    table = {"robots": [{"count": 2}, {"count": 1, "mind": mind}], "network.topology": {"use": "full"}}
    env = SwarmEnv(ROOM, {**table, "task": {"use": "spacing", "apart": 9.0}})
    observed, _ = env.reset(seed=1)
    assert [int(one["heard"]) for one in observed.values()] == [1, 1, 2]
    assert observed["robot_0"]["tiles"][0].any()


def test_seeds_count_on_from_the_one_given() -> None:
    env = SwarmEnv(ROOM)
    first = [env.reset(seed=7 if number == 0 else None)[0]["robot_0"]["pose"] for number in range(3)]
    again = [SwarmEnv(ROOM).reset(seed=seed)[0]["robot_0"]["pose"] for seed in (7, 8, 9)]
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"action": "fly"}, "action: 'fly'; expected one of goal, twist, wheels"),
        ({"reward": "fame"}, "reward: 'fame'; expected one of progress, own, or a function"),
        ({"learners": [3]}, r"learners: \[3\]; expected some of 0 to 2"),
        ({"overrides": {"sensor.use": "none", "mind.use": "x"}}, "mind"),
    ],
)
def test_what_cannot_be_is_refused(keys: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        SwarmEnv(ROOM, **keys)


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([np.nan, 0.0], r"actions\['robot_1'\]: \[nan, 0\.0\] in iteration 0; expected two numbers from -1 to 1"),
        ([0.0, np.inf], r"actions\['robot_1'\]: \[0\.0, inf\] in iteration 0"),
        ([1.01, 0.0], r"actions\['robot_1'\]: \[1\.01, 0\.0\] in iteration 0"),
        (0.5, r"actions\['robot_1'\]: 0\.5, of shape \(\); expected two numbers"),
        ([0.0, 0.0, 0.0], r"actions\['robot_1'\]: \[0\.0, 0\.0, 0\.0\], of shape \(3,\)"),
        ("ab", r"actions\['robot_1'\]: 'ab'; expected"),
        (np.ma.zeros(2), r"actions\['robot_1'\]: a masked array"),
    ],
)
def test_actions_that_are_none_are_refused_by_agent(action: str, given: object, words: str) -> None:
    env = SwarmEnv(ROOM, action=action)
    env.reset(seed=1)
    with pytest.raises(InputError, match=words):
        env.step(still(env) | {"robot_1": given})
    env.step(still(env) | {"robot_1": np.array([1.0 + 1e-7, -1.0])})  # rounding is no mistake, and nothing has broken


def test_actions_of_nobody_and_rewards_that_are_none_are_refused() -> None:
    env = SwarmEnv(ROOM)
    env.reset(seed=1)
    with pytest.raises(InputError, match=r"actions: 'robot1' is no agent; did you mean 'robot_1'\?"):
        env.step({"robot1": np.zeros(2)})
    robot = RobotEnv(ROOM, robot=2)
    robot.reset(seed=1)
    with pytest.raises(InputError, match=r"actions\['robot_2'\]: \[nan, nan\]"):
        robot.step(np.full(2, np.nan, np.float32))
    env = SwarmEnv(ROOM, reward=lambda before, moment: 1.0)
    env.reset(seed=1)
    with pytest.raises(InputError, match=r"reward: 1\.0, of shape \(\); expected a number for each of 3 robots"):
        env.step(still(env))


def test_channels_of_sensors_are_observed_on_request_and_nothing_else_changes() -> None:
    near = {"sensors": [{"use": "neighbours", "reach": 9.0}, {"use": "bump"}], "sensor": {"use": "ir-ring"}}
    short = {"stop.iterations": 3}
    plain, more = SwarmEnv(ROOM, short), SwarmEnv(ROOM, {**short, **near}, observe=["neighbours", "bump"])
    names = ["neighbours", "neighbours_known", "bump", "bump_known"]
    first, second = plain.observation_space("robot_0"), more.observation_space("robot_0")
    assert set(second) - set(first) == set(names)
    assert all(second[name] == first[name] for name in first)
    ours, theirs = plain.reset(seed=1)[0]["robot_0"], more.reset(seed=1)[0]["robot_0"]
    for name, value in ours.items():
        assert np.array_equal(value, theirs[name])
    seen = 0
    while more.agents:
        observed, *_ = more.step({})
        for one in observed.values():
            assert second.contains(one)
            seen += int(one["neighbours_known"].any())
            assert not one["neighbours"][one["neighbours_known"] == 0].any()
    assert seen
    with pytest.raises(InputError, match=r"observe: .* no channel 'echo'; they have tiles, neighbours"):
        SwarmEnv(ROOM, near, observe=["echo"])
    with pytest.raises(InputError, match="observe: 'field' has no bounds; expected a channel that declares low"):
        SwarmEnv(ROOM, {"field": {"use": "formula", "formula": "x"}}, observe=["field"])


def test_lights_of_agents_rest_those_of_others_shine_and_agents_can_see_them() -> None:
    lights = ROOT / "scenarios" / "operations" / "lights.toml"
    see = {"use": "neighbours", "reach": 9.0, "most": 15, "sees": ["led"]}
    changes = {"stop.iterations": 4, "sensors": [see], "mind.strategy.first": [0, 1]}
    env = SwarmEnv(lights, changes, learners=[1, 2], observe=["neighbours_led"])
    env.reset(seed=1)
    for _ in range(3):
        observed, *_ = env.step(still(env))
    shines = env.world.perceived.state.actuators["led"].any(axis=1)
    assert np.flatnonzero(~shines).tolist() == [1, 2]
    seen = observed["robot_1"]["neighbours_led"]
    assert seen.shape == (15, 3)
    assert seen.any(axis=1).sum() == 14
    assert env.observation_space("robot_1").contains(observed["robot_1"])
    everybody = SwarmEnv(lights, changes)
    everybody.reset(seed=1)
    everybody.step(still(everybody))
    assert not everybody.world.perceived.state.actuators["led"].any()
