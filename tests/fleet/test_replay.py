"""A robot on a desk: it lives through what it sensed and heard in a recorded run."""

from __future__ import annotations

import copy
import time
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
from swarmsim.fleet import robot_command
from swarmsim.fleet.adapter import Adapter, RobotBody
from swarmsim.fleet.diary import Diary, replayed
from swarmsim.fleet.transport import LinkError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the run `run`, and robot 1's diary of it, `diary`."""
    found = tmp_path_factory.mktemp("replay")
    keys = {"stop.iterations": 25, "localisation.use": "odometry"}
    sw.run(ROOT / "scenarios" / "room.toml", out=found / "run", overrides=keys)
    assert sw.open(found / "run").replay(id_=1, out=found / "diary").equal
    return found


def test_a_robot_does_again_what_it_did(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done = CliRunner().invoke(app, ["robot", "replay", str(folder / "run"), "--id", "0"])
    assert done.exit_code == 0
    assert "run: robot 0: equal in all 25 iterations; " in done.output
    assert robot_command.main(["replay", str(folder / "diary")]) == 0
    assert capsys.readouterr().out.startswith(f"{folder / 'diary'}: robot 1: equal in all 25 iterations; ")


@pytest.mark.parametrize(("key", "what"), [("said", "what it says"), ("deeds", "what it does or reports")])
def test_another_decision_is_told(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str, what: str
) -> None:
    diary = Diary.open(folder / "diary")
    entries = getattr(diary, key)
    entries[7], entries[8] = entries[8], entries[7]
    assert replayed(diary, "diary").difference == f"iteration 7, {what}"
    diary.write(tmp_path / "diary")
    assert robot_command.main(["replay", str(tmp_path / "diary")]) == robot_command.DIFFERENT
    assert capsys.readouterr().out.endswith(f"diary: robot 1: different: iteration 7, {what}\n")


def test_what_it_heard_matters(folder: Path) -> None:
    diary = Diary.open(folder / "diary")
    heard = next(iteration for iteration, frames in enumerate(diary.heard) if frames)
    deaf = copy.deepcopy(diary)
    deaf.heard[heard:] = [[] for _ in diary.heard[heard:]]
    assert not replayed(deaf, "diary").equal


def test_a_recording_of_another_run_is_refused(folder: Path) -> None:
    run = sw.open(folder / "run")
    told = msgspec.structs.replace(run.recording.scenario, seed=77)
    run.recording.scenario = told
    with pytest.raises(InputError, match=r"run: simulated again it is different \(iteration 0, field "):
        run.replay(id_=1)
    with pytest.raises(InputError, match=r"--id 9: .*run has robots 0 to "):
        run.replay(id_=9)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"no diary", r"is no diary \(.*\); expected what `swarmsim robot replay --out` writes"),
        (msgspec.msgpack.encode({"charge": b""}), "the diary's charge: is no charge of a robot"),
        (msgspec.msgpack.encode({"charge": b"", "version": 2}), "is no diary"),
    ],
)
def test_what_is_no_diary_is_refused(tmp_path: Path, content: bytes, told: str) -> None:
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(InputError, match=told):
        Diary.open(tmp_path / "x")


def test_a_diary_cut_short_or_garbled_is_refused(folder: Path, tmp_path: Path) -> None:
    diary = Diary.open(folder / "diary")
    diary.sensed.pop()
    diary.write(tmp_path / "short")
    with pytest.raises(InputError, match="short: has lists of several lengths"):
        Diary.open(tmp_path / "short")
    diary = Diary.open(folder / "diary")
    diary.ears[3] = diary.ears[3][:-1]
    with pytest.raises(InputError, match=r"x: iteration 3: .*; expected what a run has told"):
        replayed(diary, "x")


def desk(file: Path, robot: int = 1, pace: float = 1.0) -> RobotBody:
    return Part[Adapter]("adapter", {"use": "replay", "file": str(file), "pace": pace}).build(None).open(robot)


def test_a_body_on_a_desk_feels_what_the_robot_sensed(folder: Path) -> None:
    body, recording = desk(folder / "diary"), sw.open(folder / "run").recording
    felt = body.sense()  # in its first second
    assert felt.pose == tuple(recording["believed"][0, 1].tolist())
    assert felt.values["tiles.values"] == tuple(recording["tiles"][0, 1].ravel().tolist())
    body.drive(0.1, 0.2)
    body.stop()
    assert body.commands == [(0.1, 0.2), (0.0, 0.0)]
    hurried, poses = desk(folder / "diary", pace=100.0), set()
    with pytest.raises(LinkError, match="the run has ended, after 25 iterations"):  # noqa: PT012
        while True:
            poses.add(hurried.sense().pose)
            time.sleep(0.001)
    assert 10 <= len(poses) <= 25
    assert poses <= {tuple(one.tolist()) for one in recording["believed"][:, 1]}
    assert np.isfinite(sorted(poses)).all()


def test_a_diary_of_another_robot_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"adapter replay: .*diary is of robot 1; expected one of robot 2"):
        desk(folder / "diary", robot=2)


def test_a_diary_runs_no_code_unless_told_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text(
        f"import pathlib\npathlib.Path({str(tmp_path / 'ran')!r}).touch()\n"
        "from swarmsim.operations.mapping.computation import OccupancyGrid\nMine = OccupancyGrid\n"
    )
    keys = {"stop.iterations": 3, "mind.computation": {"use": f"{tmp_path}/mine.py:Mine"}}
    run = sw.run(ROOT / "scenarios" / "room.toml", out=tmp_path / "run", overrides=keys, allow_code=True)
    assert run.replay(id_=0, out=tmp_path / "diary", allow_code=True).equal
    (tmp_path / "ran").unlink()
    assert robot_command.main(["replay", str(tmp_path / "diary")]) == robot_command.BAD_INPUT
    assert "expected --allow-code" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()
