"""What it costs to hold parts to their contracts in every iteration, as ratios of paired runs of the basilica."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from swarmsim.core.scenario import load
from swarmsim.engine import guard
from swarmsim.engine.build import Run, build

SCENARIO = Path(__file__).parent.parent / "scenarios" / "basilica.toml"
PAIRS = 15
SEAMS = ("sensor", "localisation", "topology", "channel", "computation", "strategy", "task")


def run_with(*seams: str) -> Run:
    """A run of which these parts are checked as those of others are."""
    run = build(load(SCENARIO, ["stop.iterations=300"]), str(SCENARIO))
    run.simulation.parts = guard.guarded(run.simulation.parts, run.setting, seams)
    return run


def seconds(*seams: str) -> float:
    run = run_with(*seams)
    begun = time.process_time()
    run.simulation.run()
    return time.process_time() - begun


@pytest.mark.bench
def test_checking_costs_little() -> None:
    """Prints the median ratio of checked over unchecked runs, for each seam and for all of them."""
    seconds(*SEAMS)
    print()
    for seams in (*((seam,) for seam in SEAMS), SEAMS):
        ratios = []
        for pair in range(PAIRS):
            order = ((), seams) if pair % 2 else (seams, ())
            taken = {chosen: seconds(*chosen) for chosen in order}
            ratios.append(taken[seams] / taken[()])
        low, median, high = np.quantile(ratios, (0.25, 0.5, 0.75))
        name = seams[0] if len(seams) == 1 else "all seven"
        print(f"{name:14s} {100 * (median - 1):+5.1f} % (quartiles {100 * (low - 1):+.1f} to {100 * (high - 1):+.1f})")
        assert run_with(*seams).simulation.run() == run_with().simulation.run()
