"""How long work takes is told before it is done, and too long work is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT, called, made

from swarmsim.cli import waiting
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import budget
from swarmsim.core.scenario.file import load
from swarmsim.engine import survey

ROOM = ROOT / "scenarios" / "room.toml"


@pytest.fixture
def fresh() -> None:
    """No building of an earlier test is known: its survey would cost nothing."""
    survey.opened.cache_clear()
    survey.surveyed.cache_clear()


def test_estimates_grow_with_what_they_are_of_and_name_it() -> None:
    assert budget.survey(2000, 72, 5.0, 42).seconds == pytest.approx(2.0 * budget.survey(1000, 72, 5.0, 42).seconds)
    assert budget.survey(1000, 144, 5.0, 0).seconds == pytest.approx(2.0 * budget.survey(1000, 72, 5.0, 0).seconds)
    assert budget.running(10, 500, 72, 5.0).seconds == pytest.approx(10.0 * budget.running(1, 500, 72, 5.0).seconds)
    for work, number in (
        (budget.drawing(800_000, "plan.svg"), "800000 segments"),
        (budget.reading(64_000_000), "64000000 characters"),
        (budget.opening(25_000_000), "25000000 cells"),
        (budget.survey(12_000_000, 3000, 5.0, 42), "12000000 places along 3000 beams"),
        (budget.running(1000, 100_000, 72, 5.0), "1000 robots for up to 100000 iterations"),
    ):
        assert number in work.doing
        assert work.seconds > work.told


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.2, "1 s"), (12.3, "13 s"), (119.0, "120 s"), (121.0, "3 min"), (7199.0, "120 min"), (15_000.0, "5 h"),
     (86_400.0, "24 h"), (1e6, "12 days")],
)  # fmt: skip
def test_times_are_told_in_round_numbers(seconds: float, words: str) -> None:
    assert budget.lasting(seconds) == words


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            ["grid.cell=0.01", "sensor.beams=3000", "sensor.tile=[45, 45]", "budget=20"],
            r"grid.cell: looking from .* 3000 beams",
        ),
        (
            ["robots.count=10", "stop.iterations=100000", "sensor.beams=1000", "budget=60"],
            "stop.iterations: simulating 10 robots",
        ),
        (["grid.cell=0.0015", "budget=1"], "grid.cell: looking for floor in"),
    ],
)
def test_work_beyond_the_budget_is_refused_before_it_is_done(fresh: None, changes: list[str], told: str) -> None:
    with pytest.raises(InputError, match=rf"{told}.* takes about .*; expected .*, or budget = \d+ in the scenario"):
        made(*changes)


def test_a_budget_as_large_as_the_message_says_is_enough(fresh: None) -> None:
    changes = ["grid.cell=0.02", "sensor.tile=[21, 21]", "sensor.beams=720"]
    with pytest.raises(InputError, match=r"budget = 2 in") as refused:
        made(*changes, "budget=1")
    asked = str(refused.value).rpartition("budget = ")[2].split()[0]
    assert made(*changes, f"budget={asked}").explorable.any()


def test_a_survey_is_told_of_before_it_begins_and_then_how_far_it_is(
    fresh: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(survey, "MANY", 100)
    told: list[tuple[str, float]] = []
    with budget.told_to(lambda work, share: told.append((work.doing, share))):
        made()
    surveyed = [share for doing, share in told if doing.startswith("looking from 628 places along 72 beams")]
    assert surveyed == pytest.approx([i / 7 for i in range(8)])


def test_the_command_line_tells_how_long_it_may_be_unless_it_is_quiet(
    fresh: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(survey, "MANY", 100)
    monkeypatch.setattr(waiting, "EVERY", 0.0)
    monkeypatch.setattr(budget, "_CROSSED", 1e-4)  # a machine on which everything takes long
    words = ["run", ROOM, "--set", "stop.iterations=2", "--set", "seed=3"]
    loud = called(*words, "--out", tmp_path / "a")
    assert "notice: looking from 628 places along 72 beams: about " in loud.stderr
    assert "looking from 628 places along 72 beams: 43 %" in loud.stderr
    survey.surveyed.cache_clear()
    assert called(*words, "--out", tmp_path / "b", "--quiet").stderr == ""


def test_usual_work_is_not_worth_a_word(fresh: None, tmp_path: Path) -> None:
    assert called("run", ROOM, "--set", "stop.iterations=2", "--out", tmp_path / "a").stderr == ""


def test_drawings_are_within_the_budget_of_their_scenario() -> None:
    work = budget.drawing(800_000, "plan.svg")
    with budget.of(1.0), pytest.raises(InputError, match=r"plan\.svg: reading 800000 segments of paths takes about"):
        budget.begin(work)
    budget.begin(work)


def test_the_budget_is_a_key_that_changes_no_result() -> None:
    assert load(ROOM, ["budget=7200"]).budget == 7200.0
    with pytest.raises(InputError, match=r"budget: .*>= 1"):
        load(ROOM, ["budget=0"])
