"""Small buildings drawn in characters, for tests of bounds and tours: # is wall, s a cell where robots start."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from swarmsim.core.scenario.file import load
from swarmsim.engine.build import BuiltRun, build

CELL = 0.15


def built_from(
    drawing: list[str], folder: Path, robots: int = 1, tile: tuple[int, int] = (6, 7), seed: int = 1
) -> BuiltRun:
    """A run in a building whose first line is at the top; its wall is as thick as drawn."""
    cells = np.array([list(line) for line in drawing])
    pixels = np.where(cells == "#", 0, 254).astype(np.uint8)
    rows, columns = cells.shape
    (folder / "map.pgm").write_bytes(b"P5 %d %d 255\n" % (columns, rows) + pixels.tobytes())
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nresolution: {CELL}\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    starts = np.argwhere(cells[::-1] == "s")
    low, high = starts.min(axis=0), starts.max(axis=0) + 1
    spawn = [float(low[1] * CELL), float(low[0] * CELL), *(float(side * CELL) for side in (high - low)[::-1])]
    (folder / "scenario.toml").write_text(
        f'world = {{file = "map.yaml", spawn = {spawn}}}\n[robots]\ncount = {robots}\n'
        f'[sensor]\nuse = "ir-ring"\ntile = {list(tile)}\n[network.topology]\nuse = "none"\n'
    )
    return build(load(folder / "scenario.toml"), "scenario.toml")
