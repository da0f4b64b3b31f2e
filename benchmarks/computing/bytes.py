"""python benchmarks/computing/bytes.py SEEDS [NETWORK ...]: what the bytes of a job in pieces are said for.

The job is the collective way of `ways.py` alone, on the same robots and ways. A line for each network: iterations;
bytes of all robots for a level; how many times the least that is, which is each value that a piece shows, once; and the
shares by cause, over all seeds. A value is said first by the robot that made it, passed on by others, and said again by
either.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np
from ways import LEVELS, SCENARIO, SOLVE, SWEEPS, Watch

from swarmsim.core.messages import HEADER, Broadcast
from swarmsim.core.scenario.file import load
from swarmsim.core.state import Senses
from swarmsim.engine.build import build
from swarmsim.jobs.facts.wire import Fact, Facts
from swarmsim.jobs.onlooker import ObservedJob
from swarmsim.jobs.reports import REPORT, STATE

NETWORKS = {
    f"{name}, loss {loss:g}": (f"network.topology={{{topology}}}", f"network.channel.loss={loss}")
    for name, topology in {
        "gabriel": 'use = "gabriel"', "delaunay": 'use = "delaunay"', "knn 2": 'use = "knn", k = 2',
        "knn 4": 'use = "knn", k = 4',
    }.items() for loss in (0.0, 0.1, 0.3)
}  # fmt: skip
NAMES = {REPORT: "reports", STATE: "states"}


class Causes:
    """Bytes by cause, from what each robot says."""

    def __init__(self, job: ObservedJob) -> None:
        self.bytes: Counter[str] = Counter()
        self._job, self._say, self._once = job.inner, job.say, set[tuple[int, int, int, int]]()
        job.say = self.say  # type: ignore[method-assign]

    def say(self, senses: Senses) -> Broadcast[Facts]:
        """Count what is said."""
        said = self._say(senses)
        for row, (start, end) in enumerate(zip(said.starts(), said.ends, strict=True)):
            facts = said.content.rows()[start:end]
            self.bytes["headers of messages"] += HEADER.size * bool(facts)
            for fact in facts:
                size = self._job.codec.size(fact)
                if fact.kind in NAMES:
                    self.bytes[NAMES[fact.kind]] += size
                else:
                    self._value(row, fact, size)
        return said

    def _value(self, row: int, fact: Fact, size: int) -> None:
        """The bytes of what a piece shows to some readers, or of an answer."""
        plan = self._job._plan
        readers = plan.named(fact.key, fact.robot)
        if len(fact.value) == len(readers):
            self.bytes["answers"] += size
            return
        width = plan.keys.value * plan.rows(fact.key, fact.robot)[0]
        said = {(row, fact.key, fact.version, reader) for reader in readers}
        made, new = fact.key in self._job._parts[row].worker.own, bool(said - self._once)
        self._once |= said
        self.bytes["values' headers"] += size - width
        self.bytes[f"{'said' if made else 'passed on'} {'first' if new else 'again'}"] += width


def one_run(network: str, seed: int) -> tuple[int, float, dict[str, float]]:
    """Iterations (NaN unless it ended), the least bytes, and bytes by cause."""
    keys = (f"jobs=[{{{SOLVE}}}]", 'task.use="computed"', *NETWORKS[network], f"seed={seed}", "stop.iterations=600")
    run = build(load(SCENARIO, keys), str(SCENARIO))
    (job,) = run.simulation.parts.computation._jobs.values()
    causes, watch = Causes(job), Watch()
    ended = run.simulation.run([watch])
    plan = job.inner.plan
    least = plan.keys.value * sum(len(piece.rim) for piece in plan.pieces) * SWEEPS * LEVELS
    assert sum(causes.bytes.values()) == watch.sent
    return watch.iterations if ended else np.nan, least, dict(causes.bytes)


def main(seeds: int, networks: Sequence[str]) -> None:
    """A line for each network."""
    for network in networks:
        runs = [one_run(network, seed) for seed in range(1, seeds + 1)]
        sums = sum((Counter(by) for *_, by in runs), Counter())
        whole = sum(sums.values())
        shares = ", ".join(f"{name} {100 * size / whole:.1f} %" for name, size in sums.most_common())
        its = [one[0] for one in runs]
        print(
            f"{network}: iterations {its}, median {np.median(its):g}; {whole / seeds / LEVELS / 1e3:.0f} kB a level, "
            f"{whole / sum(least for _, least, _ in runs):.2f} times the least; {shares}", flush=True
        )  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:] or list(NETWORKS))
