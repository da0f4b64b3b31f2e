"""The provenance of one robot's knowledge: the robot that sensed it, the links it came over, its age."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swarmsim.view.plots.fault_marks import area_key, line_key
from swarmsim.view.plots.floor_plan import draw_outlines, measure_in_metres
from swarmsim.view.plots.sheet import is_narrow, settled, sheet
from swarmsim.view.plots.style import BLACK, BLUE, COLOURS, GREY, VERMILLION, Reals, styled
from swarmsim.view.scene import Scene

SHOWN: Final = 6  # others with a colour of their own: those of whom the robot has most
REST: Final = "#C9CED6"
HOPS: Final = ("#08306B", "#4292C6", "#9ECAE1", "#DEEBF7")  # 0, 1, 2, 3 and more links


@styled
def provenance(
    scene: Scene, robot: int, by: NDArray[np.int32], hops: NDArray[np.uint8], age: Reals, ages: Reals, title: str
) -> Figure:
    """One robot's map by sensing robot, links and age; below, the mean age of each robot's knowledge.

    `by`, `hops` and `age` are (rows, columns), the age in iterations and NaN where nothing is known; `ages` (t, n).
    """
    left, right, low, high = scene.bounds
    shape = min((high - low) / (right - left), 2.0)
    figure = sheet(11.4, 3.5 * shape + 2.6, title)
    columns = 1 if is_narrow(figure) else 3
    rows = 3 // columns
    across = figure.get_figwidth() / columns  # inches of a map
    figure.set_figheight(rows * (across * shape + 0.5) + 2.0)
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=(*[max(across * shape, 1.5)] * rows, 2.0))
    maps = [figure.add_subplot(grid[divmod(place, columns)]) for place in range(3)]
    known = np.isfinite(age)
    tellers, cells = np.unique(by[known & (by != robot)], return_counts=True)
    most = sorted(tellers[np.argsort(-cells, kind="stable")][:SHOWN].tolist())
    who = np.full(by.shape, np.nan)
    who[known] = len(most) + 1
    for place, other in enumerate([robot, *most]):
        who[known & (by == other)] = place
    colours = [BLUE, *[colour for colour in COLOURS if colour not in (BLUE, BLACK)][: len(most)], REST]
    pictures: tuple[tuple[Reals, ListedColormap | str, tuple[float, float], str], ...] = (
        (who, ListedColormap(colours), (-0.5, len(colours) - 0.5), f"who sensed what robot {robot} knows"),
        (np.where(known, np.minimum(hops, 3), np.nan), ListedColormap(list(HOPS)), (-0.5, 3.5), "links it came over"),
        (age, "cividis_r", (0.0, max(1.0, float(np.nanmax(age, initial=1.0)))), "age, iterations"),
    )
    for axes, (values, colourmap, (least, greatest), name) in zip(maps, pictures, strict=True):
        image = axes.imshow(
            values, colourmap, vmin=least, vmax=greatest, origin="lower", extent=scene.lattice.extent,
            interpolation="nearest",
        )  # fmt: skip
        draw_outlines(axes, scene.layers, GREY)
        axes.set_title(name, loc="left")
        axes.set(xlabel="x, m")
    figure.colorbar(image, ax=maps[2], fraction=0.05, pad=0.02)
    measure_in_metres(np.array(maps), scene.bounds)
    course = figure.add_subplot(grid[rows, :])
    course.plot(np.arange(1, len(ages) + 1), ages, color=GREY, lw=0.7, alpha=0.6)
    course.plot(np.arange(1, len(ages) + 1), ages[:, robot], color=VERMILLION, lw=1.8)
    course.set(xlabel="iterations", ylabel="mean age, iterations", ylim=(0.0, None), xlim=(1, max(2, len(ages))))
    handles: list[Artist] = [area_key("itself", BLUE, BLACK)]
    handles += [area_key(f"robot {other}", colour, BLACK) for other, colour in zip(most, colours[1:], strict=False)]
    handles += [area_key("others", REST, BLACK)] if len(tellers) > len(most) else []
    handles += [
        area_key(f"{links}{' and more' if links == 3 else ''} link{'s' * (links != 1)}", colour, BLACK)
        for links, colour in enumerate(HOPS)
    ]
    handles += [line_key(f"robot {robot}", VERMILLION, "", "-"), line_key("the others", GREY, "", "-", width=0.8)]
    return settled(figure, handles)
