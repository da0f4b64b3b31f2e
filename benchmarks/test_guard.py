"""What it costs to hold parts to their contracts in every iteration of the basilica, as shares of one run's time."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmsim.core.scenario import load
from swarmsim.engine import contracts, guard
from swarmsim.engine.build import Run, build
from swarmsim.operations.mapping.maps import MapAuditor

SCENARIO = Path(__file__).parent.parent / "scenarios" / "basilica.toml"
PAIRS = 15
CHECKS = {
    "sensor and localisation": [(contracts, "readings"), (contracts, "located")],
    "topology": [(contracts, "links")],
    "channel": [(contracts, "delivery")],
    "computation": [(contracts, "said"), (contracts, "knowledge"), (contracts, "record"), (MapAuditor, "audit")],
    "strategy": [(contracts, "intents")],
    "task": [(contracts, "measured")],
}


def run_with(seams: tuple[str, ...]) -> Run:
    """A run of which these parts are checked as those of others are."""
    run = build(load(SCENARIO, ["stop.iterations=600"]), str(SCENARIO))
    run.simulation.parts = guard.guarded(run.simulation.parts, run.setting, seams, seams)
    return run


def seconds(*seams: str) -> float:
    run = run_with(seams)
    begun = time.process_time()
    run.simulation.run()
    return time.process_time() - begun


@pytest.mark.bench
def test_checking_costs_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Prints the share of a run's time that is spent in the checks of each part, and the ratio of whole runs."""
    seams = ("sensor", "localisation", "topology", "channel", "computation", "strategy", "task")
    seconds(*seams)
    pairs = [(seconds(), seconds(*seams)) for _ in range(PAIRS)]
    low, median, high = np.quantile([checked / plain for plain, checked in pairs], (0.25, 0.5, 0.75))
    spent: Counter[str] = Counter()

    def timed(part: str, check: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any) -> Any:
            begun = time.perf_counter()
            found = check(*given)
            spent[part] += time.perf_counter() - begun
            return found

        return call

    for part, several in CHECKS.items():
        for place, name in several:
            monkeypatch.setattr(place, name, timed(part, getattr(place, name)))
    whole = 0.0
    for _ in range(PAIRS):
        run = run_with(seams)
        begun = time.perf_counter()
        run.simulation.run()
        whole += time.perf_counter() - begun
    print()
    for part in CHECKS:
        print(f"{part:24s} {100 * spent[part] / whole:4.1f} % of the run")
    print(f"whole runs, all checked over none: {median:.3f} (quartiles {low:.3f} to {high:.3f}, {PAIRS} pairs)")
    assert run_with(seams).simulation.run() == run_with(()).simulation.run()
