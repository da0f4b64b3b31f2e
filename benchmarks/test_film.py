"""The time of a film against encoding the same ready frames, in turns in one process."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from conftest import Figures

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.recording.reader import Recording
from swarmsim.view import video

ROOT = Path(__file__).parents[1]
TURNS = 5


@pytest.mark.bench
def test_a_film_costs_at_most_half_as_much_again_as_encoding_it(tmp_path: Path, figures: Figures) -> None:
    path = ROOT / "scenarios" / "basilica.toml"
    run = build(load(path), str(path))
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    recording, film = Recording(tmp_path), video.Film()
    ready = list(video.Stage([recording], film).pictures(None, video._memory))
    ratios = []
    for _ in range(TURNS):
        begun = time.perf_counter()
        video._write_mp4(tmp_path / "ready.mp4", ready, film.size, film.fps)
        encoded = time.perf_counter()
        video.write_film(recording, tmp_path / "film.mp4", film)
        done = time.perf_counter()
        ratios.append((done - encoded) / (encoded - begun))
        print(f"{len(ready)} frames: encoding {encoded - begun:.1f} s, film {done - encoded:.1f} s")
    figures.add("Film", f"time over that of encoding ready frames, median of {TURNS}", np.median(ratios), "", "1.5")
    figures.add("Film", "frames a second, of 1280 x 720", len(ready) / (done - encoded))
    assert (tmp_path / "film.mp4").read_bytes() == (tmp_path / "ready.mp4").read_bytes()
    assert np.median(ratios) <= 1.5
