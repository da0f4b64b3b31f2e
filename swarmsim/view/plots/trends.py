"""Trends: a measure against something that is varied in steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swarmsim.view.plots.marks import area_key, counted, estimate_bars, line_key
from swarmsim.view.plots.scales import mark_values, span_axis
from swarmsim.view.plots.sheet import settled, sheet
from swarmsim.view.plots.style import BLACK, BLUE, GREEN, GREY, PURPLE, TIME, VERMILLION, Reals, styled


@styled
def scaling(
    robots: NDArray[Any], means: Reals, intervals: Reals, fit: tuple[float, float], published: Mapping[int, float],
    title: str, runs: Sequence[int] = (),
) -> Figure:  # fmt: skip
    """Iterations against the number of robots with the line T = a + b / N, and the speed-up over the fewest robots.

    `robots` (m,), `means` (m,), `intervals` (m, 2), 95 %; `fit` is (a, b) in iterations; `runs`: how many made each.
    """
    figure = sheet(9.6, 4.6, title)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    numbers = np.unique([*np.asarray(robots, dtype=float), *published])
    finer = np.linspace(numbers[0], numbers[-1], 200)
    line = fit[0] + fit[1] / finer
    left.plot(finer, line, "--", color=VERMILLION, lw=1.6)
    estimate_bars(left, robots, means, intervals)
    left.plot(list(published), list(published.values()), "D", color=PURPLE, mec=BLACK, ms=9, zorder=1.5)
    span_axis(left, np.concatenate([means, np.ravel(intervals), line, list(published.values())]))
    first = int(np.argmin(robots))
    right.plot(finer, finer / robots[first], ":", color=GREY, lw=1.6)
    right.plot(finer, (fit[0] + fit[1] / robots[first]) / line, "--", color=VERMILLION, lw=1.6)
    right.plot(robots, means[first] / means, "o", color=BLUE, ms=6)
    right.set(xlabel="robots", ylabel=f"speed-up over {robots[first]} robots, times", ylim=(0.0, None))
    left.set(xlabel="robots", ylabel=TIME)
    mark_values(figure, left, numbers)
    mark_values(figure, right, numbers)
    formula = f"T = {fit[0]:.4g} {'-' if fit[1] < 0 else '+'} {abs(fit[1]):.4g} / N"
    handles = [line_key(f"mean, 95 % interval{counted(runs)}", BLUE, "o", "-"), line_key(formula, VERMILLION, "", "--")]
    handles += [line_key("published", PURPLE, "D", edge=BLACK)] if published else []
    return settled(figure, [*handles, line_key("in proportion to N", GREY, "", ":")])


@styled
def degradation(
    share_lost: Reals, means: Reals, intervals: Reals, unfinished_share: Reals, title: str, runs: Sequence[int] = ()
) -> Figure:
    """Iterations, and below them the share of runs that did not finish, against the share of robots lost.

    `share_lost` (m,) and `unfinished_share` (m,) are 0 to 1; `means` (m,) and `intervals` (m, 2), 95 %, are NaN
    where no run finished; `runs`: how many were made at each share.
    """
    figure = sheet(7.2, 5.6, title)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    lost = 100.0 * np.asarray(share_lost, dtype=float)
    upper.plot(lost, means, "-", color=BLUE, lw=1.2, alpha=0.5)
    estimate_bars(upper, lost, means, intervals)
    span_axis(upper, np.concatenate([means, np.ravel(intervals)]))
    upper.set(ylabel=TIME)
    gap = np.diff(np.unique(lost)).min(initial=10.0)
    lower.bar(lost, 100.0 * np.asarray(unfinished_share), 0.5 * gap, color=VERMILLION)
    lower.set(xlabel="robots lost, %", ylabel="unfinished\nruns, %", ylim=(0.0, 105.0), yticks=(0, 50, 100))
    mark_values(figure, lower, lost)
    handles = [line_key("mean of finished runs, 95 % interval", BLUE, "o", "-")]
    return settled(figure, [*handles, area_key(f"unfinished runs{counted(runs)}", VERMILLION, "none")])


@styled
def sweep(
    values: Reals, means: Reals, intervals: Reals, xlabel: str, title: str, best: float | None,
    ylabel: str = TIME, runs: Sequence[int] = (),
) -> Figure:  # fmt: skip
    """A measure along one axis, and where it is best.

    `values` (m,), ascending, of what is varied, `means` (m,) and `intervals` (m, 2), 95 %, of the measure; `best` is
    where it is marked, or None; `runs`: how many were made at each value. The labels name the units.
    """
    figure = sheet(7.2, 4.6, title)
    axes = figure.subplots()
    axes.plot(values, means, "-", color=BLUE, lw=1.2, alpha=0.5)
    estimate_bars(axes, values, means, intervals)
    handles = [line_key(f"mean, 95 % interval{counted(runs)}", BLUE, "o", "-")]
    if best is not None:
        axes.axvline(best, color=GREEN, lw=14, alpha=0.16)
        axes.plot([best], [np.interp(best, values, means)], "*", color=GREEN, mec=BLACK, ms=16)
        handles += [line_key(f"best: {best:g}", GREEN, "*", edge=BLACK, size=12)]
    span_axis(axes, np.concatenate([means, np.ravel(intervals)]))
    axes.set(xlabel=xlabel, ylabel=ylabel)
    mark_values(figure, axes, values)
    return settled(figure, handles)
