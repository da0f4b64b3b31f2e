"""Cost of faults: recorded runs side by side, each against the first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.durations import told
from swarmsim.core.errors import InputError
from swarmsim.core.events import Ended
from swarmsim.core.parts import Curve
from swarmsim.operations.mapping.measures.comparing import course, quality_of
from swarmsim.operations.mapping.measures.quality import Quality
from swarmsim.recording.measures import mean_value, reached
from swarmsim.recording.reader import Recording
from swarmsim.studies.likeness import Side, notices
from swarmsim.view import plots


@dataclass(frozen=True, slots=True)
class Cost:
    """One run against a reference; None where a number is not defined."""

    name: str
    values: NDArray[np.float64]  # (t,): the task's measure after each iteration
    period: float  # s, of one iteration
    finished: bool
    faults: tuple[int, ...]  # the iterations in which a fault began or ended
    slowdown: float | None  # its time over the reference's, T_f / T_0, where both finished
    mean: float | None  # of that measure, over the longest of the runs compared
    ratio: float | None  # of that mean to the reference's
    lag: int | None  # its iterations behind at half of what the reference had left to do at its first fault
    recovery: int | None  # iterations from the first fault until its measure is back; None for never
    quality: Quality  # of the union's occupied cells in the domain, at the end
    messages: int
    lost: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """Runs compared with the first."""

    costs: tuple[Cost, ...]  # in the order of the runs, the first among them
    curve: Curve  # their task's measure
    notices: tuple[str, ...]  # differences that make their numbers hard to compare
    figures: tuple[Path, ...] = ()  # files drawn, if requested


def compared(runs: Sequence[Path], plot: Path | None = None) -> Comparison:
    """Compare each recorded run with the first; `plot` is a figure to draw.

    Raises InputError for fewer than two runs, a run without iterations, or tasks with different measures.
    """
    if len(runs) < 2:
        raise InputError(f"compare: {len(runs)} run given; expected the reference and at least one more")
    opened = [Recording(run) for run in runs]
    for run, recording in zip(runs, opened, strict=True):
        if not recording.iterations:
            raise InputError(f"{run}: no whole iteration was recorded; there is nothing to compare")
    named, curve = dict(zip(_names(runs), opened, strict=True)), opened[0].curve
    found = costs(named)
    sides = [Side(name, run.scenario, run.world, run.code) for name, run in named.items()]
    figures = [] if plot is None else draw(found, curve, plot)
    return Comparison(tuple(found), curve, tuple(notices(sides)), tuple(figures))


def _names(runs: Sequence[Path]) -> list[str]:
    """The shortest endings of the runs' paths that tell all runs apart."""
    paths = [run.absolute().parent if run.suffix == ".h5" else run.absolute() for run in runs]
    for parts in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-parts:]) for path in paths]
        if len(set(names)) == len(set(paths)):
            break
    return names if len(set(names)) == len(names) else [f"{name} ({place})" for place, name in enumerate(names, 1)]


def costs(named: Mapping[str, Recording]) -> list[Cost]:
    """Each run's cost against the first; measures are averaged over the longest run.

    Raises InputError unless all tasks have one measure.
    """
    reference = next(iter(named.values()))
    for name, run in named.items():
        mine, theirs = (f"{one.curve.name!r} ({one.curve.label})" for one in (run, reference))
        if mine != theirs:
            raise InputError(f"{name}: its task measures {mine}, the first run's {theirs}; expected runs of one task")
    horizon = max(run.iterations * run.scenario.period for run in named.values())
    return [_cost(name, run, reference, horizon) for name, run in named.items()]


def _cost(name: str, run: Recording, reference: Recording, horizon: float) -> Cost:
    """One run's cost; the horizon is in s."""
    values, mine, other = run[run.curve.name], course(run), course(reference)
    period, theirs = run.scenario.period, reference.scenario.period
    events = [event for event in run.events() if not isinstance(event, Ended)]
    faults = tuple(sorted({event.iteration for event in events}))
    summary = run.summary()
    both = summary["status"] == reference.summary()["status"] == "finished"
    mean = mean_value(values, round(horizon / period))
    base = mean_value(reference[run.curve.name], round(horizon / theirs))
    return Cost(
        name=name,
        values=values,
        period=period,
        finished=summary["status"] == "finished",
        faults=faults,
        slowdown=len(mine) / len(other) * (period / theirs) if both else None,
        mean=mean,
        ratio=mean / base if mean is not None and base else None,
        lag=_lag(mine, other, faults, period / theirs),
        recovery=_recovery(mine, faults),
        quality=quality_of(run),
        messages=summary["messages"],
        lost=sum(summary["lost"].values()),
    )


def _lag(
    mine: NDArray[np.float64], theirs: NDArray[np.float64], faults: Sequence[int], period: float = 1.0
) -> int | None:
    """How much later than the reference it had done half of the rest at the first fault; `period`: its over theirs."""
    first = round(faults[0] * period) if faults else 0  # the reference's iteration at that time
    if not faults or faults[0] >= len(mine) or first >= len(theirs):
        return None
    half = (1.0 + theirs[max(first - 1, 0)]) / 2.0
    late, early = reached(mine, half), reached(theirs, half)
    return None if late is None or early is None else late - round(early / period)


def _recovery(mine: NDArray[np.float64], faults: Sequence[int]) -> int | None:
    """Iterations from the first fault until the run stays at or above its value before it; 0 if it never fell."""
    if not faults or not 0 < faults[0] < len(mine):
        return None
    below: NDArray[np.int64] = np.flatnonzero(mine[faults[0] :] < mine[faults[0] - 1])
    if len(below) == 0:
        return 0
    return int(below[-1]) + 1 if below[-1] + 1 < len(mine) - faults[0] else None


def head(curve: Curve) -> tuple[str, ...]:
    """The columns of the table of runs with this curve."""
    return (
        "run", "iterations", "time", "slowdown", f"mean {curve.name}", "ratio", "lag", "recovery", "precision",
        "recall", "IoU", "messages", "lost", "faults at",
    )  # fmt: skip


def lines(found: Sequence[Cost]) -> list[tuple[str, ...]]:
    """One line per run, under `head`."""
    return [
        (
            one.name,
            str(len(one.values)) if one.finished else f"not finished ({len(one.values)})",
            told(len(one.values) * one.period),
            _shown(one.slowdown, ".2f"),
            _shown(one.mean, ".3f" if one.mean is None or 0.001 <= one.mean <= 1.0 else ".4g"),
            _shown(one.ratio, ".3f"),
            _shown(one.lag, "+d"),
            _shown(one.recovery, "d"),
            _shown(one.quality.precision, ".3f"),
            _shown(one.quality.recall, ".3f"),
            _shown(one.quality.iou, ".3f"),
            str(one.messages),
            str(one.lost),
            ", ".join(map(str, one.faults[:6])) + (", ..." if len(one.faults) > 6 else "") or "-",
        )
        for one in found
    ]


def _shown(value: object, how: str) -> str:
    return "-" if value is None else format(value, how)


def draw(found: Sequence[Cost], curve: Curve, path: Path) -> list[Path]:
    """Draw the runs' curves, with marks at their faults, for print; gives the files."""
    name = curve.label.partition(",")[0]
    figure = plots.curves(
        {one.name: [one.values] for one in found},
        f"{name[:1].upper()}{name[1:]}, run by run",
        {one.name: one.faults for one in found if one.faults},
        curve,
        {one.name: one.period for one in found},
    )
    return plots.save(figure, path)
