"""Logs of a fleet: whole up to a kill, enough to make the recording again, and a check on every robot."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from conftest import ROOT
from fleet.crews import fleet_of, free_fleet, in_threads

import swarmsim as sw
from swarmsim.api.fleets import fleet_merge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER
from swarmsim.fleet import diaries, logbook, merging, remembered, wire
from swarmsim.fleet.logbook import Logbook, entries
from swarmsim.fleet.wire import Telegram
from swarmsim.recording.digests import Digests

ROOM = ROOT / "scenarios" / "room.toml"
N = 16


@pytest.fixture(scope="module")
def lockstep(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Logs of a run in lockstep, and its digest."""
    return flown(fleet_of(ROOM, iterations=N), tmp_path_factory.mktemp("lockstep"))


@pytest.fixture(scope="module", params=["simulated", "real"])
def free(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The same at a free pace."""
    fleet = free_fleet(ROOM, pace=15.0, links=request.param, iterations=N)
    return flown(fleet, tmp_path_factory.mktemp(request.param))


def flown(fleet, folder: Path) -> tuple[Path, str]:
    digests = Digests()
    with in_threads(fleet, str(folder), folder):
        fleet.run.simulation.run([digests])
    return folder, digests.total()


def again(folder: Path) -> tuple[str, str, int]:
    digests = Digests()
    lacks = merging.replayed(folder).simulate([digests])
    return lacks, digests.total(), len(digests.rows)


def test_logs_of_a_run_in_lockstep_make_its_recording(lockstep: tuple[Path, str]) -> None:
    folder, digest = lockstep
    assert again(folder) == ("", digest, N)


def test_so_do_those_of_a_free_run_whatever_was_late(free: tuple[Path, str]) -> None:
    folder, digest = free
    assert again(folder) == ("", digest, N)


def test_one_log_cut_short_is_told(lockstep: tuple[Path, str], tmp_path: Path) -> None:
    shutil.copytree(lockstep[0], tmp_path, dirs_exist_ok=True)
    cut = tmp_path / "robot-1.log"
    os.truncate(cut, cut.stat().st_size * 6 // 10)
    done = fleet_merge(tmp_path, tmp_path / "merged")
    whole = max(merging.Kept.of(cut).deeds) + 1
    assert 4 < whole < N
    assert done.lacks == f"{cut} holds {whole} iterations, not {whole}"
    assert done.run.summary["iterations"] == whole
    cut.unlink()
    assert again(tmp_path) == ("robot 1 has no log", Digests().total(), 0)


def test_every_decision_follows_from_the_log_of_its_robot(free: tuple[Path, str]) -> None:
    found = merging.checked(free[0])
    assert found.problems == ()
    assert found.iterations >= 3 * N - 6  # on a busy machine robots miss some
    assert found.heard > N


def rewritten(path: Path, change) -> None:
    """Write a log again, with some entries changed, or left out where the change is None."""
    before = list(entries(path))
    path.unlink()
    book = Logbook(path)
    for entry in before:
        if (data := change(entry)) is not None:
            book.note(entry.kind, data)
    book.close()


def test_what_was_not_said_cannot_have_been_heard(free: tuple[Path, str], tmp_path: Path) -> None:
    shutil.copytree(free[0], tmp_path, dirs_exist_ok=True)
    heard = [entry.data for entry in entries(tmp_path / "robot-0.log") if entry.kind == logbook.HEARD]
    sender, sent = HEADER.unpack_from(heard[len(heard) // 2])

    def without(entry):
        told = Telegram.read(entry.data) if entry.kind == wire.SAID else None
        return None if told is not None and told.iteration == sent else entry.data

    rewritten(tmp_path / f"robot-{sender}.log", without)
    problems = merging.checked(tmp_path).problems
    assert any(f"it heard what robot {sender} has not said in iteration {sent}" in one for one in problems)


def test_what_a_robot_cannot_have_decided_is_found(free: tuple[Path, str], tmp_path: Path) -> None:
    shutil.copytree(free[0], tmp_path, dirs_exist_ok=True)

    def elsewhere(entry):
        if entry.kind != wire.SENSED or Telegram.read(entry.data).iteration != 5:
            return entry.data
        told = Telegram.read(entry.data)
        tiles = next(n for n, one in enumerate(told.arrays) if one.shape == (6, 7))
        arrays = [one.copy() for one in told.arrays]
        arrays[tiles][:] = 3 - arrays[tiles] if arrays[tiles].any() else 1
        arrays[tiles][arrays[tiles] == 3] = 0
        return Telegram(told.kind, told.robot, told.iteration, tuple(arrays)).packed()

    rewritten(tmp_path / "robot-2.log", elsewhere)
    problems = merging.checked(tmp_path).problems
    assert any(one.startswith("robot 2, iteration 5: it said what does not follow") for one in problems)


def test_robots_logs_alone_make_a_recording_that_says_what_is_absent(
    lockstep: tuple[Path, str], tmp_path: Path
) -> None:
    shutil.copytree(lockstep[0], tmp_path / "logs")
    (tmp_path / "logs" / "world.log").unlink()
    with pytest.raises(InputError, match="holds no log of a world; expected --scenario"):
        fleet_merge(tmp_path / "logs", tmp_path / "none")
    limit = f'stop={{iterations={N}, when_done="continue"}}'
    done = fleet_merge(tmp_path / "logs", tmp_path / "merged", scenario=ROOM, overrides=[limit])
    assert done.lacks == ""
    assert done.run.summary["absent"][0] == "true poses"
    live = sw.run(ROOM, overrides=[limit])
    assert done.run.recording["pose"].tolist() == live.recording["pose"].tolist()
    assert done.run.summary["measures"]["coverage"] == live.summary["measures"]["coverage"]
    assert done.run.summary["messages"] == live.summary["messages"]
    with pytest.raises(InputError, match="in another scenario or under another number"):
        fleet_merge(tmp_path / "logs", tmp_path / "other", scenario=ROOM)
    (tmp_path / "logs" / "robot-2.log").unlink()
    fewer = fleet_merge(tmp_path / "logs", tmp_path / "fewer", scenario=ROOM, overrides=[limit])
    assert fewer.run.recording["alive"].all(axis=0).tolist() == [True, True, False]


def test_clocks_are_compared_by_the_frames_that_were_heard(lockstep: tuple[Path, str], tmp_path: Path) -> None:
    shutil.copytree(lockstep[0], tmp_path, dirs_exist_ok=True)
    before = remembered.offsets(merging.robots_in(tmp_path))
    assert max(map(abs, before.values())) < 0.05
    path, ahead = tmp_path / "robot-1.log", 3_000_000_000
    kept = list(entries(path))
    head = path.read_bytes()[: len(logbook._MARK)]
    path.write_bytes(
        head + b"".join(logbook._HEAD.pack(one.kind, one.when + ahead, len(one.data)) + one.data for one in kept)
    )
    after = remembered.offsets(merging.robots_in(tmp_path))
    assert after[1] - before[1] == pytest.approx(3.0)
    assert after[2] == before[2]


def test_a_log_goes_on_after_an_entry_that_was_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    book = Logbook(path)
    book.note(1, b"first")
    book.flush()
    book.note(2, b"second")
    book.close()
    os.truncate(path, path.stat().st_size - 3)
    assert [entry.data for entry in entries(path)] == [b"first"]
    book = Logbook(path)
    book.note(3, b"third")
    book.close()
    assert [(entry.kind, entry.data) for entry in entries(path)] == [(1, b"first"), (3, b"third")]
    (tmp_path / "b.log").write_bytes(b"something else")
    with pytest.raises(InputError, match="is no log of a fleet's process"):
        list(entries(tmp_path / "b.log"))


def test_a_robot_begins_with_what_its_log_says(lockstep: tuple[Path, str]) -> None:
    path = lockstep[0] / "robot-0.log"
    charge = fleet_of(ROOM, iterations=N).charges()[0]
    robot = diaries.recalled(path, charge)
    assert robot is not None
    through = diaries.Again(path)
    for one in diaries.lives(path):
        through.lived(one)
    last = list(diaries.lives(path))[-1]
    sensed = wire.sensed_of(Telegram.read(last.sensed.data), robot.context.channels, robot.context.actuators)
    assert robot.sense(sensed) == through.robot.sense(sensed)
    assert diaries.recalled(path.with_name("none.log"), charge) is None
    assert diaries.recalled(lockstep[0] / "robot-1.log", charge) is None  # another one's
