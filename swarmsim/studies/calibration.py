"""The calibration of the reproduction: of all candidates, the one nearest to the published numbers it is held to."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from swarmsim.studies.plan import Condition, Plan
from swarmsim.studies.results import gather
from swarmsim.studies.store import Store

Row = tuple[int, str, bool]  # robots, network, whether robots are removed
ROWS: Final = ("network.topology", "network.topology.k", "robots.count", "faults")  # keys that say which number it is


@dataclass(frozen=True, slots=True)
class Candidate:
    """One choice of what the paper leaves open, and how it fares."""

    choice: dict[str, object]  # dotted key: value
    means: dict[Row, float | None]  # iterations; None if a run did not finish
    published: Mapping[Row, float]
    runs: int  # behind each mean

    def log_ratio(self, row: Row) -> float:
        """The logarithm of its mean over the published number; infinite where a mean is missing."""
        mean = self.means[row]
        return math.log(mean / self.published[row]) if mean else math.inf

    def error(self, without: Row | None = None) -> float:
        """Root mean square of the logarithms of its ratios, of all rows or of all but one."""
        logs = [self.log_ratio(row) for row in self.means if row != without]
        return math.sqrt(sum(log * log for log in logs) / len(logs))


def published(path: Path) -> dict[Row, float]:
    """The published iterations; the chain is a ring too, which is what the text says of it."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found: dict[Row, float] = {}
    for row in rows:
        iterations, removal = float(row["iterations"]), row["removal"] != "none"
        networks = ("chain", "ring") if row["network"] == "chain" else (f"knn {row['k']}",)
        found |= {(int(row["robots"]), network, removal): iterations for network in networks}
    return found


def row_of(condition: Condition) -> Row:
    """Which published number a condition is held to."""
    scenario = condition.scenario
    topology = scenario.network.topology
    network = f"knn {topology.declares('k', 0)}" if topology.use == "knn" else topology.use
    return scenario.robots.count, network, bool(scenario.faults)


def candidates(plan: Plan, store: Store, numbers: Mapping[Row, float]) -> list[Candidate]:
    """All candidates of a calibration study, the best first."""
    means: dict[str, dict[Row, float | None]] = {}
    for result in gather(plan, store).values():
        choice = {key: value for key, value in result.condition.changes.items() if key not in ROWS}
        mean = result.describe().mean if not result.missing else None
        means.setdefault(json.dumps(choice), {})[row_of(result.condition)] = mean
    found = [Candidate(json.loads(choice), of_choice, numbers, len(plan.seeds)) for choice, of_choice in means.items()]
    return sorted(found, key=Candidate.error)


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A published number, and what the candidate says of it that is best by all the others."""

    row: Row
    published: float
    predicted: float | None
    choice: dict[str, object]


def left_out(found: list[Candidate]) -> list[LeftOut]:
    """Each number left out in turn, and predicted by the best candidate without it."""
    lines = []
    for row in found[0].means:
        best = min(found, key=lambda candidate: candidate.error(row))
        lines.append(LeftOut(row, best.published[row], best.means[row], best.choice))
    return lines


def prediction_error(lines: list[LeftOut]) -> float:
    """Root mean square of the logarithms of predicted over published numbers."""
    logs = [math.log(line.predicted / line.published) if line.predicted else math.inf for line in lines]
    return math.sqrt(sum(log * log for log in logs) / len(logs))


LEFT_OUT: Final = ("number left out", "published", "predicted", "ratio", "by")


def left_out_lines(found: list[LeftOut]) -> list[tuple[str, ...]]:
    """One line for each number, under LEFT_OUT."""
    return [
        (
            _named(line.row),
            f"{line.published:.0f}",
            "not finished" if line.predicted is None else f"{line.predicted:.0f}",
            "-" if line.predicted is None else f"{line.predicted / line.published:.2f}",
            ", ".join(str(value) for value in line.choice.values()),
        )
        for line in found
    ]


def lines(found: list[Candidate]) -> list[tuple[str, ...]]:
    """One line for each candidate: its choice, its means, its error."""
    return [
        (
            ", ".join(str(value) for value in candidate.choice.values()),
            *("not finished" if mean is None else f"{mean:.0f}" for mean in candidate.means.values()),
            f"{candidate.error():.3f}",
        )
        for candidate in found
    ]


def head(found: list[Candidate]) -> tuple[str, ...]:
    """The columns of `lines`: the varied keys, then each published number."""
    first = found[0]
    keys = ", ".join(key.rpartition(".")[2] for key in first.choice)
    return (keys, *(f"{_named(row)} ({first.published[row]:.0f})" for row in first.means), "rms log-ratio")


def _named(row: Row) -> str:
    robots, network, removal = row
    return f"{robots}, {network}{', shrinking' if removal else ''}"
