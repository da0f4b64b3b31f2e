"""Races for the best condition: against known survival curves, with unfinished runs, other limits and periods."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, called
from scipy import integrate

from swarmsim.core.errors import InputError
from swarmsim.studies import selection
from swarmsim.studies.plan import open_study
from swarmsim.studies.selection import Answer, Goal, TooFewError, best, race
from swarmsim.studies.store import Row, Store
from swarmsim.studies.survival import Endings

pytestmark = pytest.mark.usefixtures("no_workers")
STUDY = f"""
title = "A race"
scenario = "{ROOT}/scenarios/room.toml"
seeds = 1
[[condition]]
name = "a"
set = {{"stop.iterations" = 400}}
[[condition]]
name = "b"
set = {{"stop.iterations" = 400, "robots.count" = 2}}
"""


def study_race(folder: Path, times, text: str = STUDY, budget: int = 200, **keys: float) -> Answer:
    """What a race of a and b ends with; `times` gives iterations by condition and seed, cut at the limit if later."""
    (folder / "race.toml").write_text(text)
    plan = open_study(folder / "race.toml")
    limits = {condition.name: condition.scenario.limit for condition in plan.conditions}
    with Store(folder / "race.sqlite") as store:

        def invent(jobs) -> None:
            for job in jobs:
                took, limit = float(times(job.condition, job.seed)), limits[job.condition]
                row = (max(1, int(took)), "finished") if took <= limit else (limit, "not finished")
                store.add(Row(job.identity, job.condition, job.seed, *row[::-1], {}, None, "d", {}, 0.1, None))

        tolerance = keys.pop("tolerance", 0.03)
        return best(plan, store, invent, 0.95, budget, tolerance, **keys)


def test_the_race_finds_the_better_condition_with_few_runs(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    answer = study_race(tmp_path, lambda name, seed: generator.normal({"a": 200, "b": 100}[name], 15))
    assert (answer.best, answer.decided, answer.runs) == ("b", True, 20)
    assert answer.sentence == (
        "b is best: with 95% confidence no other needs fewer iterations by more than 3% (20 runs)"
    )
    assert selection.head(answer)[3] == "mean iterations"


def test_a_race_between_equals_ends_with_the_budget(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    answer = study_race(tmp_path, lambda name, seed: generator.normal(100, 30), tolerance=0.0, budget=60)
    assert not answer.decided
    assert answer.runs <= 60
    assert "not decided within the budget" in answer.sentence


def test_unfinished_runs_count_up_to_the_limit_and_the_answer_says_so(tmp_path: Path) -> None:
    answer = study_race(tmp_path, lambda name, seed: math.inf if name == "a" and seed % 2 else 100 + seed % 3)
    assert (answer.best, answer.decided) == ("b", True)
    assert "no other needs fewer iterations, of the first 400, by more than 3%" in answer.sentence
    assert selection.head(answer)[3] == "mean of min(iterations, 400)"
    assert [row[:4] for row in selection.lines(answer)] == [
        ("a", "10", "5", "250.6"),
        ("b (best)", "10", "10", "101.0"),
    ]
    assert [row[5] for row in selection.lines(answer)] == ["4 min 11 s", "1 min 41 s"]


def test_a_condition_with_unfinished_runs_leads_if_it_saves_more_of_the_time_than_another_without(
    tmp_path: Path,
) -> None:
    """Nine in ten done at once beat all done late, and the sentence names the time looked at."""
    answer = study_race(tmp_path, lambda name, seed: 380 + seed % 5 if name == "a" else math.inf if seed == 3 else 20)
    assert (answer.best, answer.decided) == ("b", True)
    assert ", of the first 400, " in answer.sentence


@pytest.mark.parametrize(
    ("times", "counts"),
    [
        (lambda name, seed: math.inf, "0 of 10 a, 0 of 10 b"),
        (lambda name, seed: 20 if seed == 5 else math.inf, "1 of 20 a, 1 of 20 b"),
    ],
)
def test_no_condition_is_best_where_too_few_finish(tmp_path: Path, times, counts: str) -> None:
    with pytest.raises(
        InputError, match=rf"race\.toml: no condition can be called best.*400 iterations: {counts}; exp"
    ):
        study_race(tmp_path, times)


def test_best_ends_with_2_if_nothing_finished(tmp_path: Path) -> None:
    study = tmp_path / "race.toml"
    study.write_text(STUDY.replace("400", "3"))
    done = called("study", "best", study, "--store", tmp_path / "race.sqlite", "--quiet", "--workers", "1")
    assert (done.returncode, done.stdout) == (2, "")
    assert "0 of 10 a, 0 of 10 b" in " ".join(done.stderr.split())
    wrong = called("study", "best", study, "--within", "soon", "--store", tmp_path / "race.sqlite", "--quiet")
    assert (wrong.returncode, "--within 'soon' is no duration" in wrong.stderr) == (2, True)


def test_conditions_with_other_limits_are_compared_up_to_the_shorter(tmp_path: Path) -> None:
    """a takes 300 of at most 400; b is done at 90 or not before 1000. Of the first 400 b needs fewer."""
    text = STUDY.replace("400", "1000", 1)
    answer = study_race(tmp_path, lambda name, seed: {"a": 300 + 500 * (seed % 2), "b": 90 + seed % 7}[name], text)
    assert answer.best == "b"
    assert answer.goal.horizon == 400
    assert answer.arms[0].endings.done == 5  # those at 800 are not done by 400
    assert answer.arms[0].endings.times.max() == 400


def test_conditions_with_other_periods_are_compared_by_seconds(tmp_path: Path) -> None:
    """b needs twice the iterations of a, each a quarter as long."""
    text = STUDY.replace('400, "robots.count" = 2', '1200, "period" = 0.25')
    answer = study_race(tmp_path, lambda name, seed: {"a": 100, "b": 200}[name] + seed % 3, text)
    assert answer.best == "b"
    assert "b is best: with 95% confidence no other needs less time by more than 3%" in answer.sentence
    assert [row[3] for row in selection.lines(answer)] == ["101.0", "50.2"]
    assert answer.goal.horizon == 300.0


def test_by_a_time_the_best_has_the_highest_chance_of_being_done(tmp_path: Path) -> None:
    """a is quicker on average, and b more often done by 200 s."""

    def times(name: str, seed: int) -> float:
        return (20 if seed % 10 < 7 else 300) if name == "a" else 190

    assert study_race(tmp_path, times).best == "a"
    answer = study_race(tmp_path, times, within=200.0)
    assert (answer.best, answer.decided) == ("b", True)
    assert "no other has a chance of being done by 3 min 20 s that is higher by more than 3 points" in answer.sentence
    assert [row[3] for row in selection.lines(answer)] == ["70 %", "100 %"]
    with pytest.raises(InputError, match=r"--within 10 min: beyond the limit of a, 6 min 40 s; expected"):
        study_race(tmp_path, times, within=600.0)
    with pytest.raises(InputError, match=r"no condition can be called best.*by 10 s: 0 of 10 a, 0 of 10 b"):
        study_race(tmp_path, times, within=10.0)


# Known survival curves: a chance of ever being done, and a Weibull time for those that are.
Curve = tuple[float, float, float]  # chance, scale, shape
LIMIT = 1000.0
CURVES: dict[str, list[Curve]] = {
    "exponential, a quarter to a half cut": [(1, 700, 1), (1, 1000, 1), (1, 1400, 1)],
    "curves that cross": [(1, 900, 3), (1, 800, 0.7), (0.9, 500, 2)],
    "the quick one fails more often": [(0.9, 200, 4), (0.999, 235, 4), (0.97, 200, 4)],
    "few finish": [(0.05, 500, 2), (0.10, 500, 2), (0.15, 900, 2)],
    "almost none finishes": [(0.02, 500, 2), (0.0, 500, 2), (0.06, 500, 2)],
}


def mean_up_to_the_limit(curve: Curve) -> float:
    chance, scale, shape = curve
    return integrate.quad(lambda t: 1 - chance * (1 - math.exp(-((t / scale) ** shape))), 0, LIMIT)[0]


def raced(curves: Sequence[Curve], goal: Goal, seed: int, tolerance: float = 0.05) -> Answer | None:
    """A race of conditions with these curves; None if it is refused."""
    rng, times = np.random.default_rng(seed), dict[str, np.ndarray]()

    def run(names: Sequence[str], seeds: int) -> Mapping[str, Endings]:
        for name in names:
            chance, scale, shape = curves[int(name)]
            more = seeds - len(times.get(name, ()))
            new = np.where(rng.random(more) < chance, scale * rng.weibull(shape, more), np.inf)
            times[name] = np.append(times.get(name, ()), new)
        return {
            name: Endings(np.minimum(times[name], LIMIT), times[name] <= LIMIT, LIMIT).within(goal.horizon)
            for name in names
        }

    try:
        return race([str(place) for place in range(len(curves))], goal, run, 0.95, 600, tolerance)
    except TooFewError:
        return None


@pytest.mark.thorough
@pytest.mark.parametrize("name", CURVES)
def test_a_best_named_among_known_curves_is_the_best_or_none_is_named(name: str) -> None:
    curves, repeats = CURVES[name], 60
    truth = [mean_up_to_the_limit(curve) for curve in curves]
    answers = [raced(curves, Goal(LIMIT, 1.0, False), seed) for seed in range(repeats)]
    named = [int(one.best) for one in answers if one is not None and one.decided]
    wrong = sum(truth[best] > 1.05 * min(truth) for best in named)
    assert wrong <= 6  # 3 are expected at most, and more than 6 by chance in 3 of 100 tests
    assert (name in ("few finish", "almost none finishes")) == (not named)


@pytest.mark.parametrize("name", CURVES)
def test_a_best_chance_among_known_curves_is_the_best(name: str) -> None:
    curves, repeats, horizon = CURVES[name], 12, 400.0
    truth = [chance * (1 - math.exp(-((horizon / scale) ** shape))) for chance, scale, shape in curves]
    answers = [raced(curves, Goal(horizon, None, True), seed, 0.1) for seed in range(repeats)]
    named = [int(one.best) for one in answers if one is not None and one.decided]
    assert sum(truth[best] < max(truth) - 0.1 for best in named) <= 2
