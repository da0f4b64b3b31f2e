"""What recordings hold of jobs in pieces, and what is measured of them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import called, moments_of
from test_jobs_beside_minds import HEAT, MAPPING, ROOM

import swarmsim as sw
from swarmsim.core.errors import InputError
from swarmsim.core.events import PieceLost, PieceTaken
from swarmsim.core.probes import GONE, NOBODY
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.recording.reader import Recording
from swarmsim.view.timeline import noted

KEYS = 'use="./heat.py:Heat", name="warmth", steps=40, copies={}'
DIES = 'faults=[{{use="remove", at=8, robots={}}}]'


@pytest.fixture
def room(tmp_path: Path) -> Path:
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "heat.py").write_text(HEAT)
    (tmp_path / "room.toml").write_text(MAPPING)
    return tmp_path / "room.toml"


def recorded(room: Path, *overrides: str, copies: int = 2, iterations: int = 50) -> Recording:
    out, keys = room.parent / "out", f"jobs=[{{{KEYS.format(copies)}}}]"
    shutil.rmtree(out, ignore_errors=True)
    changed = [keys, 'task={use="computed"}', f"stop.iterations={iterations}", *overrides]
    with registry.own_code(True):
        run = build(load(room, changed), str(room))
        out.mkdir()
        with run.recorder(out / "recording.h5") as recorder:
            run.simulate([recorder])
    return Recording(out)


def test_a_recording_tells_who_computes_what_from_whom_and_the_field(room: Path) -> None:
    recording = recorded(room)
    assert [one.name for one in recording.probes] == ["warmth"]
    step, holder = recording["warmth_step"], recording["warmth.holder"]
    assert holder.shape == (50, 4)
    assert sorted(holder[0].tolist()) == [0, 1, 2, 3]
    np.testing.assert_array_equal(recording["warmth.step"], step.max(axis=1))
    pieces, field = recording["warmth.piece"], recording["warmth.field"]
    assert pieces.shape == (1, *recording.lattice.shape)
    assert field.shape == (10, *recording.lattice.shape)
    np.testing.assert_array_equal(np.isfinite(field), np.broadcast_to(pieces >= 0, field.shape))
    for row in range(recording.iterations):
        heard = {(int(a), int(b)) for a, b in recording.links(row)}
        told = {(a, int(b)) for a in range(4) for b in recording["warmth.halos"][row, a] if b >= 0}
        assert told <= heard
    assert (recording["warmth.halos"] >= 0).any()


def test_what_a_job_shows_is_verified(room: Path) -> None:
    path = recorded(room, iterations=12).path
    assert sw.open(path.parent).verify(allow_code=True).equal
    with h5py.File(path, "r+") as file:
        file["warmth.age"][3, 1] = 0.5
    found = sw.open(path.parent).verify(allow_code=True)
    assert found.difference == "iteration 3, table 'warmth.age' of a probe"


def test_events_tell_who_goes_on_with_a_piece(room: Path) -> None:
    recording = recorded(room, DIES.format([2]))
    (taken,) = [one for one in recording.events() if isinstance(one, PieceTaken)]
    (piece,) = np.flatnonzero(recording["warmth.holder"][7] == 2)
    assert (taken.job, taken.piece, taken.robots[1]) == ("warmth", piece, 2)
    holder = recording["warmth.holder"][:, piece].tolist()
    assert holder[taken.iteration - 1] == taken.robots[0] == holder[-1]
    assert set(holder[8 : taken.iteration - 1]) == {NOBODY}
    assert np.isnan(recording["warmth.field"][2][recording["warmth.piece"][0] == piece]).all()
    assert not [one for one in recording.events() if isinstance(one, PieceLost)]
    (note,) = [noted(one, recording.scenario).words for one in recording.events() if isinstance(one, PieceTaken)]
    assert note == f"warmth: piece {piece} taken over: by robot {taken.robots[0]} from robot 2"


def test_events_tell_what_is_lost(room: Path) -> None:
    recording = recorded(room, DIES.format([1, 2]), copies=0)
    lost = [one for one in recording.events() if isinstance(one, PieceLost)]
    assert [one.piece for one in lost] == np.flatnonzero(recording["warmth.holder"][-1] == GONE).tolist()
    assert len(lost) == recording["pieces_lost"][-1] == 2
    assert {one.iteration for one in lost} == {9}


@pytest.mark.parametrize(("delay", "age"), [(0, 0.0), (2, 2.0)])
def test_halos_are_as_old_as_the_channel_is_slow(room: Path, delay: int, age: float) -> None:
    channel = f'network.channel={{use="latency", delay={delay}}}'
    ages = recorded(room, channel)["warmth.age"]
    assert np.unique(ages[20:]).tolist() == [age]
    assert recorded(room, channel)["halo_age"][-1] == pytest.approx(age, abs=0.2)


def test_measures_compare_with_one_computer_and_tell_the_load(room: Path) -> None:
    with registry.own_code(True):
        keys = f"jobs=[{{{KEYS.format(2)}}}]", 'task={use="computed", compare=true, tolerance=0.05}'
        run = build(load(room, [*keys, "stop.iterations=60"]), str(room))
        (cost,) = run.simulation.parts.task.summaries()
        moments = moments_of(run)
    for one in moments:
        cost.sample(one)
    errors = np.array([one.measured.values["error_sequential"] for one in moments])
    found = cost.summary()
    assert errors[-1] == 0.0 == found["error_sequential"]
    assert errors[0] > 0.05
    assert found["iterations_to_tolerance"] == np.flatnonzero(errors > 0.05)[-1] + 2
    assert 0 < found["bytes_to_tolerance"] < found["job_bytes_sent"]
    assert found["error_field"] is None  # there is no field
    assert found["load"] == pytest.approx(1.0)
    assert found["pieces_lost"] == found["steps_redone"] == 0


FORGED = [
    ("holder", "high", 9.0, r"'holder' is drawn as holders; expected i4 of shape \(pieces,\), from -2 to 3"),
    ("halos", "low", -5.0, r"'halos' is drawn as links; expected i4 of shape \('robots', k\), from -1 to 3"),
    ("field", "shape", [2, 2], r"'field' is drawn as field; expected f4 or f8 of shape"),
    ("field", "drawn", "map", "Invalid enum value 'map'"),
]


@pytest.mark.parametrize(("table", "key", "value", "told"), FORGED)
def test_made_up_declarations_are_refused(room: Path, table: str, key: str, value: object, told: str) -> None:
    path = recorded(room, iterations=6).path
    with h5py.File(path, "r+") as file:
        declared = json.loads(bytes(file.attrs["probes"]))
        next(one for one in declared[0]["tables"] if one["name"] == table)[key] = value
        file.attrs["probes"] = np.bytes_(json.dumps(declared).encode())
    with pytest.raises(InputError, match=f"not a whole recording .{told}"):
        Recording(path)


def test_made_up_holders_are_refused(room: Path) -> None:
    path = recorded(room, iterations=6).path
    with h5py.File(path, "r+") as file:
        file["warmth.holder"][2, 1] = 7
    with pytest.raises(InputError, match=r"table 'warmth\.holder' has invalid numbers"):
        Recording(path)["warmth.holder"]


def test_a_probe_may_not_be_called_like_a_job(room: Path) -> None:
    with pytest.raises(InputError, match=r"jobs\[0\]\.name: another probe is called 'warmth' already"):
        recorded(room, 'probes=[{use="batteries", name="warmth"}]')


def test_expectations_take_what_is_measured_of_jobs(room: Path) -> None:
    keys = f"[[jobs]]\n{KEYS.format(2)}".replace(", ", "\n")
    expected = ["error_sequential <= 0", "halo_age <= 0 always", "bytes_to_tolerance > 0", "pieces_lost <= 0 always"]
    expect = "".join(f'[[expect]]\nthat = "{one}"\nseeds = [1]\n' for one in expected)
    changed = MAPPING.replace("iterations = 12", "iterations = 50")
    room.write_text(f'{changed}{keys}\n[task]\nuse = "computed"\ncompare = true\n{expect}')
    told = called("test", room, "--allow-code", "--store", room.parent / "store.sqlite")
    assert told.returncode == 0, told.stdout + told.stderr
    assert "4 hold" in told.stdout
