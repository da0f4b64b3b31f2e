from __future__ import annotations

import csv
import json
import os
import shlex
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest
from conftest import ROOT, called, jobs_here

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.describe import axis_label
from swarmsim.core.scenario.file import load
from swarmsim.recording import measures
from swarmsim.studies import results as res
from swarmsim.studies.engine import execute, run_job
from swarmsim.studies.plan import open_study
from swarmsim.studies.store import Row, Store

STUDY = f"""
title = "Small"
scenario = "{ROOT}/scenarios/room.toml"
seeds = 3
[set]
"stop.iterations" = 60
[[vary]]
key = "network.topology.k"
values = [0, 1, 2]
[[condition]]
name = "chain"
set = {{"network.topology" = {{use = "chain"}}}}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(STUDY)
    return path


def test_a_grid_is_drawn_along_its_first_axis_with_a_line_for_each_value_of_the_others(study: Path) -> None:
    more = """[[vary]]
key = "robots.count"
together = "size"
values = [4, 5]
[[vary]]
key = "robots.speed"
together = "size"
values = [0.1, 0.2]
[[condition]]
"""
    study.write_text(STUDY.replace("[[condition]]\n", more))
    conditions = open_study(study).conditions
    assert [(c.x, c.series) for c in conditions[:3]] == [(0.0, "count=4"), (0.0, "count=5"), (1.0, "count=4")]
    assert [(c.x, c.series) for c in conditions[6:]] == [(None, "")]


def test_a_plan_crosses_axes_and_adds_named_conditions(study: Path) -> None:
    plan = open_study(study)
    assert [condition.name for condition in plan.conditions] == ["k=0", "k=1", "k=2", "chain"]
    topology = plan.conditions[2].scenario.network.topology
    assert topology.table == {"use": "knn", "k": 2, "mutual": False, "periodic": False}
    assert all(condition.scenario.stop.iterations == 60 for condition in plan.conditions)
    assert len(plan.runs) == 12
    assert len({plan.identity(condition, seed) for condition, seed in plan.runs}) == 12
    assert len(open_study(study, 5).seeds) == 5


def test_a_key_of_a_mind_in_the_short_form_is_varied_as_it_is_written(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "class Still:\n    def __init__(self, reach: float = 0.5) -> None:\n        self.reach = reach\n"
        "    def step(self, me) -> None:\n        me.say(self.reach)\n"
    )
    (tmp_path / "short.toml").write_text(
        'world = {generate = {use = "rooms"}}\n[robots]\ncount = 2\n[network.topology]\nuse = "full"\n'
        '[mind]\nuse = "./own.py:Still"\nreach = 0.8\n[task]\nuse = "gathered"\n'
    )
    path = tmp_path / "study.toml"
    path.write_text(
        'title = "Reach"\nscenario = "short.toml"\n[[vary]]\nkey = "mind.reach"\nvalues = [0.2, 0.4]\n'
        '[[condition]]\nname = "one half"\nset = {"mind.strategy.reach" = 0.1, "task.use" = "gathered"}\n'
    )
    with registry.own_code(True):
        plan = open_study(path)
    minds = [condition.scenario.mind for condition in plan.conditions]
    assert [(mind.computation.table["reach"], mind.strategy.table["reach"]) for mind in minds] == [
        (0.2, 0.2), (0.4, 0.4), (0.8, 0.1),
    ]  # fmt: skip
    assert [condition.name for condition in plan.conditions] == ["reach=0.2", "reach=0.4", "one half"]
    assert [condition.x for condition in plan.conditions] == [0.2, 0.4, None]


def test_a_larger_budget_makes_no_other_run(study: Path) -> None:
    first = open_study(study)
    second = open_study(study, changes={"budget": 7200.0})
    assert second.conditions[0].scenario.budget == 7200.0
    assert first.identity(first.conditions[0], 1) == second.identity(second.conditions[0], 1)


def test_axes_cross_or_step_together(study: Path) -> None:
    more = '\n[[vary]]\nkey = "robots.count"\nvalues = [4, 5]\n'
    study.write_text(STUDY + more)
    assert len(open_study(study).conditions) == 3 * 2 + 1
    together = STUDY.replace('topology.k"', 'topology.k"\ntogether = "both"').replace("[0, 1, 2]", "[1, 2]")
    study.write_text(together + more.replace("values", 'together = "both"\nvalues'))
    assert [c.name for c in open_study(study).conditions] == ["k=1, count=4", "k=2, count=5", "chain"]


def test_values_of_an_axis_have_names_of_their_own_and_lists_of_parts_are_told_in_words(study: Path) -> None:
    faults = '[[vary]]\nkey = "faults"\nvalues = [[], [{use = "crash", at = 5}, {use = "remove", at = 9, count = 1}]]\n'
    study.write_text(STUDY.replace("[0, 1, 2]", "[1]") + faults)
    told = ["k=1, faults=none", "k=1, faults=crash at=5 and remove at=9 count=1", "chain"]
    assert [c.name for c in open_study(study).conditions] == told
    study.write_text(STUDY.replace("[0, 1, 2]", "[1]") + faults + 'names = ["sound", "two die"]\n')
    conditions = open_study(study).conditions
    assert [(c.name, c.series, c.x) for c in conditions[:2]] == [
        ("k=1, sound", "sound", 1.0),
        ("k=1, two die", "two die", 1.0),
    ]
    study.write_text(STUDY.replace("[0, 1, 2]", "[0, 1, 2]\nnames = ['nobody']"))
    with pytest.raises(InputError, match=r"topology\.k: 1 names for 3 values; expected a name for each value"):
        open_study(study)


def test_an_axis_is_labelled_in_words_with_its_unit() -> None:
    scenario = load(ROOT / "scenarios/room.toml")
    for key, words in {
        "robots.count": "robots",
        "robots.speed": "speed, m/s",
        "robots.wheel_base": "wheel base, m",
        "network.topology.k": "others heard, k",
        "stop.iterations": "iterations",
        "robots.spawn": "spawn",
    }.items():
        assert axis_label(scenario, key) == words, key


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("topology.k", "topology.kk", r"small\.toml: condition 'kk=0': network\.topology\.kk: unknown key"),
        ("[0, 1, 2]", "[0, 7]", r"condition 'k=7': network\.topology\.k: 7 neighbours"),
        ("seeds = 3", "seeds = 0", r"small\.toml: seeds"),
        ("seeds = 3", "seeds = [1, 1]", "listed twice"),
        ("[[vary]]", "[[varry]]", r"varry: unknown key; did you mean 'vary'"),
        ('name = "chain"', 'name = "k=1"', "is listed twice"),
        ("room.toml", "none.toml", "none.toml: cannot be read"),
        ("[0, 1, 2]", "[]", "vary"),
        ("title", "= title", "not valid TOML"),
    ],
)
def test_a_study_that_cannot_work_is_refused_before_any_run(study: Path, old: str, new: str, words: str) -> None:
    study.write_text(STUDY.replace(old, new))
    with pytest.raises(InputError, match=words):
        open_study(study)


def run_all(study: Path, store: Path, workers: int = 2, scheduler: str | None = None) -> str:
    plan = open_study(study)
    with Store(store) as kept:
        for row in execute(res.missing(plan, kept), workers, scheduler):
            kept.add(row)
        return res.digest(list(res.gather(plan, kept).values()))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, str]:
    folder = tmp_path_factory.mktemp("study")
    study = folder / "small.toml"
    study.write_text(STUDY)
    return study, folder / "small.sqlite", run_all(study, folder / "small.sqlite")


@pytest.mark.thorough
def test_one_worker_or_two_or_a_scheduler_of_ones_own_give_equal_digests(
    done, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmsim.studies.engine.ANSWER", 3600.0)
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "3600s")
    study, _, digest = done
    assert run_all(study, tmp_path / "one.sqlite", 1) == digest
    address = "tcp://127.0.0.1:18786"
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", "18786", "--no-dashboard"]
    worker = [*dask, "worker", address, "--nthreads", "1", "--no-dashboard", "--local-directory", str(tmp_path)]
    processes = [
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for command in (scheduler, worker, worker)
    ]
    try:
        assert run_all(study, tmp_path / "own.sqlite", 1, address) == digest
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def test_an_unanswered_scheduler_is_refused(done, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmsim.studies.engine.ANSWER", 1.0)
    study, _, _ = done
    plan = open_study(study)
    with Store(Path(":memory:")) as empty, pytest.raises(InputError, match="does not answer"):
        list(execute(res.missing(plan, empty), 1, "tcp://127.0.0.1:1"))


def test_results_are_those_of_single_runs(done) -> None:
    study, store, _ = done
    plan = open_study(study)
    with Store(store) as kept:
        found = res.gather(plan, kept)
        assert res.missing(plan, kept) == []
    assert all(result.missing == 0 and len(result.rows) == 3 for result in found.values())
    with Store(Path(":memory:")) as empty:
        task = next(t for t in res.missing(plan, empty) if t.condition == "k=2" and t.seed == 2)
    alone, kept_row = run_job(task), found["k=2"].rows[1]
    assert (alone.digest, alone.iterations, alone.summary) == (kept_row.digest, kept_row.iterations, kept_row.summary)
    np.testing.assert_array_equal(alone.curve, kept_row.curve)
    assert len(kept_row.curve) == kept_row.iterations
    words = shlex.split(task.command)
    repeated = called(*words[1:], "--out", "again", "--quiet", cwd=study.parent)
    assert repeated.returncode in (0, 1), repeated.stderr
    assert json.loads((study.parent / "again" / "summary.json").read_text())["digest"] == alone.digest


def test_unfinished_runs_are_neither_dropped_nor_counted_as_their_limit(done) -> None:
    study, store, _ = done
    with Store(store) as kept:
        found = res.gather(open_study(study), kept)
    unfinished = [result for result in found.values() if not result.finished.all()]
    for result in unfinished:
        described = result.describe()
        assert described.mean is None
        assert described.n == 3
        assert described.restricted.horizon == 60


def test_a_run_that_raises_is_kept_as_failed_and_the_others_go_on(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_part.py").write_text(
        "import msgspec\n"
        "class Broken(msgspec.Struct, frozen=True, forbid_unknown_fields=True):\n"
        "    def build(self, context):\n        return self\n"
        "    def links(self, state):\n        raise RuntimeError('the mast broke')\n"
    )
    study.write_text(
        STUDY + '[[condition]]\nname = "broken"\nset = {"network.topology" = {use = "broken_part:Broken"}}\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    with jobs_here():
        done = called("study", "run", study, "--store", tmp_path / "s.sqlite", "--quiet", "--allow-code")
    assert done.returncode == 1, done.stderr
    assert (
        done.stdout.count("PartError: topology broken_part.py:Broken, iteration 0: RuntimeError: the mast broke") == 3
    )
    assert done.stdout.count("raise RuntimeError('the mast broke'); to repeat: swarmsim run") == 3
    with Store(tmp_path / "s.sqlite") as kept:
        rows = kept._base.execute("select status, count(*) from runs group by status").fetchall()
    assert dict(rows)["failed"] == 3
    assert sum(count for _, count in rows) == 15


def kept_in(store: Path) -> int:
    """How many runs a store that is being written has."""
    base = sqlite3.connect(f"file:{store}?mode=ro", uri=True)
    try:
        return base.execute("select count(*) from runs").fetchone()[0]
    except sqlite3.OperationalError:  # no table yet
        return 0
    finally:
        base.close()


@pytest.mark.thorough
def test_a_killed_study_is_finished_by_running_it_again(done, tmp_path: Path) -> None:
    study, _, digest = done
    store = tmp_path / "killed.sqlite"
    command = [sys.executable, "-m", "swarmsim", "study", "run", str(study), "--store", str(store), "--quiet"]
    process = subprocess.Popen(command, start_new_session=True)  # tests/engine/test_soak.py does it again and again
    while process.poll() is None and (not store.exists() or kept_in(store) < 3):
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert subprocess.run(command, check=False).returncode == 0
    with Store(store) as kept:
        plan = open_study(study)
        assert res.digest(list(res.gather(plan, kept).values())) == digest
        assert kept._base.execute("select count(*) from runs").fetchone() == (12,)


def test_a_store_keeps_the_first_of_equal_runs_and_replaces_failures(tmp_path: Path) -> None:
    def row(status: str, seconds: float) -> Row:
        return Row("id", "c", 1, status, 5, {"t50": None}, None, "d", {}, seconds, None)

    with Store(tmp_path / "s.sqlite") as store:
        for status, seconds in (("failed", 1.0), ("finished", 2.0), ("finished", 3.0)):
            store.add(row(status, seconds))
        assert store.rows(["id", "other"]) == {"id": row("finished", 2.0)}


def test_a_file_that_is_no_store_is_refused(tmp_path: Path) -> None:
    (tmp_path / "s.sqlite").write_text("certainly no database, but rather long prose " * 40)
    with pytest.raises(InputError, match=r"s\.sqlite: not a store of results"):
        Store(tmp_path / "s.sqlite")
    with Store(tmp_path / "t.sqlite") as store:
        store._base.execute("pragma user_version = 9")
    with pytest.raises(InputError, match="format 9"):
        Store(tmp_path / "t.sqlite")


def test_the_verbs_of_a_study_print_and_write(done, tmp_path: Path) -> None:
    study, store, digest = done
    at = ["--store", store]
    planned = called("study", "plan", study, *at, cwd=tmp_path)
    assert "4 conditions x 3 seeds = 12 runs, 0 still to do" in planned.stdout.replace("\n", " ")
    assert called("study", "status", study, *at, cwd=tmp_path).returncode == 0
    table = called("study", "table", study, *at, "--compare", "k=0", cwd=tmp_path)
    assert digest in table.stdout
    assert "A12" in table.stdout
    asked = ("--by", "40", "--by", "2min", "--quantile", "0.5")
    surely = " ".join(called("study", "table", study, *at, *asked, cwd=tmp_path).stdout.split())
    assert "by 40 s" in surely
    assert "beyond the limit" in surely  # of 60 iterations
    assert "50 % done" in surely
    for wrong in (("--by", "soon"), ("--quantile", "95")):
        refused = called("study", "table", study, *at, *wrong, cwd=tmp_path)
        assert (refused.returncode, wrong[0] in refused.stderr) == (2, True)
    assert "path_sum" in called("study", "table", study, *at, "--measure", "path_sum", cwd=tmp_path).stdout
    peak = called("study", "table", study, *at, "--measure", "path_sum", "--peak", "lowest", cwd=tmp_path).stdout
    assert "path_sum is lowest at k = " in " ".join(peak.split())
    unsaid = called("study", "table", study, *at, "--peak", "lowest", cwd=tmp_path)
    assert unsaid.returncode == 2
    assert "--peak lowest: no measure is named" in unsaid.stderr
    wrong = called("study", "table", study, *at, "--measure", "paths", cwd=tmp_path)
    assert (wrong.returncode, "'paths' is not a measure" in wrong.stderr) == (2, True)
    exported = called("study", "export", study, *at, "--csv", "runs.csv", "--parquet", "runs.parquet", cwd=tmp_path)
    assert exported.returncode == 0, exported.stderr
    with (tmp_path / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    columns = parquet.read_table(tmp_path / "runs.parquet").to_pydict()
    assert columns["digest"] == [row["digest"] for row in rows]
    assert columns["iterations"] == [int(row["iterations"]) for row in rows]
    assert {row["network.topology.k"] for row in rows} == {"0", "1", "2", ""}
    document = called("study", "table", study, *at, "--format", "latex", cwd=tmp_path).stdout
    assert document.startswith("\\begin{tabular}{l")
    assert document.endswith("\\end{tabular}\n")
    drawn = called("study", "plot", study, "figures", *at, cwd=tmp_path)
    assert drawn.returncode == 0, drawn.stderr
    assert {path.name for path in (tmp_path / "figures").iterdir()} >= {
        "iterations.png",
        "coverage.svg",
        "table.md",
        "table.tex",
        "table.csv",
    }


def test_times_in_a_table_are_of_coverage_and_not_of_the_share_asked_for(tmp_path: Path) -> None:
    study, store, out = tmp_path / "part.toml", tmp_path / "part.sqlite", tmp_path / "part.csv"
    text = STUDY.replace("seeds = 3", "seeds = 1").replace('"stop.iterations" = 60', '"task.share" = 0.6')
    study.write_text(text[: text.index("[[vary]]")])
    with Store(store) as kept:
        for task in res.missing(open_study(study), kept):
            kept.add(run_job(task))
    assert called("study", "export", study, "--store", store, "--csv", out).returncode == 0
    (row,) = csv.DictReader(out.read_text().splitlines())
    assert row["status"] == "finished"
    assert {row[f"measure_{name}"] for name in ("t75", "t100", "tail_ratio")} == {""}
    assert 0 < int(row["measure_t50"]) < int(row["iterations"])
    assert 0.6 <= float(row["measure_coverage"]) == float(row["measure_sensed"]) < 0.75
    told = called("study", "table", study, "--store", store, "--measure", "t100").stdout
    assert "│base│1│0│-│-│-│-│" in "".join(told.split())


def test_rows_of_another_edition_of_the_measures_are_not_mixed_in(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = open_study(study)
    before = {plan.identity(condition, seed) for condition, seed in plan.runs}
    monkeypatch.setattr(measures, "EDITION", measures.EDITION + 1)
    assert not before & {plan.identity(condition, seed) for condition, seed in plan.runs}
