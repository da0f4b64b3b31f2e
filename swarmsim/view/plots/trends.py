"""Trends: a measure against a varied parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swarmsim.view.plots.fault_marks import counted, estimate_bars, line_key, spelled
from swarmsim.view.plots.scales import mark_values, span_axis, time_axis
from swarmsim.view.plots.sheet import settled, sheet, side_by_side
from swarmsim.view.plots.style import BLACK, BLUE, COLOURS, GREY, MARKERS, PURPLE, TIME, VERMILLION, Reals, styled


@styled
def scaling(
    robots: NDArray[np.generic], means: Reals, intervals: Reals, fit: tuple[float, float],
    published: Mapping[int, float], title: str, runs: Sequence[int] = (), period: float | None = None,
) -> Figure:  # fmt: skip
    """Iterations against the number of robots with the line T = a + b / N, and the speed-up over the fewest robots.

    `robots` (m,), `means` (m,), `intervals` (m, 2), 95 %; `fit` is (a, b) in iterations; `runs`: how many made each.
    With the `period` of iterations in s there is a second axis in time.
    """
    figure = sheet(9.6, 4.2, title)
    left, right = side_by_side(figure, (3, 2))
    numbers = np.unique([*np.asarray(robots, dtype=float), *published])
    finer = np.linspace(numbers[0], numbers[-1], 200)
    line = fit[0] + fit[1] / finer
    left.plot(finer, line, "--", color=VERMILLION, lw=1.6)
    estimate_bars(left, robots, means, intervals)
    left.plot(list(published), list(published.values()), "D", color=PURPLE, mec=BLACK, ms=7, zorder=1.5)
    span_axis(left, np.concatenate([means, np.ravel(intervals), line, list(published.values())]))
    first = int(np.argmin(robots))
    right.plot(finer, finer / robots[first], ":", color=GREY, lw=1.6)
    right.plot(finer, (fit[0] + fit[1] / robots[first]) / line, "--", color=VERMILLION, lw=1.6)
    right.plot(robots, means[first] / means, "o", color=BLUE, ms=6)
    right.set(xlabel="robots", ylabel=f"speed-up over {robots[first]}", ylim=(0.0, None))
    left.set(xlabel="robots", ylabel=TIME)
    mark_values(figure, left, numbers)
    mark_values(figure, right, numbers)
    if period is not None:
        time_axis(left, period, "y")
    formula = f"T = {fit[0]:.4g} {'-' if fit[1] < 0 else '+'} {abs(fit[1]):.4g} / N"
    handles = [line_key(f"mean, 95 % interval{counted(runs)}", BLUE, "o", "-"), line_key(formula, VERMILLION, "", "--")]
    handles += [line_key("published", PURPLE, "D", edge=BLACK)] if published else []
    return settled(figure, [*handles, line_key("in proportion to N", GREY, "", ":")])


WIDE: Final = 30.0  # numbers that differ more than so many times stand on a logarithmic scale


@dataclass(frozen=True, slots=True)
class Steps:
    """A measure at m values of the varied parameter."""

    values: Reals  # (m,), ascending
    means: Reals  # (m,), of the runs that finished; NaN where none did
    intervals: Reals  # (m, 2), 95 %
    unfinished: Reals  # (m,): share of runs that did not finish, 0 to 1
    runs: Sequence[int]  # (m,)


@styled
def sweep(
    series: Mapping[str, Steps], levels: Mapping[str, Steps], xlabel: str, title: str, ylabel: str = TIME,
    period: float | None = None,
) -> Figure:  # fmt: skip
    """Iterations, or a measure, against the varied parameter, a line per series; below, unfinished runs if any.

    `levels` have one value each, off the axis: lines across. The `period` of iterations in s gives an axis in time.
    """
    unfinished = any(steps.unfinished.any() for steps in series.values())
    figure = sheet(6.4, 5.0 if unfinished else 4.0, title)
    heights = (3, 1) if unfinished else (1,)
    upper, *lower = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0].tolist()
    handles: list[Artist] = []
    for row, (name, steps) in enumerate(series.items()):
        colour, marker = COLOURS[row % len(COLOURS)], MARKERS[row % len(MARKERS)]
        upper.plot(steps.values, steps.means, "-", marker=marker, color=colour, lw=1.2, ms=5)
        estimate_bars(upper, steps.values, steps.means, steps.intervals, colour, 2.0)
        for panel in lower:
            panel.plot(steps.values, 100.0 * steps.unfinished, "-", marker=marker, color=colour, lw=1.2, ms=5)
        handles += [line_key(spelled(name), colour, marker, "-")] if name else []
    for row, (name, level) in enumerate(levels.items(), len(series)):
        colour = COLOURS[row % len(COLOURS)]
        upper.axhspan(*level.intervals[0], color=colour, alpha=0.12, lw=0)
        line = upper.axhline(level.means[0], color=colour, lw=1.8, ls="--" if row % 2 else ":")
        line.set_label(f"{spelled(name)}{counted(level.runs)}")
        handles.append(line)
    mean = f"mean, 95 % interval{counted([number for steps in series.values() for number in steps.runs])}"
    handles.append(line_key(mean, GREY if any(series) else BLUE, "o", "-"))
    shown = [part for steps in (*series.values(), *levels.values()) for part in (steps.means, steps.intervals.ravel())]
    numbers = np.concatenate(shown)
    low, high = np.nanmin(numbers, initial=np.inf), np.nanmax(numbers, initial=0.0)
    span_axis(upper, numbers, "log" if high > WIDE * low > 0.0 else "linear")
    upper.set_ylabel(ylabel)
    for panel in lower:
        panel.set(ylabel="unfinished\nruns, %", ylim=(-5.0, 105.0), yticks=(0, 50, 100))
    (lower or [upper])[-1].set_xlabel(xlabel)
    mark_values(figure, (lower or [upper])[-1], np.concatenate([steps.values for steps in series.values()]))
    if period is not None:
        time_axis(upper, period, "y")
    return settled(figure, handles, upper)
