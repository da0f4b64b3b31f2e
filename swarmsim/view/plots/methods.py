"""Methods compared over many tasks: ratios with their intervals, and performance profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from swarmsim.view.plots.fault_marks import line_key
from swarmsim.view.plots.sheet import settled, sheet
from swarmsim.view.plots.style import COLOURS, DASHES, GREY, MARKERS, Reals, styled

TAUS: Final = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # marked along profiles


@dataclass(frozen=True, slots=True)
class Ratios:
    """One method in one group of tasks."""

    method: str
    ratio: float  # of its time to that of the first method
    interval: tuple[float, float]  # 95 %
    taus: Reals  # (t,): rising ratios ...
    profile: Reals  # (t,): ... and the share of runs within each


@styled
def ratios(groups: Mapping[str, Sequence[Ratios]], title: str, unit: str = "") -> Figure:
    """Ratios of each method's time to the first one's, or to the `unit`, with 95 % intervals, per group; in logs."""
    names = [one.method for one in next(iter(groups.values()))]
    figure = sheet(8.4, 1.6 + 0.4 * len(names), title)
    axes = figure.subplots()
    handles = []
    for row, (group, methods) in enumerate(groups.items()):
        offset = (row - (len(groups) - 1) / 2) * 0.7 / max(1, len(groups))
        places = np.arange(len(methods)) + offset
        colour, marker = COLOURS[row % len(COLOURS)], MARKERS[row % len(MARKERS)]
        low, high = np.array([one.interval for one in methods]).T
        axes.hlines(places, low, high, color=colour, lw=1.6)
        axes.plot([one.ratio for one in methods], places, marker, color=colour, ms=5)
        if group:
            handles.append(line_key(group, colour, marker, "-"))
    axes.axvline(1.0, color=GREY, lw=1.2)
    axes.set_yticks(range(len(names)), names)
    axes.set(
        ylim=(len(names) - 0.5, -0.5),
        xscale="log",
        xlabel=f"T99 over {unit}" if unit else f"time, times that of {names[0]}",
    )
    ends = np.array([(1.0, 1.0), *(one.interval for methods in groups.values() for one in methods)])
    ticks = [tick for tick in (0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 20.0)
             if ends.min() / 1.3 <= tick <= ends.max() * 1.3]  # fmt: skip
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    return settled(figure, handles)


@styled
def profiles(
    groups: Mapping[str, Sequence[Ratios]], title: str, unit: str = "the first method's mean", of: str = "runs finished"
) -> Figure:
    """The share of runs (`of`: which) that each method finishes within tau times the unit in the task; per group.

    Performance profiles as in Agarwal et al. (2021): the higher the curve, the better.
    """
    figure = sheet(4.2 * min(2, len(groups)), 1.4 + 2.9 * -(-len(groups) // 2), title)
    panels = figure.subplots(-(-len(groups) // 2), min(2, len(groups)), sharex=True, sharey=True, squeeze=False)
    handles = []
    for axes, (group, methods) in zip(panels.flat, groups.items(), strict=False):
        for row, one in enumerate(methods):
            colour, dash = COLOURS[row % len(COLOURS)], DASHES[row // len(COLOURS) % len(DASHES)]
            axes.plot(one.taus, 100.0 * one.profile, color=colour, linestyle=dash, lw=1.5)
        axes.set(title=group, xscale="log", ylim=(0.0, 102.0), xlim=(one.taus[0], one.taus[-1]))
        ticks = [tick for tick in TAUS if one.taus[0] <= tick <= one.taus[-1]]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        axes.axvline(1.0, color=GREY, lw=0.8)
    for axes in panels.flat[len(groups) :]:
        axes.remove()
    for axes in panels[:, 0]:
        axes.set_ylabel(f"{of}, %")
    for axes in panels[-1]:
        axes.set_xlabel(f"within so many times {unit}")
    for row, one in enumerate(next(iter(groups.values()))):
        key = line_key(one.method, COLOURS[row % len(COLOURS)], "")
        key.set_linestyle(DASHES[row // len(COLOURS) % len(DASHES)])
        handles.append(key)
    return settled(figure, handles)
