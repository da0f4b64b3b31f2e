"""Builds the probes of a run, those of what its jobs show among them, and checks them against their declarations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import msgspec

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.own import brief, is_failure, told
from swarmsim.core.parts import Parts, Probe
from swarmsim.core.probes import Declared, ProbeTable, Sampled, wrong, wrong_picture
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.state import Knowledge, Moment
from swarmsim.engine.foreign import built
from swarmsim.engine.guard import Author, Clock, Guard
from swarmsim.engine.jobs import name_of
from swarmsim.recording import layout
from swarmsim.recording.probes import Watching


class JobProbe:
    """Samples what a job shows."""

    def __init__(self, name: str, tables: tuple[ProbeTable, ...]) -> None:
        self._name, self.tables = name, tables

    def sample(self, moment: Moment[Knowledge]) -> Mapping[str, object]:
        """A row of each of its tables, from what the job has found."""
        found: Any = next(one.knowledge for one in moment.jobs if one.name == self._name)
        rows: Mapping[str, object] = found.sample(moment.state.alive)
        return rows


def watching(scenario: Scenario, context: BuildContext, parts: Parts, clock: Clock) -> tuple[Watching, ...]:
    """The probes of a scenario, which can read the parts' gauges, and those of its jobs. Raises InputError."""
    found: list[Watching] = []
    for number, part in enumerate(scenario.probes):
        with _inside(f"probes[{number}]"):
            probe = built(part, replace(context, gauges=parts.gauges))
            asked = part.parameters
            if not isinstance(asked, Sampled):
                raise InputError(
                    f"use: {part.use!r} has no keys 'name' and 'every'; expected a class of "
                    "swarmsim.core.probes.Sampled"
                )
            declared = _declared(asked.name, asked.every, _tables(probe, part.use), part.use)
            found.append(Watching(declared, _held("probe", probe, registry.author_of(probe), declared, context, clock)))
    shown = _shown(parts)
    for number, job in enumerate(scenario.jobs):
        if tables := shown[name_of(job)]:
            with _inside(f"jobs[{number}]"):
                declared = _declared(name_of(job), 1, tables, job.use)
                author, watch = registry.author_of(job.parameters), JobProbe(declared.name, declared.tables)
                found.append(Watching(declared, _held("job", watch, author, declared, context, clock)))
    _check_names(found, len(scenario.probes), context)
    return tuple(found)


def _shown(parts: Parts) -> Mapping[str, tuple[ProbeTable, ...]]:
    """What jobs declare, by name. Raises InputError if one fails."""
    try:
        return {} if parts.jobs is None else parts.jobs.tables
    except BaseException as problem:
        if not is_failure(problem):
            raise
        raise InputError(f"jobs: one of them cannot say what it shows: {told(problem)}") from problem


@contextmanager
def _inside(place: str) -> Iterator[None]:
    """Puts a place in the scenario in front of what InputErrors say."""
    try:
        yield
    except InputError as problem:
        raise problem.inside(place) from problem


def _check_names(found: Sequence[Watching], probes: int, context: BuildContext) -> None:
    """Raise InputError for names that are taken, and for tables that pictures cannot show as they say."""
    names = set[str]()
    for number, one in enumerate(found):
        declared = one.declared
        with _inside(f"probes[{number}]" if number < probes else f"jobs[{number - probes}]"):
            if declared.name in names:
                raise InputError(f"name: another probe is called {declared.name!r} already; expected a name for each")
            names.add(declared.name)
            for table in declared.tables:
                if problem := layout.wrong_name(declared.called(table), "probe"):
                    raise InputError(f"name: {problem}")
                if problem := wrong_picture(table, context.lattice.shape, context.swarm):
                    raise InputError(f"use: {problem}")


def _held(seam: str, probe: Probe, author: Author, declared: Declared, context: BuildContext, clock: Clock) -> Probe:
    """The guarded probe, whose rows have their declared form."""
    checks = {"sample": lambda found, moment: wrong(found, declared.tables, context.swarm)}
    ours = registry.is_ours(author)
    return Guard(seam, probe, author, checks, clock, is_foreign=not ours, lends=not ours)


def _tables(probe: Probe, use: str) -> object:
    """What a probe declares. Raises InputError if it fails."""
    try:
        return probe.tables
    except BaseException as problem:
        if not is_failure(problem):
            raise
        raise InputError(f"use: {use!r} cannot say what it records: {told(problem)}") from problem


def _declared(name: str, every: int, tables: object, use: str) -> Declared:
    """The declaration of what is recorded under a name. Raises InputError for an invalid one."""
    if not isinstance(tables, tuple) or not tables or not all(isinstance(one, ProbeTable) for one in tables):
        raise InputError(f"use: {use!r} declares {brief(tables)} as its tables; expected a tuple of ProbeTable")
    try:  # structs check nothing when made, only when read back
        declared = msgspec.convert(msgspec.to_builtins(Declared(name, every, tables)), Declared)
    except (msgspec.ValidationError, TypeError) as problem:
        raise InputError(f"use: {use!r} declares an invalid table: {problem}") from problem
    names = [table.name for table in declared.tables]
    if len(set(names)) < len(names):
        raise InputError(f"use: {use!r} declares {', '.join(map(repr, names))}; expected different names")
    return declared
