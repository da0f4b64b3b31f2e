"""The background of a run's figures: the floor plan in metres, and the signs of robots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from swarmsim.view.plots.style import BLACK, GREY

SOLIDS: Final = {"walls": "#9AA3AF", "pillars": "#B4BAC4", "furniture": "#CFC7BA"}
EDGE: Final = "#5B6470"

Bounds = tuple[float, float, float, float]  # m: left, right, lower, upper


def draw_solids(axes: Axes, layers: Mapping[str, shapely.MultiPolygon]) -> None:
    """Fill the solid areas, layer by layer."""
    for name, colour in SOLIDS.items():
        axes.add_patch(PathPatch(outline(layers[name]), facecolor=colour, edgecolor=EDGE, linewidth=0.5))


def draw_outlines(axes: Axes, layers: Mapping[str, shapely.MultiPolygon], colour: str) -> None:
    """Draw the edges of solid areas as faint lines over the figure."""
    for name in SOLIDS:
        axes.add_patch(PathPatch(outline(layers[name]), facecolor="none", edgecolor=colour, linewidth=0.6, alpha=0.6))


def solid_keys(layers: Mapping[str, shapely.MultiPolygon]) -> list[Artist]:
    """The legend's entries for layers that are not empty."""
    there = {name: colour for name, colour in SOLIDS.items() if not layers[name].is_empty}
    return [PathPatch(Path.unit_rectangle(), facecolor=c, edgecolor=EDGE, lw=0.5, label=n) for n, c in there.items()]


def measure_in_metres(panels: Iterable[Axes], bounds: Bounds) -> None:
    """Give all panels of a grid the same limits and equal scales in x and y; outer labels only."""
    for axes in panels:
        axes.set(xlim=bounds[:2], ylim=bounds[2:], aspect="equal", xlabel="x, m", ylabel="y, m")
        axes.grid(False)
        axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        axes.yaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
        axes.label_outer()


def draw_robot(axes: Axes, x: float, y: float, robot: int, colour: str, size: float, alive: bool = True) -> None:
    """A disc with the robot's id, `size` in points; dead robots are grey crosses beside their ids."""
    if alive:
        axes.plot([x], [y], "o", color=colour, mec=BLACK, mew=0.5, ms=size, zorder=4)
        letters = 0.62 * size if robot < 100 else 0.48 * size
        axes.text(x, y, str(robot), color=ink_on(colour), size=letters, ha="center", va="center_baseline", zorder=4)
    else:
        axes.plot([x], [y], "x", color=GREY, ms=0.6 * size, zorder=3)
        axes.annotate(
            str(robot), (x, y), (0.5 * size, 0), textcoords="offset points", color=GREY, size=0.6 * size, va="center"
        )


def dead_key() -> Line2D:
    """The legend's entry for dead robots."""
    return Line2D([], [], color=GREY, linestyle="", marker="x", markersize=6, label="dead")


def ink_on(colour: str) -> str:
    """Black or white, whichever is easier to read on `colour`, given as #RRGGBB."""
    red, green, blue = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return BLACK if 0.299 * red + 0.587 * green + 0.114 * blue > 120 else "#FFFFFF"


def outline(shapes: shapely.MultiPolygon) -> Path:
    """All rings as one path; holes run against their outlines, so that they are not filled."""
    rings = [
        Path(np.asarray(ring.coords)[:, :2], closed=True)
        for part in shapes.geoms
        for ring in _rings(shapely.geometry.polygon.orient(part))
    ]
    return Path.make_compound_path(*rings)


def _rings(part: shapely.Polygon) -> list[shapely.LinearRing]:
    return [part.exterior, *part.interiors]
