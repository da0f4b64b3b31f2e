"""An imported file before and after reading: its drawing, and the floor found in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import shapely
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle

from swarmsim.view.plots.fault_marks import area_key, line_key
from swarmsim.view.plots.floor_plan import draw_solids, measure_in_metres, outline, solid_keys
from swarmsim.view.plots.sheet import settled, sheet, side_by_side
from swarmsim.view.plots.style import BLACK, VERMILLION, styled
from swarmsim.world.plan import FloorPlan

FLOOR: Final = "#CDE8D5"
POCKET: Final = "#F3D9A4"
UNKNOWN: Final = ("#E3E6EB", "#C9CED6")


@styled
def imported(
    shown: Sequence[tuple[shapely.MultiPolygon, float]],
    plan: FloorPlan,
    floor: shapely.Polygon | None,
    pockets: Sequence[shapely.Polygon],
    title: str,
) -> Figure:
    """A file's drawing, as areas with their ink from 0 to 1, beside the floor plan made from it.

    `floor` is the free space where robots start; they cannot enter `pockets`.
    """
    drawn = [area for area, _ in shown if not area.is_empty]
    extent: list[float]
    extent = shapely.total_bounds([*drawn, plan.walls, plan.border, *([floor] if floor else [])]).tolist()
    left, low, right, high = extent
    around = 0.03 * max(right - left, high - low)
    bounds = left - around, right + around, low - around, high + around
    figure = sheet(11.0, 5.0, title)
    before, after = side_by_side(figure)
    for area, ink in shown:
        level = 1.0 - 0.85 * min(max(ink, 0.08), 1.0)
        before.add_patch(PathPatch(outline(area), facecolor=(level, level, level), edgecolor="#8A8F98", lw=0.2))
    if floor is not None:
        after.add_patch(PathPatch(outline(shapely.MultiPolygon([floor])), facecolor=FLOOR, edgecolor="none"))
    for pocket in pockets:
        after.add_patch(PathPatch(outline(shapely.MultiPolygon([pocket])), facecolor=POCKET, edgecolor="none"))
    if not plan.unknown.is_empty:
        patch = PathPatch(outline(plan.unknown), facecolor=UNKNOWN[0], hatch="///", edgecolor=UNKNOWN[1], lw=0.0)
        after.add_patch(patch)
    draw_solids(after, plan.layers)
    if not plan.border.is_empty:
        after.add_patch(PathPatch(outline(plan.border), facecolor=BLACK, edgecolor="none", alpha=0.35))
    for x0, y0, x1, y1 in plan.openings:
        after.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=VERMILLION, edgecolor=VERMILLION, lw=1.6))
    before.set_title("what the file shows")
    after.set_title("what is read")
    measure_in_metres([before, after], bounds)
    handles: list[Artist] = [*solid_keys(plan.layers)]
    handles += [area_key("floor", FLOOR, FLOOR)] if floor is not None else []
    handles += [area_key("cannot be entered", POCKET, POCKET)] if len(pockets) else []
    handles += [] if plan.unknown.is_empty else [area_key("unknown", *UNKNOWN)]
    handles += [] if plan.border.is_empty else [area_key("border", "#A6A6A6", "#A6A6A6")]
    handles += [line_key("door that was made", VERMILLION, "s", "", size=6.0)] if plan.openings else []
    return settled(figure, handles)
