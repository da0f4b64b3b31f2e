"""The results of a study's runs, by condition."""

from __future__ import annotations

import csv
import hashlib
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core.durations import told
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry, shipped
from swarmsim.core.scenario.identity import differences
from swarmsim.recording.digests import versions
from swarmsim.studies.engine import Job
from swarmsim.studies.plan import Condition, Plan
from swarmsim.studies.requests import libraries
from swarmsim.studies.statistics import Description, describe
from swarmsim.studies.store import Row, Store
from swarmsim.studies.survival import Endings

MOST = 3  # differences in code that a sentence lists


@dataclass(frozen=True, slots=True)
class Result:
    """The completed runs of one condition, in the order of their seeds."""

    condition: Condition
    rows: tuple[Row, ...]  # finished or not, without failed ones
    failed: tuple[Row, ...]
    missing: int
    older: tuple[Row, ...] = ()  # runs of other code where the present code has none; in `rows` if they count

    @property
    def times(self) -> NDArray[np.float64]:
        """Iterations of each run; an unfinished one has its iterations at the stop."""
        return self.endings.times

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Whether each run finished."""
        return self.endings.finished

    @property
    def endings(self) -> Endings:
        """How its runs ended, in iterations."""
        return endings(self.rows, self.condition.scenario.limit)

    @property
    def seconds(self) -> Endings:
        """How its runs ended, in simulated seconds."""
        return self.endings.scaled(self.condition.scenario.period)

    @property
    def curves(self) -> list[NDArray[np.float64]]:
        """The task's measure of each run, by iteration."""
        return [row.curve.astype(np.float64) for row in self.rows if row.curve is not None]

    def measure(self, name: str) -> NDArray[np.float64]:
        """One measure of each run; NaN where undefined. Raises InputError for an unknown name."""
        if any(name not in row.summary for row in self.rows):
            raise InputError(f"{name!r} is not a measure; known: {', '.join(self.rows[0].summary)}")
        values = (row.summary[name] for row in self.rows)
        return np.array([np.nan if value is None else value for value in values], np.float64)

    def describe(self) -> Description:
        """The statistics of its iterations; None values without runs."""
        return describe(self.times, self.finished, float(self.condition.scenario.limit))

    def describe_measure(self, name: str) -> Description:
        """The statistics of a measure over the runs that define it. Raises InputError if none does."""
        values = self.measure(name)
        defined = values[np.isfinite(values)]
        if len(defined) == 0:
            raise InputError(f"{name!r} is defined in no run of {self.condition.name!r}")
        return describe(defined)


def endings(rows: Sequence[Row], limit: float) -> Endings:
    """How runs ended, in iterations; `limit` is that of their scenario."""
    times = np.array([row.iterations for row in rows], np.float64)
    return Endings(times, np.array([row.status == "finished" for row in rows], np.bool_), float(limit))


def filled(head: Sequence[str], rows: Sequence[Sequence[str]]) -> tuple[list[str], list[list[str]]]:
    """The table without its empty columns."""
    kept = [place for place in range(len(head)) if any(row[place] != "-" for row in rows)]
    return [head[place] for place in kept], [[row[place] for place in kept] for row in rows]


def gather(plan: Plan, store: Store) -> dict[str, Result]:
    """All results of a study in the store, by condition, in the plan's order."""
    found, older = _rows(plan, store)
    results = {}
    for condition in plan.conditions:
        rows = [found.get(plan.identity(condition, seed)) for seed in plan.seeds]
        asked = [plan.asks(condition, seed) for seed in plan.seeds] if older else []
        old = [older.get(one) if row is None else None for row, one in zip(rows, asked, strict=False)]
        if plan.keep_old and older:
            rows = [row or other for row, other in zip(rows, old, strict=True)]
        there = [row for row in rows if row is not None]
        results[condition.name] = Result(
            condition,
            tuple(row for row in there if row.status != "failed"),
            tuple(row for row in there if row.status == "failed"),
            len(rows) - len(there),
            tuple(row for row in old if row is not None),
        )
    return results


def _rows(plan: Plan, store: Store) -> tuple[dict[str, Row], dict[str, Row]]:
    """The present code's rows, by identity, and where there are none other code's, by request."""
    identities = [(condition, seed, plan.identity(condition, seed)) for condition, seed in plan.runs]
    found = store.rows(identity for _, _, identity in identities)
    rest = {plan.asks(condition, seed): one for condition, seed, one in identities if one not in found}
    return found, store.of_other_code(rest) if rest else {}


def of_other_code(plan: Plan, results: Mapping[str, Result]) -> list[str]:
    """A sentence about runs made by other code, if any."""
    old = [(result.condition, row) for result in results.values() for row in result.older]
    if not old:
        return []
    told = dict.fromkeys(
        differences(row.code | libraries(row.versions), {**condition.code.hashes, **libraries(versions())})
        for condition, row in old
    )
    ways = "; or ".join(list(told)[:MOST]) + (f"; and {len(told) - MOST} more ways" if len(told) > MOST else "")
    one = len(old) == 1
    count = "1 run of other code" if one else f"{len(old)} runs of other code"
    if plan.keep_old:
        names = ", ".join(name for name, result in results.items() if result.older)
        return [f"{count} count{'s' * one} (--keep-old), in {names}: {ways}"]
    return [
        f"{count} {'does' if one else 'do'} not count: {ways}; 'study run' does {'it' if one else 'them'} again and "
        f"keeps both, --keep-old lets {'it' if one else 'them'} count"
    ]


def missing(plan: Plan, store: Store, retry: bool = False) -> list[Job]:
    """The runs that the store lacks; with `retry` also those that failed. Equal runs come once."""
    found, older = _rows(plan, store)
    tasks: dict[str, Job] = {}
    for condition, seed in plan.runs:
        identity = plan.identity(condition, seed)
        if identity in found and not (retry and found[identity].status == "failed"):
            continue
        asks = plan.asks(condition, seed)
        if plan.keep_old and identity not in found and asks in older:
            continue
        tasks[identity] = job_of(plan, condition, seed, store)
    return list(tasks.values())


def job_of(plan: Plan, condition: Condition, seed: int, store: Store) -> Job:
    """One run of a study; recordings go beside the store."""
    identity, keep = plan.identity(condition, seed), plan.study.keep
    return Job(
        identity=identity,
        condition=condition.name,
        seed=seed,
        scenario=msgspec.structs.replace(condition.scenario, seed=seed),
        world=plan.world_of(condition),
        curves=keep != "summary",
        recording=store.path.with_suffix("") / f"{identity}.h5" if keep == "recordings" else None,
        command=command(plan, condition, seed),
        allow_code=registry.own_code_is_allowed(),
        asks=plan.asks(condition, seed),
        code=condition.code,
        watched=condition.watched,
    )


def command(plan: Plan, condition: Condition, seed: int) -> str:
    """The command that repeats one run of a study."""
    changes = {**plan.study.set, **condition.changes}
    sets = " ".join(f"--set {shlex.quote(f'{key}={_toml(value)}')}" for key, value in changes.items())
    allow = " --allow-code" if registry.own_code_is_allowed() else ""
    scenario = shlex.quote(str(shipped.found(plan.study.scenario, folder=plan.path.parent)))
    return f"swarmsim run {scenario} --seed {seed}{allow} {sets}".strip()


def _toml(value: object) -> str:
    """A value as TOML on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}={_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(inner) for inner in value) + "]"
    return json.dumps(value)


def digest(results: Sequence[Result]) -> str:
    """One digest over all runs, independent of their order or cluster."""
    hashed = hashlib.blake2b(digest_size=16)
    lines = sorted(f"{row.identity} {row.digest}" for result in results for row in result.rows)
    hashed.update("\n".join(lines).encode())
    return hashed.hexdigest()


HEAD = (
    "condition", "n", "finished", "mean", "95 % interval", "mean in time", "sd", "median", "quartiles",
    "restricted mean", "restricted in time",
)  # fmt: skip


def lines(results: dict[str, Result]) -> list[tuple[str, ...]]:
    """The table of iterations, one line per condition, under HEAD."""
    return [(name, *_described(result)) for name, result in results.items()]


def _described(result: Result) -> tuple[str, ...]:
    if not result.rows:
        return ("0", *["-"] * (len(HEAD) - 2))
    d, period = result.describe(), result.condition.scenario.period
    restricted = d.restricted
    error = "" if restricted.error is None else f" ± {restricted.error:.1f}"
    return (
        str(d.n),
        str(d.finished),
        number(d.mean),
        "-" if d.interval is None else f"{d.interval[0]:.1f} to {d.interval[1]:.1f}",
        "-" if d.mean is None else told(d.mean * period),
        number(d.sd),
        number(d.median),
        "-" if d.lower is None or d.upper is None else f"{d.lower:.0f} to {d.upper:.0f}",
        "-" if d.finished == d.n else f"{restricted.mean:.1f}{error} to {restricted.horizon:.0f}",
        "-" if d.finished == d.n else told(restricted.mean * period),
    )


def number(value: float | None) -> str:
    """One decimal, or a dash for None."""
    return "-" if value is None else f"{value:.1f}"


def records(plan: Plan, results: dict[str, Result]) -> list[dict[str, object]]:
    """Every run as a flat record: condition, its changes, seed, outcome and all measures."""
    names = list(dict.fromkeys(key for condition in plan.conditions for key in condition.changes))
    return [
        {
            "condition": name,
            **{key: _plain(result.condition.changes.get(key)) for key in names},
            "seed": row.seed,
            "status": row.status,
            "iterations": row.iterations,
            **{f"measure_{key}": value for key, value in row.summary.items()},
            "digest": row.digest,
            "code": _hash_of(row),
            "seconds": row.seconds,
            "message": row.message,
        }
        for name, result in results.items()
        for row in (*result.rows, *result.failed)
    ]


def _hash_of(row: Row) -> str:
    """One hash of all code that made a run."""
    return hashlib.blake2b(msgspec.json.encode(row.code, order="sorted"), digest_size=8).hexdigest()


def _plain(value: object) -> object:
    return _toml(value) if isinstance(value, dict | list) else value


def write_csv(path: Path, rows: Sequence[dict[str, object]]) -> None:
    """Write records as CSV; texts that a spreadsheet would take for formulas get a leading apostrophe."""
    names = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows({name: _harmless(value) for name, value in row.items()} for row in rows)


def _harmless(value: object) -> object:
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


def write_parquet(path: Path, rows: Sequence[dict[str, object]]) -> None:
    """Write records as Parquet. Raises InputError if pyarrow is not installed."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as problem:
        raise InputError("--parquet: needs pyarrow; install it with: pip install 'swarmsim-lab[export]'") from problem
    names = list(dict.fromkeys(key for row in rows for key in row))
    columns = {name: _one_type([row.get(name) for row in rows]) for name in names}
    pq.write_table(pa.table(columns), path)


def _one_type(values: list[object]) -> list[object]:
    """A column of a single type: text for mixed values."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} or len(kinds) <= 1:
        mixed = kinds == {int, float}
        return [float(value) if mixed and isinstance(value, int | float) else value for value in values]
    return [None if value is None else str(value) for value in values]


MEASURED = ("condition", "n", "defined", "mean", "95 % interval", "sd", "median")


def measured(results: dict[str, Result], name: str) -> list[tuple[str, ...]]:
    """The table of one measure, one line per condition, under MEASURED."""
    table: list[tuple[str, ...]] = []
    for label, result in results.items():
        values = result.measure(name)
        defined = values[np.isfinite(values)]
        if len(defined) == 0:
            table.append((label, str(len(values)), "0", *["-"] * 4))
            continue
        d = describe(defined)
        between = "-" if d.interval is None else f"{d.interval[0]:.4g} to {d.interval[1]:.4g}"
        sd = "-" if d.sd is None else f"{d.sd:.4g}"
        table.append((label, str(len(values)), str(len(defined)), f"{d.mean:.4g}", between, sd, f"{d.median:.4g}"))
    return table
