"""Iterations per second of the learning environment beside those of the bare engine, in turns."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from swarmsim.core.scenario.file import load
from swarmsim.core.state import Intents
from swarmsim.engine.build import build
from swarmsim.learning import SwarmEnv, vector_env

SCENARIO = Path(__file__).parents[1] / "scenarios" / "basilica.toml"
WANDERING = SCENARIO.parent / "operations" / "wandering.toml"
STEPS, ROUNDS = 200, 5


@pytest.mark.bench
def test_an_environment_costs_observations_only() -> None:
    env = SwarmEnv(SCENARIO)
    action = np.array([0.0, 0.5], np.float32)
    robots = load(SCENARIO).robots
    twists = np.tile([0.0, robots.speed / robots.wheel_base], (robots.count, 1))
    seconds: dict[str, list[float]] = {"environment": [], "engine": []}
    for _ in range(ROUNDS + 1):
        env.reset(seed=1)
        begun = time.process_time()
        for _ in range(STEPS):
            env.step(dict.fromkeys(env.agents, action))
        seconds["environment"].append(time.process_time() - begun)
        simulation = build(load(SCENARIO), str(SCENARIO)).simulation
        begun = time.process_time()
        for _ in range(STEPS):
            simulation.act(simulation.perceive(), Intents.twisting(twists))
        seconds["engine"].append(time.process_time() - begun)
    for name, taken in seconds.items():
        print(f"{name}, 15 robots: {STEPS / np.median(taken[1:]):.0f} iterations/s of one core")
    ratio = np.median(seconds["environment"][1:]) / np.median(seconds["engine"][1:])
    print(f"environment / engine: {ratio:.1f}")
    assert ratio > 1.0


@pytest.mark.bench
def test_many_worlds_cost_little_more_than_the_engine() -> None:
    """64 worlds of 20 reactive robots, beside 64 simulations whose robots are told the same."""
    keys = {"task.distance": 1e6, "stop.iterations": 100_000, "network.topology": {"use": "none"}}
    worlds = vector_env(WANDERING, keys, worlds=64)
    worlds.reset(seed=1)
    robots = worlds.worlds[0].scenario.robots
    twists = np.tile([0.5 * robots.speed, 0.5 * robots.speed / robots.wheel_base], (robots.count, 1))
    bare = [build(load(WANDERING, changes={**keys, "seed": seed}), str(WANDERING)).simulation for seed in range(1, 65)]
    actions = np.tile(np.array([0.5, 0.25], np.float32), (64, robots.count, 1))
    shares = []
    for _ in range(ROUNDS + 1):
        begun = time.process_time()
        for _ in range(10):
            worlds.step(actions)
        stepped = time.process_time() - begun
        begun = time.process_time()
        for _ in range(10):
            for simulation in bare:
                simulation.act(simulation.perceive(), Intents.twisting(twists))
        shares.append((time.process_time() - begun) / stepped)
    for one, world in zip(bare, worlds.worlds, strict=True):
        np.testing.assert_array_equal(one.state.pose, world.run.simulation.state.pose)
    rate = 640 * robots.count / stepped
    print(f"64 worlds of {robots.count}: {rate:.0f} robot-steps/s; of the engine's rate: {np.median(shares[1:]):.2f}")
