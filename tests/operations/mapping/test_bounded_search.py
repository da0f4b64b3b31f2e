"""Robots whose searches settle only so many cells in an iteration, so that a small computer keeps its period."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import BuiltRun, build
from swarmsim.recording.digests import Digests
from swarmsim.testing import check_apart, check_locality

OFFICE = ROOT / "scenarios" / "room.toml"


def run_with(bound: int | None, *keys: str) -> BuiltRun:
    bounded = [] if bound is None else [f"mind.strategy.search={bound}"]
    return build(load(OFFICE, [*bounded, *keys]), str(OFFICE))


def test_robots_that_search_for_several_iterations_stand_meanwhile_and_explore_everything() -> None:
    run = run_with(9)
    works, stood = run.simulation.parts.strategy._scratches, 0
    while not run.simulation.over:
        moment = run.simulation.tick([])
        assert all(0 <= work.left[0] <= 9 for work in works)
        searching = np.array([work.paused[0] > 0 for work in works])
        assert (moment.intents.counts[searching] == 0).all()
        stood += searching.sum()
    assert run.simulation.finished
    assert stood > 20


def test_a_bound_that_is_never_reached_costs_no_time() -> None:
    run = run_with(10**6)
    run.simulation.run([])
    assert run.simulation.finished
    assert not any(work.paused[0] for work in run.simulation.parts.strategy._scratches)
    assert run.simulation.state.iteration < 1.3 * _iterations_without()


def _iterations_without() -> int:
    run = run_with(None)
    run.simulation.run([])
    return run.simulation.state.iteration


def test_runs_are_repeated_and_robots_are_the_same_alone() -> None:
    rows = []
    for _ in range(2):
        observer = Digests()
        run_with(9, "stop.iterations=40").simulation.run([observer])
        rows.append(observer.rows)
    assert rows[0] == rows[1]
    check_apart(OFFICE, ["mind.strategy.search=9"], 40)
    check_locality(OFFICE, ["mind.strategy.search=9"], 20)


def test_robots_that_patrol_are_not_bounded() -> None:
    with pytest.raises(InputError, match=r"mind\.strategy\.search: robots that patrol search all that they can reach"):
        run_with(9, 'mind.strategy.idle="patrol"')
