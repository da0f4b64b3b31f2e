"""Figures of runs, found by name: ours and those in files, in one list, drawn and failing under their names."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, called, made
from matplotlib.figure import Figure

import swarmsim as sw
from swarmsim.core.errors import InputError, PartError
from swarmsim.recording.reader import Recording

MINE = """
import msgspec
from matplotlib.figure import Figure

def spread(recording, *, robot: int = 0, fails: str = ""):
    "How far a robot is from the middle of the swarm."
    if fails == "raises":
        raise RuntimeError("no ink left")
    if fails == "gives":
        return [1, 2]
    pose = recording["pose" if fails != "reads" else "poses"][..., :2]
    figure = Figure()
    axes = figure.subplots()
    axes.plot(((pose[:, robot] - pose.mean(axis=1)) ** 2).sum(axis=1) ** 0.5)
    if fails == "draws":
        figure.suptitle("$\\\\frac$", parse_math=True)
    return figure

class Places(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    "Where robots are at the end."
    marker: str = "x"

    def draw(self, recording):
        figure = Figure()
        figure.subplots().plot(*recording["pose"][-1, :, :2].T, self.marker)
        return figure
"""
OURS = {
    "curve": {},
    "local-maps": {"robots": [0, 1], "at": 5},
    "network": {"at": 2, "and": 9},
    "network-measures": {"shows": "degrees", "from": 2},
    "provenance": {"robot": 1},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> sw.Run:
    folder = tmp_path_factory.mktemp("figures")
    (folder / "mine.py").write_text(MINE)
    simulated = made("stop.iterations=12")
    with simulated.recorder(folder / "recording.h5") as recorder:
        simulated.simulation.run([recorder])
    return sw.Run(Recording(folder))


def own(run: sw.Run, name: str = "spread") -> str:
    return f"{run.recording.path.parent}/mine.py:{name}"


def test_ours_are_all_in_the_list_and_can_all_be_drawn(run: sw.Run) -> None:
    assert {part.name for part in sw.parts("figure")} == set(OURS)
    for name, keys in OURS.items():
        assert isinstance(run.plot(name, overrides=keys), Figure), name


def test_a_verb_of_a_figure_draws_what_its_name_draws(run: sw.Run, tmp_path: Path) -> None:
    png, svg = run.figure("local-maps", tmp_path / "one", overrides=["robots=[0, 1]", "at=5"])
    again = run.figure_local_maps([0, 1], 5, tmp_path / "two")
    assert [path.read_bytes() for path in (png, svg)] == [path.read_bytes() for path in again]
    changed = run.figure_network(2, 9)
    assert {path.name for path in changed} == {"network-2-9.png", "network-2-9.svg"}
    assert changed[0].read_bytes() == run.figure("network", overrides=OURS["network"])[0].read_bytes()


def test_a_function_and_a_struct_in_a_file_are_figures_with_keys(run: sw.Run, tmp_path: Path) -> None:
    figure = run.plot(own(run), overrides={"robot": 2}, allow_code=True)
    other = run.plot(own(run), allow_code=True)
    one, two = (each.axes[0].lines[0].get_ydata() for each in (figure, other))
    assert len(one) == 12
    assert (one != two).any()
    assert not figure.axes[0].spines["top"].get_visible()  # in the style of ours
    crosses = run.plot(own(run, "Places"), overrides=["marker=+"], allow_code=True)
    assert crosses.axes[0].lines[0].get_marker() == "+"
    files = [run.figure(own(run), tmp_path / stem, allow_code=True) for stem in "ab"]
    assert [path.read_bytes() for path in files[0]] == [path.read_bytes() for path in files[1]]


def test_the_command_line_draws_it_from_the_folder_that_it_stands_in(run: sw.Run) -> None:
    folder = run.recording.path.parent
    asked = ["plot", ".", "--figure", "./mine.py:spread"]
    done = called(*asked, "--set", "robot=1", "--allow-code", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["spread.png", "spread.svg"]
    assert (folder / "spread.png").stat().st_size > 10_000
    refused = called(*asked, cwd=folder)
    assert (refused.returncode, "--allow-code" in refused.stderr) == (2, True)
    failed = called(*asked, "--set", "fails=raises", "--allow-code", cwd=folder)
    assert failed.returncode == 3
    assert re.search(
        r"figure .*mine\.py:spread: RuntimeError: no ink left\n.*mine\.py, line 8, in spread", failed.stderr
    )


@pytest.mark.parametrize(
    ("name", "keys", "words"),
    [
        ("nope", {}, r"--figure nope: no figure is called 'nope'; known: curve, local-maps, network"),
        ("netwrk", {}, r"did you mean 'network'\?"),
        ("local-maps", {}, r"--figure local-maps: robots, at: required keys are missing"),
        (
            "local-maps",
            {"robots": [0, 99], "at": 1},
            r"robots 0,99: no robot 99 in the run; expected numbers from 0 to",
        ),
        ("network", {"at": 1, "and": 40}, r"--figure network: and 40: no such iteration; expected 0 to 11"),
        ("network", {"at": 1, "amd": 4}, r"amd: unknown key; did you mean 'and'\?"),
        ("curve", ["wide"], r"--set wide: expected key=value"),
        ("curve", ["wide=[1"], r"--set wide=\[1: '\[1' is not a TOML value"),
    ],
)
def test_unknown_names_and_keys_are_told_with_what_would_be_right(
    run: sw.Run, name: str, keys: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        run.plot(name, overrides=keys)


@pytest.mark.parametrize(
    ("fails", "error", "words"),
    [
        ("raises", PartError, r"^figure .*mine\.py:spread: RuntimeError: no ink left"),
        ("gives", PartError, r"mine\.py:spread: gave \[1, 2\]; expected a matplotlib\.figure\.Figure"),
        ("draws", PartError, r"mine\.py:spread: ValueError"),
        ("reads", InputError, r"mine\.py:spread: .*no table 'poses' is recorded; did you mean 'pose'\?"),
    ],
)
def test_a_figure_that_fails_is_named(run: sw.Run, fails: str, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        run.plot(own(run), overrides={"fails": fails}, allow_code=True)


def test_what_is_not_a_figure_is_refused(run: sw.Run) -> None:
    (run.recording.path.parent / "other.py").write_text("class Odd:\n    pass\n")
    path = f"{run.recording.path.parent}/other.py:Odd"
    with pytest.raises(InputError, match=r"is not a figure: expected a msgspec\.Struct .* or with draw of its own"):
        run.plot(path, allow_code=True)


def test_who_asks_what_figures_there_are_needs_no_matplotlib() -> None:
    words = "import sys; from swarmsim.core.scenario import describe; "
    words += "print(len(describe.parts('figure')), 'matplotlib' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True, cwd=ROOT)
    assert told.stdout.split() == [str(len(OURS)), "False"]
