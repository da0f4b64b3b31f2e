"""Many robots in large buildings: time, memory and size of recordings."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
import workload
from conftest import Figures

BUILDING = """
title = "1000 robots map a building of 100 m x 100 m"
world = {generate = {use = "office", width = 100.0, height = 100.0}, spawn = [30.0, 30.0, 40.0, 40.0]}
[robots]
count = 1000
[network.topology]
use = "knn"
k = 3
[stop]
iterations = 20000
"""
#: Runs the command line, and prints its peak memory in MiB.
MEASURED = (
    "import resource, subprocess, sys; "
    "code = subprocess.run([sys.executable, '-m', 'swarmsim', *sys.argv[1:]], stdout=subprocess.DEVNULL).returncode; "
    "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)"
)


def measured(figures: Figures, name: str, *words: str) -> int:
    begun = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", MEASURED, *words], check=True, capture_output=True, text=True)
    code, memory = done.stdout.split()
    figures.add("Many robots", f"{name}: seconds", time.perf_counter() - begun, "s")
    figures.add("Many robots", f"{name}: memory at most", float(memory) / 1024, "GiB", "2")
    assert float(memory) < 2048
    return int(code)


@pytest.mark.bench
def test_a_thousand_robots_map_a_building_of_100_m(tmp_path: Path, figures: Figures) -> None:
    (tmp_path / "building.toml").write_text(BUILDING)
    name = "1000 robots map 100 m x 100 m"
    assert measured(figures, name, "run", str(tmp_path / "building.toml"), "--out", str(tmp_path / "run")) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "finished"
    figures.add("Many robots", f"{name}: iterations", summary["iterations"])
    size = (tmp_path / "run" / "recording.h5").stat().st_size
    figures.add("Many robots", f"{name}: recording", size / 2**30, "GiB")
    film = str(tmp_path / "film.mp4")
    words = ("video", str(tmp_path / "run"), film, "--speed", "1000")
    assert measured(figures, f"{name}: its film at 1000 times real time", *words) == 0
    figures.add("Many robots", f"{name}: film", Path(film).stat().st_size / 2**20, "MiB")


@pytest.mark.bench
def test_five_thousand_robots_run_w(tmp_path: Path, figures: Figures) -> None:
    path = workload.written(tmp_path, 5000, True, 600)
    name = "5000 robots, W with mapping, 600 iterations"
    assert measured(figures, name, "run", str(path), "--out", str(tmp_path / "run")) == 1  # wandering maps no 5000 m^2
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["iterations"] == 600
