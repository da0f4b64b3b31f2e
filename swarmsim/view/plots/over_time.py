"""Curves over time: the progress of each condition's swarms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter

from swarmsim.core.parts import Curve
from swarmsim.view.plots.fault_marks import area_key, counted, described, fault_marks
from swarmsim.view.plots.scales import time_axis, unit_of
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
    iteration in each condition, bring a second axis in time if they are equal, and time along the first if not.
    """
    scale, label = _along(values, periods)
    counts = [len(runs) for runs in values.values()]
    each = len(set(counts)) > 1  # else the key of the band tells how many runs all conditions have
    names = [described(name, runs, _whole(curve), each=each) for name, runs in values.items()]
    figure = sheet(6.4, 4.0, title)
    axes = figure.subplots()
    handles: list[Artist] = []
    for row, (name, runs) in enumerate(values.items()):
        filled = curve.scale * padded(runs)
        kept = np.unique(np.linspace(0, filled.shape[1] - 1, FINEST).round().astype(int))
        low, high = np.percentile(filled[:, kept], (2.5, 97.5), axis=0)
        at = scale[name] * (kept + 1)
        colour, step = COLOURS[row % len(COLOURS)], max(1, len(kept) // 8)
        if len(runs) > 1:
            axes.fill_between(at, low, high, color=colour, alpha=0.16 if len(names) < 5 else 0.06, linewidth=0)
        handles += axes.plot(
            at, filled[:, kept].mean(axis=0), color=colour, linestyle=DASHES[row % len(DASHES)], linewidth=1.6,
            marker=MARKERS[row % len(MARKERS)], markersize=5, markevery=(step * row // len(names), step),
            label=names[row],
        )  # fmt: skip
    if max(counts) > 1:
        handles += [area_key(f"95 % of the runs{'' if each else counted(counts)}", GREY, "none", 0.25)]
    places = {name: [scale[name] * time for time in times] for name, times in marks.items() if name in scale}
    handles += fault_marks(axes, list(values), places if len(places) == len(marks) else marks)
    ends = [scale[name] * len(run) for name, runs in values.items() for run in runs]
    ends += [time for times in places.values() for time in times]
    axes.set(xlabel=label, ylabel=curve.label, xlim=(0.0, 1.02 * max(ends)))
    lengths = [scale[name] * float(np.median([len(run) for run in runs])) for name, runs in values.items()]
    if max(lengths) > FAR * float(np.median(lengths)):  # else most curves would share a corner
        axes.set(xscale="log", xlim=(1.0, 1.02 * max(ends)))
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    if curve.low is not None and curve.high is not None:
        axes.set_ylim(curve.low, curve.high + 0.02 * (curve.high - curve.low))
    if len(set(periods.values())) == 1:
        time_axis(axes, next(iter(periods.values())), "x")
    return settled(figure, handles, axes)


def _along(values: Mapping[str, Sequence[Reals]], periods: Mapping[str, float]) -> tuple[Mapping[str, float], str]:
    """What an iteration of each condition is along the first axis, and the axis' name: time, if periods differ."""
    if len(set(periods.values())) < 2:
        return dict.fromkeys(values, 1.0), "iteration"
    unit, word = unit_of(max(periods[name] * len(run) for name, runs in values.items() for run in runs))
    return {name: period / unit for name, period in periods.items()}, f"time, {word}"


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
