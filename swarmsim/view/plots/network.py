"""A run's network: its graphs over time, degrees, first contacts and contact times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FormatStrFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from swarmsim.network.analysis import LinkGraph, Reach, Spells
from swarmsim.view.plots.fault_marks import area_key, line_key
from swarmsim.view.plots.sheet import settled, sheet, side_by_side
from swarmsim.view.plots.style import BLACK, COLOURS, FINEST, GREY, Line, Reals, styled

PANELS: Final = {
    "mean_degree": "others heard by a live robot",
    "turnover": "neighbour turnover",
    "weak_components": "weak components",
    "strong_components": "strong components",
    "weak_share": "largest weak component",
    "strong_share": "largest strong component",
    "reciprocity": "reciprocity",
    "clustering": "clustering",
}
SHARES: Final = ("turnover", "weak_share", "strong_share", "reciprocity", "clustering")
LINES: Final[tuple[Line, ...]] = ("-", "--")  # of the first graph, and the second
SMOOTHED: Final = 40  # a running mean is taken over this part of the window


@styled
def network_course(graphs: Mapping[str, Sequence[LinkGraph]], first: int, title: str) -> Figure:
    """Eight measures of one or two graphs against the iteration: each value thin, their running mean thick.

    The largest components are shares of the live robots.

    `graphs` gives the snapshots (t,) of each; `first` is the iteration of the first one. Where a measure is not
    defined there is a gap. The band about the number of others heard spans the least to the most of any live robot.
    """
    figure = sheet(9.0, 9.4, title)
    panels: list[Axes] = figure.subplots(4, 2, sharex=True).ravel().tolist()
    length = max(map(len, graphs.values()))
    width = max(1, length // SMOOTHED)
    for axes, (measure, label) in zip(panels, PANELS.items(), strict=True):
        for colour, dash, snapshots in zip(COLOURS, LINES, graphs.values(), strict=False):
            values = _values(snapshots, measure)
            at = first + np.arange(len(values))
            kept = np.unique(np.linspace(0, len(values) - 1, FINEST).round().astype(int))
            if measure == "mean_degree":
                low, high = (_values(snapshots, name)[kept] for name in ("least_degree", "most_degree"))
                axes.fill_between(at[kept], low, high, color=colour, alpha=0.16, linewidth=0)
            else:
                axes.plot(at[kept], values[kept], color=colour, linewidth=0.6, alpha=0.35)
            axes.plot(at[kept], _running_mean(values, width)[kept], color=colour, linestyle=dash, linewidth=1.6)
        axes.set_title(label, loc="left", size="small")
        axes.set_xlim(first - 0.5, first + length - 0.5)
        top = 1.0 if measure in SHARES else max(axes.get_ylim()[1], 1.0)
        axes.set_ylim(-0.04 * top, 1.06 * top)  # a line at 0 is seen above the axis
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=measure not in SHARES))
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    for axes in panels[-2:]:
        axes.set(xlabel="iteration")
    handles: list[Artist] = [
        line_key(f"{name}: running mean of {width} iterations", colour, "", dash)
        for colour, dash, name in zip(COLOURS, LINES, graphs, strict=False)
    ]
    return settled(figure, [*handles, area_key("least to most of any robot", GREY, "none", 0.25)])


@styled
def degrees(graphs: Mapping[str, Sequence[LinkGraph]], title: str) -> Figure:
    """How many others a robot hears, and how many hear it, as shares of all live robots in all iterations.

    `graphs` gives the snapshots of one or two graphs.
    """
    figure = sheet(8.6, 3.8, title)
    panels = side_by_side(figure, shared=True)
    width = 0.8 / len(graphs)
    sides = {"degrees": "others heard (in-degree)", "listeners": "others that hear it (out-degree)"}
    for axes, (side, label) in zip(panels, sides.items(), strict=True):
        longest = 0
        for row, (colour, snapshots) in enumerate(zip(COLOURS, graphs.values(), strict=False)):
            counts = np.bincount(np.concatenate([getattr(snapshot, side) for snapshot in snapshots]), minlength=1)
            places = np.arange(len(counts)) + width * (row - 0.5 * (len(graphs) - 1))
            axes.bar(places, 100.0 * counts / max(counts.sum(), 1), width, color=colour)
            longest = max(longest, len(counts))
        axes.set(xlabel=label, xlim=(-0.6, longest - 0.4))
        axes.grid(False, axis="x")
        axes.xaxis.set_major_locator(MaxNLocator(12, integer=True))
    panels[0].set(ylabel="live robots, %")
    observed = {name: sum(len(snapshot.degrees) for snapshot in snapshots) for name, snapshots in graphs.items()}
    return settled(
        figure,
        [
            area_key(f"{name}, n = {number} robots x iterations", colour, "none")
            for colour, (name, number) in zip(COLOURS, observed.items(), strict=False)
        ],
    )


@styled
def who_heard_whom(found: Reach, title: str) -> Figure:
    """The iteration in which each robot first heard each other: rows are receivers, columns senders."""
    robots = len(found.present)
    side = 4.6 + 0.02 * min(robots, 100)
    figure = sheet(side + 1.4, side + 0.9, title)
    axes = figure.subplots()
    axes.grid(False)
    axes.imshow(np.eye(robots), cmap=ListedColormap(["white", GREY]), interpolation="nearest", vmin=0, vmax=1)
    shown = np.ma.masked_less(found.first_heard, 0)
    picture = axes.imshow(shown, cmap="viridis", interpolation="nearest")
    if shown.count():
        figure.colorbar(picture, ax=axes, shrink=0.8, label="first heard in iteration")
    axes.set(xlabel="robot heard", ylabel="robot that hears")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(FixedLocator(range(robots)) if robots <= 24 else MaxNLocator(20, integer=True))
    pairs = int(found.present.sum()) * (int(found.present.sum()) - 1)
    heard = int(found.union.sum())
    return settled(
        figure,
        [
            area_key(f"never heard ({pairs - heard} of {pairs} ordered pairs)", "white", BLACK),
            area_key("the robot itself", GREY, "none"),
        ],
    )


@styled
def contact_times(graphs: Mapping[str, tuple[Spells, Spells]], title: str) -> Figure:
    """The share of contacts, and of times between contacts, that last longer than the iterations along x.

    `graphs` gives both for each kind of pair. Kaplan-Meier estimates on log-log axes; a point marks the time when
    half of them are over.
    """
    figure = sheet(9.6, 4.0, title)
    panels = side_by_side(figure, shared=True)
    lowest = 1.0
    for number, (axes, label) in enumerate(zip(panels, ("contact time", "time between contacts"), strict=True)):
        lines: list[Artist] = []
        for colour, dash, (name, both) in zip(COLOURS, LINES, graphs.items(), strict=False):
            spells = both[number]
            lengths, outlasting = spells.survival()
            # Nothing lasts less than an iteration; a share of 0 has no place on a logarithmic scale.
            upright = np.where(outlasting > 0.0, outlasting, np.nan)
            axes.step(np.r_[1.0, lengths], np.r_[1.0, upright], where="post", color=colour, ls=dash, lw=1.6)
            lowest = min([lowest, *outlasting[outlasting > 0.0]])
            median = spells.median()
            if median is not None:
                axes.plot([median], [0.5], "o", color=colour, mec=BLACK, ms=6, clip_on=False)
            censored = int((~spells.ended[spells.begun]).sum())
            half = "no median" if median is None else f"median {median:g}"
            text = f"{name}: {half}, n = {spells.begun.sum()}, {censored} censored"
            lines.append(line_key(text, colour, "o", dash, edge=BLACK))
        axes.set(xscale="log", yscale="log", xlabel=f"{label}, iterations")
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.legend(handles=lines, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    panels[0].set(ylabel="share that lasts longer", ylim=(0.7 * lowest, 1.2))
    panels[0].yaxis.set_major_formatter(FormatStrFormatter("%g"))
    panels[0].yaxis.set_minor_formatter(NullFormatter())
    return settled(figure)


def _values(snapshots: Sequence[LinkGraph], measure: str) -> Reals:
    return np.array([getattr(snapshot, measure) for snapshot in snapshots], dtype=np.float64)


def _running_mean(values: Reals, width: int) -> Reals:
    """The mean of the defined values among `width` about each; NaN where there is none."""
    there = np.isfinite(values)
    sums, counts = (
        np.convolve(part, np.ones(width), mode="same") for part in (np.where(there, values, 0.0), there.astype(float))
    )
    means: NDArray[np.float64] = np.where(counts > 0.5, sums / np.maximum(counts, 1.0), np.nan)
    return means
