"""A swarm that does not map, from a file of somebody's own: pictures, tables, studies and refusals work for it, too."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, called, made
from wanderers import WANDERING

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.state import UNKNOWN
from swarmsim.recording.reader import Recording
from swarmsim.studies import results as res
from swarmsim.studies.comparison import costs, head, lines
from swarmsim.studies.engine import run_job
from swarmsim.studies.plan import open_study
from swarmsim.studies.report import study_figures
from swarmsim.studies.store import Store
from swarmsim.view.canvas import Canvas
from swarmsim.view.legend import signs
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.theme import DARK
from swarmsim.view.video import frame

SIZE = (1280, 720)
SETTINGS = [part for context in WANDERING for part in ("--set", context)]


def recorded(path: Path, *overrides: str) -> Recording:
    with registry.own_code(True):
        run = made(*WANDERING, *overrides)
    with run.recorder(path) as recorder:
        run.simulation.run([recorder])
    return Recording(path)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return recorded(tmp_path_factory.mktemp("wandering") / "recording.h5")


def swarmsim(*arguments: object, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    if not more:
        return called(*arguments, cwd=cwd)
    command = [sys.executable, "-m", "swarmsim", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=os.environ | more)


def test_a_picture_shows_the_measure_of_the_task_and_no_map(recording: Recording) -> None:
    scene = Scene(recording)
    shot = scene.at(3)
    assert (scene.curve.label, shot.value) == ("distance, m", recording["distance"][3])
    assert (scene.curves.mean, scene.curves.worst) == (None, None)
    assert scene.limits == (0.0, 0.6000000000000001)  # above 0.50, and a quarter of it is round
    assert (scene.cells(3) == UNKNOWN).all()
    assert not {"free", "seen", "unexplored", "aim"} & {kind for kind, *_ in signs(scene, Style(), 1.0)}
    assert Canvas(scene, SIZE)._panel._worded(0.1234) == "0.123 m"
    ways = [len(way) for way in shot.ways]
    assert ways == [0] * scene.robots


def test_the_floor_without_a_map_is_bright_and_a_line_shows_the_estimated_heading(recording: Recording) -> None:
    scene = Scene(recording)
    canvas = Canvas(scene, SIZE)
    shot, picture = scene.at(2), frame(recording, 2, SIZE)
    assert (np.abs(picture.astype(int) - DARK.floor).max(axis=2) <= 5).mean() > 0.2
    robot = scene.robots - 1
    yaw = recording["heading"][2, robot]
    ahead = canvas.pixels(shot.pose[robot, :2]) + 3.0 * canvas.radius * np.array([np.cos(yaw), -np.sin(yaw)])
    column, row = np.rint(ahead).astype(int)
    around = picture[row - 2 : row + 3, column - 2 : column + 3].astype(int)
    assert np.abs(around - DARK.curve).sum(axis=2).min() < 60
    assert "heading" in {kind for kind, *_ in signs(scene, Style(), 1.0)}


def test_a_comparison_leaves_out_what_only_maps_have(recording: Recording, room: Path, tmp_path: Path) -> None:
    faulty = recorded(tmp_path / "faulty.h5", 'faults=[{use="crash", at=2, count=1}]')
    found = costs({"sound": recording, "faulty": faulty})
    columns = head(recording.curve)
    assert columns[4] == "mean distance"
    of_maps = slice(columns.index("precision"), columns.index("IoU") + 1)
    assert [line[of_maps] for line in lines(found)] == [("-", "-", "-")] * 2
    assert found[1].ratio == pytest.approx(found[1].mean / recording["distance"].mean(), rel=0.2)
    with pytest.raises(InputError, match=r"measures 'coverage' .*, the first run's 'distance'"):
        costs({"wander": recording, "map": Recording(room)})


def test_a_run_needs_leave_to_run_code_and_tells_its_measure(tmp_path: Path) -> None:
    room = ROOT / "scenarios" / "room.toml"
    refused = swarmsim("run", room, *SETTINGS, cwd=tmp_path)
    assert (refused.returncode, "--allow-code" in refused.stderr) == (2, True)
    assert not (tmp_path / "runs").exists()
    done = swarmsim("run", room, *SETTINGS, "--allow-code", "--out", "run", "--video", "run.gif", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert list(summary["measures"]) == ["distance", "farthest"]
    assert f"{summary['measures']['distance']:.3g} m" in done.stdout
    assert "{" not in done.stdout
    assert swarmsim("show", "run", cwd=tmp_path).returncode == 0
    assert swarmsim("network", "run", cwd=tmp_path).returncode == 0
    assert swarmsim("verify", "run", cwd=tmp_path).returncode == 2
    assert swarmsim("verify", "run", "--allow-code", cwd=tmp_path).returncode == 0
    maps = swarmsim("figure", "local-maps", "run", "--robots", "0", "--at", "1", cwd=tmp_path)
    assert (maps.returncode, "kept no maps" in maps.stderr) == (2, True)
    assert swarmsim("figure", "network", "run", "--at", "1", "--and", "2", cwd=tmp_path).returncode == 0


def test_a_part_that_fails_ends_the_run_with_its_own_lines_and_exit_code_3(tmp_path: Path) -> None:
    room = ROOT / "scenarios" / "room.toml"
    breaking = ("--set", "mind.strategy.breaks_at=2", "--allow-code", "--out", "run")
    done = swarmsim("run", room, *SETTINGS, *breaking, cwd=tmp_path)
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    for words in ("strategy", "iteration 2", "RuntimeError: the wheel came off", "wanderers.py, line"):
        assert words in done.stderr


def test_the_current_folder_is_no_place_for_modules(tmp_path: Path) -> None:
    (tmp_path / "here.py").write_text((ROOT / "tests" / "wanderers.py").read_text())
    arguments = ("run", ROOT / "scenarios" / "room.toml", "--set", 'task={use="here:Roam"}', "--allow-code")
    done = swarmsim(*arguments, cwd=tmp_path)
    assert (done.returncode, "No module named 'here'" in done.stderr) == (2, True)
    found = swarmsim(*arguments, "--set", "stop.iterations=2", cwd=tmp_path, PYTHONPATH=str(tmp_path))
    assert found.returncode == 1, found.stderr


@pytest.fixture
def study(tmp_path: Path) -> Path:
    code = (ROOT / "tests" / "wanderers.py").read_text()
    (tmp_path / "own.py").write_text(code)
    (tmp_path / "own.toml").write_text(
        (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", f"{ROOT}/worlds")
        + '[mind]\ncomputation = {use = "./own.py:Tell"}\nstrategy = {use = "./own.py:Drive"}\n'
        + '[task]\nuse = "./own.py:Roam"\n'
    )
    path = tmp_path / "study.toml"
    path.write_text(
        'title = "Wandering"\nscenario = "own.toml"\nseeds = 2\n'
        '[[vary]]\nkey = "mind.strategy.speed"\nvalues = [0.05, 0.1]\n'
    )
    return path


def test_a_study_keeps_the_curve_of_its_task(study: Path, tmp_path: Path) -> None:
    with registry.own_code(True), Store(tmp_path / "s.sqlite") as store:
        plan = open_study(study)
        tasks = res.missing(plan, store)
        assert all(task.allow_code for task in tasks)
        rows = [run_job(task) for task in tasks]
        for row in rows:
            store.add(row)
        found = res.gather(plan, store)
    assert [row.status for row in rows] == ["finished"] * 4
    assert all(row.curve[-1] >= 0.5 and "path_sum" in row.summary for row in rows)
    assert "coverage" not in rows[0].summary
    files = study_figures(plan.study, found, tmp_path / "figures")
    assert "distance.png" in {path.name for path in files}


def test_a_run_is_another_once_its_code_has_changed(study: Path, tmp_path: Path) -> None:
    def identities() -> set[str]:
        with registry.own_code(True):
            plan = open_study(study)
            return {plan.identity(condition, seed) for condition, seed in plan.runs}

    before = identities()
    assert identities() == before
    (tmp_path / "own.py").write_text((tmp_path / "own.py").read_text() + "\n# another remark\n")
    assert not identities() & before


@pytest.mark.usefixtures("no_workers")
def test_the_verbs_of_a_study_need_leave_to_run_code(study: Path, tmp_path: Path) -> None:
    assert swarmsim("study", "run", study, "--quiet", cwd=tmp_path).returncode == 2
    done = swarmsim("study", "run", study, "--allow-code", "--workers", 1, "--quiet", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "")
    status = swarmsim("study", "status", study, "--allow-code", cwd=tmp_path)
    assert status.returncode == 0, status.stderr


def test_a_fault_in_words_may_be_code_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "import msgspec\n"
        "from swarmsim.core.events import Begins\n"
        "class Curse(msgspec.Struct, frozen=True, forbid_unknown_fields=True):\n"
        "    at: int\n"
        "    def build(self, context):\n        return Cursed(self.at, context.number)\n"
        "class Cursed:\n"
        "    def __init__(self, at, number):\n        self.at, self.number = at, number\n"
        "    def install(self, parts):\n        parts.schedule.enter(self)\n        return parts\n"
        "    def advance(self, now):\n"
        "        return (Begins(now.iteration, self.number, (0,)),) if now.iteration == self.at else ()\n"
    )
    room = ROOT / "scenarios" / "room.toml"
    arguments = ("run", room, "--set", "stop.iterations=5", "--fault", "./own.py:Curse at=3", "--out", "run")
    refused = swarmsim(*arguments, cwd=tmp_path)
    assert (refused.returncode, "--allow-code" in refused.stderr) == (2, True)
    done = swarmsim(*arguments, "--allow-code", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "iteration 3: Curse: robot 0" in done.stdout
    assert Scene(Recording(tmp_path / "run")).at(4).marks == ["fault", "", ""]
