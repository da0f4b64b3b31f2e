"""Probes: what they declare is recorded, read back, verified and held to; what cannot be is refused before the run."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import ROOT
from numpy.testing import assert_allclose, assert_array_equal
from typer.testing import CliRunner

import swarmsim
from swarmsim.cli import app
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.recording.reader import Recording
from swarmsim.recording.recorder import text_of
from swarmsim.studies.requests import asked

ROOM = ROOT / "scenarios" / "room.toml"
BATTERY = {"use": "battery", "capacity": 10.0, "per_metre": 2.0, "per_byte": 0.001, "idle": 0.5}
OWN = '''
import sys
import numpy as np
from msgspec import Struct
from swarmsim.core.probes import ProbeTable, Sampled


class Own(Sampled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A probe that does what a test asks it to."""

    name: str = "own"
    how: str = "well"

    def build(self, context):
        return Probe(self.how)


class Probe:
    tables = (
        ProbeTable("speed", shape=("robots", 2), unit="m/s", columns=("x", "y")),
        ProbeTable("met", dtype="i4", low=0),
    )

    def __init__(self, how):
        self.how, self.kept = how, np.zeros((3, 2))
        if how == "twice":
            self.tables = (*self.tables, *self.tables)
        if how == "none":
            self.tables = ()
        if how == "slash":
            self.tables = (ProbeTable("a/b"),)
        if how == "object":
            self.tables = (ProbeTable("a", dtype="O"),)

    def sample(self, moment):
        speed, met = moment.state.velocity[:, :2], len(moment.links)
        if self.how == "reuse":
            self.kept[:] = moment.state.iteration
            speed = self.kept
        if moment.state.iteration == 2:
            if self.how == "raise":
                raise ValueError("no sample")
            if self.how == "exit":
                sys.exit(0)
            if self.how == "write":
                moment.state.pose[:] = 0.0
            if self.how == "shape":
                speed = speed[:2]
            if self.how == "text":
                met = "many"
            if self.how == "half":
                met = 0.5
            if self.how == "low":
                met = -1
            if self.how == "missing":
                return {"speed": speed}
        return {"speed": speed, "met": met}


class Plain(Struct):
    def build(self, context):
        return Probe("well")
'''


def recorded(folder: Path, **changes: object) -> Recording:
    made = build(load(ROOM, changes={"stop.iterations": 7, **changes}), "room.toml")
    with made.recorder(folder / "recording.h5") as recorder:
        made.simulation.run([recorder])
    return Recording(folder)


@pytest.fixture
def own(tmp_path: Path):
    (tmp_path / "own.py").write_text(OWN)

    def opened(how: str = "well", part: str = "Own", **keys: object):
        probe = {"use": f"{tmp_path}/own.py:{part}", **({"how": how} if part == "Own" else {}), **keys}
        with registry.own_code(True):
            return build(load(ROOM, changes={"probes": [probe], "stop.iterations": 7}), "room.toml")

    return opened


def test_levels_of_batteries_are_recorded_every_so_many_iterations(tmp_path: Path) -> None:
    battery, probe = {**BATTERY, "robots": [0, 1]}, {"use": "batteries", "name": "energy", "every": 3}
    recording = recorded(tmp_path, faults=[battery], probes=[probe])
    left = recording["energy.left"]
    assert left.shape == (3, 3)  # of iterations 0, 3 and 6
    assert np.isinf(left[:, 2]).all()
    # Three iterations at half a watt, two joules for each metre, and a thousandth for each byte on each link.
    pose, sends = recording["pose"], np.zeros(2)
    for iteration in (1, 2, 3):
        links, letters = recording.links(iteration), recording.letters(iteration)
        sends += letters[0, 3] * np.bincount(links[:, 1], minlength=3)[:2]
    driven = np.hypot(*np.diff(pose[:4, :2, :2], axis=0).transpose(2, 0, 1)).sum(axis=0)
    assert_allclose(left[0, :2] - left[1, :2], 3 * 0.5 + 2.0 * driven + 0.001 * sends, rtol=1e-9)


def test_of_a_robot_with_two_batteries_the_emptier_one_is_recorded(tmp_path: Path) -> None:
    idle = {"use": "battery", "per_metre": 0.0, "per_byte": 0.0, "idle": 1.0}
    faults = [{**idle, "capacity": 9.0}, {**idle, "capacity": 20.0, "idle": 3.0, "robots": [1]}]
    recording = recorded(tmp_path, faults=faults, probes=[{"use": "batteries"}])
    assert recording["batteries.left"][:, 0].tolist() == [9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0]
    assert recording["batteries.left"][:, 1].tolist() == [9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 2.0]


def test_without_batteries_no_robot_tires(tmp_path: Path) -> None:
    assert np.isposinf(recorded(tmp_path, probes=[{"use": "batteries"}])["batteries.left"]).all()


def test_believed_poses_are_told_from_true_ones(tmp_path: Path) -> None:
    noisy = {"use": "noisy", "sigma": 0.05, "sigma_yaw": 0.02}
    recording = recorded(tmp_path, probes=[{"use": "believed"}], localisation=noisy)
    assert_array_equal(recording["believed_poses.place"], recording["believed"][:, :, :2])
    assert_array_equal(recording["believed_poses.yaw"], recording["believed"][:, :, 2])
    away = np.hypot(*(recording["believed"] - recording["pose"])[:, :, :2].transpose(2, 0, 1))
    assert_allclose(recording["believed_poses.error"], away)
    assert away.max() > 0.0


def test_a_run_is_the_same_with_probes_and_texts_without_them_say_nothing_of_them(tmp_path: Path) -> None:
    plain, probed = load(ROOM), load(ROOM, changes={"probes": [{"use": "believed"}]})
    assert "probes" not in text_of(plain)
    assert b"probes" not in asked(plain)
    assert asked(plain) != asked(probed)
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first, second = recorded(tmp_path / "a"), recorded(tmp_path / "b", probes=[{"use": "believed"}])
    assert first.digest() == second.digest()
    assert first.probes == []
    with h5py.File(tmp_path / "a" / "recording.h5") as file:
        assert "probes" not in file.attrs


def test_frames_have_a_row_for_each_sample_and_robot_and_units_in_their_columns() -> None:
    probe = {"use": "believed", "every": 2}
    run = swarmsim.run(ROOM, overrides={"stop.iterations": 7, "probes": [probe], "period": 0.5})
    frame = run.frame("believed_poses")
    assert list(frame.columns) == [
        "iteration", "time (s)", "robot", "place x (m)", "place y (m)", "yaw (rad)", "error (m)",
    ]  # fmt: skip
    assert frame["iteration"].tolist() == [i for i in (0, 2, 4, 6) for _ in range(3)]
    assert frame["time (s)"].tolist() == [0.5 * i for i in (0, 2, 4, 6) for _ in range(3)]
    assert frame["robot"].tolist() == [0, 1, 2] * 4
    one = frame[(frame["iteration"] == 4) & (frame["robot"] == 1)].iloc[0]
    assert_allclose([one["place x (m)"], one["place y (m)"], one["yaw (rad)"]], run.recording["pose"][4, 1])
    with pytest.raises(InputError, match=r"no probe or channel is called 'believed'; did you mean 'believed_poses'"):
        run.frame("believed")


def test_a_probe_of_ones_own_is_recorded_with_numbers_of_the_swarm_repeated(own, tmp_path: Path) -> None:
    made = own(every=3)
    with made.recorder(tmp_path / "recording.h5") as recorder:
        made.simulation.run([recorder])
    run = swarmsim.open(tmp_path)
    assert run.recording["own.met"].dtype == np.int32
    assert run.recording["own.met"].tolist() == [len(run.recording.links(i)) for i in (0, 3, 6)]
    frame = run.frame("own")
    assert list(frame.columns) == ["iteration", "time (s)", "robot", "speed x (m/s)", "speed y (m/s)", "met"]
    assert frame["met"].tolist() == [met for met in run.recording["own.met"] for _ in range(3)]


def test_what_a_probe_gave_stays_though_it_uses_its_array_again(own, tmp_path: Path) -> None:
    made = own("reuse")
    with made.recorder(tmp_path / "recording.h5") as recorder:
        made.simulation.run([recorder])
    assert Recording(tmp_path)["own.speed"][:, 0, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("raise", r"ValueError: no sample\n.*own\.py, line \d+, in sample"),
        ("exit", "SystemExit"),
        ("write", "assignment destination is read-only"),
        ("shape", r"'speed' is an array of float64 and shape \(2, 2\); expected numbers of shape \(3, 2\)"),
        ("text", r"'met' is 'many'.*; expected numbers of shape \(\)"),
        ("half", "'met' has numbers that int32 cannot hold"),
        ("low", "'met' is not within 0 and inf, as declared"),
        ("missing", "sample gave 'speed'; expected 'speed', 'met'"),
    ],
)
def test_what_breaks_the_contract_of_a_probe_names_it_and_the_iteration(own, tmp_path, how: str, words: str) -> None:
    made = own(how)
    with (
        pytest.raises(PartError, match=rf"(?s)probe own\.py:Probe, iteration 2: .*{words}"),
        made.recorder(tmp_path / "recording.h5") as recorder,
    ):
        made.simulation.run([recorder])


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("twice", "declares 'speed', 'met', 'speed', 'met'; expected different names"),
        ("none", r"declares \(\) as its tables; expected a tuple of ProbeTable"),
        ("slash", "declares an invalid table: .*matching regex"),
        ("object", "declares an invalid table: Invalid enum value"),
    ],
)
def test_tables_that_cannot_be_are_refused_before_the_run(own, how: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"room\.toml: probes\[0\]\.use: .*own\.py:Own' {words}"):
        own(how)


def test_names_that_are_taken_and_parameters_without_them_are_refused(own) -> None:
    two = [{"use": "believed"}, {"use": "batteries", "name": "believed_poses"}, {"use": "believed"}]
    with pytest.raises(InputError, match=r"probes\[1\]\.name: another probe is called 'believed_poses' already"):
        build(load(ROOM, changes={"probes": two}), "room.toml")
    with pytest.raises(InputError, match=r"probes\[0\]\.use: .*Plain' has no keys 'name' and 'every'"):
        own(part="Plain")
    with pytest.raises(InputError, match=r"probes\[0\]\.name: expected `str` matching regex"):
        load(ROOM, changes={"probes": [{"use": "believed", "name": "a/b"}]})
    with pytest.raises(InputError, match=r"probes\[0\]\.every: expected `int` >= 1"):
        load(ROOM, changes={"probes": [{"use": "believed", "every": 0}]})


def test_verify_compares_what_probes_sampled(tmp_path: Path) -> None:
    recorded(tmp_path, probes=[{"use": "believed", "every": 2}])
    assert CliRunner().invoke(app, ["verify", str(tmp_path), "--quiet"]).exit_code == 0
    with h5py.File(tmp_path / "recording.h5", "a") as file:
        file["believed_poses.yaw"][1, 2] += 1e-9
    done = CliRunner().invoke(app, ["verify", str(tmp_path), "--quiet"])
    assert done.exit_code == 1
    assert "iteration 2, table 'believed_poses.yaw' of a probe" in done.output


def declare(old: bytes, new: bytes):
    def damage(file: h5py.File) -> None:
        told = bytes(file.attrs["probes"])
        assert old in told
        file.attrs["probes"] = np.bytes_(told.replace(old, new, 1))

    return damage


def leave_out(file: h5py.File) -> None:
    del file["believed_poses.yaw"]


def shorten(file: h5py.File) -> None:
    file["believed_poses.yaw"].resize(2, axis=0)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (leave_out, "table 'believed_poses.yaw' is missing"),
        (shorten, "has not a row for every 2 of 7 iterations"),
        (declare(b'"name":"believed_poses"', b'"name":"../../etc"'), "matching regex"),
        (declare(b'"every":2', b'"every":0'), "Expected `int` >= 1"),
        (declare(b'"unit":"rad"', b'"unit":"rad","dtype":"i4"'), "is float64 .* not int32"),
        (declare(b'"name":"yaw"', b'"name":"error"'), "something else already"),
    ],
)
def test_a_recording_that_does_not_hold_what_it_declares_is_refused(tmp_path: Path, damage, words: str) -> None:
    recorded(tmp_path, probes=[{"use": "believed", "every": 2}])
    with h5py.File(tmp_path / "recording.h5", "a") as file:
        damage(file)
    with pytest.raises(InputError, match=f"not a whole recording .*{words}"):
        Recording(tmp_path)


def test_numbers_outside_of_what_is_declared_are_refused_when_they_are_read(tmp_path: Path) -> None:
    recorded(tmp_path, probes=[{"use": "believed"}])
    with h5py.File(tmp_path / "recording.h5", "a") as file:
        file["believed_poses.error"][0, 0] = -1.0
    with pytest.raises(InputError, match=r"table 'believed_poses\.error' has invalid numbers"):
        Recording(tmp_path)["believed_poses.error"]
