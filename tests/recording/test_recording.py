from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import ROOT, made

from swarmsim.core.errors import InputError
from swarmsim.core.events import Ended
from swarmsim.core.state import FREE, OCCUPIED, Moment
from swarmsim.operations.mapping.replay import MapReplay
from swarmsim.recording.digests import DIGESTED, Digests
from swarmsim.recording.reader import Recording
from swarmsim.recording.recorder import BLOCK


class Snapshots:
    """Keeps every map of every robot, as the reference that a replay must meet."""

    def __init__(self) -> None:
        self.maps: list[tuple[np.ndarray, np.ndarray]] = []
        self.moments: list[Moment] = []

    def sample(self, moment: Moment) -> None:
        self.moments.append(moment)
        self.maps.append((moment.knowledge.observed.copy(), moment.knowledge.log_odds.copy()))


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory):
    run = made("robots.count=4", "network.topology.k=2")
    path = tmp_path_factory.mktemp("watched") / "recording.h5"
    snapshots = Snapshots()
    with run.recorder(path) as recorder:
        run.simulation.run([recorder, snapshots])
    return run, Recording(path), snapshots


def test_everything_that_happened_reads_back(watched) -> None:
    run, recording, snapshots = watched
    assert recording.iterations == len(snapshots.moments) == run.simulation.state.iteration
    new = iter(recording.paths())
    for t, moment in enumerate(snapshots.moments):
        np.testing.assert_array_equal(recording["pose"][t], moment.state.pose)
        np.testing.assert_array_equal(recording["alive"][t], moment.state.alive)
        np.testing.assert_array_equal(recording["tiles"][t], moment.readings.tiles.values)
        np.testing.assert_array_equal(recording["origins"][t], moment.readings.tiles.origins)
        np.testing.assert_array_equal(recording["goals"][t], moment.intents.goals)
        np.testing.assert_array_equal(recording["covered"][t], moment.measured.robots["covered"])
        np.testing.assert_array_equal(recording.links(t), moment.links)
        np.testing.assert_array_equal(recording.letters(t)[:, :4], moment.delivery.heard)
        assert recording["coverage"][t] == moment.measured.values["coverage"]
        assert recording.progress[t] == moment.measured.progress
        assert recording["messages"][t] == len(moment.inbox.receivers)
        for robot in np.flatnonzero(moment.intents.planned):
            iteration, who, way = next(new)
            assert (iteration, who) == (t, robot)
            np.testing.assert_allclose(way, moment.intents.waypoints[robot, : moment.intents.counts[robot]], rtol=1e-6)
    assert next(new, None) is None
    assert recording.scenario == run.scenario
    assert recording.world == run.world
    assert recording.lattice == run.arena.lattice
    np.testing.assert_array_equal(recording["domain"], run.explorable)
    assert recording.events() == [Ended(recording.iterations - 1, True)]


def test_every_map_at_every_iteration_is_rebuilt_from_its_changes(watched) -> None:
    _, recording, snapshots = watched
    replay = MapReplay(recording)
    for t, (observed, log_odds) in enumerate(snapshots.maps):
        replay.advance(t)
        np.testing.assert_array_equal(replay.maps, np.where(observed, np.where(log_odds > 0, OCCUPIED, FREE), 0))
    with pytest.raises(ValueError, match="behind"):
        replay.advance(0)


def test_the_finished_map_equals_the_truth_on_its_domain(watched) -> None:
    _, recording, _ = watched
    replay = MapReplay(recording)
    replay.advance(recording.iterations - 1)
    domain = recording["domain"]
    believed = replay.collective()[domain] == 2
    assert (replay.collective()[domain] != 0).all()
    assert (believed == recording["truth"][domain]).mean() > 0.99


def test_the_summary_tells_when_each_share_was_reached(watched) -> None:
    _, recording, snapshots = watched
    summary = recording.summary()
    shares = [moment.measured.values["coverage"] for moment in snapshots.moments]
    assert summary["status"] == "finished"
    assert summary["reached"]["100 %"] == summary["iterations"] == len(shares)
    assert summary["reached"]["50 %"] == 1 + next(t for t, share in enumerate(shares) if share >= 0.5)
    assert summary["messages"] == 4 * 2 * len(shares)
    assert summary["digest"] == recording.digest()


def test_a_digest_changes_with_any_field(watched) -> None:
    _, recording, snapshots = watched
    digests = Digests()
    digests.sample(snapshots.moments[0])
    assert recording.difference(0, digests.rows[0], {}) is None
    for field, name in enumerate(DIGESTED):
        row = bytearray(digests.rows[0])
        row[8 * field] ^= 1
        assert recording.difference(0, bytes(row), {}) == f"iteration 0, field {name!r}"


def test_coverage_never_falls_and_counts_add_up(watched) -> None:
    _, recording, _ = watched
    assert (np.diff(recording["coverage"]) >= 0).all()
    assert (np.diff(recording["covered"], axis=0) >= 0).all()
    assert (recording["covered"].max(axis=1) <= recording["coverage"]).all()


KILLED = """
import sys, os, signal
sys.path.insert(0, {tests!r})
from conftest import made
run = made("robots.count=2", "task.share=1.0", "network.topology={{use='none'}}", "robots.speed=0.01")
recorder = run.recorder({path!r})
for _ in range({ticks}):
    run.simulation.tick([recorder])
print("ticked", flush=True)
{end}
"""


@pytest.mark.parametrize("ticks", [BLOCK - 1, 2 * BLOCK + 5])
def test_a_killed_run_opens_up_to_its_last_flush(tmp_path: Path, ticks: int) -> None:
    path = tmp_path / "recording.h5"
    end = "os.kill(os.getpid(), signal.SIGKILL)"
    code = KILLED.format(tests=str(ROOT / "tests"), path=str(path), ticks=ticks, end=end)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    recording = Recording(path)
    assert recording.iterations == ticks // BLOCK * BLOCK
    assert len(recording["pose"]) == recording.iterations
    assert recording.summary()["status"] == "interrupted"


def test_goals_of_older_recordings_are_cells_and_read_as_their_middles(tmp_path: Path) -> None:
    run = made("stop.iterations=6", 'mind.strategy={use="nearest-frontier"}')
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    points = Recording(tmp_path)["goals"]
    assert np.isfinite(points).any()
    with h5py.File(tmp_path / "recording.h5", "a") as file:
        del file["goals"]
        file["goals"] = cells = run.arena.lattice.cells_within(points)
    found = Recording(tmp_path)["goals"]
    np.testing.assert_array_equal(found, points)
    with h5py.File(tmp_path / "recording.h5", "a") as file:
        file["goals"][0, 0] = run.arena.lattice.rows, 0
    with pytest.raises(InputError, match="table 'goals' has invalid numbers"):
        Recording(tmp_path)["goals"]
    with h5py.File(tmp_path / "recording.h5", "a") as file:
        del file["goals"]
        file["goals"] = cells.astype(np.int64)
    with pytest.raises(InputError, match="table 'goals' is int64"):
        Recording(tmp_path)


def test_a_run_that_goes_on_is_told_from_one_that_was_killed(tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    code = KILLED.format(tests=str(ROOT / "tests"), path=str(path), ticks=BLOCK, end="sys.stdin.read()")
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ticked\n"
    assert Recording(path).summary()["status"] == "under way"
    assert Recording(path).summary()["status"] == "under way"  # looking has changed nothing
    process.kill()
    process.communicate()
    assert Recording(path).summary()["status"] == "interrupted"


@pytest.mark.skipif(sys.platform != "linux", reason="locks of open files are Linux's")
def test_without_locks_it_is_not_told_whether_a_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.fcntl", refused)
    run = made("robots.count=2", "robots.speed=0.01")
    with run.recorder(tmp_path / "recording.h5") as recorder:
        for _ in range(BLOCK):
            run.simulation.tick([recorder])
        assert Recording(tmp_path).summary()["status"] == "under way or interrupted"
        assert Recording(tmp_path, recorder.file).summary()["status"] == "under way"
    assert Recording(tmp_path).summary()["status"] == "interrupted"  # it was closed


@pytest.mark.thorough
def test_a_run_killed_at_any_moment_leaves_a_readable_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for trial in range(4):
        path = tmp_path / f"{trial}.h5"
        code = KILLED.format(tests=str(ROOT / "tests"), path=str(path), ticks=10**6, end="")
        process = subprocess.Popen([sys.executable, "-c", code])
        while not path.exists() or path.stat().st_size < 20_000:
            assert process.poll() is None
            time.sleep(0.05)
        time.sleep(rng.uniform(0.0, 0.5))
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        recording = Recording(path)
        whole = recording.iterations
        assert whole % BLOCK == 0
        assert len(recording["tiles"]) == len(recording["links_end"]) == whole
        if whole:
            MapReplay(recording).advance(whole - 1)


def test_a_truncated_recording_is_refused(room: Path, tmp_path: Path) -> None:
    whole = room.read_bytes()
    rng = np.random.default_rng(0)
    for size in [0, 1, 100, 2000, *rng.integers(0, len(whole), 20), len(whole) - 1]:
        cut = tmp_path / "cut.h5"
        cut.write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"cut\.h5.*expected|cut\.h5: format"):
            Recording(cut)


def test_flipped_bytes_give_a_refusal_or_a_recording_but_no_traceback(room: Path, tmp_path: Path) -> None:
    whole = bytearray(room.read_bytes())
    rng = np.random.default_rng(1)
    for _ in range(60):
        broken = whole.copy()
        for at in rng.integers(0, len(whole), 30):
            broken[at] ^= 0xFF
        path = tmp_path / "broken.h5"
        path.write_bytes(broken)
        with suppress(InputError):  # anything else fails this test
            assert Recording(path).summary()["iterations"] >= 0


def test_another_format_or_another_file_is_refused(room: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.h5"
    other.write_bytes(room.read_bytes())
    with h5py.File(other, "r+") as file:
        file.attrs["swarmsim-recording"] = 99
    with pytest.raises(InputError, match=r"format 99.*reads format 4"):
        Recording(other)
    plain = tmp_path / "plain.h5"
    with h5py.File(plain, "w") as file:
        file["x"] = [1]
    with pytest.raises(InputError, match="format unknown"):
        Recording(plain)
    with pytest.raises(InputError, match="no such recording"):
        Recording(tmp_path / "none")
    with pytest.raises(InputError, match="no such recording"):
        Recording(tmp_path)


def test_a_recording_never_overwrites_another(room: Path) -> None:
    run = made()
    with pytest.raises(FileExistsError):
        run.recorder(room)
