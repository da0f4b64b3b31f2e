"""Code that was edited is run, or refused: in a session, by local workers, by a scheduler that has stood for long."""

from __future__ import annotations

import json
import pickle
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import ROOT, called

import swarmsim
from swarmsim.core.scenario import registry
from swarmsim.studies import results as res
from swarmsim.studies.engine import accepted, run_job, worker_pool
from swarmsim.studies.plan import open_study
from swarmsim.studies.store import Row, Store

SCENARIO = f"""
world = "{ROOT}/worlds/room.svg"
[robots]
count = 2
spawn = "room"
[sensor]
use = "none"
[network.topology]
use = "knn"
k = 1
[mind]
use = "USE"
[task]
use = "./ends.py:travelled"
[stop]
iterations = 5
"""
STUDY = 'title = "Own"\nscenario = "own.toml"\nseeds = 1\n'
TASK = "def travelled(moment):\n    return abs(float(moment.state.pose[0, 2]) - 0.0)\n"
MIND = "{imports}\nclass Mine:\n    def step(self, me):\n        return me.drive(0.0, {turn})\n"
#: What the mind is called, its files, and the file that is edited, with its text before and after.
CASES: dict[str, tuple[str, dict[str, str], str, str, str]] = {
    "one file": (
        "./mind.py:Mine", {}, "mind.py", MIND.format(imports="", turn="0.0"), MIND.format(imports="", turn="0.5"),
    ),
    "two files beside the scenario": (
        "./mind.py:Mine", {"mind.py": MIND.format(imports="import helper", turn="helper.TURN")},
        "helper.py", "TURN = 0.0\n", "TURN = 0.5\n",
    ),
    "a package of two files": (
        "./pack/mind.py:Mine",
        {"pack/__init__.py": "", "pack/mind.py": MIND.format(imports="from .helper import TURN", turn="TURN")},
        "pack/helper.py", "TURN = 0.0\n", "TURN = 0.5\n",
    ),
    "a file that is imported late": (
        "./mind.py:Mine", {"mind.py": MIND.format(imports="", turn="__import__('builtins').float(turn())")
                           + "def turn():\n    from helper import TURN\n    return TURN\n"},
        "helper.py", "TURN = 0.0\n", "TURN = 0.5\n",
    ),
}  # fmt: skip
Answer = Callable[[Path], tuple[str, dict[str, str]]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "own.toml").write_text(SCENARIO)
    (tmp_path / "ends.py").write_text(TASK)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def written(folder: Path, case: str) -> tuple[Path, str]:
    """The file of a case that will be edited, and what it will be then."""
    use, files, edited, before, after = CASES[case]
    (folder / "own.toml").write_text(SCENARIO.replace("USE", use))
    for name, text in {**files, edited: before}.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder / edited, after


def in_session(folder: Path) -> tuple[str, dict[str, str]]:
    run = swarmsim.run(folder / "own.toml", allow_code=True)
    return run.recording.digest(), run.recording.code


def by(workers: Callable[..., Iterator[Row]], folder: Path) -> tuple[str, dict[str, str]]:
    with registry.own_code(True), Store(folder / "s.sqlite") as store:
        plan = open_study(folder / "study.toml")
        for row in workers(res.missing(plan, store)):
            assert row.message is None
            store.add(row)
        (result,) = res.gather(plan, store).values()
        (row,) = result.rows
    return row.digest, row.code


@pytest.fixture(scope="module")
def local() -> Iterator[Answer]:
    with worker_pool(1) as workers:
        yield lambda folder: by(workers, folder)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A scheduler with a worker, processes of their own that stand from the first test to the last."""
    folder = tmp_path_factory.mktemp("dask")
    at, dask = folder / "scheduler.json", [sys.executable, "-m", "dask"]
    commands = (
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", at],
        [*dask, "worker", "--scheduler-file", at, "--nthreads", "2", "--no-dashboard", "--local-directory", folder],
    )
    processes = [
        subprocess.Popen(list(map(str, command)), cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for command in commands
    ]
    try:
        until = time.monotonic() + 60
        while not (at.exists() and at.read_text().strip()):
            assert time.monotonic() < until, "the scheduler does not start"
            time.sleep(0.05)
        yield json.loads(at.read_text())["address"]
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


@pytest.fixture(scope="module")
def standing(address: str) -> Iterator[Answer]:
    with worker_pool(1, address) as workers:
        yield lambda folder: by(workers, folder)


@pytest.fixture(params=["session", "local", "standing"])
def answer(request: pytest.FixtureRequest) -> Answer:
    return in_session if request.param == "session" else request.getfixturevalue(request.param)


@pytest.mark.parametrize("case", CASES)
def test_edited_code_is_run_and_is_another_code(case: str, answer: Answer, folder: Path) -> None:
    edited, after = written(folder, case)
    first = answer(folder)
    assert answer(folder) == first
    edited.write_text(after)
    second = answer(folder)
    assert second[0] != first[0]
    name = edited.relative_to(folder).as_posix()
    assert {one for one in second[1] if second[1][one] != first[1].get(one)} == {name}
    assert first[1].keys() == second[1].keys() >= {"swarmsim", "ends.py", name}
    assert in_session(folder) == second  # whoever does it


def test_runs_of_other_code_are_kept_named_and_do_not_count_unless_asked_for(local: Answer, folder: Path) -> None:
    edited, after = written(folder, "a package of two files")
    study = ("study.toml", "--store", "s.sqlite", "--allow-code")

    def told(*words: str) -> str:
        done = called("study", *words, cwd=folder)
        assert done.returncode == 0, done.stderr
        return " ".join(done.stdout.split())

    first = local(folder)
    done = told("status", *study)  # wherever the study is looked at from
    assert ("notice" in done, "│base│0│1│0│0│" in done.replace(" ", "")) == (False, True)
    edited.write_text(after)
    status = told("status", *study)
    assert "1 run of other code does not count: pack/helper.py (" in status
    assert "'study run' does it again and keeps both" in status
    assert "│base│0│0│0│1│" in status.replace(" ", "")
    old = told("table", *study, "--keep-old")
    assert "1 run of other code counts (--keep-old), in base: pack/helper.py (" in old
    assert told("run", *study, "--workers", "1", "--keep-old", "--quiet") == ""  # there is nothing to do
    assert "1 run of other code does not count" in told("status", *study)
    second = local(folder)
    assert "notice" not in told("status", *study)
    (folder / "pack" / "unused.py").write_text("what no part imports is no code of it")
    edited.write_text(CASES["a package of two files"][3])
    assert "notice" not in told("status", *study)  # the first run is there still
    told("export", *study, "--csv", "runs.csv")
    assert first[0] in (folder / "runs.csv").read_text()
    assert second[0] not in (folder / "runs.csv").read_text()


@pytest.mark.thorough
def test_local_workers_of_two_study_runs_do_not_run_the_old_code(folder: Path) -> None:
    """Through Python, as in a notebook: each study starts its processes anew."""
    edited, after = written(folder, "two files beside the scenario")
    found = []
    for text in (None, after):
        if text is not None:
            edited.write_text(text)
        done = swarmsim.study(folder / "study.toml", store=folder / "s.sqlite", workers=1, allow_code=True)
        (record,) = done.records()
        found.append((record["digest"], record["code"]))
    assert found[0][0] != found[1][0]
    assert found[0][1] != found[1][1]
    assert found[1][0] == in_session(folder)[0]


def test_a_run_that_is_under_way_keeps_the_code_that_it_was_planned_with(folder: Path) -> None:
    edited, after = written(folder, "two files beside the scenario")
    with registry.own_code(True), Store(Path(":memory:")) as store:
        plan = open_study(folder / "study.toml")
        (task,) = res.missing(plan, store)
    before = run_job(task)
    edited.write_text(after)
    (folder / "mind.py").unlink()
    assert (run_job(pickle.loads(pickle.dumps(task))).digest, before.message) == (before.digest, None)


def test_a_worker_with_another_swarmsim_refuses(folder: Path, tmp_path: Path) -> None:
    written(folder, "one file")
    with registry.own_code(True), Store(Path(":memory:")) as store:
        (task,) = res.missing(open_study(folder / "study.toml"), store)
    other = tmp_path / "other"
    shutil.copytree(Path(swarmsim.__file__).parent, other / "swarmsim", ignore=shutil.ignore_patterns("__pycache__"))
    with (other / "swarmsim" / "core" / "chance.py").open("a") as file:
        file.write("# another\n")
    script = (
        "import pickle, sys; from swarmsim.studies.engine import run_job; print(run_job(pickle.load(sys.stdin.buffer)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], input=pickle.dumps(task), capture_output=True, check=False, cwd=other
    )
    told = done.stdout.decode()
    assert "status='failed'" in told, done.stderr.decode()
    assert "refused: a worker has other code: swarmsim (" in told
    assert "digest=None" in told


def test_a_row_that_tells_other_code_is_no_result(folder: Path) -> None:
    """As a worker gives whose swarmsim is too old to look at the code itself."""
    written(folder, "one file")
    with registry.own_code(True), Store(Path(":memory:")) as store:
        (task,) = res.missing(open_study(folder / "study.toml"), store)
    row = replace(run_job(task), code={})
    kept = accepted(task, row)
    assert (kept.status, kept.digest) == ("failed", None)
    assert "refused: a worker has other code" in kept.message


def test_a_recording_tells_its_code_and_verify_says_if_it_has_changed(folder: Path) -> None:
    written(folder, "two files beside the scenario")
    assert called("run", "own.toml", "--out", "run", "--allow-code", "--quiet", cwd=folder).returncode in (0, 1)
    recorded = swarmsim.open(folder / "run").recording.code
    assert recorded.keys() == {"swarmsim", "mind.py", "helper.py", "ends.py"}
    assert "code" not in called("verify", "run", "--allow-code", cwd=folder).stdout
    (folder / "helper.py").write_text("TURN = 0.0  # as before\n")
    same = called("verify", "run", "--allow-code", cwd=folder)
    assert (same.returncode, "though the code differs: helper.py (" in same.stdout) == (0, True)
    (folder / "helper.py").write_text("TURN = 0.5\n")
    different = called("verify", "run", "--allow-code", cwd=folder)
    assert (different.returncode, "  the code differs: helper.py (" in different.stdout) == (1, True)
    called("run", "own.toml", "--out", "second", "--allow-code", "--quiet", cwd=folder)
    assert "made by different code of helper.py" in " ".join(
        called("compare", "run", "second", cwd=folder).stdout.split()
    )
