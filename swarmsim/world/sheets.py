"""Drawings put together from shapes: their page, and the scenario's scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import shapely
from shapely import MultiPolygon, affinity

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.file import World
from swarmsim.world.plan import DOORS_LAYER, FLOOR_LAYER, SOLID_LAYERS
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.viewport import LARGEST


def sheet(
    name: str, shapes: Sequence[Shape], world: World, page: Box | None, unit: str, notices: Sequence[str]
) -> Drawing:
    """A drawing of these shapes, scaled by `world.scale` or to `world.width`.

    Without a page, its extent is that of all shapes in layers, or else of all shapes. Raises InputError if too large.
    """
    layered = [shape for shape in shapes if shape.layer not in ("", DOORS_LAYER)] or shapes
    inked = [area for shape in layered if not (area := shape.stroke if shape.fill.is_empty else shape.fill).is_empty]
    if not inked:
        raise InputError(f"{name}: nothing in it is solid; expected polygons, or lines with a width")
    left, low, right, high = page or (float(side) for side in shapely.total_bounds(inked))
    factor = (world.scale or 1.0) if world.width is None else world.width / (right - left)
    box = (left * factor, low * factor, right * factor, high * factor)
    if not max(map(abs, box)) <= LARGEST:
        raise InputError(f"{name}: a point lies farther than {LARGEST:g} m from the origin; is the scale right?")
    scaled = shapes if factor == 1.0 else [_scaled(shape, factor) for shape in shapes]
    says_solid = any(shape.layer in (*SOLID_LAYERS, FLOOR_LAYER) for shape in shapes)
    return Drawing(name, tuple(scaled), box, unit, tuple(notices), says_solid)


def _scaled(shape: Shape, factor: float) -> Shape:
    def larger(area: MultiPolygon) -> MultiPolygon:
        return affinity.scale(area, factor, factor, origin=(0.0, 0.0))

    lines = tuple(line * factor for line in shape.lines)
    return replace(shape, fill=larger(shape.fill), stroke=larger(shape.stroke), lines=lines, pen=shape.pen * factor)
