"""Search for faults that break a swarm."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from swarmsim.api.overrides import Overrides
from swarmsim.api.runs import prepared
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.studies import worst as search
from swarmsim.studies.engine import Job, pool_when_needed
from swarmsim.studies.store import Row


def study_worst(
    scenario: str | Path,
    out: str | Path | None = None,
    *,
    overrides: Overrides | None = None,
    budget: int = 300,
    entries: int = 3,
    factor: float = 2.0,
    seeds: int = 3,
    seed: int = 1,
    workers: int | None = None,
    scheduler: str | None = None,
    allow_code: bool = False,
    progress: Callable[[int], None] = lambda timelines: None,
    tell: Callable[[str], None] = lambda words: None,
) -> search.Findings:
    """Look for the smallest timeline of faults that makes the swarm fail: `swarmsim study worst`.

    It fails if, with each of `seeds` seeds, it is not done in `factor` times the iterations of the run without faults.
    At least `budget` timelines of at most `entries` faults are tried, drawn by `seed`. The result is written as the
    new scenario `out`. `workers` and `scheduler` are those of `StudyRun.run`; `progress` is called with the timelines
    tried, `tell` with interim findings. Raises InputError for a scenario that does not finish without faults, and for
    a file that exists already.
    """
    if out is not None and Path(out).exists():
        raise InputError(f"{out}: exists already; expected the name of a new file")
    with registry.own_code(allow_code), pool_when_needed(workers, scheduler) as run_all:
        made = prepared(scenario, None, overrides, ())

        def performed(jobs: Sequence[Job]) -> Iterator[Row]:
            for row in run_all(jobs):
                progress(look.timelines)
                yield row
            progress(look.timelines)

        look = search.Search(made.scenario, made.world, performed, seeds, factor, tell)
        answer = look.run(budget, entries, seed)
        if out is not None and answer.smallest is not None:
            search.write(made.scenario, answer.smallest.timeline, answer.limit[0], Path(out))
    return answer
