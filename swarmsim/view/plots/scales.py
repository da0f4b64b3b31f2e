"""Axis limits, and ticks whose labels do not touch."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, FormatStrFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from swarmsim.view.plots.fault_marks import spelled
from swarmsim.view.plots.style import DPI, GREY, TIME, Reals, asked_for

Scale = Literal["linear", "log"]
UNITS: Final = ((1.0, "s", 180.0), (60.0, "min", 10_800.0), (3600.0, "h", math.inf))  # s, name, used below so many s


def span_axis(axes: Axes, numbers: Reals, scale: Scale = "linear", along: Literal["x", "y"] = "y") -> None:
    """Limits around all numbers (without NaN), from zero on a linear scale; ticks in plain figures."""
    shown = numbers[numbers > 0.0] if scale == "log" else numbers[np.isfinite(numbers)]
    low, high = shown.min(initial=1.0 if not len(shown) else np.inf), shown.max(initial=-np.inf if len(shown) else 10.0)
    axis = axes.yaxis if along == "y" else axes.xaxis
    limits = (low / 1.2, high * 1.2) if scale == "log" else (min(0.0, 1.06 * low), 1.06 * max(0.0, high))
    axes.set(**{f"{along}scale": scale, f"{along}lim": limits})
    if scale == "log":
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high > 4.0 * low else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
        axis.set_major_formatter(FormatStrFormatter("%g"))
        axis.set_minor_locator(NullLocator())


def unit_of(longest: float) -> tuple[float, str]:
    """The unit for times up to `longest` s: its s, and its name."""
    return next((unit, name) for unit, name, most in UNITS if longest < most)


def time_axis(axes: Axes, period: float, along: Literal["x", "y"]) -> None:
    """A second axis in time opposite one in iterations of `period` s; its unit suits the longest."""
    unit, name = unit_of(period * (axes.get_xlim() if along == "x" else axes.get_ylim())[1])
    factor = period / unit
    convert = (lambda count: np.multiply(count, factor), lambda time: np.divide(time, factor))
    second = axes.secondary_xaxis("top", convert) if along == "x" else axes.secondary_yaxis("right", convert)
    axis, scale = (second.xaxis, axes.get_xscale()) if along == "x" else (second.yaxis, axes.get_yscale())
    second.spines[:].set_visible(True)
    second.spines[:].set_color(GREY)
    if scale == "log":
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_label_text(f"time, {name}")


def is_crowded(figure: Figure, axes: Axes) -> bool:
    """Whether neighbouring tick labels along x touch."""
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
    return any(right.x0 - left.x1 < 0.04 * DPI for left, right in pairwise(boxes))


def name_conditions(figure: Figure, axes: Axes, labels: Sequence[str], runs: Sequence[int], label: str = TIME) -> None:
    """Conditions in rows, from above, with the number of their runs; the figure is as high as the rows need."""
    width = int(0.5 * figure.get_figwidth() * 72 / (0.55 * asked_for().letters))  # letters across half of the sheet
    counts = [f" (n = {count})" if len(set(runs)) > 1 else "" for count in runs] or [""] * len(labels)
    named = ["\n".join(textwrap.wrap(spelled(name) + count, width)) for name, count in zip(labels, counts, strict=True)]
    axes.set_yticks(range(len(labels)), named)
    axes.set(xlabel=label, ylim=(len(labels) - 0.4, -0.6))
    axes.grid(False, axis="y")
    rows = sum(max(2.6, 1.5 * (1 + name.count("\n"))) for name in named)
    figure.set_figheight(figure.get_figheight() + max(rows, 8.0) * asked_for().letters / 72)


def mark_values(figure: Figure, axes: Axes, values: NDArray[np.generic]) -> None:
    """Ticks along x at the values themselves, or at round numbers where those would overlap."""
    axes.set_xticks(np.unique(values))
    if is_crowded(figure, axes):
        axes.xaxis.set_major_locator(AutoLocator())
