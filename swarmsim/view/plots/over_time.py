"""Curves over time: the progress of each condition's swarms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter

from swarmsim.core.parts import Curve
from swarmsim.view.plots.fault_marks import area_key, described, fault_marks
from swarmsim.view.plots.scales import time_axis
from swarmsim.view.plots.sheet import settled, sheet
from swarmsim.view.plots.style import COLOURS, DASHES, FINEST, GREY, MARKERS, Reals, styled

FAR: Final = 5.0  # times as long as most runs: from here on iterations stand on a logarithmic scale
COVERAGE: Final = Curve("coverage", "coverage, %", scale=100.0, low=0.0, high=100.0)


@styled
def curves(
    values: Mapping[str, Sequence[Reals]],
    title: str,
    marks: Mapping[str, Sequence[int]] = {},
    curve: Curve = COVERAGE,
    periods: Mapping[str, float] = {},
) -> Figure:
    """The mean of each condition and the band that holds 95 % of its runs, against iterations.

    `values` gives, for each condition, the curves (t,) of its runs: what `curve` describes, by default the share of
    the domain that is covered, after 1, 2, ... t iterations. A run that is over keeps its last value as long as others
    of its condition go on. `marks` are the iterations of faults in the swarms of a condition. `periods`, the s of one
    iteration in each condition, bring a second axis in time if they are equal, and seconds along the first if not.
    """
    scale = periods if len(set(periods.values())) > 1 else dict.fromkeys(values, 1.0)  # from iterations
    names = [described(label, runs, _whole(curve)) for label, runs in values.items()]
    figure = sheet(6.4 + 0.075 * max(map(len, names)), max(4.4, 1.4 + 0.21 * len(names)), title)
    axes = figure.subplots()
    handles: list[Artist] = []
    for row, (label, runs) in enumerate(values.items()):
        filled = curve.scale * padded(runs)
        kept = np.unique(np.linspace(0, filled.shape[1] - 1, FINEST).round().astype(int))
        low, high = np.percentile(filled[:, kept], (2.5, 97.5), axis=0)
        at = scale[label] * (kept + 1)
        colour, step = COLOURS[row % len(COLOURS)], max(1, len(kept) // 8)
        if len(runs) > 1:
            axes.fill_between(at, low, high, color=colour, alpha=0.16 if len(names) < 5 else 0.06, linewidth=0)
        handles += axes.plot(
            at, filled[:, kept].mean(axis=0), color=colour, linestyle=DASHES[row % len(DASHES)], linewidth=1.6,
            marker=MARKERS[row % len(MARKERS)], markersize=5, markevery=(step * row // len(names), step),
            label=names[row],
        )  # fmt: skip
    if any(len(runs) > 1 for runs in values.values()):
        handles += [area_key("95 % of the runs", GREY, "none", 0.25)]
    places = {label: [scale[label] * time for time in times] for label, times in marks.items() if label in scale}
    handles += fault_marks(axes, list(values), places if len(places) == len(marks) else marks)
    ends = [scale[label] * len(run) for label, runs in values.items() for run in runs]
    ends += [time for times in places.values() for time in times]
    axes.set(xlabel="iteration" if scale is not periods else "s", ylabel=curve.label, xlim=(0.0, 1.02 * max(ends)))
    lengths = [scale[label] * float(np.median([len(run) for run in runs])) for label, runs in values.items()]
    if max(lengths) > FAR * float(np.median(lengths)):  # else most curves would share a corner
        axes.set(xscale="log", xlim=(1.0, 1.02 * max(ends)))
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    if curve.low is not None and curve.high is not None:
        axes.set_ylim(curve.low, curve.high + 0.02 * (curve.high - curve.low))
    if len(set(periods.values())) == 1:
        time_axis(axes, next(iter(periods.values())), "x")
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return settled(figure)


def _whole(curve: Curve) -> float | None:
    """The value at which a run is done, for a curve in per cent; None for all other curves."""
    percent = curve.rises and curve.high is not None and curve.label.endswith("%")
    return curve.high / curve.scale if percent and curve.high is not None else None


def padded(runs: Sequence[Reals]) -> Reals:
    """Curves (t,) of unequal lengths as one array (n, longest), each going on at its last value."""
    if not runs or not all(len(run) for run in runs):
        raise ValueError("a condition needs at least one run, and a run at least one iteration")
    longest = max(map(len, runs))
    return np.array([np.pad(np.asarray(run, dtype=float), (0, longest - len(run)), mode="edge") for run in runs])
