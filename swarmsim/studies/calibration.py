"""The calibration of a reproduction: the candidate nearest to the published numbers that are its targets."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import msgspec

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.part import plain
from swarmsim.studies.claims import Runs
from swarmsim.studies.paper import Paper, Published, Reading
from swarmsim.studies.plan import Condition, Plan, open_study
from swarmsim.studies.results import gather
from swarmsim.studies.store import Store


@dataclass(frozen=True, slots=True)
class Candidate:
    """One choice of the settings that the paper leaves open, with its results."""

    choice: dict[str, object]  # dotted key: value
    means: dict[str, float | None]  # by published row; None if a run did not finish
    published: Mapping[str, float]

    def log_ratio(self, row: str) -> float:
        """The logarithm of its mean over the published number; infinite where a mean is missing."""
        mean = self.means[row]
        return math.log(mean / self.published[row]) if mean else math.inf

    def error(self, without: str | None = None) -> float:
        """Root mean square of its log-ratios, over all rows or all but one."""
        logs = [self.log_ratio(row) for row in self.means if row != without]
        return math.sqrt(sum(log * log for log in logs) / len(logs))


class Targets(NamedTuple):
    """The published number that is the target of each condition of a calibration."""

    row_of: Mapping[str, str]  # by condition
    published: Mapping[str, float]
    measure: str  # of the published numbers
    keys: tuple[str, ...]  # of a scenario; their values identify its number


def opened(paper: Paper, reading: Reading) -> Plan:
    """The study that calibrated a reading's open choices. Raises InputError if there is none."""
    if reading.calibration is None:
        raise InputError(f"{paper.folder}: the reading {reading.name!r} has no calibration")
    return open_study(paper.folder / reading.calibration)


def held(paper: Paper, reading: Reading, plan: Plan) -> Targets:
    """Matches a calibration's conditions to a reading's published numbers by the paper's `rows`.

    Raises InputError for a condition that matches none.
    """
    keys = paper.readings.rows
    studies = {name: {one.name: one for one in of.conditions} for name, of in paper.plans(reading, 1).items()}
    known: dict[bytes, Published] = {}
    for number in paper.published:
        name = reading.conditions.get(number.condition, number.condition)
        known.setdefault(_values(studies[number.study][name], keys), number)
    row_of = {}
    for condition in plan.conditions:
        number_of = known.get(_values(condition, keys))
        if number_of is None:
            what = f"no published number has its values of {', '.join(keys) or 'rows'}"
            raise InputError(f"{plan.path}: {condition.name}: {what}; expected those of one in {paper.folder}")
        row_of[condition.name] = number_of.row
    return Targets(row_of, {number.row: number.value for number in known.values()}, paper.about.published, keys)


def _values(condition: Condition, keys: Sequence[str]) -> bytes:
    """A scenario's values at dotted keys, for comparison."""
    found = []
    for key in keys:
        value = msgspec.to_builtins(condition.scenario, enc_hook=plain)
        for name in key.split("."):
            value = value.get(name) if isinstance(value, dict) else None
        found.append(value)
    return msgspec.json.encode(found, order="sorted")


def candidates(plan: Plan, store: Store, numbers: Targets) -> list[Candidate]:
    """All candidates of a calibration study, the best first."""
    means: dict[str, dict[str, float | None]] = {}
    rows = tuple(f"{key}." for key in numbers.keys)
    runs = Runs(gather(plan, store), {})
    for name, result in runs.results.items():
        changes = result.condition.changes.items()
        choice = {key: value for key, value in changes if not f"{key}.".startswith(rows)}
        mean = runs.describe(name, numbers.measure).mean if not result.missing else None
        means.setdefault(json.dumps(choice), {})[numbers.row_of[name]] = mean
    found = [Candidate(json.loads(choice), of, numbers.published) for choice, of in means.items()]
    return sorted(found, key=Candidate.error)


class LeftOut(NamedTuple):
    """A published number, and its prediction by the candidate that fits all others best."""

    row: str
    published: float
    predicted: float | None
    choice: dict[str, object]


def left_out(found: list[Candidate]) -> list[LeftOut]:
    """Leaves out each number in turn, predicted by the best candidate without it."""
    lines = []
    for row in found[0].means:
        best = min(found, key=lambda candidate: candidate.error(row))
        lines.append(LeftOut(row, best.published[row], best.means[row], best.choice))
    return lines


def prediction_error(lines: list[LeftOut]) -> float:
    """Root mean square log-ratio of predicted to published numbers."""
    logs = [math.log(line.predicted / line.published) if line.predicted else math.inf for line in lines]
    return math.sqrt(sum(log * log for log in logs) / len(logs))


LEFT_OUT: Final = ("number left out", "published", "predicted", "ratio", "by")


def left_out_lines(found: list[LeftOut]) -> list[tuple[str, ...]]:
    """One line per number, under LEFT_OUT."""
    return [
        (
            line.row,
            f"{line.published:.0f}",
            "not finished" if line.predicted is None else f"{line.predicted:.0f}",
            "-" if line.predicted is None else f"{line.predicted / line.published:.2f}",
            ", ".join(str(value) for value in line.choice.values()),
        )
        for line in found
    ]


def lines(found: list[Candidate]) -> list[tuple[str, ...]]:
    """One line per candidate: its choice, its means, its error."""
    return [
        (
            ", ".join(str(value) for value in candidate.choice.values()),
            *("not finished" if mean is None else f"{mean:.0f}" for mean in candidate.means.values()),
            f"{candidate.error():.3f}",
        )
        for candidate in found
    ]


def head(found: list[Candidate]) -> tuple[str, ...]:
    """The columns of `lines`: the varied keys, then each published number."""
    first = found[0]
    keys = ", ".join(key.rpartition(".")[2] for key in first.choice)
    return (keys, *(f"{row} ({first.published[row]:.0f})" for row in first.means), "rms log-ratio")
