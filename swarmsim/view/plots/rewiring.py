"""Rewiring: the network in the building at two moments, and the robots whose neighbours changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from numpy.typing import NDArray

from swarmsim.view.plots.fault_marks import line_key
from swarmsim.view.plots.floor_plan import dead_key, draw_robot, draw_solids, measure_in_metres, solid_keys
from swarmsim.view.plots.sheet import settled, sheet, side_by_side
from swarmsim.view.plots.style import BLACK, BLUE, COLOURS, GREY, VERMILLION, styled
from swarmsim.view.scene import Scene

DISC: Final = 8.5  # points across
APART: Final = 1.4  # discs, between the middles of two, so that an arrow between them is seen
WIDTH: Final = 4.2  # inches, of one floor plan
PLAIN: Final = "#E5E7EB"
SPREADING: Final = 300  # steps
ORANGE: Final = COLOURS[4]


@styled
def rewiring(scene: Scene, heard: Mapping[int, NDArray[np.int32]], title: str) -> Figure:
    """The swarm at two iterations, with who hears whom: links that are there at one of them alone
    are coloured, and robots whose set of heard neighbours differs.

    `heard` gives, for each of the two iterations in order, the messages (m, 2) that were heard: receiver, sender.
    """
    pairs = [{(int(receiver), int(sender)) for receiver, sender in links} for links in heard.values()]
    changed = changes(*(_neighbours(links, scene.robots) for links in heard.values()))
    lasting = {robot for robot in changed if all(scene.at(at).alive[robot] for at in heard)}
    left, right, *_ = scene.bounds
    shots = {iteration: scene.at(iteration) for iteration in heard}
    places = {iteration: shot.pose[:, :2].copy() for iteration, shot in shots.items()}
    for iteration, shot in shots.items():
        crowd = places[iteration][shot.alive]
        places[iteration][shot.alive] = spread(crowd, APART * DISC * (right - left) / (72.0 * WIDTH))
    moved = any(not np.array_equal(places[at], shot.pose[:, :2]) for at, shot in shots.items())
    handles: list[Artist] = [
        line_key("heard at both iterations", GREY, ">", "-", size=5, width=1.0),
        line_key("only at the first", VERMILLION, ">", "-", size=5, width=1.4),
        line_key("only at the second", BLUE, ">", "-", size=5, width=1.4),
        line_key(f"robot that hears others than before ({len(lasting)})", ORANGE, "o", edge=BLACK),
    ]
    handles += [line_key("drawn apart where too close", PLAIN, "o", edge=BLACK)] if moved else []
    handles += [] if all(shot.alive.all() for shot in shots.values()) else [dead_key()]
    handles += solid_keys(scene.layers)
    figure = sheet(2 * WIDTH + 0.9, 4.5, title)
    panels = side_by_side(figure, shared=True)
    for axes, (iteration, links), mine, other, own in zip(
        panels, heard.items(), pairs, pairs[::-1], (VERMILLION, BLUE), strict=True
    ):
        alive = shots[iteration].alive
        draw_solids(axes, scene.layers)
        _arrows(axes, mine, other, places[iteration], own)
        for robot, (x, y) in enumerate(places[iteration].tolist()):
            draw_robot(axes, x, y, robot, ORANGE if robot in lasting else PLAIN, DISC, bool(alive[robot]))
        count = len(np.unique(links, axis=0))
        axes.set_title(f"iteration {iteration}: n = {alive.sum()} robots, {count} links", loc="left")
    measure_in_metres(panels, scene.bounds)
    return settled(figure, handles)


def changes(before: Sequence[set[int]], after: Sequence[set[int]]) -> dict[int, tuple[list[int], list[int]]]:
    """The robots whose neighbours differ, each with those it no longer hears and those it newly hears."""
    pairs = enumerate(zip(before, after, strict=True))
    return {robot: (sorted(old - new), sorted(new - old)) for robot, (old, new) in pairs if old != new}


def spread(places: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Places (n, 2) near the given ones, at least `least` apart where a few hundred steps achieve it.

    In each step two places that are too close move apart equally; those far from all others stay.
    """
    moved = places.copy()
    for _ in range(SPREADING):
        between = moved[:, None] - moved[None]
        distance = np.hypot(between[..., 0], between[..., 1])
        np.fill_diagonal(distance, np.inf)
        if not (distance < least).any():
            break
        short = 0.5 * np.maximum(1.02 * least - distance, 0.0) * (distance < least)
        moved += (between * (short / np.maximum(distance, 1e-9))[..., None]).sum(axis=1)
    return moved


def _neighbours(links: NDArray[np.int32], robots: int) -> list[set[int]]:
    return [set(links[links[:, 0] == robot, 1].tolist()) for robot in range(robots)]


def _arrows(
    axes: Axes, pairs: set[tuple[int, int]], other: set[tuple[int, int]], places: NDArray[np.float64], own: str
) -> None:
    """An arrow from each sender to its receiver; links missing at the other moment have their `own` colour.

    It has two heads where both hear each other, then and now.
    """
    for receiver, sender in sorted(pairs):
        kept = (receiver, sender) in other
        mutual = (sender, receiver) in pairs and ((sender, receiver) in other) == kept
        if mutual and sender < receiver:
            continue
        axes.add_patch(
            FancyArrowPatch(
                places[sender], places[receiver], arrowstyle="<|-|>" if mutual else "-|>", mutation_scale=6.0,
                shrinkA=0.5 * DISC, shrinkB=0.5 * DISC, linewidth=0.8 if kept else 1.3, color=GREY if kept else own,
                zorder=2,
            )
        )  # fmt: skip
