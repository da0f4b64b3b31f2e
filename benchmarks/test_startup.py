"""Start-up times."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Figures

TURNS = 5
GROUP = "Start"


def seconds(*words: str, **environment: str) -> float:
    begun = time.perf_counter()
    command = [sys.executable, "-m", "swarmsim", *words]
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT, env={**os.environ, **environment})
    return time.perf_counter() - begun


@pytest.mark.bench
def test_start(tmp_path: Path, figures: Figures) -> None:
    room = str(ROOT / "scenarios" / "room.toml")
    seconds("run", room, "--out", str(tmp_path / "first"))
    figures.add(GROUP, "--help", np.median([seconds("--help") for _ in range(TURNS)]), "s", "0.3")
    warm = [seconds("run", room, "--out", str(tmp_path / f"{turn}")) for turn in range(TURNS)]
    figures.add(GROUP, "run scenarios/room.toml, compiled before", np.median(warm), "s", "1.0")
    cold = seconds("run", room, "--out", str(tmp_path / "cold"), NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    figures.add(GROUP, "run scenarios/room.toml, first on a machine", cold, "s", "15")
