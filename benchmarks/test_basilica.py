"""Speed and time shares of the main job: 15 robots map the basilica."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Figures
from pymunk._chipmunk_cffi import lib

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import BuiltRun, build

SCENARIO = ROOT / "scenarios" / "basilica.toml"
TURNS = 5
GROUP = "The basilica, 15 robots, to 100 %"
#: The calls of an iteration, by purpose.
CALLS = {
    "physics and wheels": ("bodies.drive", "bodies.state", "motion.follow"),
    "beams": ("sensor.sense", "localisation.locate"),
    "network": ("topology.links", "channel.deliver"),
    "mapping": ("computation.say", "computation.hear"),
    "frontiers and paths": ("strategy.step",),
    "coverage": ("task.measure",),
}


def opened() -> BuiltRun:
    return build(load(SCENARIO), str(SCENARIO))


def faster(run: BuiltRun, seconds: float) -> float:
    assert run.simulation.finished
    return run.simulation.state.iteration * run.scenario.period / seconds


@pytest.mark.bench
def test_times_real_time(tmp_path: Path, figures: Figures) -> None:
    opened().simulation.run()  # compiles, fills caches
    plain, recorded = [], []
    for turn in range(TURNS):
        run = opened()
        begun = time.process_time()
        run.simulation.run()
        plain.append(faster(run, time.process_time() - begun))
        run = opened()
        begun = time.process_time()
        with run.recorder(tmp_path / f"{turn}.h5") as recorder:
            run.simulation.run([recorder])
        recorded.append(faster(run, time.process_time() - begun))
    figures.add(GROUP, "times real time, without recording", np.median(plain), "", "2500")
    figures.add(GROUP, "times real time, with recording", np.median(recorded), "", "2000")


@pytest.mark.bench
def test_where_the_time_goes(figures: Figures) -> None:
    run, spent = opened(), Counter[str]()

    def timed(call: Callable[..., Any], name: str) -> Callable[..., Any]:
        def timing(*given: Any) -> Any:
            begun = time.perf_counter()
            found = call(*given)
            spent[name] += time.perf_counter() - begun
            return found

        return timing

    for name, places in CALLS.items():
        for place in places:
            seam, verb = place.split(".")
            part = getattr(run.simulation.parts, seam)
            setattr(part, verb, timed(getattr(part, verb), name))
    begun = time.perf_counter()
    assert run.simulation.run()
    whole = time.perf_counter() - begun
    for name in CALLS:
        figures.add(GROUP, f"share of time: {name}", 100 * spent[name] / whole, "%")
    figures.add(GROUP, "share of time: between parts, in Python", 100 * (1 - sum(spent.values()) / whole), "%")


class Asked:
    """A motion like a third-party one: called at every sub-step, so that each call can be timed."""

    def __init__(self, inner: Any) -> None:
        self.follow, self.command = inner.follow, inner.command


@pytest.mark.bench
def test_time_over_that_of_the_physics_engine(figures: Figures) -> None:
    from dataclasses import replace

    ratios = []
    for _ in range(TURNS):
        run = opened()
        begun = time.perf_counter()
        run.simulation.run()
        whole = time.perf_counter() - begun
        run, inside = opened(), 0.0
        parts = run.simulation.parts
        space = parts.bodies.space._space

        def step(dt: float, space: Any = space) -> None:
            nonlocal inside
            begun = time.perf_counter()
            lib.cpSpaceStep(space, dt)
            inside += time.perf_counter() - begun

        parts.bodies.space.step = step
        run.simulation.parts = replace(parts, motion=Asked(parts.motion))
        run.simulation.run()
        ratios.append(whole / inside)
    figures.add(GROUP, "whole run over time inside Chipmunk's cpSpaceStep", np.median(ratios))
