"""Conditions side by side: every run of each, or our means beside published ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swarmsim.view.plots.fault_marks import area_key, counted, estimate_bars, line_key, places_of, quartile_box
from swarmsim.view.plots.scales import Scale, name_conditions, span_axis, time_axis
from swarmsim.view.plots.sheet import settled, sheet
from swarmsim.view.plots.style import BLACK, BLUE, PALE, PURPLE, TIME, VERMILLION, Reals, styled


@styled
def distributions(
    times: Mapping[str, Reals], finished: Mapping[str, NDArray[np.bool_]], title: str,
    published: Mapping[str, float] = {}, estimates: Mapping[str, tuple[float, float, float]] = {},
    period: float | None = None, label: str = TIME,
) -> Figure:  # fmt: skip
    """Every run's iterations to 100 %: a box and points for each condition.

    `times` (n,) holds each run's iterations, or its limit where `finished` (n,) is false. The box shows the
    median and the quartiles of all runs, unfinished ones counted at their limits: a lower bound where the box
    touches them. `published` values stand above the box, `estimates` (a mean, and the low and the high end of
    its 95 % interval) below it. The scale is logarithmic if the numbers differ more than eightfold.
    With the `period` of iterations in s there is a second axis in time.
    """
    figure = sheet(6.4, 1.2, title)
    axes = figure.subplots()
    for row, (name, taken) in enumerate(times.items()):
        quartile_box(axes, row, np.asarray(taken, dtype=float), np.asarray(finished[name], dtype=bool))
    means = np.array(list(estimates.values()), dtype=float).reshape(-1, 3)
    estimate_bars(axes, places_of(estimates, list(times)) + 0.36, means[:, 0], means[:, 1:], BLACK, 1.6, "x")
    axes.plot(list(published.values()), places_of(published, list(times)) - 0.36, "D", color=PURPLE, mec=BLACK, ms=5)
    everything = np.concatenate([*times.values(), means.ravel(), list(published.values())])
    scale: Scale = "log" if np.nanmax(everything) > 8.0 * np.nanmin(everything) > 0.0 else "linear"
    span_axis(axes, everything, scale, along="x")
    runs = [len(one) for one in times.values()]
    handles = [area_key("median and quartiles", PALE, BLUE), line_key(f"one run{counted(runs)}", BLUE, "o", size=3)]
    if not all(np.all(done) for done in finished.values()):
        handles += [line_key("unfinished, at its limit", VERMILLION, ">", face="none", size=5)]
    handles += [line_key("mean, 95 % interval", BLACK, "o", "-")] if estimates else []
    handles += [line_key("published", PURPLE, "D", edge=BLACK)] if published else []
    name_conditions(figure, axes, list(times), runs, label)
    if period is not None:
        time_axis(axes, period, "x")
    return settled(figure, handles, axes)


@styled
def comparison(
    labels: Sequence[str], ours_mean: Reals, interval: Reals, prediction: Reals, published: Reals, title: str,
    runs: Sequence[int] = (), period: float | None = None,
) -> Figure:  # fmt: skip
    """Our means beside the published ones, for m conditions, in iterations on a logarithmic scale.

    `ours_mean` (m,); `interval` (m, 2), the 95 % interval of the mean, thick; `prediction` (m, 2), where 95 % of
    single runs are expected, thin; `published` (m,). NaN where there is no number. `runs`: how many made each mean.
    With the `period` of iterations in s there is a second axis in time.
    """
    figure = sheet(6.4, 1.2, title)
    axes = figure.subplots()
    places = np.arange(len(labels), dtype=float)
    estimate_bars(axes, places - 0.14, ours_mean, prediction, BLUE, 1.2, "x")
    estimate_bars(axes, places - 0.14, ours_mean, interval, BLUE, 4.0, "x")
    axes.plot(published, places + 0.16, "D", color=PURPLE, mec=BLACK, ms=5)
    numbers = np.concatenate([ours_mean, np.ravel(interval), np.ravel(prediction), published])
    span_axis(axes, numbers, "log", along="x")
    ours = line_key(f"our mean, 95 % interval{counted(runs)}", BLUE, "o", "-", width=4.0)
    expected = line_key("95 % of single runs expected", BLUE, "", "-", width=1.2)
    name_conditions(figure, axes, labels, runs)
    if period is not None:
        time_axis(axes, period, "x")
    return settled(figure, [ours, expected, line_key("published", PURPLE, "D", edge=BLACK)], axes)
