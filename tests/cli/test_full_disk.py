"""A disk that is full, or a limit on files: every command ends in a sentence, and what was flushed can be shown."""

from __future__ import annotations

import os
import re
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
from offspring import Offspring

from swarmsim.recording.reader import Recording

Ended = Callable[..., subprocess.CompletedProcess[str]]
#: What a user writes in Python: the error reaches the caller, and then the interpreter ends as it always does.
SCRIPT = """
import sys
from swarmsim import api
from swarmsim.core.errors import StorageError
from swarmsim.api.runs import run
try:
    run({scenario!r}, out="out/api", overrides={changes!r})
except StorageError as problem:
    print(problem, file=sys.stderr)
    sys.exit(4)
sys.exit(1)  # the limit comes first
"""
STUDY = f'title = "s"\nscenario = "{ROOT}/scenarios/room.toml"\nseeds = 4\n[set]\n"stop.iterations" = 40\n'
SIZES = 30  # of a disk, for each verb
LONG = ["--set", "robots.count=15", "--set", "stop.iterations=400", "--set", "stop.when_done='continue'"]
SHORT = ["--set", "stop.iterations=20"]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run and a script."""
    folder = tmp_path_factory.mktemp("inputs")
    run = made("robots.count=3", "stop.iterations=200", "stop.when_done='continue'")
    (folder / "run").mkdir()
    with run.recorder(folder / "run" / "recording.h5") as recorder:
        run.simulation.run([recorder])
    (folder / "script.py").write_text(
        SCRIPT.format(
            scenario=str(ROOT / "scenarios/room.toml"),
            changes={"robots.count": 15, "stop.iterations": 400, "stop.when_done": "continue"},
        )
    )
    return folder


def commands(inputs: Path) -> dict[str, list[str]]:
    """The words of each verb that writes files, and a script."""
    run, study, done = str(inputs / "run"), str(inputs / "study.toml"), str(inputs / "done.sqlite")
    room = str(ROOT / "scenarios/room.toml")
    film = ["--size", "480x270", "--speed", "200", "--quiet"]
    return {
        "run": ["run", room, *LONG, "--out", "out/run", "--quiet"],
        "run, film": ["run", room, *SHORT, "--out", "out/run", "--video", "out/film.mp4", "--quiet"],
        "Python": [str(inputs / "script.py")],
        "study": ["study", "run", study, "--store", "out/study.sqlite", "--workers", "1", "--quiet"],
        "study plot": ["study", "plot", study, "out/figures", "--store", done],
        "csv": ["study", "export", study, "--store", done, "--csv", "out/study.csv"],
        "parquet": ["study", "export", study, "--store", done, "--parquet", "out/study.parquet"],
        "mp4": ["video", run, "out/film.mp4", *film],
        "gif": ["video", run, "out/film.gif", *film],
        "pictures": ["video", run, "out/film.png", *film],
        "report": ["report", run, "--out", "out/page.html"],
        "report of a study": ["report", study, "--store", done, "--out", "out/page.html"],
        "map": ["export", run, "--map", "out/map.yaml", "--quiet"],
        "map as JSON": ["export", run, "--map", "out/map.json", "--quiet"],
        "mcap": ["export", run, "--mcap", "out/run.mcap", "--quiet"],
        "rerun": ["export", run, "--rerun", "out/run.rrd", "--quiet"],
        "figure": ["figure", "network", run, "--out", "out/figure", "--at", "5", "--and", "20"],
        "network": ["network", run, "--plots", "out/plots"],
        "compare": ["compare", run, run, "--plot", "out/plot"],
        "preview": ["world", "preview", room, "out/preview.png"],
        "drawing": ["world", "generate", "office", "out/office.svg"],
        "polygons": ["world", "convert", room, "out/room.geojson"],
        "new part": ["new", "strategy", "mine", "--to", "out"],
        "copied example": ["examples", "copy", "basilica", "out"],
    }


def ended(words: list[str], folder: Path, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    """What becomes of a command whose files may have so many bytes at most, in a folder with a folder `out`."""

    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    start = [sys.executable] if words[0].endswith(".py") else [sys.executable, "-m", "swarmsim"]
    return subprocess.run(
        [*start, *words], cwd=folder, preexec_fn=limited, capture_output=True, text=True, check=False, timeout=300
    )


def shown(folder: Path) -> str:
    """What is wrong with what was kept of a run or a study, if anything."""
    for run in (folder / "out" / "run", folder / "out" / "api"):
        if (run / "recording.h5").exists():
            done = called("show", run, "--json", cwd=folder)
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


def test_a_limit_on_files_ends_in_a_sentence(inputs: Path, tmp_path: Path) -> None:
    """In a process as a user starts it; the next test tries more in forks of one."""
    (tmp_path / "out").mkdir()
    done = ended(commands(inputs)["run"], tmp_path, 16_000)
    assert (done.returncode, wrong(done, tmp_path)) == (4, ""), done.stderr
    assert "cannot be written (File too large)" in done.stderr


@pytest.mark.parametrize(
    ("verb", "size", "kept"),
    [
        ("run", 90_000, ""),
        ("run", 200_000, r"recording\.h5: cannot be written \(File too large\); (\d+) iterations are kept"),
        ("run, film", 18_000, ""),
        ("Python", 60_000, ""),
        ("figure", 16_000, ""),
        ("mp4", 16_000, r"film\.mp4: cannot be written \(File too large\); no film was kept"),
        ("rerun", 16_000, ""),
    ],
)
def test_a_limit_on_files_is_told_with_what_is_kept(
    inputs: Path, offspring: Offspring, tmp_path: Path, verb: str, size: int, kept: str
) -> None:
    (tmp_path / "out").mkdir()
    done = offspring.ended(commands(inputs)[verb], tmp_path, size)
    assert (done.returncode, wrong(done, tmp_path)) == (4, ""), done.stderr
    assert "cannot be written (File too large)" in done.stderr
    told = re.search(kept, done.stderr)
    assert told, done.stderr
    assert not (tmp_path / "out" / "film.mp4").exists()
    if told.groups():
        assert Recording(tmp_path / "out" / "run").iterations == int(told[1]) > 0


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
@pytest.mark.parametrize("size", [64_000, 200_000])
def test_a_full_disk_ends_in_a_sentence(inputs: Path, offspring: Offspring, tmp_path: Path, size: int) -> None:
    (tmp_path / "out").mkdir()
    with small_disk(tmp_path, size):
        done = offspring.ended(commands(inputs)["run"], tmp_path)
        assert done.returncode == 4, done.stderr
        assert wrong(done, tmp_path) == ""
        assert "No space left on device" in done.stderr


def sizes(words: list[str], folder: Path, ended: Ended) -> list[int]:
    """Sizes of disks from 16 kB, or less than what a command writes, to 200 kB, what it needs, or 1 MB."""
    (folder / "out").mkdir(parents=True)
    done = ended(words, folder)
    assert (done.returncode, done.stderr.count("Traceback")) in ((0, 0), (1, 0)), (words, done.stderr)
    needed = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    shutil.rmtree(folder)
    return [
        int(size) for size in np.geomspace(min(16_000, needed / 20), min(1_000_000, max(200_000, 1.2 * needed)), SIZES)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["limit", "disk"])
def test_no_size_of_a_disk_ends_in_a_signal(inputs: Path, offspring: Offspring, tmp_path: Path, kind: str) -> None:
    if kind == "disk" and (shutil.which("mount") is None or os.geteuid() != 0):
        pytest.skip("a small disk needs root to mount it")
    (inputs / "study.toml").write_text(STUDY)
    assert called("study", "run", "study.toml", "--store", "done.sqlite", "--quiet", cwd=inputs).returncode == 0
    disk = small_disk if kind == "disk" else no_disk
    faults = []
    for verb, words in commands(inputs).items():
        codes: Counter[int] = Counter()
        tried = sizes(words, tmp_path / verb, offspring.ended)
        for size in tried:
            folder = tmp_path / f"{verb}-{size}"
            (folder / "out").mkdir(parents=True)
            with disk(folder, size):
                done = offspring.ended(words, folder, None if kind == "disk" else size)
                codes[done.returncode] += 1
                if fault := wrong(done, folder):
                    faults.append(f"{kind} {verb} {size}: {fault}")
            shutil.rmtree(folder, ignore_errors=True)
        told = ", ".join(f"{count} x exit code {code}" for code, count in sorted(codes.items()))
        print(f"{kind:5} {verb:17} {len(tried)} sizes of {tried[0]:6} to {tried[-1]:7} bytes: {told}", flush=True)
    print(f"{kind:5} faults: {len(faults)}", *faults, sep="\n")
    assert faults == []
