"""The calibration of the reproduction: of all candidates, the one that comes nearest to two published numbers."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any, Final

from swarmsim.studies.plan import Plan
from swarmsim.studies.results import gather
from swarmsim.studies.store import Store

TARGETS: Final = {1: 583.0, 5: 303.0}  # published iterations of 1NN and 5NN (Table II), by number of neighbours
DEGREE: Final = "network.topology.k"


@dataclass(frozen=True, slots=True)
class Candidate:
    """One choice of everything that the paper leaves open, and how it fares."""

    choice: dict[str, Any]  # dotted key: value
    means: dict[int, float | None]  # iterations by number of neighbours; None if a run did not finish
    runs: int  # behind each mean

    @property
    def error(self) -> float:
        """Root mean square of the logarithms of its two ratios; infinite where a mean is missing."""
        logs = [math.log(mean / TARGETS[k]) if mean else math.inf for k, mean in self.means.items()]
        return math.sqrt(sum(log * log for log in logs) / len(logs))


def candidates(plan: Plan, store: Store) -> list[Candidate]:
    """All candidates of the calibration study, the best first."""
    means: dict[str, dict[int, float | None]] = {}
    for result in gather(plan, store).values():
        choice = {key: value for key, value in result.condition.changes.items() if key != DEGREE}
        of_choice = means.setdefault(json.dumps(choice), {})
        of_choice[result.condition.changes[DEGREE]] = result.describe().mean if not result.missing else None
    found = [Candidate(json.loads(choice), of_choice, len(plan.seeds)) for choice, of_choice in means.items()]
    return sorted(found, key=lambda candidate: candidate.error)


def lines(found: list[Candidate]) -> list[tuple[str, ...]]:
    """One line for each candidate: its choice, its two means, its error."""
    return [
        (
            ", ".join(str(value) for value in candidate.choice.values()),
            *("not finished" if mean is None else f"{mean:.0f}" for mean in candidate.means.values()),
            f"{candidate.error:.3f}",
        )
        for candidate in found
    ]


def head(found: list[Candidate]) -> tuple[str, ...]:
    """The columns of `lines`: the varied keys, then each published number."""
    keys = ", ".join(key.rpartition(".")[2] for key in found[0].choice)
    return (keys, *(f"{k}NN ({TARGETS[k]:.0f})" for k in found[0].means), "rms log-ratio")
