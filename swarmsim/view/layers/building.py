"""The building and its contents: floor, walls, boxes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from swarmsim.core.drawing import Lines, Mark, Polygons, ends_of
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.signs import Sign
from swarmsim.view.style import Style

FLOOR, EDGES, BOXES = 0.0, 20.0, 30.0  # z


class BuildingLayer:
    """The floor plan, constant over the run."""

    name = "building"

    def __init__(self, scene: Scene) -> None:
        floor = "unexplored" if scene.has_maps else "floor"
        solids = [(name, list(shape.geoms)) for name, shape in scene.layers.items() if not shape.is_empty]
        rings = [ring for _, parts in solids for part in parts for ring in (part.exterior, *part.interiors)]
        edges = Lines(
            *ends_of(map(shapely.get_coordinates, rings)), "edge", None, 2.0, name="edges", z=EDGES, still=True
        )
        areas = [_areas(scene.footprint, floor), *(_areas(parts, name) for name, parts in solids)]
        self._marks: list[Mark] = [*areas, edges]

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Areas, and their outlines above the known floor."""
        return self._marks

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """None: walls need no explanation."""
        return []


class BoxLayer:
    """Closed doors, furniture and rubble."""

    name = "boxes"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Rectangles."""
        return [box_marks(*shot.boxes)] if shot.boxes else []

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A box, if one ever appears."""
        return [Sign("box", "box placed during the run", [box_marks((-7.0, -5.0, 7.0, 5.0))])] * ("box" in scene.signs)


def box_marks(*boxes: tuple[float, float, float, float]) -> Polygons:
    """Boxes (left, lower, right, upper) in m."""
    corners = [np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) for x0, y0, x1, y1 in boxes]
    return Polygons(*ends_of(corners), "walls", "mark", 1.5, name="box", z=BOXES)


def _areas(parts: Iterable[shapely.Polygon], ink: str) -> Polygons:
    """Large areas first: a hole is cut before the smaller areas inside it are drawn."""
    order = sorted(parts, key=lambda part: -shapely.Polygon(part.exterior).area)
    rings = [(ring, place > 0) for part in order for place, ring in enumerate((part.exterior, *part.interiors))]
    points, ends = ends_of(shapely.get_coordinates(ring) for ring, _ in rings)
    holes = np.array([hole for _, hole in rings], np.bool_)
    return Polygons(points, ends, ink, None, holes=holes, name=ink, z=FLOOR, still=True)
