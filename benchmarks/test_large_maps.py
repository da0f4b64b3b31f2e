"""Time and memory for a large map, from a ROS file to a swarm that starts in it."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

SIDE, ROOMS = 4000, 12  # pixels, rooms along a side


def scanned() -> np.ndarray:
    """Grey levels of a rotated building with doors and specks, as from a robot's laser."""
    picture = Image.new("L", (SIDE, SIDE), 205)
    pen = ImageDraw.Draw(picture)
    cos, sin = np.cos(0.3), np.sin(0.3)
    wide = 0.6 * SIDE / ROOMS

    def turned(*corners: tuple[float, float]) -> list[tuple[float, float]]:
        return [(SIDE / 2 + cos * x - sin * y, SIDE / 2 + sin * x + cos * y) for x, y in corners]

    grid = [(-0.3 * SIDE + i * wide, -0.3 * SIDE + j * wide) for i in range(ROOMS) for j in range(ROOMS)]
    for x, y in grid:
        corners = turned((x, y), (x + wide, y), (x + wide, y + wide), (x, y + wide))
        pen.polygon(corners, fill=254)
        pen.line([*corners, corners[0]], fill=0, width=4)
    for number, (x, y) in enumerate(grid):
        if number % ROOMS:
            pen.line(turned((x + 0.4 * wide, y), (x + 0.6 * wide, y)), fill=254, width=10)
        if number >= ROOMS:
            pen.line(turned((x, y + 0.4 * wide), (x, y + 0.6 * wide)), fill=254, width=10)
    levels = np.array(picture)
    levels[(np.random.default_rng(1).random(levels.shape) < 0.0005) & (levels == 254)] = 0
    return levels


@pytest.mark.bench
def test_a_map_of_4000_by_4000_pixels(tmp_path: Path) -> None:
    Image.fromarray(scanned()).save(tmp_path / "m.png")
    (tmp_path / "m.yaml").write_text("image: m.png\nresolution: 0.05\norigin: [-100, -100, 0]\n")
    begun = time.perf_counter()
    command = [sys.executable, "-m", "swarmsim", "world", "check", str(tmp_path / "m.yaml"), "--set", "robots.count=10"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begun
    assert done.returncode == 0, done.stdout + done.stderr
    assert "100 % is attainable" in done.stdout
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"\nworld check of {SIDE} x {SIDE} pixels: {seconds:.1f} s, {memory:.0f} MiB at most")
    (tmp_path / "s.toml").write_text(
        'world = "m.yaml"\n[robots]\ncount = 10\n[network.topology]\nuse = "knn"\nk = 2\n[stop]\niterations = 20\n'
    )
    begun = time.perf_counter()
    out = str(tmp_path / "run")
    done = subprocess.run(
        [sys.executable, "-m", "swarmsim", "run", str(tmp_path / "s.toml"), "--out", out],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stdout + done.stderr  # 20 iterations are not enough
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"20 iterations of 10 robots in it: {time.perf_counter() - begun:.1f} s, {memory:.0f} MiB at most")
