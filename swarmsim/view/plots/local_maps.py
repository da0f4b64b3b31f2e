"""The maps of single robots at one moment, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from swarmsim.view.plots.fault_marks import area_key, line_key
from swarmsim.view.plots.floor_plan import dead_key, draw_outlines, measure_in_metres
from swarmsim.view.plots.sheet import settled, sheet
from swarmsim.view.plots.style import BLACK, BLUE, COLUMN, GREY, VERMILLION, asked_for, styled
from swarmsim.view.scene import Scene

UNSEEN, OPEN, SOLID = "#C9CED6", "#FFFFFF", "#000000"
CELLS: Final = {"unknown": UNSEEN, "free": OPEN, "occupied": SOLID}  # in the order of their values
ACROSS: Final = 3  # maps in a row


@styled
def local_maps(
    scene: Scene, maps: NDArray[np.uint8], shares: Sequence[float], robots: Sequence[int], iteration: int, title: str
) -> Figure:
    """The maps of `robots` at the end of an iteration, with each robot's position and sensed tile.

    `maps` (n, rows, columns) and `shares` (n,), the part of the domain in each map, 0 to 1, belong to all robots.
    The outlines are the true ones, which no robot knows.
    """
    width = asked_for().width
    columns = 2 if len(robots) == 4 else min(len(robots), ACROSS if width is None or width > COLUMN else 2)
    rows = -(-len(robots) // columns)
    figure = sheet(3.6 * columns + 0.9, 4.0 * rows, title)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    shot, lattice = scene.at(iteration), scene.lattice
    height, length = (side * lattice.cell for side in scene.tile)
    for axes, robot in zip(panels, robots, strict=False):
        axes.imshow(
            maps[robot], ListedColormap(list(CELLS.values())), vmin=0, vmax=2, origin="lower", extent=lattice.extent,
            interpolation="nearest",
        )  # fmt: skip
        draw_outlines(axes, scene.layers, BLUE)
        if shot.alive[robot] and len(shot.origins):
            axes.add_patch(Rectangle(shot.origins[robot].tolist(), length, height, fill=False, ec=VERMILLION, lw=1.0))
        state, mark, colour = ("", "o", VERMILLION) if shot.alive[robot] else (", dead", "x", GREY)
        axes.plot(*shot.pose[robot, :2], mark, color=colour, ms=3.0)  # small enough to leave the tile in sight
        axes.set_title(f"robot {robot}{state}: {100.0 * shares[robot]:.1f} % mapped", loc="left")
    measure_in_metres(panels, scene.bounds)
    for axes in panels[len(robots) :]:
        axes.set_visible(False)
    for axes in panels[len(robots) - columns : len(robots)]:  # nothing stands below these
        axes.set(xlabel="x, m")
        axes.tick_params(labelbottom=True)
    handles: list[Artist] = [area_key(name, colour, BLACK) for name, colour in CELLS.items()]
    handles += [line_key("walls as they are", BLUE, "", "-", width=0.8), line_key("robot", VERMILLION, "o", size=3.0)]
    handles += [area_key("its tile", "none", VERMILLION)] if len(shot.origins) else []
    handles += [] if shot.alive[list(robots)].all() else [dead_key()]
    return settled(figure, handles)
