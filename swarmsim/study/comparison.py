"""What it cost: recorded runs side by side, each against the first."""

from __future__ import annotations

from collections.abc import Sequence
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
    mean_coverage: float | None  # over the longer of the two runs
    coverage_ratio: float | None  # of that to the reference's
    lag: int | None  # iterations that it is behind at half of what the reference still had to map at its first fault
    recovery: int | None  # iterations from the first fault until coverage is back where it was; None for never
    quality: Quality  # of the union's occupied cells in the domain, at the end
    messages: int
    lost: int


def cost(name: str, run: Recording, reference: Recording) -> Cost:
    """What distinguishes a run from the reference."""
    mine, theirs = run["coverage"], reference["coverage"]
    events = [event for event in run.events() if event.kind not in ("finished", "not finished")]
    faults = tuple(sorted({event.iteration for event in events}))
    summary = run.summary()
    both = summary["status"] == reference.summary()["status"] == "finished"
    horizon = max(len(mine), len(theirs))
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


def lines(costs: Sequence[Cost]) -> list[tuple[str, ...]]:
    """One line for each run, under HEAD."""
    return [
        (
            found.name,
            str(len(found.curve)) if found.finished else f"not finished ({len(found.curve)})",
            _shown(found.slowdown, ".2f"),
            _shown(found.mean_coverage, ".3f"),
            _shown(found.coverage_ratio, ".3f"),
            _shown(found.lag, "+d"),
            _shown(found.recovery, "d"),
            _shown(found.quality.precision, ".3f"),
            _shown(found.quality.recall, ".3f"),
            _shown(found.quality.iou, ".3f"),
            str(found.messages),
            str(found.lost),
            ", ".join(map(str, found.faults[:6])) + (", ..." if len(found.faults) > 6 else "") or "-",
        )
        for found in costs
    ]


def _shown(value: Any, how: str) -> str:
    return "-" if value is None else format(value, how)


def draw(costs: Sequence[Cost], path: Path) -> tuple[Path, Path]:
    """Draw the coverage curves, with marks at their faults, as PNG and SVG; gives the files."""
    figure = plots.coverage(
        {found.name: [found.curve] for found in costs},
        "Coverage, run by run",
        {found.name: found.faults for found in costs if found.faults},
    )
    return plots.save(figure, path)
