"""A study file: one scenario, its variations, and the number of seeds."""

from __future__ import annotations

import copy
import hashlib
import itertools
import math
import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Curve
from swarmsim.core.scenario import budget, shipped
from swarmsim.core.scenario.decoding import read_struct
from swarmsim.core.scenario.expect import Expect
from swarmsim.core.scenario.file import Scenario, assign, decode, files_outside
from swarmsim.core.scenario.files import Table
from swarmsim.core.scenario.identity import Code, known
from swarmsim.core.scenario.part import plain
from swarmsim.core.scenario.toml import read_toml
from swarmsim.engine.build import build
from swarmsim.recording import measures
from swarmsim.recording.digests import versions
from swarmsim.studies.labels import label
from swarmsim.studies.requests import asked, libraries
from swarmsim.studies.watching import Watch
from swarmsim.world.source import read_world

MOST_RUNS = 1_000_000
TRIED = 100  # iterations of each condition that are timed
USUAL = 700  # typical iterations of a run, unless its limit is lower


class Axis(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One key of the scenario and the values it takes."""

    key: str  # dotted, of the scenario
    values: Annotated[list[Any], Meta(min_length=1)]  # one condition for each
    names: list[str] | None = None  # of the values, in conditions, tables and figures
    together: str | None = None  # axes with the same name step together; all others are crossed


class Named(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A single condition outside the grid."""

    name: str  # of the condition, in tables and plots
    set: dict[str, object]  # dotted key: value
    x: float | None = None  # its place on the study's axis; without one, it is a line across the plot
    series: str = ""  # its line in the plot


class Study(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file's contents."""

    title: str  # of the study, in tables and plots
    scenario: str  # relative to the study's folder, or the name of one that ships
    seeds: Annotated[int, Meta(ge=1)] | Annotated[list[Annotated[int, Meta(ge=0)]], Meta(min_length=1)] = (
        30  # 1 to N, or a list
    )
    keep: Literal["summary", "curves", "recordings"] = "curves"  # of a run
    set: dict[str, object] = {}  # dotted key: value, for every condition
    axis: str | None = None  # the meaning of the conditions' `x`, with its unit: plots show iterations against it
    vary: tuple[Axis, ...] = ()  # keys and the values that they take
    condition: tuple[Named, ...] = ()  # single conditions outside the grid
    expect: tuple[Expect, ...] = ()  # of every condition's runs; `swarmsim test`

    @property
    def words(self) -> dict[str, list[tuple[object, str]]]:
        """The names of an axis' values, by its key."""
        return {axis.key: list(zip(axis.values, axis.names, strict=True)) for axis in self.vary if axis.names}


@dataclass(frozen=True, slots=True)
class Condition:
    """One cell of the study: a scenario without its seed."""

    name: str
    changes: dict[str, object]  # dotted key: value, against the study's scenario
    scenario: Scenario
    curve: Curve  # of its task, for figures
    code: Code  # that makes its runs
    x: float | None = None  # its place on the study's axis
    series: str = ""
    watched: tuple[Watch, ...] = ()  # what else its rows say of the iterations


@dataclass(frozen=True, slots=True)
class Plan:
    """A study with all its conditions expanded and checked."""

    path: Path
    study: Study
    conditions: tuple[Condition, ...]
    seeds: tuple[int, ...]
    worlds: dict[bytes, str]  # floor plans' texts, by `_world_key`
    notices: tuple[str, ...] = ()  # how floor plans were read, and files outside the scenario's folder
    keep_old: bool = False  # whether runs of other code count where the present code has none

    @property
    def runs(self) -> list[tuple[Condition, int]]:
        """Every condition with every seed, seeds outermost, so that an interrupted study is balanced."""
        return [(condition, seed) for seed in self.seeds for condition in self.conditions]

    def world_of(self, condition: Condition) -> str:
        """The text of a condition's floor plan."""
        return self.worlds[_world_key(condition.scenario)]

    def asks(self, condition: Condition, seed: int) -> str:
        """A hash of the request: the scenario with its floor plan, and how it is measured."""
        hashed = hashlib.blake2b(digest_size=16)
        hashed.update(asked(msgspec.structs.replace(condition.scenario, seed=seed)))
        hashed.update(self.world_of(condition).encode())
        hashed.update(str(measures.EDITION).encode())
        for watch in condition.watched:
            hashed.update(watch.key.encode())
        return hashed.hexdigest()

    def identity(self, condition: Condition, seed: int) -> str:
        """A hash of all that its row depends on: the request, library versions, and code by content."""
        hashed = hashlib.blake2b(self.asks(condition, seed).encode(), digest_size=16)
        hashed.update(msgspec.json.encode([libraries(versions()), dict(condition.code.hashes)], order="sorted"))
        return hashed.hexdigest()


def one_period(conditions: Iterable[Condition]) -> float | None:
    """The period of all conditions in s; None if they have several, so that only their seconds can be compared."""
    periods = {condition.scenario.period for condition in conditions}
    return periods.pop() if len(periods) == 1 else None


def _world_key(scenario: Scenario) -> bytes:
    """Everything that a floor plan's text depends on."""
    return msgspec.json.encode([scenario.world, scenario.grid.cell], enc_hook=plain, order="deterministic")


def read_study(path: Path) -> Study:
    """A study file's contents, without reading its scenario. Raises InputError."""
    return read_struct(path, "a study file", Study)


def open_study(
    path: Path, seeds: int | None = None, changes: dict[str, object] | None = None, keep_old: bool = False
) -> Plan:
    """Read a study and check every condition by building its swarm; `seeds` replaces the number of seeds.

    `changes`, by dotted key, override the study's settings; its conditions override both. `keep_old` as in Plan.

    Raises InputError that names the file, the condition and the key.
    """
    path = shipped.found(path, "studies")
    study = read_study(path)
    return plan_study(path, msgspec.structs.replace(study, set={**study.set, **(changes or {})}), seeds, keep_old)


def plan_study(path: Path, study: Study, seeds: int | None = None, keep_old: bool = False) -> Plan:
    """Check every condition of a study by building its swarm, as `open_study` does; messages name `path`."""
    chosen = study.seeds if seeds is None else seeds
    numbers = tuple(range(1, chosen + 1)) if isinstance(chosen, int) else tuple(chosen)
    if len(set(numbers)) < len(numbers):
        raise InputError(f"{path}: seeds: a seed is listed twice; expected each once")
    cells = changes_of(path, study)
    if len(cells) * len(numbers) > MOST_RUNS:
        raise InputError(f"{path}: {len(cells)} conditions x {len(numbers)} seeds are more than {MOST_RUNS} runs")
    return planned(path, study, cells, numbers, keep_old)


def planned(
    path: Path, study: Study, cells: Mapping[str, dict[str, object]], seeds: tuple[int, ...], keep_old: bool = False
) -> Plan:
    """The plan of a study with these conditions, each one's changes by its name; every swarm is built as a check.

    Raises InputError as `open_study`.
    """
    base = shipped.found(study.scenario, folder=path.parent)
    table = read_toml(base, "the study's scenario file")
    named = {condition.name: condition for condition in study.condition}
    worlds: dict[bytes, str] = {}
    notices = dict.fromkeys(files_outside(base))

    def place_of(name: str) -> str:
        return f"{path}: condition {name!r}" if name else str(path)

    def condition(name: str) -> Condition:
        made = checked(place_of(name), name, cells[name], scenarios[name], worlds, notices)
        x, series = (named[name].x, named[name].series) if name in named else _place(study, cells[name])
        return replace(made, x=x, series=series)

    scenarios = {name: changed(place_of(name), table, {**study.set, **one}, base.parent) for name, one in cells.items()}
    buildings: dict[bytes, list[str]] = {}  # one after another, as few are kept open at a time
    for name, scenario in scenarios.items():
        buildings.setdefault(_world_key(scenario), []).append(name)
    made = {name: condition(name) for names in buildings.values() for name in names}
    return Plan(path, study, tuple(made[name] for name in cells), seeds, worlds, tuple(notices), keep_old)


def checked(
    place: str,
    name: str,
    changes: dict[str, object],
    scenario: Scenario,
    worlds: dict[bytes, str],
    notices: dict[str, None],
) -> Condition:
    """A condition, checked by building its swarm; its floor plan joins `worlds`, what is to be noticed `notices`.

    Raises InputError that starts with `place`.
    """
    key = _world_key(scenario)
    if key not in worlds:
        try:
            with budget.of(scenario.budget):
                worlds[key] = read_world(scenario.world, scenario.grid.cell)
        except InputError as problem:
            raise InputError(f"{place}: {problem}") from problem
    made = build(scenario, place, worlds[key])
    notices.update(dict.fromkeys(made.notices))
    return Condition(name, changes, scenario, made.simulation.parts.task.curve, known(made.code, place))


def changes_of(path: Path, study: Study) -> dict[str, dict[str, object]]:
    """Each condition's changes, by name: the grid of all axes, then the named ones."""
    groups: dict[str, list[Axis]] = {}
    for number, axis in enumerate(study.vary):
        if axis.names is not None and len(axis.names) != len(axis.values):
            counts = f"{len(axis.names)} names for {len(axis.values)} values"
            raise InputError(f"{path}: vary: {axis.key}: {counts}; expected a name for each value")
        groups.setdefault(axis.together or f"axis {number}", []).append(axis)
    steps: list[list[dict[str, object]]] = []
    for name, axes in groups.items():
        if len({len(axis.values) for axis in axes}) > 1:
            raise InputError(f"{path}: vary: the axes with together = {name!r} differ in their number of values")
        steps.append([{axis.key: axis.values[i] for axis in axes} for i in range(len(axes[0].values))])
    if math.prod(len(step) for step in steps) > MOST_RUNS:
        raise InputError(f"{path}: vary: more than {MOST_RUNS} conditions")
    grid = [{key: value for step in cell for key, value in step.items()} for cell in itertools.product(*steps)]
    changes: dict[str, dict[str, object]] = {}
    for cell in grid:
        if cell or not study.condition:
            name = label(cell, study.words)
            if name in changes:
                raise InputError(f"{path}: vary: {name!r} is listed twice; expected each value once")
            changes[name] = cell
    for named in study.condition:
        if named.name in changes:
            raise InputError(f"{path}: condition: the name {named.name!r} is listed twice; expected each once")
        changes[named.name] = named.set
    return changes


def _place(study: Study, cell: dict[str, object]) -> tuple[float | None, str]:
    """A grid cell's x, its value on the first axis if that is a number, and its series, the other values."""
    if not study.vary or study.vary[0].key not in cell:
        return None, ""
    first = study.vary[0]
    value = cell[first.key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None, ""
    leading = {axis.together or axis.key: axis.key for axis in reversed(study.vary)}  # one key for each group
    others = {key: cell[key] for group, key in reversed(leading.items()) if group != (first.together or first.key)}
    return float(value), label(others, study.words) if others else ""


def changed(place: str, table: Table, changes: dict[str, object], folder: Path) -> Scenario:
    """The scenario of a table with changes by dotted key. Raises InputError that starts with `place`."""
    table = copy.deepcopy(table)
    for key, value in changes.items():
        try:
            assign(table, key, value)
        except InputError as problem:
            raise InputError(f"{place}: {problem}") from problem
    return decode(table, place, folder)


def with_seeds(plan: Plan, seeds: int, names: Collection[str]) -> Plan:
    """The study with seeds 1 to `seeds` and the named conditions only."""
    conditions = tuple(condition for condition in plan.conditions if condition.name in names)
    return replace(plan, conditions=conditions, seeds=tuple(range(1, seeds + 1)))


def trial(plan: Plan) -> float:
    """Estimated seconds per run here, averaged over the first iterations of the study's conditions."""
    seconds = []
    for one in plan.conditions:
        simulation = build(one.scenario, one.name, plan.world_of(one)).simulation
        simulation.tick()
        begun = time.perf_counter()
        while not simulation.over and simulation.state.iteration < TRIED:
            simulation.tick()
        each = (time.perf_counter() - begun) / max(simulation.state.iteration - 1, 1)
        seconds.append(each * min(one.scenario.limit, USUAL))
    return sum(seconds) / len(seconds)
