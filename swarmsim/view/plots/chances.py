"""How likely a task is to be done by a time, and what each way of doing it costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from swarmsim.view.plots.fault_marks import area_key, line_key
from swarmsim.view.plots.sheet import settled, sheet
from swarmsim.view.plots.style import BLACK, COLOURS, DASHES, GREY, MARKERS, Reals, styled


@dataclass(frozen=True, slots=True)
class Chances:
    """One swarm's chance of being done by each time."""

    label: str
    times: Reals  # (t,): s, ascending
    shares: Reals  # (t,): of its runs that were done by then
    low: Reals  # (t,): the interval of the chance
    high: Reals
    best: bool  # whether it is the answer
    banded: bool  # whether its interval is drawn


@dataclass(frozen=True, slots=True)
class Way:
    """One way to do a mission, and what it takes."""

    group: str
    label: str
    price: float
    interval: tuple[float, float]  # of the price
    seconds: float  # mean time
    risk: float  # share of runs that were not done in time
    on_front: bool


@styled
def chances(
    groups: Mapping[str, Sequence[Chances]], title: str, within: float, asked: tuple[float, float], level: float
) -> Figure:
    """The share of runs done against time, with some intervals; a panel for each group, the answers thick.

    `within` is the time allowed, s; `asked` the chance that must be exceeded and the one asked for, with a band
    between; `level` the confidence of the intervals at any one time.
    """
    figure = sheet(6.4, 0.8 + 3.4 * len(groups), title)
    panels = figure.subplots(len(groups), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    unit, scale = ("min", 60.0) if within >= 180.0 else ("s", 1.0)
    handles: list[Artist] = []
    for axes, (group, curves) in zip(panels, groups.items(), strict=True):
        for row, curve in enumerate(curves):
            handles += _curve(axes, row, curve, scale, f"{group}: " if group and len(groups) > 1 else "")
        axes.axhspan(100.0 * asked[0], 100.0 * asked[1], color=GREY, alpha=0.35, linewidth=0)
        axes.axvline(within / scale, color=BLACK, lw=1.2, linestyle=":")
        axes.set(title=group, ylabel="done, % of runs", xlim=(0.0, 1.02 * within / scale), ylim=(0.0, 101.5))
    panels[-1].set_xlabel(f"time since the start, {unit}")
    banded = all(curve.banded for curves in groups.values() for curve in curves)
    interval = f"{100 * level:.3g} % interval at any one time{'' if banded else ', of those with most runs'}"
    handles += [
        area_key(interval, GREY, "none", 0.2),
        area_key(f"asked for: {100 * asked[1]:g} %, less the slack", GREY, "none", 0.45),
        line_key("time allowed", BLACK, "", ":"),
    ]
    return settled(figure, handles, panels[0] if len(groups) == 1 else None)


def _curve(axes: Axes, row: int, curve: Chances, scale: float, group: str) -> Sequence[Artist]:
    colour = COLOURS[row % len(COLOURS)]
    times = curve.times / scale
    if curve.banded:
        axes.fill_between(
            times, 100.0 * curve.low, 100.0 * curve.high, step="post", color=colour, linewidth=0,
            alpha=0.22 if curve.best else 0.09,
        )  # fmt: skip
    return axes.plot(
        times, 100.0 * curve.shares, color=colour, drawstyle="steps-post", linewidth=2.8 if curve.best else 1.4,
        linestyle="-" if curve.best else DASHES[row // 2 % len(DASHES)], label=group + curve.label,
        marker=MARKERS[row % len(MARKERS)], markersize=5, markevery=(row / 60.0, 0.25),
    )  # fmt: skip


@styled
def front(ways: Sequence[Way], title: str) -> Figure:
    """Mean time against mean price; each way has its risk beside it, and is filled if none is better in all three."""
    figure = sheet(6.4, 4.4, title)
    axes = figure.subplots()
    handles: list[Artist] = []
    unit, scale = ("min", 60.0) if max(way.seconds for way in ways) >= 180.0 else ("s", 1.0)
    for row, group in enumerate(dict.fromkeys(way.group for way in ways)):
        colour, marker = COLOURS[row % len(COLOURS)], MARKERS[row % len(MARKERS)]
        for way in (way for way in ways if way.group == group):
            face = colour if way.on_front else "white"
            axes.hlines(way.seconds / scale, *way.interval, color=colour, lw=1.0, alpha=0.6)
            axes.plot(way.price, way.seconds / scale, marker, color=colour, mfc=face, ms=8, mew=1.6, zorder=3)
            axes.annotate(
                f"{way.label}, {100 * way.risk:.1f} %", (way.price, way.seconds / scale), (7, 6),
                textcoords="offset points", fontsize="small",
            )  # fmt: skip
        handles += [line_key(group, colour, marker)] if group else []
    handles += [
        line_key("on the front (beside it: swarm, share not done in time)", GREY, "o"),
        line_key("another beats it in price, time or risk, and in none is worse", GREY, "o", face="white"),
        line_key("interval of the price", GREY, "", "-", width=1.0),
    ]
    ends = np.array([way.interval for way in ways])
    reach = max(float(ends.max() - ends.min()), 1e-9)
    axes.set(xlabel="price of a mission, mean", ylabel=f"time of a mission, mean, {unit}")
    axes.set_xlim(ends.min() - 0.05 * reach, ends.max() + 0.2 * reach)
    axes.margins(y=0.15)
    return settled(figure, handles)
