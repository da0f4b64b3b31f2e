"""How far bodies overlap, and how far they get, in a crowd that pushes: a table by sub-step and `physics.parting`.

    python benchmarks/pushing.py

Forty robots meet in the middle of `worlds/arena.svg` for 40 s, each going to the mean place of those near it. Overlaps
are taken at the ends of iterations, as shares of a radius; ways are of all robots together. Means of ten seeds, with
95 % intervals of Student's t.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import stats

from swarmsim.core.scenario.file import load
from swarmsim.core.state import Knowledge, Moment
from swarmsim.engine.build import build
from swarmsim.engine.contacts import Contacts

SCENARIO = Path(__file__).parents[1] / "scenarios" / "operations" / "rendezvous.toml"
KEYS = ("robots.count=40", "task.within=0.05", "stop.iterations=40")
SEEDS = range(1, 11)


class Way:
    """How far all robots have gone."""

    def __init__(self) -> None:
        self.metres, self._last = 0.0, None

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Add this iteration's."""
        places = moment.state.pose[:, :2].copy()
        if self._last is not None:
            self.metres += float(np.hypot(*(places - self._last).T).sum())
        self._last = places


def crowd(substep: float, parting: float, seed: int) -> tuple[float, float]:
    """The deepest overlap of a run, in % of a radius, and the way in m."""
    keys = (*KEYS, f"physics.substep={substep}", f"physics.parting={parting}", f"seed={seed}")
    made, way = build(load(SCENARIO, keys), str(SCENARIO)), Way()
    made.simulate([contacts := Contacts(made), way])
    return 100.0 * contacts.deepest[0], way.metres


def told(values: list[float]) -> str:
    """Their mean with its interval."""
    half = stats.t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / len(values) ** 0.5
    return f"{np.mean(values):.1f} ({np.mean(values) - half:.1f} to {np.mean(values) + half:.1f})"


def main() -> None:
    """Print the table."""
    print("| sub-step | `parting` | deepest overlap, % of a radius | way of all robots, m |\n|---|---|---|---|")
    for substep in (1 / 256, 1 / 64, 0.05):
        for parting in (1 / 60, 0.2):
            overlaps, ways = zip(*(crowd(substep, parting, seed) for seed in SEEDS), strict=True)
            print(f"| 1/{1 / substep:.0f} s | 1/{1 / parting:.0f} s | {told(overlaps)} | {told(ways)} |", flush=True)


if __name__ == "__main__":
    main()
