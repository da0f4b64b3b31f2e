"""The calibration's rule: of all candidates the nearest to two published numbers."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from swarmsim.studies.calibration import candidates, head, lines
from swarmsim.studies.plan import open_study
from swarmsim.studies.reproduction import calibration_plan
from swarmsim.studies.store import Row, Store

STUDY = """
title = "Two candidates"
scenario = "{scenario}"
seeds = [7, 8]
keep = "summary"

[[vary]]
key = "mind.strategy.ties"
values = ["own-order", "row-order"]

[[vary]]
key = "network.topology.k"
values = [1, 5]
"""
TIMES = {("own-order", 1): (600, 700), ("own-order", 5): (300, 320), ("row-order", 1): (580, 590)}


@pytest.fixture
def ranked(tmp_path: Path, root: Path):
    path = tmp_path / "two.toml"
    path.write_text(STUDY.format(scenario=root / "scenarios" / "kit2018.toml"))
    plan = open_study(path)
    with Store(tmp_path / "two.sqlite") as store:
        for condition, seed in plan.runs:
            change = condition.changes
            times = TIMES.get((change["mind.strategy.ties"], change["network.topology.k"]), (303, None))
            took = times[seed - 7]
            status = "not finished" if took is None else "finished"
            identity = plan.identity(condition, seed)
            row = Row(identity, condition.name, seed, status, took or 5000, {}, None, None, {}, 0.0, None)
            store.add(row)
        return candidates(plan, store)


def test_the_best_has_the_lowest_root_mean_square_of_both_log_ratios(ranked) -> None:
    assert [candidate.choice for candidate in ranked] == [
        {"mind.strategy.ties": "own-order"},
        {"mind.strategy.ties": "row-order"},
    ]
    assert ranked[0].means == {1: 650.0, 5: 310.0}
    expected = math.sqrt((math.log(650 / 583) ** 2 + math.log(310 / 303) ** 2) / 2)
    assert ranked[0].error == pytest.approx(expected)


def test_a_candidate_with_an_unfinished_run_is_never_the_best(ranked) -> None:
    assert math.isinf(ranked[1].error)
    assert lines(ranked)[1] == ("row-order", "585", "not finished", "inf")
    assert head(ranked) == ("ties", "1NN (583)", "5NN (303)", "rms log-ratio")


def test_the_shipped_search_has_other_seeds_than_the_reproduction_and_holds_what_was_chosen(root: Path) -> None:
    plan = calibration_plan()
    assert min(plan.seeds) > 1000
    base = open_study(root / "scenarios" / "studies" / "kit2018" / "network.toml", 1)
    chosen = next(condition for condition in base.conditions if condition.name == "1NN").scenario
    same = [
        condition for condition in plan.conditions
        if condition.scenario.world.scale == chosen.world.scale and condition.scenario.robots == chosen.robots
        and condition.scenario.mind == chosen.mind and condition.scenario.network == chosen.network
    ]  # fmt: skip
    assert len(same) == 1
