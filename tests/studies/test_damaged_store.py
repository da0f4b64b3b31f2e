"""Stores that were damaged are refused in words; two studies can write to one store at once."""

from __future__ import annotations

import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError, StorageError
from swarmsim.studies.store import Row, Store

VERSIONS = {"swarmsim": "0"}


def row(number: int) -> Row:
    summary = {"finished": 1, "iterations": number, "coverage": 1.0, "tail_ratio": None}
    curve = np.linspace(0.0, 1.0, 50, dtype=np.float32)
    return Row(f"id {number}", "k = 1", number, "finished", number, summary, curve, "ab12", VERSIONS, 0.5, None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("store") / "s.sqlite"
    with Store(path) as store:
        for number in range(60):
            store.add(row(number))
    return path.read_bytes()


def test_rows_come_back_as_they_were(tmp_path: Path) -> None:
    with Store(tmp_path / "s.sqlite") as store:
        store.add(row(7))
        (found,) = store.rows(["id 7"]).values()
    assert found.summary == row(7).summary
    assert np.array_equal(found.curve, row(7).curve)
    assert [type(value) for value in found.summary.values()] == [int, int, float, type(None)]


def refusal(path: Path) -> str:
    """Read a store and write to it; what it says if it refuses."""
    try:
        with Store(path) as store:
            store.rows(f"id {number}" for number in range(60))
            store.add(row(1000))
    except (InputError, StorageError) as problem:
        return str(problem)
    return ""


def test_a_damaged_store_is_refused_or_read(whole: bytes, tmp_path: Path) -> None:
    dice, refused = random.Random(1), 0
    for trial in range(150):
        data = bytearray(whole)
        for _ in range(dice.choice((1, 20, 400))):
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        path = tmp_path / f"{trial}.sqlite"
        path.write_bytes(data if trial % 5 else data[: dice.randrange(len(data))])
        told = refusal(path)
        refused += bool(told)
        assert not told or str(path) in told
    assert 30 < refused < 150


@pytest.mark.thorough
def test_two_studies_write_to_one_store_at_once(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        f'title = "Two"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 6\n[set]\n"stop.iterations" = 5\n'
    )
    command = [sys.executable, "-m", "swarmsim", "study", "run", str(tmp_path / "s.toml"), "--workers", "1", "--quiet"]
    command += ["--store", str(tmp_path / "s.sqlite")]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    assert [(one.communicate()[1], one.returncode) for one in both] == [("", 0)] * 2
    with Store(tmp_path / "s.sqlite") as store:
        assert len(store._base.execute("select * from runs").fetchall()) == 6
