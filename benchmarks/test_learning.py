"""Iterations per second of the learning environment beside those of the bare engine, in turns."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from swarmsim.core.scenario.file import load
from swarmsim.core.state import Intents
from swarmsim.engine.build import build
from swarmsim.learning import SwarmEnv

SCENARIO = Path(__file__).parents[1] / "scenarios" / "basilica.toml"
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
