"""Logs of robots that exist become recordings, which are shown, measured and compared like any other."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from typer.testing import CliRunner

import swarmsim as sw
from swarmsim.cli import app
from swarmsim.core.errors import InputError

ROOM = ROOT / "scenarios" / "room.toml"
POSE, MESSAGE = ["time", "robot", "x", "y", "yaw"], ["time", "sender", "receiver", "bytes"]


@pytest.fixture(scope="module")
def run() -> sw.Run:
    return sw.run(ROOM, overrides={"stop.iterations": 30, "task": {"use": "travelled", "distance": 100.0}})


def table(path: Path, names: list[str], rows: list[list[float]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([names, *rows])
    return path


def logged(run: sw.Run, folder: Path) -> tuple[Path, Path]:
    """The run as a log that begins at 100 s, with poses every half second, the second of a pair half-way."""
    recording, rows = run.recording, []
    for now, (before, after) in enumerate(zip(recording["pose"], recording["pose"][1:], strict=False)):
        for robot in range(3):
            middle = 0.5 * (before[robot] + after[robot])
            rows += [[100.0 + now, robot, *before[robot]], [100.5 + now, robot, *middle]]
    rows += [[100.0 + 29, robot, *recording["pose"][29, robot]] for robot in range(3)]
    letters = [
        [100.2 + sent, sender, receiver, size]
        for now in range(30)
        for receiver, sender, sent, size, fate in recording.letters(now).tolist()
        if fate == 0
    ]
    return table(folder / "poses.csv", POSE, rows[::-1]), table(folder / "messages.csv", MESSAGE, letters)


def test_a_log_becomes_a_recording(run: sw.Run, tmp_path: Path) -> None:
    found = sw.import_log(ROOM, logged(run, tmp_path), tmp_path / "real").run
    recording = found.recording
    assert found.iterations == 30
    assert recording["pose"][..., :2] == pytest.approx(run.recording["pose"][..., :2])
    assert recording["alive"].all()
    for now in range(30):
        assert recording.letters(now).tolist() == run.recording.letters(now).tolist()
    assert found.measures["travelled"] == pytest.approx(run.measures["travelled"])
    assert "tiles" not in recording  # which nobody has logged
    assert "changes" not in recording
    assert np.isnan(recording["goals"]).all()


def test_what_looks_at_runs_copes_with_what_is_absent(run: sw.Run, tmp_path: Path) -> None:
    found = sw.import_log(ROOM, logged(run, tmp_path), tmp_path / "real").run
    assert found.summary["status"] == "not finished"
    assert {**found.network().numbers, "title": ""} == {**run.network().numbers, "title": ""}
    assert found.report(tmp_path / "page.html", beside=run).exists()
    assert found.picture(20, (480, 270)).shape == (270, 480, 3)
    done = CliRunner().invoke(app, ["compare", str(run.path), str(found.path)])
    assert done.exit_code == 0, done.output
    assert not found.verify().equal  # it was never simulated


def test_the_bag_of_a_run_is_read_as_a_log(run: sw.Run, tmp_path: Path) -> None:
    run.export(ros2=tmp_path / "bag")
    found = sw.import_log(ROOM, [tmp_path / "bag"], tmp_path / "real").run
    assert found.recording["pose"][..., :2] == pytest.approx(run.recording["pose"][..., :2])
    assert np.unwrap(found.recording["pose"][..., 2], axis=0) - found.recording["pose"][0, :, 2] == pytest.approx(
        np.unwrap(run.recording["pose"][..., 2], axis=0) - run.recording["pose"][0, :, 2], abs=1e-9
    )


def test_a_robot_is_there_while_it_is_logged(tmp_path: Path) -> None:
    rows = [[now, 0, 1.0, 1.0, 0.0] for now in range(40)] + [[now, 1, 2.0, 1.0, 0.0] for now in range(20, 25)]
    found = sw.import_log(ROOM, [table(tmp_path / "x.csv", POSE, rows)], tmp_path / "real").run
    assert found.recording["alive"][:, 0].all()
    assert np.flatnonzero(found.recording["alive"][:, 1]).tolist() == list(range(15, 30))


@pytest.mark.parametrize(
    ("names", "rows", "told"),
    [
        (
            ["a", "b"],
            [],
            r"x\.csv: columns a, b; expected time, robot, x, y, yaw, or time, sender, receiver, bytes, or",
        ),
        (POSE, [[0, 0, "here", 0, 0]], r"x\.csv: line 2: could not convert .*; expected numbers"),
        (POSE, [[0, 0, 1, 1, 0], [1, 0, "nan", 1, 0]], r"x\.csv: line 3: 1, 0, nan, 1, 0; expected 5 finite numbers"),
        (POSE, [], r"x\.csv: no pose in it; expected where robots were"),
        (POSE, [[0, 0, 500, 1, 0]], r"robot 0 is at \(500, 1\) m after 0 s, off the page of .*; expected poses in"),
        (POSE, [[0, -1, 1, 1, 0]], r"robot -1 in the log; expected 0 to 9999"),
        (
            POSE,
            [[0, 0, 1, 1, 0], [1e9, 0, 1, 1, 0]],
            "the log has 1000000001 periods of 1 s; expected 1000000",
        ),
        (
            POSE,
            [[0, 0, 1, 1, 0], [1, 0.5, 1, 1, 0]],
            r"line 3: 1, 0\.5, 1, 1, 0; expected whole numbers of robots",
        ),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, names: list[str], rows: list[list[float]], told: str) -> None:
    with pytest.raises(InputError, match=told):
        sw.import_log(ROOM, [table(tmp_path / "x.csv", names, rows)], tmp_path / "real")
    assert not (tmp_path / "real").exists()


def test_a_message_of_nobody_is_refused(run: sw.Run, tmp_path: Path) -> None:
    poses, _ = logged(run, tmp_path)
    messages = table(tmp_path / "strange.csv", MESSAGE, [[101.0, 0, 7, 21]])
    with pytest.raises(InputError, match="robot 7 sends or hears a message, and has no pose; expected 0 to 2"):
        sw.import_log(ROOM, [poses, messages], tmp_path / "real")


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"no bag")
    with pytest.raises(InputError, match=r"x\.mcap: .*; expected a rosbag2 folder, an MCAP file, or \.csv"):
        sw.import_log(ROOM, [tmp_path / "x.mcap"], tmp_path / "real")
