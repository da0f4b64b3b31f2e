"""Axis limits, and ticks whose labels do not touch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, FormatStrFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from swarmsim.view.plots.style import DPI, GREY, TIME, Reals

UNITS: Final = ((1.0, "s", 180.0), (60.0, "min", 10_800.0), (3600.0, "h", math.inf))  # s, name, used below so many s


def span_axis(axes: Axes, numbers: Reals, scale: Literal["linear", "log"] = "linear") -> None:
    """Vertical limits around all numbers (without NaN), from zero on a linear scale; ticks in plain figures."""
    shown = numbers[numbers > 0.0] if scale == "log" else numbers[np.isfinite(numbers)]
    low, high = shown.min(initial=1.0 if not len(shown) else np.inf), shown.max(initial=-np.inf if len(shown) else 10.0)
    axes.set_yscale(scale)
    if scale == "log":
        axes.set_ylim(low / 1.2, high * 1.2)
        axes.yaxis.set_major_locator(
            LogLocator(subs=(1.0, 2.0, 5.0) if high > 8.0 * low else (1.0, 1.5, *range(2, 10)))
        )
        axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.set_ylim(min(0.0, 1.06 * low), 1.06 * max(0.0, high))


def time_axis(axes: Axes, period: float, along: Literal["x", "y"]) -> None:
    """A second axis in time opposite one in iterations of `period` s; its unit suits the longest."""
    longest = period * (axes.get_xlim() if along == "x" else axes.get_ylim())[1]
    unit, name = next((unit, name) for unit, name, most in UNITS if longest < most)
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
    axis.set_label_text(name)


def is_crowded(figure: Figure, axes: Axes) -> bool:
    """Whether neighbouring tick labels along x touch."""
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
    return any(right.x0 - left.x1 < 0.04 * DPI for left, right in pairwise(boxes))


def name_conditions(figure: Figure, axes: Axes, labels: Sequence[str], runs: Sequence[int], ylabel: str = TIME) -> None:
    """The names of conditions along x, with the number of their runs; turned where they would overlap."""
    counts = [f"n = {count}" for count in runs] or [""] * len(labels)
    both = list(zip(labels, counts, strict=True))
    axes.set(ylabel=ylabel, xlim=(-0.6, len(labels) - 0.4))
    axes.grid(False, axis="x")
    axes.set_xticks(range(len(labels)), [f"{label}\n{count}".strip() for label, count in both])
    if is_crowded(figure, axes):
        turned = [f"{label} ({count})" if count else label for label, count in both]
        axes.set_xticks(range(len(labels)), turned, rotation=40, ha="right", rotation_mode="anchor")
        figure.set_figheight(figure.get_figheight() + 0.045 * max(map(len, turned)))


def mark_values(figure: Figure, axes: Axes, values: NDArray[np.generic]) -> None:
    """Ticks along x at the values themselves, or at round numbers where those would overlap."""
    axes.set_xticks(np.unique(values))
    if is_crowded(figure, axes):
        axes.xaxis.set_major_locator(AutoLocator())
