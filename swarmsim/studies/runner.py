"""Runs by condition and seed, each done once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from swarmsim.studies.engine import Job
from swarmsim.studies.plan import Condition, Plan
from swarmsim.studies.results import job_of
from swarmsim.studies.store import Row, Store


class Runner:
    """Gives runs by condition and seed, from the store or done now; what is done is stored at once."""

    def __init__(
        self,
        store: Store,
        perform: Callable[[Sequence[Job]], Iterable[Row]],
        progress: Callable[[int], None] = lambda done: None,
    ) -> None:
        """`progress` is called with the number of runs done."""
        self._store, self._perform, self._progress = store, perform, progress
        self._rows = {key: row for key, row in store.every().items() if row.status != "failed"}
        #: By plan and condition: the plan, kept so that no other gets its `id`, and identities by seed.
        self._identities: dict[tuple[int, str], tuple[Plan, dict[int, str]]] = {}
        #: Runs done now.
        self.done = 0

    def rows(self, plan: Plan, condition: Condition, seeds: Sequence[int]) -> list[Row]:
        """The runs of these seeds, in their order."""
        identities = [self._identity(plan, condition, seed) for seed in seeds]
        lacking = [seed for seed, key in zip(seeds, identities, strict=True) if key not in self._rows]
        for row in self._perform([job_of(plan, condition, seed, self._store) for seed in lacking]) if lacking else ():
            self._store.add(row)
            self._rows[row.identity] = row
            self.done += 1
            self._progress(self.done)
        return [self._rows[key] for key in identities]

    def lacks(self, plan: Plan, condition: Condition, seeds: Sequence[int]) -> int:
        """How many of these runs are not stored."""
        return sum(self._identity(plan, condition, seed) not in self._rows for seed in seeds)

    def _identity(self, plan: Plan, condition: Condition, seed: int) -> str:
        _, known = self._identities.setdefault((id(plan), condition.name), (plan, {}))
        if seed not in known:
            known[seed] = plan.identity(condition, seed)
        return known[seed]
