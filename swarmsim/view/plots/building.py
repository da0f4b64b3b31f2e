"""A building as a swarm finds it: cells, domain, spawn areas, doors, and problems."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from numpy.typing import NDArray

from swarmsim.core.lattice import Lattice
from swarmsim.view.plots.fault_marks import area_key, line_key
from swarmsim.view.plots.floor_plan import SOLIDS, Bounds, draw_solids, measure_in_metres, outline, solid_keys
from swarmsim.view.plots.sheet import settled, sheet
from swarmsim.view.plots.style import BLACK, BLUE, GREEN, PALE, VERMILLION, styled
from swarmsim.world.plan import FloorPlan

AMBER: Final = "#E69F00"
FINEST_GRID: Final = 250  # cells across, beyond which a grid of lines is grey
MOST_DOORS: Final = 60  # that are drawn with their widths
CHANCE: Final = {"wide enough": GREEN, "tight, under two diameters": AMBER, "too narrow": VERMILLION}


@styled
def building(
    plan: FloorPlan,
    lattice: Lattice,
    domain: NDArray[np.bool_] | None,
    doors: Sequence[tuple[float, float, float]],
    pockets: Sequence[tuple[float, float]],
    problems: Sequence[tuple[float, float]],
    diameter: float,
    title: str,
) -> Figure:
    """A floor plan with its grid, the `domain` (rows, columns), spawn areas, and `doors` (x, y, width in m).

    Doors are coloured by how well a robot of `diameter` (m) fits through; `pockets` are places that it cannot enter,
    `problems` those that make 100 % unattainable.
    """
    bounds = _bounds(plan)
    left, right, low, high = bounds
    figure = sheet(9.0, 6.0, title)
    axes = figure.subplots()
    if domain is not None:
        axes.imshow(
            domain, ListedColormap(["#FFFFFF00", PALE]), vmin=0, vmax=1, origin="lower", extent=lattice.extent,
            interpolation="nearest", zorder=0,
        )  # fmt: skip
    if not plan.unknown.is_empty:
        axes.add_patch(PathPatch(outline(plan.unknown), facecolor="#E3E6EB", hatch="///", edgecolor="#C9CED6", lw=0.0))
    for area in plan.spawns.values():
        axes.add_patch(PathPatch(outline(area), facecolor="none", edgecolor=BLUE, lw=1.4, ls="--", zorder=2))
    draw_solids(axes, plan.layers)
    if (right - left) / lattice.cell <= FINEST_GRID:
        rows, columns = lattice.shape
        axes.vlines(lattice.x0 + lattice.cell * np.arange(columns + 1), low, high, color="#B9C2CE", lw=0.25, zorder=1)
        axes.hlines(lattice.y0 + lattice.cell * np.arange(rows + 1), left, right, color="#B9C2CE", lw=0.25, zorder=1)
    for x, y, wide in list(doors)[:MOST_DOORS]:
        colour = CHANCE[_chance(wide, diameter)]
        axes.plot(x, y, "o", ms=5.0, color=colour, mec=BLACK, mew=0.4, zorder=4)
        axes.annotate(
            f"{wide:.2f}", (x, y), (4, 3), textcoords="offset points", size="x-small", zorder=5,
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75},
        )  # fmt: skip
    for places, mark, size in ((pockets, "x", 5.0), (problems, "D", 9.0)):
        if len(places):
            axes.plot(*np.transpose(places), mark, ms=size, color=VERMILLION, mec=BLACK if mark == "D" else VERMILLION)
    measure_in_metres([axes], bounds)
    handles: list[Artist] = list(solid_keys(plan.layers))
    handles += [] if domain is None else [area_key("counts for 100 %", PALE, "#B9C2CE")]
    handles += [] if plan.unknown.is_empty else [area_key("unknown", "#E3E6EB", "#C9CED6")]
    handles.append(line_key("spawn area", BLUE, "", "--", width=1.4))
    found = {_chance(wide, diameter) for _, _, wide in doors}
    handles += [line_key(f"door, m: {c}", CHANCE[c], "o", "", size=5.0) for c in CHANCE if c in found]
    handles += [line_key("cannot be reached", VERMILLION, "x", "", size=5.0)] if len(pockets) else []
    handles += [line_key("problem", VERMILLION, "D", "", size=7.0)] if len(problems) else []
    return settled(figure, handles)


def _chance(width: float, diameter: float) -> str:
    """How well a robot fits through a door."""
    names = list(CHANCE)
    return names[2] if width < diameter else names[1] if width < 2.0 * diameter else names[0]


def _bounds(plan: FloorPlan) -> Bounds:
    """The bounds shown: the solid areas, and the page unless it is much larger."""
    left, low, right, high = shapely.total_bounds(
        [layer for name in SOLIDS if not (layer := plan.layers[name]).is_empty] or [plan.walls]
    )
    around = 0.03 * max(right - left, high - low)
    return left - around, right + around, low - around, high + around
