"""How near robots come to a source, and how good predictions are by the time at which they are made, over seeds.

Usage: python benchmarks/computing/source.py [SCENARIO] [SEEDS]; a line of JSON for each seed: the summary, and for each
40 iterations the mean errors of robots that are sure of the place, as [iteration, [ahead, prediction, persistence,
persistence of the truth], ...].
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

import numpy as np

from swarmsim.api.runs import prepared
from swarmsim.core.context import Field
from swarmsim.core.state import Moment
from swarmsim.operations.sources.errors import errors_of
from swarmsim.operations.sources.found import located_by


class ByTime:
    """An observer that keeps errors by the iteration of the inversion."""

    def __init__(self, field: Field, ahead: Sequence[float], within: float) -> None:
        self._field, self._ahead, self._within = field, ahead, within
        self.rows: list[list] = []

    def sample(self, moment: Moment) -> None:
        """Note one iteration."""
        now, located = moment.state.iteration, located_by(moment)
        sure = np.flatnonzero(moment.state.alive & (located.made == now) & (located.spread <= self._within))
        if len(sure) == 0:
            return
        found = list(errors_of(located, sure.tolist(), self._field, float(now), self._ahead))
        shares = {
            ahead: [(e.prediction / e.variance, e.persistence / e.variance, e.truth_persistence / e.variance)
                    for e in found if e.ahead == ahead]
            for ahead in self._ahead
        }  # fmt: skip
        self.rows.append([now, *([ahead, *np.mean(one, axis=0).round(4).tolist()] for ahead, one in shares.items())])


def main(path: str = "scenarios/computing/buoys.toml", seeds: str = "20") -> None:
    """Run the seeds one after another."""
    for seed in range(1, int(seeds) + 1):
        run = prepared(path, seed, None, ())
        keys = run.scenario.task.parameters
        (summary,) = run.simulation.parts.task.summaries()
        by = ByTime(run.context.scalar_field, keys.ahead, keys.within)
        run.simulation.run([summary, by])
        print(json.dumps({"seed": seed, **summary.summary(), "by": by.rows}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
