"""Recordings that somebody or something has changed are refused in words, or shown, by every verb that reads them."""

from __future__ import annotations

import random
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import made
from typer.testing import CliRunner

from swarmsim.cli import app
from swarmsim.core.errors import InputError

TYPES = ("f4", "f8", "i2", "i8", "u1", "?", "S4")
WORDS = (b"", b"0", b"-1", b"null", b'"', b"{}", b"[", b"1e999", b"nan", b"\xff")
NUMBERS = {
    "u": (0, 1, 2, 3, 100, 255),
    "i": (-1, 0, 7, 2**31 - 1, -(2**31)),
    "f": (np.nan, np.inf, -1e30, 1e30, 0.0),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Recordings of a swarm that maps, of one that agrees on a heading, and of one that estimates a field."""
    found = []
    for name in ("room", "operations/heading-consensus", "operations/field"):
        path = tmp_path_factory.mktemp("sound") / "recording.h5"
        run = made("stop.iterations=30", scenario=name)
        with run.recorder(path) as recorder:
            run.simulation.run([recorder])
        found.append(path)
    return found


def edited(text: bytes, dice: random.Random) -> bytes:
    at = dice.randrange(len(text) or 1)
    return text[:at] + dice.choice(WORDS) + text[at + dice.randrange(6) :]


def damage(path: Path, dice: random.Random) -> str:
    """Change the file; gives how."""
    way = dice.random()
    if way < 0.25:
        whole = bytearray(path.read_bytes())
        for _ in range(dice.choice((1, 3, 20))):
            whole[dice.randrange(len(whole))] ^= 1 << dice.randrange(8)
        path.write_bytes(whole if way < 0.2 else whole[: dice.randrange(len(whole))])
        return "bits" if way < 0.2 else "cut"
    with h5py.File(path, "r+") as file:
        if way < 0.4:
            name = dice.choice(list(file.attrs))
            value = file.attrs[name]
            if isinstance(value, bytes):
                file.attrs[name] = np.bytes_(edited(value, dice) or b" ")
            elif dice.random() < 0.5:
                file.attrs[name] = [dice.choice((0.0, -1.0, 1e9, np.nan, np.inf)) for _ in range(5)]
            else:
                del file.attrs[name]
            return f"attribute {name}"
        name = dice.choice(list(file))
        what = dice.choice(("drop", "rename", "type", "shape", "number", "numbers", "text", "empty", "more"))
        _change(file, name, what, dice)
        return f"{what} {name}"


def _change(file: h5py.File, name: str, what: str, dice: random.Random) -> None:
    rows: np.ndarray = file[name][()]
    instead: Any = rows
    if what == "rename":
        file.move(name, f"{name}x")
        return
    if what == "more":
        file["more"] = np.zeros(dice.choice(((0,), (3, 2), ())))
        return
    if what == "type":
        instead = np.zeros(rows.shape, dice.choice(TYPES))
    elif what == "shape":
        instead = rows.reshape(-1) if dice.random() < 0.5 else rows[: len(rows) // 2]
    elif what in ("number", "numbers") and rows.dtype.kind in NUMBERS and rows.size:
        flat = rows.reshape(-1)
        for at in [dice.randrange(len(flat))] if what == "number" else range(len(flat)):
            flat[at] = dice.choice(NUMBERS[rows.dtype.kind])
    elif what == "text" and rows.dtype == np.uint8 and rows.ndim == 1:
        instead = np.frombuffer(edited(rows.tobytes(), dice), np.uint8)
    elif what == "empty":
        instead = h5py.Empty("f4")
    del file[name]
    if what != "drop":
        file[name] = instead


def verbs(path: Path, folder: Path) -> list[list[str]]:
    run, out = str(path), str(folder)
    return [
        ["show", run],
        ["show", run, "--json"],
        ["verify", run, "--quiet"],
        ["network", run],
        ["compare", run, run],
        ["report", run, "--out", f"{out}/page.html"],
        ["export", run, "--map", f"{out}/map.yaml", "--quiet"],
        ["export", run, "--mcap", f"{out}/run.mcap", "--quiet"],
        ["figure", "local-maps", run, "--robots", "0,1", "--at", "10", "--out", f"{out}/maps.png"],
        ["video", run, f"{out}/film.png", "--speed", "2000", "--size", "640x360", "--no-cards", "--quiet"],
    ]


def survives(sound: list[Path], folder: Path, seed: int) -> int:
    """Damage a recording and read it with a verb; gives the exit code. Raises AssertionError with what was done."""
    dice = random.Random(seed)
    path = folder / "recording.h5"
    shutil.copy(dice.choice(sound), path)
    how = damage(path, dice)
    words = dice.choice(verbs(path, folder))
    with np.errstate(all="ignore"):
        done = CliRunner().invoke(app, words)
    refused = isinstance(done.exception, InputError)
    assert refused or done.exit_code in (0, 1, 2), (seed, how, words, done.output, done.exc_info)
    assert refused or done.exception is None or isinstance(done.exception, SystemExit), (
        seed,
        how,
        words,
        done.exc_info,
    )
    return 2 if refused else done.exit_code


def test_damaged_recordings_are_refused_or_read(sound: list[Path], tmp_path: Path) -> None:
    codes = [survives(sound, tmp_path, seed) for seed in range(40)]
    assert {0, 2} <= set(codes)  # some damage does no harm


@pytest.mark.slow
def test_many_damaged_recordings_are_refused_or_read(sound: list[Path], tmp_path: Path) -> None:
    codes = [survives(sound, tmp_path, seed) for seed in range(1000, 3000)]
    print({code: codes.count(code) for code in set(codes)})
    assert {0, 2} <= set(codes)


def test_a_table_that_would_fill_the_memory_is_refused_before_it_is_read(sound: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    shutil.copy(sound[0], path)
    with h5py.File(path, "r+") as file:
        for name, shape in (("links", (10**12, 2)), ("letters", (10**8, 5))):
            kind = file[name].dtype
            del file[name]
            file.create_dataset(name, shape, kind, chunks=(10**4, shape[1]))
    done = CliRunner().invoke(app, ["show", str(path)])
    assert isinstance(done.exception, InputError)
    assert "bytes" in str(done.exception)
