"""Figures of what many runs say together, made from plain numbers, and saved as the same bytes every time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import AutoLocator, FormatStrFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Line = Literal["", "-", "--", ":"]

DPI: Final = 150  # of a saved PNG
FINEST: Final = 900  # points along a curve: more than a picture has pixels only make its file larger
TIME: Final = "iterations to 100 %"
#: Okabe and Ito's colours, as on the map, without yellow, which is lost on white paper.
COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
BLUE, VERMILLION, GREEN, PURPLE, _, _, BLACK = COLOURS
GREY: Final = "#6B7280"
PALE: Final = "#DCEBF5"
#: With seven colours and nine markers no two of the first 63 curves look alike.
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
DASHES: Final[Sequence[Any]] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (7, 2, 1.5, 2)))
STYLE: Final[dict[Any, Any]] = {
    "font.size": 10.0, "axes.labelsize": 10.0, "legend.fontsize": 9.0, "xtick.labelsize": 9.0, "ytick.labelsize": 9.0,
    "figure.titlesize": 12.0, "figure.titleweight": "bold", "text.parse_math": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": GREY, "axes.axisbelow": True,
    "axes.grid": True, "grid.color": "#E3E6EB", "grid.linewidth": 0.8, "xtick.color": GREY, "ytick.color": GREY,
    "xtick.labelcolor": BLACK, "ytick.labelcolor": BLACK, "legend.frameon": False, "legend.handlelength": 2.8,
    "svg.hashsalt": "swarmsim", "svg.fonttype": "path",
}  # fmt: skip
#: Every figure starts from matplotlib's own settings, whatever the user's are, and leaves those as they were.
_styled = style.context(STYLE, after_reset=True)


@_styled
def save(figure: Figure, path: Path) -> tuple[Path, Path]:
    """Write the figure as `path`.png (150 dots per inch) and `path`.svg, and give both paths.

    Equal figures give equal bytes: neither a date, nor a version, nor random names are written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    png, svg = (path.with_name(f"{path.name}.{kind}") for kind in ("png", "svg"))
    figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
    figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    return png, svg


@_styled
def coverage(curves: Mapping[str, Sequence[Reals]], title: str, marks: Mapping[str, Sequence[int]] = {}) -> Figure:
    """The mean coverage of each condition and the band that holds 95 % of its runs, against iterations.

    `curves` gives, for each condition, the curves (t,) of its runs: the share of the domain, 0 to 1, after
    1, 2, ... t iterations. A run that is over keeps its last value as long as others of its condition go on.
    `marks` are the iterations at which faults befell the swarms of a condition.
    """
    names = [_described(label, runs) for label, runs in curves.items()]
    figure = _sheet(6.4 + 0.075 * max(map(len, names)), max(4.4, 1.4 + 0.21 * len(names)), title)
    axes = figure.subplots()
    handles: list[Artist] = []
    for row, runs in enumerate(curves.values()):
        filled = 100.0 * padded(runs)
        kept = np.unique(np.linspace(0, filled.shape[1] - 1, FINEST).round().astype(int))
        low, high = np.percentile(filled[:, kept], (2.5, 97.5), axis=0)
        colour, step = COLOURS[row % len(COLOURS)], max(1, len(kept) // 8)
        axes.fill_between(kept + 1, low, high, color=colour, alpha=0.16 if len(names) < 5 else 0.06, linewidth=0)
        handles += axes.plot(
            kept + 1, filled[:, kept].mean(axis=0), color=colour, linestyle=DASHES[row % len(DASHES)], linewidth=1.6,
            marker=MARKERS[row % len(MARKERS)], markersize=5, markevery=(step * row // len(names), step),
            label=names[row],
        )  # fmt: skip
    handles += [_patch("95 % of the runs", GREY, "none", 0.25)]
    handles += _faults(axes, list(curves), marks)
    ends = [*(len(run) for runs in curves.values() for run in runs), *(at for times in marks.values() for at in times)]
    axes.set(xlabel="iteration", ylabel="coverage, %", xlim=(0.0, 1.02 * max(ends)), ylim=(0.0, 102.0))
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return _settled(figure)


@_styled
def distributions(
    times: Mapping[str, Reals], finished: Mapping[str, NDArray[np.bool_]], title: str,
    published: Mapping[str, float] = {}, estimates: Mapping[str, tuple[float, float, float]] = {},
) -> Figure:  # fmt: skip
    """Every run's iterations to 100 %: a box and points for each condition.

    `times` (n,) holds the iterations of each run, or its limit where `finished` (n,) is false. The box shows the
    median and the quartiles of all runs, unfinished ones counted at their limits: a lower bound where the box
    touches them. `published` values stand left of the box, `estimates` (a mean, and the low and the high end of
    its 95 % interval) right of it. The scale is logarithmic where the numbers differ more than eightfold.
    """
    figure = _sheet(max(6.4, 1.6 + 0.68 * len(times)), 5.2, title)
    axes = figure.subplots()
    for row, (label, taken) in enumerate(times.items()):
        _box(axes, row, np.asarray(taken, dtype=float), np.asarray(finished[label], dtype=bool))
    means = np.array(list(estimates.values()), dtype=float).reshape(-1, 3)
    _estimates(axes, _places(estimates, list(times)) + 0.36, means[:, 0], means[:, 1:], BLACK, 1.6)
    axes.plot(_places(published, list(times)) - 0.36, list(published.values()), "D", color=PURPLE, mec=BLACK, ms=6)
    everything = np.concatenate([*times.values(), means.ravel(), list(published.values())])
    _span(axes, everything, "log" if np.nanmax(everything) > 8.0 * np.nanmin(everything) > 0.0 else "linear")
    handles = [_patch("median and quartiles", PALE, BLUE), _key("one run", BLUE, "o", size=3.5)]
    if not all(np.all(done) for done in finished.values()):
        handles += [_key("unfinished, at its limit", VERMILLION, "^", face="none")]
    handles += [_key("mean, 95 % interval", BLACK, "o", "-")] if estimates else []
    handles += [_key("published", PURPLE, "D", edge=BLACK)] if published else []
    _conditions(figure, axes, list(times), [len(taken) for taken in times.values()])
    return _settled(figure, handles)


@_styled
def comparison(
    labels: Sequence[str], ours_mean: Reals, interval: Reals, prediction: Reals, published: Reals, title: str,
    runs: Sequence[int] = (),
) -> Figure:  # fmt: skip
    """Our means beside the published ones, for m conditions, in iterations on a logarithmic scale.

    `ours_mean` (m,); `interval` (m, 2), the 95 % interval of the mean, thick; `prediction` (m, 2), where 95 % of
    single runs are expected, thin; `published` (m,). NaN where there is no number. `runs`: how many made each mean.
    """
    figure = _sheet(max(6.4, 1.6 + 0.6 * len(labels)), 5.0, title)
    axes = figure.subplots()
    places = np.arange(len(labels), dtype=float)
    _estimates(axes, places - 0.14, ours_mean, prediction, BLUE, 1.2)
    _estimates(axes, places - 0.14, ours_mean, interval, BLUE, 4.0)
    axes.plot(places + 0.16, published, "D", color=PURPLE, mec=BLACK, ms=7)
    _span(axes, np.concatenate([ours_mean, np.ravel(interval), np.ravel(prediction), published]), "log")
    ours = _key(f"our mean, 95 % interval{_n(runs)}", BLUE, "o", "-", width=4.0)
    expected = _key("95 % of single runs expected", BLUE, "", "-", width=1.2)
    _conditions(figure, axes, labels, runs)
    return _settled(figure, [ours, expected, _key("published", PURPLE, "D", edge=BLACK)])


@_styled
def scaling(
    robots: NDArray[Any], means: Reals, intervals: Reals, fit: tuple[float, float], published: Mapping[int, float],
    title: str, runs: Sequence[int] = (),
) -> Figure:  # fmt: skip
    """Iterations against the number of robots with the line T = a + b / N, and the speed-up over the fewest robots.

    `robots` (m,), `means` (m,), `intervals` (m, 2), 95 %; `fit` is (a, b) in iterations; `runs`: how many made each.
    """
    figure = _sheet(9.6, 4.6, title)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    numbers = np.unique([*np.asarray(robots, dtype=float), *published])
    finer = np.linspace(numbers[0], numbers[-1], 200)
    line = fit[0] + fit[1] / finer
    left.plot(finer, line, "--", color=VERMILLION, lw=1.6)
    _estimates(left, robots, means, intervals)
    left.plot(list(published), list(published.values()), "D", color=PURPLE, mec=BLACK, ms=9, zorder=1.5)
    _span(left, np.concatenate([means, np.ravel(intervals), line, list(published.values())]))
    first = int(np.argmin(robots))
    right.plot(finer, finer / robots[first], ":", color=GREY, lw=1.6)
    right.plot(finer, (fit[0] + fit[1] / robots[first]) / line, "--", color=VERMILLION, lw=1.6)
    right.plot(robots, means[first] / means, "o", color=BLUE, ms=6)
    right.set(xlabel="robots", ylabel=f"speed-up over {robots[first]} robots, times", ylim=(0.0, None))
    left.set(xlabel="robots", ylabel=TIME)
    _values(figure, left, numbers)
    _values(figure, right, numbers)
    formula = f"T = {fit[0]:.4g} {'-' if fit[1] < 0 else '+'} {abs(fit[1]):.4g} / N"
    handles = [_key(f"mean, 95 % interval{_n(runs)}", BLUE, "o", "-"), _key(formula, VERMILLION, "", "--")]
    handles += [_key("published", PURPLE, "D", edge=BLACK)] if published else []
    return _settled(figure, [*handles, _key("in proportion to N", GREY, "", ":")])


@_styled
def degradation(
    share_lost: Reals, means: Reals, intervals: Reals, unfinished_share: Reals, title: str, runs: Sequence[int] = ()
) -> Figure:
    """Iterations, and below them the share of runs that did not finish, against the share of robots lost.

    `share_lost` (m,) and `unfinished_share` (m,) are 0 to 1; `means` (m,) and `intervals` (m, 2), 95 %, are NaN
    where no run finished; `runs`: how many were made at each share.
    """
    figure = _sheet(7.2, 5.6, title)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    lost = 100.0 * np.asarray(share_lost, dtype=float)
    upper.plot(lost, means, "-", color=BLUE, lw=1.2, alpha=0.5)
    _estimates(upper, lost, means, intervals)
    _span(upper, np.concatenate([means, np.ravel(intervals)]))
    upper.set(ylabel=TIME)
    gap = np.diff(np.unique(lost)).min(initial=10.0)
    lower.bar(lost, 100.0 * np.asarray(unfinished_share), 0.5 * gap, color=VERMILLION)
    lower.set(xlabel="robots lost, %", ylabel="unfinished\nruns, %", ylim=(0.0, 105.0), yticks=(0, 50, 100))
    _values(figure, lower, lost)
    handles = [_key("mean of finished runs, 95 % interval", BLUE, "o", "-")]
    return _settled(figure, [*handles, _patch(f"unfinished runs{_n(runs)}", VERMILLION, "none")])


@_styled
def sweep(
    values: Reals, means: Reals, intervals: Reals, xlabel: str, title: str, best: float | None,
    ylabel: str = TIME, runs: Sequence[int] = (),
) -> Figure:  # fmt: skip
    """A measure along one axis, and where it is best.

    `values` (m,), ascending, of what is varied, `means` (m,) and `intervals` (m, 2), 95 %, of the measure; `best` is
    where it is marked, or None; `runs`: how many were made at each value. The labels name the units.
    """
    figure = _sheet(7.2, 4.6, title)
    axes = figure.subplots()
    axes.plot(values, means, "-", color=BLUE, lw=1.2, alpha=0.5)
    _estimates(axes, values, means, intervals)
    handles = [_key(f"mean, 95 % interval{_n(runs)}", BLUE, "o", "-")]
    if best is not None:
        axes.axvline(best, color=GREEN, lw=14, alpha=0.16)
        axes.plot([best], [np.interp(best, values, means)], "*", color=GREEN, mec=BLACK, ms=16)
        handles += [_key(f"best: {best:g}", GREEN, "*", edge=BLACK, size=12)]
    _span(axes, np.concatenate([means, np.ravel(intervals)]))
    axes.set(xlabel=xlabel, ylabel=ylabel)
    _values(figure, axes, values)
    return _settled(figure, handles)


@_styled
def table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> Figure:
    """A table as a picture, every column as wide as its widest text, all but the first aligned on the right."""
    figure = _sheet(1.0, 1.0, "")
    lines = [[figure.text(0, 0, text, va="center") for text in row] for row in (columns, *rows)]
    heading = figure.text(0, 0, title, size=12, weight="bold", va="center")
    for text in lines[0]:
        text.set_fontweight("bold")
    widths = [max(text.get_window_extent().width / DPI for text in column) for column in zip(*lines, strict=True)]
    line, gap, margin = 0.28, 0.36, 0.25
    ends = margin - 0.5 * gap + np.cumsum(np.array(widths) + gap)  # the right edge of each column's text
    width = max(ends[-1] + 0.5 * gap, margin + heading.get_window_extent().width / DPI) + margin
    height = 2 * margin + line * (len(lines) + 1.3)
    figure.set_size_inches(width, height)
    heading.set_position((margin / width, 1 - (margin + 0.4 * line) / height))
    for row, texts in enumerate(lines):
        middle = 1 - (margin + line * (1.8 + row)) / height
        for at, text in enumerate(texts):
            text.set(x=(ends[at] if at else margin) / width, y=middle, ha="right" if at else "left")
        if row % 2:
            stripe = Rectangle((0.5 * margin / width, middle - 0.5 * line / height), 1 - margin / width, line / height)
            figure.add_artist(stripe).set(facecolor=PALE, alpha=0.6, zorder=0)
    figure.add_artist(
        Line2D((0.5 * margin / width, 1 - 0.5 * margin / width), 2 * [1 - (margin + 2.3 * line) / height])
    )
    figure.set_layout_engine("none")
    return figure


def padded(runs: Sequence[Reals]) -> Reals:
    """Curves (t,) of unequal lengths as one array (n, longest), each going on at its last value."""
    if not runs or not all(len(run) for run in runs):
        raise ValueError("a condition needs at least one run, and a run at least one iteration")
    longest = max(map(len, runs))
    return np.array([np.pad(np.asarray(run, dtype=float), (0, longest - len(run)), mode="edge") for run in runs])


def _sheet(width: float, height: float, title: str) -> Figure:
    """An empty figure in inches, which no window and no global list of figures knows."""
    figure = Figure((width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.08, wspace=0.05)
    figure.suptitle(title, x=0.02, ha="left", wrap=True)
    return figure


def _settled(figure: Figure, handles: Sequence[Artist] = ()) -> Figure:
    """The figure with a legend below it, laid out once and for all: drawing it again moves nothing."""
    for rows in range(1, len(handles) + 1):  # as few rows as the width allows
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=-(-len(handles) // rows))
        if rows == len(handles) or legend.get_window_extent().width < 0.96 * figure.bbox.width:
            break
        legend.remove()
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure


def _n(runs: Sequence[int]) -> str:
    """How many runs there are, for a legend."""
    return f", n = {min(runs)}{f' to {max(runs)}' if min(runs) < max(runs) else ''}" if len(runs) else ""


def _described(label: str, runs: Sequence[Reals]) -> str:
    """A condition with the number of its runs, and of those that did not get to 100 %."""
    below = sum(run[-1] < 1.0 for run in runs)
    return f"{label} (n = {len(runs)}{f', {below} below 100 %' if below else ''})"


def _key(
    label: str, colour: str, marker: str, line: Line = "", face: str = "", edge: str = "", size: float = 6.0,
    width: float = 1.8,
) -> Line2D:  # fmt: skip
    """A line or a point in a legend."""
    return Line2D(
        [], [], color=colour, linestyle=line, linewidth=width, marker=marker, markersize=size, label=label,
        markerfacecolor=face or colour, markeredgecolor=edge or colour,
    )  # fmt: skip


def _patch(label: str, face: str, edge: str, alpha: float = 1.0) -> Rectangle:
    """An area in a legend."""
    return Rectangle((0, 0), 1, 1, facecolor=face, edgecolor=edge, alpha=alpha, label=label)


def _faults(axes: Axes, labels: Sequence[str], marks: Mapping[str, Sequence[int]]) -> list[Artist]:
    """Vertical dashes in the colours of the conditions, in turns where several share an iteration; for the legend."""
    rows = _places(marks, labels).astype(int)
    owners: dict[int, list[int]] = {}
    for row, iterations in zip(rows, marks.values(), strict=True):
        for at in iterations:
            owners.setdefault(at, []).append(row)
    for at, sharing in owners.items():
        for turn, row in enumerate(sharing):
            dash = (4.0 * turn, (4.0, 4.0 * max(1, len(sharing) - 1)))
            axes.axvline(at, color=COLOURS[row % len(COLOURS)], linestyle=dash, linewidth=1.2, alpha=0.8, zorder=1.5)
    return [_key("fault, in the colour of its curve", GREY, "", "--")] if owners else []


def _places(given: Iterable[str], labels: Sequence[str]) -> Reals:
    """Where the given labels stand among all labels."""
    unknown = sorted(set(given) - set(labels))
    if unknown:
        raise ValueError(f"no such condition: {', '.join(unknown)}; there are {', '.join(labels)}")
    return np.array([labels.index(label) for label in given], dtype=float)


def _box(axes: Axes, place: float, taken: Reals, done: NDArray[np.bool_]) -> None:
    """The quartiles and the median of one condition, and its runs as points."""
    low, middle, high = np.percentile(taken, (25, 50, 75))
    axes.add_patch(Rectangle((place - 0.24, low), 0.48, high - low, facecolor=PALE, edgecolor=BLUE))
    axes.hlines(middle, place - 0.24, place + 0.24, color=BLUE, linewidth=2.2)
    aside = place + 0.36 * (np.arange(len(taken)) * 0.6180339887 % 1.0 - 0.5)  # golden steps: even, and always the same
    axes.plot(aside[done], taken[done], "o", color=BLUE, markersize=3.5, alpha=0.7, markeredgewidth=0)
    axes.plot(aside[~done], taken[~done], "^", markersize=6, markerfacecolor="none", markeredgecolor=VERMILLION)


def _estimates(
    axes: Axes, at: NDArray[Any], means: Reals, spans: Reals, colour: str = BLUE, width: float = 2.5
) -> None:
    """Means (m,) as points on upright bars over `spans` (m, 2)."""
    if np.shape(spans) != (len(at), 2) or len(means) != len(at):
        raise ValueError(f"{len(at)} places, means of shape {np.shape(means)} and spans of shape {np.shape(spans)}")
    axes.vlines(at, spans[:, 0], spans[:, 1], color=colour, linewidth=width, alpha=0.75)
    axes.plot(at, spans, "_", color=colour, markersize=5 + 1.5 * width)  # seen even where a point hides the bar
    axes.plot(at, means, "o", color=colour, markersize=5)


def _span(axes: Axes, numbers: Reals, scale: Literal["linear", "log"] = "linear") -> None:
    """Upright limits that hold all numbers (not NaN), from zero on a linear scale; ticks in plain figures."""
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


def _crowded(figure: Figure, axes: Axes) -> bool:
    """Whether labels of neighbouring ticks along x touch."""
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
    return any(right.x0 - left.x1 < 0.04 * DPI for left, right in pairwise(boxes))


def _conditions(figure: Figure, axes: Axes, labels: Sequence[str], runs: Sequence[int]) -> None:
    """The names of conditions along x, with the number of their runs; turned where they would overlap."""
    counts = [f"n = {count}" for count in runs] or [""] * len(labels)
    both = list(zip(labels, counts, strict=True))
    axes.set(ylabel=TIME, xlim=(-0.6, len(labels) - 0.4))
    axes.grid(False, axis="x")
    axes.set_xticks(range(len(labels)), [f"{label}\n{count}".strip() for label, count in both])
    if _crowded(figure, axes):
        turned = [f"{label} ({count})" if count else label for label, count in both]
        axes.set_xticks(range(len(labels)), turned, rotation=40, ha="right", rotation_mode="anchor")
        figure.set_figheight(figure.get_figheight() + 0.045 * max(map(len, turned)))


def _values(figure: Figure, axes: Axes, values: NDArray[Any]) -> None:
    """Ticks along x at the values themselves, or at round numbers where those would overlap."""
    axes.set_xticks(np.unique(values))
    if _crowded(figure, axes):
        axes.xaxis.set_major_locator(AutoLocator())
