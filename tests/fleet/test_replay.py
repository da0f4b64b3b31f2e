"""A robot on a desk: it lives through what it sensed and heard in a recorded run."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest
from conftest import ROOT
from typer.testing import CliRunner

import swarmsim as sw
from swarmsim.cli import app
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.part import Part
from swarmsim.fleet import logbook, robot_command
from swarmsim.fleet.adapter import Adapter, RobotBody
from swarmsim.fleet.diaries import replayed
from swarmsim.fleet.logbook import Logbook, LogEntry
from swarmsim.fleet.transport import LinkError
from swarmsim.fleet.wire import CHARGE, DEED, EARS, SAID, SENSED, Telegram


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the run `run`, and robot 1's log of it, `log`."""
    found = tmp_path_factory.mktemp("replay")
    keys = {"stop.iterations": 25, "localisation.use": "odometry"}
    sw.run(ROOT / "scenarios" / "room.toml", out=found / "run", overrides=keys)
    assert sw.open(found / "run").replay(id_=1, out=found / "log").equal
    return found


def test_a_robot_does_again_what_it_did(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done = CliRunner().invoke(app, ["robot", "replay", str(folder / "run"), "--id", "0"])
    assert done.exit_code == 0
    assert "run: robot 0: equal in all 25 iterations; " in done.output
    assert robot_command.main(["replay", str(folder / "log")]) == 0
    assert capsys.readouterr().out.startswith(f"{folder / 'log'}: robot 1: equal in all 25 iterations; ")


def rewritten(log: Path, out: Path, change: Callable[[int, LogEntry], bytes | None]) -> Path:
    """The log with entries changed, or left out where `change`, given the iteration, has none."""
    iteration = -1
    with closing(Logbook(out)) as book:
        for entry in logbook.entries(log):
            iteration += entry.kind == SENSED
            data = change(iteration, entry)
            if data is not None:
                book.note(entry.kind, data)
    return out


@pytest.mark.parametrize(
    ("kind", "what"),
    [
        (SAID, "it said what does not follow from what it sensed"),
        (DEED, "it decided what does not follow from what it sensed and heard"),
    ],
)
def test_another_decision_is_told(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: int, what: str
) -> None:
    kept = [Telegram.read(entry.data) for entry in logbook.entries(folder / "log") if entry.kind == kind]

    def changed(iteration: int, entry: LogEntry) -> bytes:
        if entry.kind != kind or iteration != 7:
            return entry.data
        arrays = (*kept[7].arrays[:1], *kept[8].arrays[1:])  # it has heard the same, and does something else
        return Telegram(kind, 1, 7, arrays, kept[8].pieces).packed()

    rewritten(folder / "log", tmp_path / "log", changed)
    assert robot_command.main(["replay", str(tmp_path / "log")]) == robot_command.DIFFERENT
    assert capsys.readouterr().out.endswith(f"log: robot 1: different: iteration 7, {what}\n")


def test_what_it_heard_matters(folder: Path, tmp_path: Path) -> None:
    def deafened(iteration: int, entry: LogEntry) -> bytes | None:
        return None if entry.kind == logbook.HEARD and iteration == 3 else entry.data

    with pytest.raises(InputError, match="iteration 3: it heard what has not arrived from robot "):
        replayed(rewritten(folder / "log", tmp_path / "log", deafened))


def test_a_recording_of_another_run_is_refused(folder: Path) -> None:
    run = sw.open(folder / "run")
    told = msgspec.structs.replace(run.recording.scenario, seed=77)
    run.recording.scenario = told
    with pytest.raises(InputError, match=r"run: simulated again it is different \(iteration 0, field "):
        run.replay(id_=1)
    with pytest.raises(InputError, match=r"--id 9: .*run has robots 0 to "):
        run.replay(id_=9)


def test_what_is_no_log_of_a_robot_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"no log")
    with pytest.raises(InputError, match=r"x: is no log of a fleet's process"):
        replayed(tmp_path / "x")
    without = rewritten(folder / "log", tmp_path / "y", lambda _, entry: entry.data if entry.kind != CHARGE else None)
    with pytest.raises(InputError, match=r"y: has no charge; expected the log of a robot"):
        replayed(without)


def test_a_log_cut_short_goes_as_far_as_it_is_whole_and_a_garbled_one_is_refused(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "log").read_bytes()
    (tmp_path / "short").write_bytes(whole[: len(whole) // 2])
    found = replayed(tmp_path / "short")
    assert found.equal
    assert 5 < found.iterations < 25

    def garbled(iteration: int, entry: LogEntry) -> bytes:
        return entry.data[:-1] if entry.kind == EARS and iteration == 3 else entry.data

    with pytest.raises(InputError, match=r"x: iteration 3: .*; expected a log as written"):
        replayed(rewritten(folder / "log", tmp_path / "x", garbled))


def desk(file: Path, robot: int = 1, pace: float = 1.0) -> RobotBody:
    return Part[Adapter]("adapter", {"use": "replay", "file": str(file), "pace": pace}).build(None).open(robot)


def test_a_body_on_a_desk_feels_what_the_robot_sensed(folder: Path) -> None:
    body, recording = desk(folder / "log"), sw.open(folder / "run").recording
    felt = body.sense()  # in its first second
    assert felt.pose == tuple(recording["believed"][0, 1].tolist())
    assert felt.values["tiles.values"] == tuple(recording["tiles"][0, 1].ravel().tolist())
    body.drive(0.1, 0.2)
    body.stop()
    assert body.commands == [(0.1, 0.2), (0.0, 0.0)]
    hurried, poses = desk(folder / "log", pace=100.0), set()
    with pytest.raises(LinkError, match="the run has ended, after 25 iterations"):  # noqa: PT012
        while True:
            poses.add(hurried.sense().pose)
            time.sleep(0.001)
    assert 10 <= len(poses) <= 25
    assert poses <= {tuple(one.tolist()) for one in recording["believed"][:, 1]}
    assert np.isfinite(sorted(poses)).all()


def test_a_log_of_another_robot_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"adapter replay: .*log is of robot 1; expected one of robot 2"):
        desk(folder / "log", robot=2)


def test_a_log_runs_no_code_unless_told_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text(
        f"import pathlib\npathlib.Path({str(tmp_path / 'ran')!r}).touch()\n"
        "from swarmsim.operations.mapping.computation import OccupancyGrid\nMine = OccupancyGrid\n"
    )
    keys = {"stop.iterations": 3, "mind.computation": {"use": f"{tmp_path}/mine.py:Mine"}}
    run = sw.run(ROOT / "scenarios" / "room.toml", out=tmp_path / "run", overrides=keys, allow_code=True)
    assert run.replay(id_=0, out=tmp_path / "log", allow_code=True).equal
    (tmp_path / "ran").unlink()
    assert robot_command.main(["replay", str(tmp_path / "log")]) == robot_command.BAD_INPUT
    assert "expected --allow-code" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()
