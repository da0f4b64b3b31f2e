"""How near robots come to a source, and how good their predictions are, over seeds.

Usage: python benchmarks/computing/source.py [SCENARIO] [SEEDS] [KEY=VALUE ...]; seeds are counted from 101,
since others were looked at when keys were chosen. A line of JSON for each seed, then tables. Errors are means over the
robots that are sure of the place, as shares of the truth's variance; each mean has its 95 % interval by the bootstrap
over seeds.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarmsim.api.runs import prepared
from swarmsim.core.context import Field
from swarmsim.core.state import Moment
from swarmsim.operations.sources.found import located_by
from swarmsim.operations.sources.locate import Located

FIRST, DRAWS = 101, 10_000
LASTING = {"prediction": None, "the source goes on": math.inf, "it ends now": 0.0}
COLUMNS = (*LASTING, "persistence", "persistence of the truth")
Rows = dict[tuple[int, float], NDArray[np.float64]]  # by iteration and s ahead: the means of COLUMNS


class ByTime:
    """An observer that keeps errors by the iteration of the inversion."""

    def __init__(self, field: Field, ahead: Sequence[float], within: float) -> None:
        self._field, self._ahead, self._within = field, ahead, within
        self.rows: Rows = {}

    def sample(self, moment: Moment) -> None:
        """Note one iteration."""
        now, located = moment.state.iteration, located_by(moment)
        sure = np.flatnonzero(moment.state.alive & (located.made == now) & (located.spread <= self._within))
        for ahead in self._ahead if len(sure) else ():
            if now + ahead <= located.plan.last:
                errors = [self._errors(located, robot, now, ahead) for robot in sure.tolist()]
                self.rows[now, ahead] = np.mean(errors, axis=0)

    def _errors(self, located: Located, robot: int, now: int, ahead: float) -> list[float]:
        """One robot's errors, in the order of COLUMNS."""
        greens, finding = located.plan.inversion.greens, located.findings[robot]
        assert finding is not None
        cells, places = np.arange(greens.cells), located.plan.inversion.candidates.places
        still, then = (self._field.value(now + later, places) for later in (0.0, ahead))
        guesses = [finding.forecast(greens, now + ahead, cells, lasting) for lasting in LASTING.values()]
        guesses += [finding.forecast(greens, float(now), cells), still]
        return [float(((guess - then) ** 2).mean() / then.var()) for guess in guesses]


def resampled(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """The means of columns (n, c) over seeds with the ends of their intervals (c, 3)."""
    drawn = table[np.random.default_rng(0).integers(len(table), size=(DRAWS, len(table)))].mean(axis=1)
    return np.column_stack([table.mean(axis=0), *np.percentile(drawn, [2.5, 97.5], axis=0)])


def row_of(table: NDArray[np.float64]) -> str:
    """Means over seeds of COLUMNS (n, c), then the skill of the first over the persistence, with intervals."""
    at = COLUMNS.index("persistence")
    drawn = table[np.random.default_rng(0).integers(len(table), size=(DRAWS, len(table)))].mean(axis=1)
    low, high = np.percentile(1.0 - drawn[:, 0] / drawn[:, at], [2.5, 97.5])
    rows = [*resampled(table).tolist(), (1.0 - table[:, 0].mean() / table[:, at].mean(), low, high)]
    return " | ".join(f"{mean:.2f} ({low:.2f} to {high:.2f})" for mean, low, high in rows)


def told(summaries: Sequence[dict], by: Sequence[Rows]) -> None:
    """Print the tables."""
    near = [one["near_share_end"] == 1.0 for one in summaries]
    ends = stats.binomtest(sum(near), len(near)).proportion_ci(method="wilson")
    away = [one["source_distance_end"] for one in summaries if one["source_distance_end"] is not None]
    since = [math.inf if one["source_near_since"] is None else one["source_near_since"] for one in summaries]
    print(f"all robots near at the end: {sum(near)} of {len(near)} seeds ({ends.low:.2f} to {ends.high:.2f})")
    print(f"distance at the end: median {np.median(away):.2f} m, largest {max(away):.2f} m, n = {len(away)}")
    print(f"near since: {np.percentile(since, [0, 25, 50, 75, 100], method='lower')}")
    print(f"\n| made at, for | n | {' | '.join(COLUMNS)} | skill |")
    keys = sorted({key for rows in by for key in rows})
    for now, ahead in keys:
        found = np.array([rows[now, ahead] for rows in by if (now, ahead) in rows])
        print(f"| {now} s, {ahead:g} s ahead | {len(found)} | {row_of(found)} |")
    for ahead in sorted({ahead for _, ahead in keys}):
        means = [[row for (_, one), row in rows.items() if one == ahead] for rows in by]
        found = np.array([np.mean(rows, axis=0) for rows in means if rows])
        print(f"| all, {ahead:g} s ahead | {len(found)} | {row_of(found)} |")


def main(path: str = "scenarios/computing/buoys.toml", seeds: str = "20", *overrides: str) -> None:
    """Run the seeds one after another."""
    summaries, by = [], []
    for seed in range(FIRST, FIRST + int(seeds)):
        run = prepared(path, seed, list(overrides), ())
        keys = run.scenario.task.parameters
        (summary,) = run.simulation.parts.task.summaries()
        rows = ByTime(run.context.scalar_field, keys.ahead, keys.within)
        run.simulation.run([summary, rows])
        summaries.append(summary.summary())
        by.append(rows.rows)
        print(json.dumps({"seed": seed, **summaries[-1]}), flush=True)
    told(summaries, by)


if __name__ == "__main__":
    main(*sys.argv[1:])
