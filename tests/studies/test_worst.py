"""The search for the smallest timeline of faults: against swarms that fail by a known rule, and a real one."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from conftest import ROOT, called

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import load
from swarmsim.studies import worst
from swarmsim.studies.store import Row

pytestmark = pytest.mark.usefixtures("no_workers")
SCENARIO = load(ROOT / "scenarios" / "basilica.toml")  # 15 robots
SOUND = 200


def search(fails, scenario=SCENARIO, **keys) -> worst.Search:
    """A search in which runs are not simulated: they last twice as long if `fails` says so of their faults."""

    def run_jobs(tasks):
        for task in reversed(tasks):  # in any order
            took = 2 * SOUND + 50 if fails(task.scenario.faults, task.seed) else SOUND
            done = took <= task.scenario.stop.iterations
            status = "finished" if done else "not finished"
            yield Row(task.identity, task.condition, task.seed, status, min(took, 5000), {}, None, None, {}, 0.0, None)

    return worst.Search(scenario, "", run_jobs, **keys)


def test_shrinking_finds_the_least_that_fails() -> None:
    """It takes seven crashed robots for 100 iterations, and nothing else does anything."""
    answer = search(
        lambda faults, seed: any(
            f["use"] == "crash" and f["count"] >= 7 and min(f.get("duration", 1000), 2 * SOUND - f["at"]) >= 100
            for f in (fault.table for fault in faults)
        )
    ).run(80)
    assert answer.sound == (SOUND,) * 3
    assert answer.limit == (2 * SOUND,) * 3
    (entry,) = answer.by_kind["crash"].timeline
    assert entry.count == 7
    assert 7 * 100 <= entry.size(2 * SOUND) < 7 * 115  # steps are of an eighth
    assert [kind for kind, failure in answer.by_kind.items() if failure is not None] == ["crash"]
    assert answer.smallest == answer.by_kind["crash"]
    assert answer.smallest.share == pytest.approx(answer.smallest.size / (15 * 400))


def test_a_moment_that_is_enough_is_found() -> None:
    """Maps are lost in any one iteration after half of the run."""

    def lost(table) -> bool:
        return table.get("map") == "lost" and table["at"] >= 100

    answer = search(lambda faults, seed: any(lost(fault.table) for fault in faults)).run(1)
    (entry,) = answer.smallest.timeline
    assert (entry.kind, entry.count, entry.duration, answer.smallest.size) == ("remove, map lost", 1, 1, 1)


def test_what_fails_with_some_seeds_only_is_no_failure() -> None:
    assert search(lambda faults, seed: bool(faults) and seed > 1).run(30).smallest is None


def test_two_faults_together_are_found_at_random() -> None:
    def both(faults, seed) -> bool:
        return {"motor", "radio"} <= {fault.use for fault in faults}

    answer = search(both).run(300)
    assert {entry.kind for entry in answer.smallest.timeline} == {"motor off", "radio off"}
    assert answer.smallest.size == 2
    assert all(failure is None for failure in answer.by_kind.values())
    assert answer == search(both).run(300)  # the same search again


def test_a_scenario_that_fails_by_itself_is_refused() -> None:
    tired = search(
        lambda faults, seed: True, scenario=load(ROOT / "scenarios" / "basilica.toml", ["stop.iterations=300"])
    )
    with pytest.raises(InputError, match="not done without faults: 0 of 3 runs finished within 300 iterations"):
        tired.run(1)


@pytest.mark.thorough
def test_from_a_scenario_to_one_that_shows_the_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worst, "KINDS", {"crash": worst.KINDS["crash"]})
    out = tmp_path / "worst.toml"
    options = ("--out", out, "--budget", 1, "--seeds", 1, "--workers", 1, "--quiet")
    done = called("study", "worst", ROOT / "scenarios" / "room.toml", *options)
    assert done.returncode == 0, done.stderr
    assert "crash: " in done.stdout
    table = tomllib.loads(out.read_text())
    assert table["faults"][0]["use"] == "crash"
    run = called("run", out, "--quiet", "--out", tmp_path / "run")
    assert run.returncode == 1, run.stderr  # not finished
    again = called("study", "worst", ROOT / "scenarios" / "room.toml", *options)
    assert again.returncode == 2
    assert "exists already" in again.stderr
