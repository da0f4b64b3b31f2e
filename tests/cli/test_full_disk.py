"""A disk that is full, or a limit on files: every command ends in a sentence, and what was flushed can be shown."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, called, made

#: What a user writes in Python: the error reaches the caller, and then the interpreter ends as it always does.
SCRIPT = """
import sys
from swarmsim import api
from swarmsim.core.errors import StorageError
from swarmsim.api.runs import run
try:
    run({scenario!r}, out="out/api", overrides={{"stop.iterations": 400}})
except StorageError as problem:
    print(problem, file=sys.stderr)
    sys.exit(4)
sys.exit(1)  # the limit comes first
"""
SIZES = tuple(int(size) for size in np.geomspace(16_000, 1_000_000, 30))


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run, a study that is done, one that is not, and a script."""
    folder = tmp_path_factory.mktemp("inputs")
    run = made("robots.count=3", "stop.iterations=200", "stop.when_done='go-on'")
    (folder / "run").mkdir()
    with run.recorder(folder / "run" / "recording.h5") as recorder:
        run.simulation.run([recorder])
    text = f'title = "s"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 4\n[set]\n"stop.iterations" = 40\n'
    (folder / "study.toml").write_text(text)
    assert called("study", "run", "study.toml", "--store", "done.sqlite", "--quiet", cwd=folder).returncode == 0
    (folder / "script.py").write_text(SCRIPT.format(scenario=str(ROOT / "scenarios/basilica.toml")))
    return folder


def commands(inputs: Path) -> dict[str, list[str]]:
    verb = [sys.executable, "-m", "swarmsim"]
    run, study, done = str(inputs / "run"), str(inputs / "study.toml"), str(inputs / "done.sqlite")
    basilica = str(ROOT / "scenarios/basilica.toml")
    return {
        "run": [*verb, "run", basilica, "--set", "stop.iterations=400", "--out", "out/run", "--quiet"],
        "Python": [sys.executable, str(inputs / "script.py")],
        "video": [*verb, "video", run, "out/film.mp4", "--size", "480x270", "--speed", "200", "--quiet"],
        "pictures": [*verb, "video", run, "out/film.png", "--size", "480x270", "--speed", "400", "--quiet"],
        "report": [*verb, "report", run, "--out", "out/page.html"],
        "map": [*verb, "export", run, "--map", "out/map.yaml", "--quiet"],
        "mcap": [*verb, "export", run, "--mcap", "out/run.mcap", "--quiet"],
        "rerun": [*verb, "export", run, "--rerun", "out/run.rrd", "--quiet"],
        "figure": [*verb, "figure", "network", run, "--out", "out/figure", "--at", "5", "--and", "20"],
        "csv": [*verb, "study", "export", study, "--store", done, "--csv", "out/study.csv"],
        "study": [*verb, "study", "run", study, "--store", "out/study.sqlite", "--workers", "1", "--quiet"],
    }


def ended(command: list[str], folder: Path, limit: int | None) -> subprocess.CompletedProcess[str]:
    """What becomes of a command whose files may have so many bytes at most, in a folder with a folder `out`."""

    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.run(
        command, cwd=folder, preexec_fn=limited, capture_output=True, text=True, check=False, timeout=300
    )


def shown(folder: Path) -> str:
    """What is wrong with what was kept of a run, if anything."""
    for run in (folder / "out" / "run", folder / "out" / "api"):
        if (run / "recording.h5").exists():
            done = called("show", run, "--json")
            if done.returncode != 0 or '"status": "under way' in done.stdout:
                return f"{run.name} cannot be shown: {done.stderr}{done.stdout[:200]}"
    return ""


def wrong(done: subprocess.CompletedProcess[str], folder: Path) -> str:
    """What is wrong with the end of a command, if anything."""
    if done.returncode not in (0, 1, 4):
        return f"exit code {done.returncode}: {done.stderr[-300:]}"
    if "Traceback" in done.stderr or "Exception ignored" in done.stderr:
        return f"a traceback: {done.stderr[-300:]}"
    if done.returncode == 4 and done.stderr.count("\n") != 1:
        return f"not one sentence: {done.stderr[-300:]}"
    return shown(folder)


@pytest.mark.parametrize(("verb", "size"), [("run", 16_000), ("run", 90_000), ("Python", 60_000), ("figure", 16_000)])
def test_a_limit_on_files_ends_in_a_sentence(inputs: Path, tmp_path: Path, verb: str, size: int) -> None:
    (tmp_path / "out").mkdir()
    done = ended(commands(inputs)[verb], tmp_path, size)
    assert done.returncode == 4, done.stderr
    assert wrong(done, tmp_path) == ""
    assert "cannot be written (File too large)" in done.stderr or "cannot be written (encoder error" in done.stderr


@contextmanager
def small_disk(folder: Path, size: int) -> Iterator[None]:
    """Meanwhile `out` in the folder is a disk of so many bytes. Skips where nothing may be mounted."""
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder / "out"], capture_output=True, check=False
    )
    if made.returncode != 0:
        pytest.skip(f"a small disk cannot be mounted here: {made.stderr.decode().strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", folder / "out"], check=True)


@contextmanager
def no_disk(folder: Path, size: int) -> Iterator[None]:
    yield


@pytest.mark.skipif(shutil.which("mount") is None or os.geteuid() != 0, reason="a small disk needs root to mount it")
@pytest.mark.parametrize("size", [64_000, 300_000])
def test_a_full_disk_ends_in_a_sentence(inputs: Path, tmp_path: Path, size: int) -> None:
    (tmp_path / "out").mkdir()
    with small_disk(tmp_path, size):
        done = ended(commands(inputs)["run"], tmp_path, None)
        assert done.returncode == 4, done.stderr
        assert wrong(done, tmp_path) == ""
        assert "No space left on device" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["limit", "disk"])
def test_no_size_of_a_disk_ends_in_a_signal(inputs: Path, tmp_path: Path, kind: str) -> None:
    if kind == "disk" and (shutil.which("mount") is None or os.geteuid() != 0):
        pytest.skip("a small disk needs root to mount it")
    disk: Callable[..., object] = small_disk if kind == "disk" else no_disk
    faults = []
    for verb, command in commands(inputs).items():
        codes: Counter[int] = Counter()
        for size in SIZES:
            folder = tmp_path / f"{verb}-{size}"
            (folder / "out").mkdir(parents=True)
            with disk(folder, size):  # type: ignore[attr-defined]
                done = ended(command, folder, None if kind == "disk" else size)
                codes[done.returncode] += 1
                if fault := wrong(done, folder):
                    faults.append(f"{kind} {verb} {size}: {fault}")
            shutil.rmtree(folder, ignore_errors=True)
        told = ", ".join(f"{count} x exit code {code}" for code, count in sorted(codes.items()))
        print(f"{kind:5} {verb:8} {len(SIZES)} sizes of {SIZES[0]} to {SIZES[-1]} bytes: {told}", flush=True)
    print(f"{kind:5} faults: {len(faults)}")
    assert faults == []
