"""Simulates the runs that a search for the smallest swarm asks for; each is stored as it ends, and done once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from swarmsim.core.durations import iterations_in, told
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.files import Table
from swarmsim.studies.labels import label
from swarmsim.studies.plan import Condition, Plan, Study, changed, checked
from swarmsim.studies.runner import Runner
from swarmsim.studies.sizing import Times
from swarmsim.studies.store import Row


@dataclass
class Trials:
    """The runs of one scenario with the values of one key: called as a search asks, it gives their times.

    A run ends with the task, whatever the scenario's limit; unfinished, it ends at the last whole iteration `within`.
    """

    path: Path  # of the scenario
    table: Table  # its contents
    changes: Mapping[str, object]  # for all runs, by dotted key
    key: str
    values: Sequence[object]
    within: float  # s
    runner: Runner
    worlds: dict[bytes, str] = field(default_factory=dict)
    notices: dict[str, None] = field(default_factory=dict)
    _plans: dict[int, tuple[Plan, Condition]] = field(default_factory=dict)
    _times: dict[int, list[float]] = field(default_factory=dict)

    def __call__(self, place: int, runs: int) -> Times:
        """The times (runs,) of seeds 1 to `runs`. Raises InputError for a bad value, and for a run that fails."""
        times = self._times.setdefault(place, [])
        if len(times) < runs:
            times += self._new(place, range(len(times) + 1, runs + 1))
        return np.array(times[:runs], np.float64)

    def condition(self, place: int) -> Condition:
        """The scenario with a value, checked. Raises InputError."""
        return self._planned(place)[1]

    def accepts(self, place: int) -> bool:
        """Whether the scenario accepts a value: five robots cannot have six neighbours."""
        try:
            self.condition(place)
        except InputError:
            return False
        return True

    def _planned(self, place: int) -> tuple[Plan, Condition]:
        if place not in self._plans:
            values = {self.key: self.values[place]}
            where = f"{self.path}: {label(values)}"
            period = changed(where, self.table, {**self.changes, **values}, self.path.parent).period
            limit = iterations_in(self.within, period)
            if limit < 1:
                raise InputError(
                    f"--within {told(self.within)}: less than one iteration of {period:g} s; expected a longer time"
                )
            values["stop"] = {"iterations": limit}
            scenario = changed(where, self.table, {**self.changes, **values}, self.path.parent)
            condition = checked(
                where, label({self.key: self.values[place]}), values, scenario, self.worlds, self.notices
            )
            study = Study(title="", scenario=self.path.name, keep="summary", set=dict(self.changes))
            self._plans[place] = Plan(self.path, study, (condition,), (), self.worlds), condition
        return self._plans[place]

    def _new(self, place: int, seeds: range) -> list[float]:
        plan, condition = self._planned(place)
        rows = self.runner.rows(plan, condition, seeds)
        if failed := [row for row in rows if row.status == "failed"]:
            row = failed[0]
            raise InputError(f"{self.path}: {row.condition}, seed {row.seed}: the run failed: {row.message}")
        return [self._time(row, condition.scenario.period) for row in rows]

    def _time(self, row: Row, period: float) -> float:
        return math.inf if row.status != "finished" or row.iterations is None else row.iterations * period
