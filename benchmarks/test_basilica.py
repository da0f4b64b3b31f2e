"""How fast, how lean and how close to bare physics the main job runs: 15 robots map the basilica."""

from __future__ import annotations

import resource
import time
from pathlib import Path

import pytest

from swarmsim.core.scenario import load
from swarmsim.engine.build import build

SCENARIO = Path(__file__).parent.parent / "scenarios" / "basilica.toml"


@pytest.mark.bench
def test_the_basilica_runs_500_times_faster_than_real_time() -> None:
    build(load(SCENARIO, ["stop.iterations=20"]), str(SCENARIO)).simulation.run()  # compiles, fills caches
    made = build(load(SCENARIO), str(SCENARIO))
    simulation, space = made.simulation, made.simulation.parts.bodies.space
    inside = 0.0
    step = space.step

    def timed(dt: float) -> None:
        nonlocal inside
        begun = time.perf_counter()
        step(dt)
        inside += time.perf_counter() - begun

    space.step = timed
    begun = time.perf_counter()
    finished = simulation.run()
    total = time.perf_counter() - begun
    simulated = simulation.state.iteration * made.scenario.period
    print(
        f"\n{made.scenario.robots.count} robots, {simulation.state.iteration} iterations in {total:.3f} s: "
        f"{simulated / total:.0f} times real time, {1e3 * total / simulation.state.iteration:.2f} ms an iteration"
        f"\ntotal / Space.step = {total:.3f} s / {inside:.3f} s = {total / inside:.2f}"
        f"\npeak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"
    )
    assert finished
    assert simulated / total >= 500
    assert total / inside <= 6
