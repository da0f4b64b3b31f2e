"""The calibrations' rules: of all candidates the nearest to published numbers; and what numbers left out say."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.studies.calibration import (
    Candidate,
    candidates,
    head,
    held,
    left_out,
    left_out_lines,
    lines,
    opened,
    prediction_error,
)
from swarmsim.studies.paper import open_paper
from swarmsim.studies.plan import open_study
from swarmsim.studies.store import Row, Store

PAPER = open_paper(ROOT / "papers" / "kit2018")
READINGS = {reading.name: reading for reading in PAPER.read()}
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
        return candidates(plan, store, held(PAPER, READINGS["arrival"], plan))


def test_the_best_has_the_lowest_root_mean_square_of_both_log_ratios(ranked) -> None:
    assert [candidate.choice for candidate in ranked] == [
        {"mind.strategy.ties": "own-order"},
        {"mind.strategy.ties": "row-order"},
    ]
    assert ranked[0].means == {"15, knn 1": 650.0, "15, knn 5": 310.0}
    expected = math.sqrt((math.log(650 / 583) ** 2 + math.log(310 / 303) ** 2) / 2)
    assert ranked[0].error() == pytest.approx(expected)


def test_a_candidate_with_an_unfinished_run_is_never_the_best(ranked) -> None:
    assert math.isinf(ranked[1].error())
    assert lines(ranked)[1] == ("row-order", "585", "not finished", "inf")
    assert head(ranked) == ("ties", "15, knn 1 (583)", "15, knn 5 (303)", "rms log-ratio")


@pytest.mark.thorough
@pytest.mark.parametrize("reading", READINGS.values(), ids=READINGS)
def test_what_a_reading_chose_is_one_candidate_of_its_search_which_has_other_seeds(reading) -> None:
    plan = opened(PAPER, reading)
    assert min(plan.seeds) > 1000
    chosen = next(one for one in PAPER.plans(reading, 1)["network"].conditions if one.name == "1NN").scenario
    same = [
        condition for condition in plan.conditions
        if condition.scenario.world.scale == chosen.world.scale and condition.scenario.robots == chosen.robots
        and condition.scenario.mind == chosen.mind and condition.scenario.network == chosen.network
    ]  # fmt: skip
    assert len(same) == 1


@pytest.mark.thorough
def test_every_published_number_has_a_place_in_the_search_by_the_letter() -> None:
    numbers = held(PAPER, READINGS["letter"], opened(PAPER, READINGS["letter"]))
    assert len(set(numbers.row_of.values())) == 14
    assert {numbers.published[row] for row in numbers.row_of.values()} == {one.value for one in PAPER.published}


def test_a_search_for_what_was_not_published_is_refused(tmp_path: Path, root: Path) -> None:
    path = tmp_path / "nine.toml"
    path.write_text(STUDY.format(scenario=root / "scenarios" / "kit2018.toml").replace("[1, 5]", "[1, 9]"))
    with pytest.raises(InputError, match=r"nine\.toml: .*k=9: no published number has its values of robots\.count"):
        held(PAPER, READINGS["arrival"], open_study(path))


def test_a_number_left_out_is_predicted_by_the_candidate_that_is_best_without_it() -> None:
    rows = [f"{n}, knn 1" for n in (5, 10, 15)]
    numbers = dict(zip(rows, (100.0, 200.0, 300.0), strict=True))
    first = Candidate({"key": 1}, dict(zip(rows, (100.0, 200.0, 450.0), strict=True)), numbers)
    second = Candidate({"key": 2}, dict(zip(rows, (130.0, 200.0, 300.0), strict=True)), numbers)
    found = left_out([second, first])
    assert [line.predicted for line in found] == [130.0, 200.0, 450.0]  # each time by the one that errs just there
    assert prediction_error(found) == pytest.approx(math.sqrt((math.log(1.3) ** 2 + math.log(1.5) ** 2) / 3))
    assert left_out_lines(found)[2] == ("15, knn 1", "300", "450", "1.50", "1")
