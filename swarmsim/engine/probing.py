"""Builds the probes of a run, and checks them against their declarations."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.own import brief, is_failure, told
from swarmsim.core.parts import Parts, Probe
from swarmsim.core.probes import Declared, ProbeTable, Sampled, wrong
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario
from swarmsim.engine.foreign import built
from swarmsim.engine.guard import Clock, Guard
from swarmsim.recording import layout
from swarmsim.recording.probes import Watching


def watching(scenario: Scenario, context: BuildContext, parts: Parts, clock: Clock) -> tuple[Watching, ...]:
    """The probes of a scenario, which can read the parts' gauges. Raises InputError."""
    found: list[Watching] = []
    for number, part in enumerate(scenario.probes):
        try:
            probe = built(part, replace(context, gauges=parts.gauges))
            declared = _declared(part.parameters, probe, part.use)
            if declared.name in (one.declared.name for one in found):
                raise InputError(f"name: another probe is called {declared.name!r} already; expected a name for each")
            for name in map(declared.called, declared.tables):
                if problem := layout.wrong_name(name, "probe"):
                    raise InputError(f"name: {problem}")
        except InputError as problem:
            raise problem.inside(f"probes[{number}]") from problem
        found.append(Watching(declared, _held(probe, declared.tables, context.swarm, clock)))
    return tuple(found)


def _held(probe: Probe, tables: tuple[ProbeTable, ...], robots: int, clock: Clock) -> Probe:
    """The guarded probe, whose rows have their declared form."""
    ours, checks = registry.is_ours(probe), {"sample": lambda found, moment: wrong(found, tables, robots)}
    return Guard("probe", probe, registry.author_of(probe), checks, clock, is_foreign=not ours, lends=not ours)


def _declared(parameters: msgspec.Struct, probe: Probe, use: str) -> Declared:
    """A probe's tables. Raises InputError for invalid ones."""
    if not isinstance(parameters, Sampled):
        raise InputError(
            f"use: {use!r} has no keys 'name' and 'every'; expected a class of swarmsim.core.probes.Sampled"
        )
    try:
        tables = probe.tables
    except BaseException as problem:
        if not is_failure(problem):
            raise
        raise InputError(f"use: {use!r} cannot say what it records: {told(problem)}") from problem
    if not isinstance(tables, tuple) or not tables or not all(isinstance(one, ProbeTable) for one in tables):
        raise InputError(f"use: {use!r} declares {brief(tables)} as its tables; expected a tuple of ProbeTable")
    try:  # structs check nothing when made, only when read back
        declared = msgspec.convert(msgspec.to_builtins(Declared(parameters.name, parameters.every, tables)), Declared)
    except (msgspec.ValidationError, TypeError) as problem:
        raise InputError(f"use: {use!r} declares an invalid table: {problem}") from problem
    names = [table.name for table in declared.tables]
    if len(set(names)) < len(names):
        raise InputError(f"use: {use!r} declares {', '.join(map(repr, names))}; expected different names")
    return declared
