"""The area of the robots in a simulator's world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely

from swarmsim.core.events import Box
from swarmsim.world.areas import polygons
from swarmsim.world.plan import SPAWN_LAYER
from swarmsim.world.shapes import Shape

_AROUND: Final = 0.5  # m, on each side of the outermost robots


def start(places: Sequence[tuple[float, float]], solid: Sequence[Shape], page: Box) -> list[Shape]:
    """A spawn area: a box around the robots' places (m), without solids and the space behind them."""
    points = np.array(places).reshape(-1, 2)
    if not len(points):
        return []
    box = shapely.box(*(points.min(axis=0) - _AROUND), *(points.max(axis=0) + _AROUND))
    walls = shapely.union_all([shape.fill for shape in solid])
    free = polygons(box.intersection(shapely.box(*page)).difference(walls))
    with_robots = [piece for piece in free.geoms if shapely.intersects_xy(piece, points[:, 0], points[:, 1]).any()]
    area = shapely.MultiPolygon(with_robots)
    return [] if area.is_empty else [Shape(area, layer=SPAWN_LAYER, spawn=SPAWN_LAYER, where="the robots' places")]
