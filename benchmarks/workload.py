"""W(N): N robots of 0.05 m radius wander among pillars, one robot per square metre, with 24 beams of 0.5 m."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

PILLARS = 7  # along a side, squares of four segments each: with the outer walls, 200 segments
RADIUS, SPEED, REACH, BEAMS, PERIOD = 0.05, 0.15, 0.5, 24, 0.1  # m, m/s, m, 1, s


def pillars(robots: int, area: float = 1.0) -> tuple[float, list[tuple[float, float, float, float]]]:
    """The side (m) of the arena for this many robots, and its pillars: left, lower, right, upper edges in m.

    There are `area` m^2 for each robot.
    """
    side = float(np.sqrt(area * robots))
    pitch = side / PILLARS
    half = 0.075 * pitch
    centres = [(i + 0.5) * pitch for i in range(PILLARS)]
    return side, [(x - half, y - half, x + half, y + half) for y in centres for x in centres]


def segments(robots: int) -> np.ndarray:
    """The walls (200, 4) as x1, y1, x2, y2 in m."""
    side, squares = pillars(robots)
    found = []
    for left, low, right, high in [*squares, (0.0, 0.0, side, side)]:
        found += [
            (left, low, right, low),
            (right, low, right, high),
            (right, high, left, high),
            (left, high, left, low),
        ]
    return np.array(found)


def written(folder: Path, robots: int, mapping: bool, iterations: int, area: float = 1.0) -> Path:
    """A swarmsim scenario file for W(N); mapping robots share tiles with their two nearest."""
    side, squares = pillars(robots, area)
    thick = 0.2

    def ring(left: float, low: float, right: float, high: float) -> list[list[float]]:
        return [[left, low], [right, low], [right, high], [left, high], [left, low]]

    def feature(layer: str, *rings: list[list[float]]) -> dict[str, object]:
        geometry = {"type": "Polygon", "coordinates": rings}
        return {"type": "Feature", "properties": {"layer": layer}, "geometry": geometry}

    frame = feature("walls", ring(-thick, -thick, side + thick, side + thick), ring(0.0, 0.0, side, side)[::-1])
    plan = {
        "type": "FeatureCollection",
        "bbox": [-thick, -thick, side + thick, side + thick],
        "features": [
            frame, *(feature("walls", ring(*square)) for square in squares),
            feature("spawn", ring(RADIUS, RADIUS, side - RADIUS, side - RADIUS)),
        ],
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"w{robots}.geojson").write_text(json.dumps(plan))
    mind = 'computation = {use = "occupancy-grid"}' if mapping else 'computation = {use = "reactive"}'
    network = 'use = "knn"\nk = 2' if mapping else 'use = "none"'
    task = 'use = "coverage"' if mapping else 'use = "travelled"\ndistance = 1e9'
    path = folder / f"w{robots}{'-mapping' if mapping else ''}.toml"
    path.write_text(f"""world = "w{robots}.geojson"
period = {PERIOD}
grid = {{cell = 0.2}}
physics = {{substep = 0.05}}
mind = {{{mind}, strategy = {{use = "wander", clearance = 0.2}}}}
[robots]
count = {robots}
radius = {RADIUS}
wheel_base = 0.08
speed = {SPEED}
[sensor]
use = "ir-ring"
tile = [5, 5]
beams = {BEAMS}
reach = {REACH}
robots = "occlude"
ranges = true
[network.topology]
{network}
[task]
{task}
[stop]
iterations = {iterations}
when_done = "continue"
""")
    return path
