"""The Python interface: the same bytes as the command line, cheap to import, typed, and at home in a notebook."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import av
import nbformat
import numpy as np
import pytest
from conftest import ROOT
from nbclient import NotebookClient

import swarmsim as sw
from swarmsim.recording.reader import Recording

pytestmark = pytest.mark.usefixtures("no_workers")
ROOM = ROOT / "scenarios" / "room.toml"


@pytest.fixture(scope="module")
def run() -> sw.Run:
    return sw.run(ROOM, seed=5, overrides={"robots.count": 4, "network.topology": {"use": "ring"}})


def test_importing_is_cheap_and_everything_named_is_there() -> None:
    heavy = ("numpy", "numba", "pygame", "matplotlib", "pymunk", "dask", "pandas")
    code = f"import sys, swarmsim; assert not set({heavy}) & set(sys.modules); print(sorted(swarmsim.__all__))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(sorted(sw.__all__))
    for name in sw.__all__:
        assert getattr(sw, name).__doc__
    assert set(sw.__all__) < set(dir(sw))
    with pytest.raises(AttributeError, match="module 'swarmsim' has no attribute 'fly'"):
        sw.fly  # noqa: B018


def test_algebra_takes_one_thread_unless_told_otherwise() -> None:
    code = (
        "import swarmsim, numpy, threadpoolctl; print({one['num_threads'] for one in threadpoolctl.threadpool_info()})"
    )
    for told, threads in ({}, "{1}"), ({"OPENBLAS_NUM_THREADS": "2"}, "{1}" if os.cpu_count() == 1 else "{2}"):
        others = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
        done = subprocess.run(
            [sys.executable, "-c", code], env=others | told, capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == threads


def test_a_run_is_that_of_the_command_line(run: sw.Run, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "swarmsim", "run", str(ROOM), "--seed", "5", "--set", "robots.count=4", "--set"]
    command += ['network.topology={use="ring"}', "--out", str(tmp_path / "run"), "--quiet"]
    assert subprocess.run(command, check=False).returncode == 0
    again = sw.open(tmp_path / "run")
    assert again.recording.digest() == run.recording.digest()
    assert again.summary == run.summary
    assert run.finished
    moments = list(sw.simulate(ROOM, seed=5, overrides={"robots.count": 4, "network.topology": {"use": "ring"}}))
    assert [moment.measured.values["coverage"] for moment in moments] == run.measures["coverage"].tolist()


def test_curves_and_frames_have_units(run: sw.Run) -> None:
    assert run.curve()[-1] == pytest.approx(100.0)
    assert len(run.curve()) == run.iterations
    frame = run.frame()
    assert list(frame.columns) == [
        "iteration", "time (s)", "coverage (%)", "progress (%)", "robots alive", "messages",
    ]  # fmt: skip
    assert len(frame) == run.iterations
    assert frame["coverage (%)"].iloc[-1] == pytest.approx(100.0)
    assert (frame["robots alive"] == 4).all()


def test_plots_films_and_pictures(run: sw.Run, tmp_path: Path) -> None:
    axes = run.plot().axes[0]
    assert axes.get_ylabel() == "coverage, %"
    np.testing.assert_allclose(axes.lines[0].get_ydata()[-1], 100.0)
    with av.open(str(run.film(tmp_path / "x.mp4", size=(480, 270), speed=100.0))) as film:
        assert sum(1 for _ in film.decode(video=0)) > 60
    assert run.picture(0, (480, 270)).shape == (270, 480, 3)


def test_a_run_shows_itself(run: sw.Run) -> None:
    assert repr(run) == f"<Run {run.recording.scenario.title!r}: finished after {run.iterations} iterations, " + (
        "coverage (%) 100.0>"
    )
    page = run._repr_html_()
    assert page.count("<img") == 1
    assert "data:image/png;base64," in page
    assert "<td>finished</td>" in page
    strange = sw.run(ROOM, overrides={"title": "<script>", "stop.iterations": 3})
    assert "<script>" not in strange._repr_html_()


def test_a_temporary_recording_goes_with_its_run_and_another_stays(tmp_path: Path) -> None:
    brief = sw.run(ROOM, overrides={"stop.iterations": 3})
    path = brief.recording.path
    assert path.exists()
    assert not brief.finished
    del brief
    assert not path.exists()
    sw.run(ROOM, overrides={"stop.iterations": 3}, out=tmp_path / "kept")
    assert Recording(tmp_path / "kept").iterations == 3
    with pytest.raises(sw.InputError, match="kept: exists already; expected a new folder"):
        sw.run(ROOM, out=tmp_path / "kept")


def test_what_cannot_work_is_told(tmp_path: Path) -> None:
    with pytest.raises(sw.InputError, match=r"room\.toml: robots\.cont: unknown key; did you mean 'count'"):
        sw.run(ROOM, overrides={"robots.cont": 3})
    with pytest.raises(sw.InputError, match=r"room\.toml: robots\.count is 3, not a table"):
        sw.run(ROOM, overrides={"robots.count.x": 3})
    with pytest.raises(sw.InputError, match="no such recording"):
        sw.open(tmp_path / "nothing")
    (tmp_path / "mine.py").write_text("def still(observations):\n    return 1 / 0\n")
    mine = {"mind.strategy": {"use": f"{tmp_path}/mine.py:still"}}
    with pytest.raises(sw.InputError, match="allow_code=True"):
        next(sw.simulate(ROOM, overrides=mine))
    with pytest.raises(sw.PartError, match=r"strategy mine\.py:still, iteration 0: ZeroDivisionError"):
        next(sw.simulate(ROOM, overrides=mine, allow_code=True))


STUDY = """
title = "Two networks"
scenario = "{room}"
seeds = 2
[[vary]]
key = "network.topology.k"
values = [0, 2]
"""


def test_a_study_does_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(STUDY.format(room=ROOM))
    done = sw.study(path, store=tmp_path / "two.sqlite", workers=1)
    assert repr(done) == "<StudyRun 'Two networks': 4 runs of 2 conditions>"
    assert [d.n for d in done.describe().values()] == [2, 2]
    assert len(done.frame()) == 4
    assert len(done.curves("k=0")) == 2
    assert {path.suffix for path in done.plot(tmp_path / "figures", "path_sum")} == {
        ".png",
        ".svg",
        ".md",
        ".tex",
        ".csv",
    }
    assert (tmp_path / "figures" / "path_sum.png").exists()
    assert "<td>k=2</td>" in done._repr_html_()
    more = sw.study(path, seeds=3, store=tmp_path / "two.sqlite", workers=1)
    assert [row.digest for row in more.results["k=0"].rows[:2]] == [row.digest for row in done.results["k=0"].rows]
    with pytest.raises(sw.InputError, match="is not a measure"):
        done.describe("nonsense")


@pytest.mark.thorough
def test_user_code_is_type_checked(tmp_path: Path) -> None:
    assert (ROOT / "swarmsim" / "py.typed").exists()
    (tmp_path / "user.py").write_text(
        "import swarmsim as sw\n"
        "run = sw.run('x.toml', seed=3)\n"
        "a: float = float(run.curve()[-1])\n"
        "b: str = run.finished\n"
        "for moment in sw.simulate('x.toml'):\n"
        "    c: int = moment.state.iteration\n"
        "sw.run('x.toml', sede=3)\n"
    )
    known = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
    command = [sys.executable, "-m", "mypy", "--strict", *known, "user.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    wrong = [line for line in done.stdout.splitlines() if "error" in line and "user.py" in line]
    assert [line.split(":")[1] for line in wrong] == ["4", "7"], done.stdout


@pytest.mark.thorough
def test_the_listing_of_the_page_runs(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "python.md").read_text()
    (code,) = [block.partition("```")[0] for block in page.split("```python\n")[1:]]
    for name in ("scenarios", "worlds"):
        (tmp_path / name).symlink_to(ROOT / name)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "finished after" in done.stdout
    assert (tmp_path / "room.gif").exists()
    assert (tmp_path / "curve.png").exists()


@pytest.mark.thorough
def test_the_notebook_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")
    notebook = nbformat.read(ROOT / "docs" / "swarmsim.ipynb", as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells)
    folder = {"metadata": {"path": str(ROOT / "docs")}}
    NotebookClient(notebook, timeout=None, startup_timeout=3600, resources=folder).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("data:image/png" in output.get("data", {}).get("text/html", "") for output in shown)
    assert not any(output["output_type"] == "error" for output in shown)
