"""What it cost: recorded runs side by side, each against the first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.state import OCCUPIED, UNKNOWN
from swarmsim.measures import Quality, mean_coverage, quality, reached
from swarmsim.recording import Recording
from swarmsim.replay import MapReplay
from swarmsim.view import plots

HEAD: Final = (
    "run", "iterations", "slowdown", "mean coverage", "ratio", "lag", "recovery", "precision", "recall", "IoU",
    "messages", "lost", "faults at",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cost:
    """One run against a reference; None where a number is not defined."""

    name: str
    curve: NDArray[np.float64]  # (t,): coverage after each iteration, 0 to 1
    finished: bool
    faults: tuple[int, ...]  # the iterations in which something began or ended
    slowdown: float | None  # its iterations over the reference's, T_f / T_0, where both finished
    mean_coverage: float | None  # over the longest of the runs compared
    coverage_ratio: float | None  # of that to the reference's
    lag: int | None  # iterations that it is behind at half of what the reference still had to map at its first fault
    recovery: int | None  # iterations from the first fault until coverage is back where it was; None for never
    quality: Quality  # of the union's occupied cells in the domain, at the end
    messages: int
    lost: int


def costs(named: Mapping[str, Recording]) -> list[Cost]:
    """What distinguishes each run from the first; coverage is averaged over the longest of all runs."""
    reference = next(iter(named.values()))
    horizon = max(run.iterations for run in named.values())
    return [_cost(name, run, reference, horizon) for name, run in named.items()]


def _cost(name: str, run: Recording, reference: Recording, horizon: int) -> Cost:
    mine, theirs = run["coverage"], reference["coverage"]
    events = [event for event in run.events() if event.kind not in ("finished", "not finished")]
    faults = tuple(sorted({event.iteration for event in events}))
    summary = run.summary()
    both = summary["status"] == reference.summary()["status"] == "finished"
    area, base = mean_coverage(mine, horizon), mean_coverage(theirs, horizon)
    maps = MapReplay(run)
    maps.advance(run.iterations - 1)
    union, domain = maps.collective(), run["domain"]
    return Cost(
        name=name,
        curve=mine,
        finished=summary["status"] == "finished",
        faults=faults,
        slowdown=len(mine) / len(theirs) if both else None,
        mean_coverage=area,
        coverage_ratio=area / base if area is not None and base else None,
        lag=_lag(mine, theirs, faults),
        recovery=_recovery(mine, faults),
        quality=quality(union == OCCUPIED, run["truth"], domain & (union != UNKNOWN)),
        messages=summary["messages"],
        lost=sum(summary["lost"].values()),
    )


def _lag(mine: NDArray[np.float64], theirs: NDArray[np.float64], faults: Sequence[int]) -> int | None:
    """How much later than the reference it had mapped half of what was left at the first fault."""
    if not faults or faults[0] >= min(len(mine), len(theirs)):
        return None
    half = (1.0 + theirs[max(faults[0] - 1, 0)]) / 2.0
    late, early = reached(mine, half), reached(theirs, half)
    return None if late is None or early is None else late - early


def _recovery(mine: NDArray[np.float64], faults: Sequence[int]) -> int | None:
    """Iterations from the first fault until coverage is, for good, what it was before it; 0 if it never fell."""
    if not faults or not 0 < faults[0] < len(mine):
        return None
    below = np.flatnonzero(mine[faults[0] :] < mine[faults[0] - 1])
    if len(below) == 0:
        return 0
    return int(below[-1]) + 1 if below[-1] + 1 < len(mine) - faults[0] else None


def lines(found: Sequence[Cost]) -> list[tuple[str, ...]]:
    """One line for each run, under HEAD."""
    return [
        (
            one.name,
            str(len(one.curve)) if one.finished else f"not finished ({len(one.curve)})",
            _shown(one.slowdown, ".2f"),
            _shown(one.mean_coverage, ".3f"),
            _shown(one.coverage_ratio, ".3f"),
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


def _shown(value: Any, how: str) -> str:
    return "-" if value is None else format(value, how)


def draw(found: Sequence[Cost], path: Path) -> tuple[Path, Path]:
    """Draw the coverage curves, with marks at their faults, as PNG and SVG; gives the files."""
    figure = plots.coverage(
        {one.name: [one.curve] for one in found},
        "Coverage, run by run",
        {one.name: one.faults for one in found if one.faults},
    )
    return plots.save(figure, path)
