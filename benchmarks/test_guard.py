"""The cost of checking parts' contracts in every iteration of the basilica."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmsim.core.parts import Parts
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.engine import guard
from swarmsim.engine.build import BuiltRun, build

SCENARIO = Path(__file__).parent.parent / "scenarios" / "basilica.toml"
PAIRS = 15
#: Without the motion: bodies call a built-in, unguarded one in a shorter way.
SEAMS = ("sensor", "localisation", "topology", "channel", "computation", "strategy", "task")
MIND = """
class Wanderer:
    message_fields = {"x": "f8", "y": "f8"}

    def say(self, me):
        return me.x, me.y

    def step(self, me):
        near = [wall for wall in me.walls if abs(wall[0] - me.x) + abs(wall[1] - me.y) < 0.4]
        return me.drive(0.02 if near else 0.1, 1.0 if near else 0.1 * len(me.heard))
"""


def opened(*overrides: str) -> BuiltRun:
    with registry.own_code(True):
        return build(load(SCENARIO, ["stop.iterations=300", *overrides]), str(SCENARIO))


def seconds(run: BuiltRun) -> float:
    begun = time.process_time()
    run.simulation.run()
    return time.process_time() - begun


def bare(parts: Parts) -> Parts:
    """The parts without their guards."""
    changed = {seam: getattr(parts, seam) for seam in SEAMS}
    return replace(parts, **{seam: getattr(part, "_part", part) for seam, part in changed.items()})


def ratios(what: str, overrides: tuple[str, ...], seams: tuple[str, ...]) -> None:
    """Print the slowdown of runs whose parts of some seams are guarded like third-party ones."""
    found = []
    for pair in range(PAIRS + 1):
        plain, checked = opened(*overrides), opened(*overrides)
        plain.simulation.parts = bare(plain.simulation.parts)
        if seams:
            parts = checked.simulation.parts
            checked.simulation.parts = guard.guarded(parts, checked.context, seams, seams, checked.simulation.clock)
        one, other = (seconds(plain), seconds(checked)) if pair % 2 else (seconds(checked), seconds(plain))[::-1]
        found.append(other / one)
        assert np.array_equal(plain.simulation.state.pose, checked.simulation.state.pose)
    low, median, high = np.quantile(found[1:], (0.25, 0.5, 0.75))  # without the first, which compiles kernels
    print(f"{what:44s} {median:.3f} (quartiles {low:.3f} to {high:.3f}, {PAIRS} pairs)")


@pytest.mark.bench
def test_checking_costs_little(tmp_path: Path) -> None:
    """Prints the ratios of whole runs, with guards over without, interleaved in one process."""
    (tmp_path / "wanderer.py").write_text(MIND)
    mine = (f"mind={{use='{tmp_path / 'wanderer.py'}:Wanderer'}}", "task={use='gathered'}")
    assert not any(isinstance(getattr(opened().simulation.parts, seam), guard.Guard) for seam in SEAMS)
    print("\nbuilt-in parts: no guards")
    ratios("a custom mind, a class", mine, ())
    for seam in SEAMS:
        ratios(f"our {seam}, guarded as third-party", (), (seam,))
    ratios("all of ours, guarded as third-party", (), SEAMS)
