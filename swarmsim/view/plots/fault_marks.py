"""The marks that stand for runs and conditions, drawn alike on the axes and in the legend."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from swarmsim.view.plots.style import BLUE, COLOURS, GREY, PALE, VERMILLION, Line, Reals


def counted(runs: Sequence[int]) -> str:
    """The number of runs, for a legend."""
    return f", n = {min(runs)}{f' to {max(runs)}' if min(runs) < max(runs) else ''}" if len(runs) else ""


def spelled(name: str) -> str:
    """The name of a condition as print has it: `k = 2`, not `k=2`."""
    return re.sub(r"\s*=\s*", " = ", name)


def described(label: str, runs: Sequence[Reals], whole: float | None = 1.0, *, each: bool = True) -> str:
    """A condition with the number of those of its runs that did not reach 100 %, the value `whole`.

    With `each`, the number of its runs is told too.
    """
    below = 0 if whole is None else sum(bool(run[-1] < whole) for run in runs)
    told = [f"n = {len(runs)}"] * each + [f"{below} below 100 %"] * (below > 0)
    return f"{spelled(label)} ({', '.join(told)})" if told else spelled(label)


def line_key(
    label: str, colour: str, marker: str, line: Line = "", face: str = "", edge: str = "", size: float = 6.0,
    width: float = 1.8,
) -> Line2D:  # fmt: skip
    """A line or a point in a legend."""
    return Line2D(
        [], [], color=colour, linestyle=line, linewidth=width, marker=marker, markersize=size, label=label,
        markerfacecolor=face or colour, markeredgecolor=edge or colour,
    )  # fmt: skip


def area_key(label: str, face: str, edge: str, alpha: float = 1.0) -> Rectangle:
    """An area in a legend."""
    return Rectangle((0, 0), 1, 1, facecolor=face, edgecolor=edge, alpha=alpha, label=label)


def fault_marks(axes: Axes, labels: Sequence[str], marks: Mapping[str, Sequence[float]]) -> list[Artist]:
    """Vertical dashes in the conditions' colours, alternating where they coincide; gives the legend's entries."""
    rows = places_of(marks, labels).astype(int)
    owners: dict[float, list[int]] = {}
    for row, iterations in zip(rows, marks.values(), strict=True):
        for at in iterations:
            owners.setdefault(at, []).append(row)
    for at, sharing in owners.items():
        for turn, row in enumerate(sharing):
            dash = (4.0 * turn, (4.0, 4.0 * max(1, len(sharing) - 1)))
            axes.axvline(at, color=COLOURS[row % len(COLOURS)], linestyle=dash, linewidth=1.2, alpha=0.8, zorder=1.5)
    return [line_key("fault, in the colour of its curve", GREY, "", "--")] if owners else []


def places_of(given: Iterable[str], labels: Sequence[str]) -> Reals:
    """The positions of the given labels among all labels."""
    unknown = sorted(set(given) - set(labels))
    if unknown:
        raise ValueError(f"no such condition: {', '.join(unknown)}; there are {', '.join(labels)}")
    return np.array([labels.index(label) for label in given], dtype=float)


def quartile_box(axes: Axes, row: float, taken: Reals, done: NDArray[np.bool_]) -> None:
    """The quartiles and the median of one condition, a row, and its runs as points."""
    low, middle, high = np.percentile(taken, (25, 50, 75))
    axes.add_patch(Rectangle((low, row - 0.24), high - low, 0.48, facecolor=PALE, edgecolor=BLUE))
    axes.vlines(middle, row - 0.24, row + 0.24, color=BLUE, linewidth=2.2)
    aside = row + 0.36 * (np.arange(len(taken)) * 0.6180339887 % 1.0 - 0.5)  # golden steps: even, and always the same
    axes.plot(taken[done], aside[done], "o", color=BLUE, markersize=3.0, alpha=0.7, markeredgewidth=0)
    axes.plot(taken[~done], aside[~done], ">", markersize=5, markerfacecolor="none", markeredgecolor=VERMILLION)


def estimate_bars(
    axes: Axes, at: NDArray[np.generic], means: Reals, spans: Reals, colour: str = BLUE, width: float = 2.5,
    along: Literal["x", "y"] = "y",
) -> None:  # fmt: skip
    """Means (m,) as points on bars over `spans` (m, 2), which lie along one axis at places on the other."""
    if np.shape(spans) != (len(at), 2) or len(means) != len(at):
        raise ValueError(f"{len(at)} places, means of shape {np.shape(means)} and spans of shape {np.shape(spans)}")
    draw, cap = (axes.vlines, "_") if along == "y" else (axes.hlines, "|")
    draw(at, spans[:, 0], spans[:, 1], color=colour, linewidth=width, alpha=0.75)
    for values, mark, size in (*((end, cap, 5 + 1.5 * width) for end in spans.T), (means, "o", 5.0)):
        pair = (at, values) if along == "y" else (values, at)
        axes.plot(*pair, mark, color=colour, markersize=size)  # caps are seen even where a point hides the bar
