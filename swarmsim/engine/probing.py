"""Builds the probes of a run, and holds them to what they declare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import msgspec

from swarmsim.core import registry
from swarmsim.core.errors import InputError
from swarmsim.core.own import brief, told
from swarmsim.core.parts import Parts, Probe
from swarmsim.core.probes import Declared, ProbeTable, Sampled, wrong
from swarmsim.core.scenario import Scenario
from swarmsim.core.setting import Setting
from swarmsim.core.state import Knowledge, Moment
from swarmsim.engine.foreign import built
from swarmsim.engine.guard import Guard, as_it_is
from swarmsim.recording import layout
from swarmsim.recording.probes import Watching


class GuardedProbe(Guard):
    """Rows of the form that it declares."""

    _part: Probe

    def __init__(self, part: Probe, tables: tuple[ProbeTable, ...]) -> None:
        super().__init__("probe", part)
        self.tables = tables
        if registry.is_ours(part):
            self.given = as_it_is

    def sample(self, moment: Moment[Knowledge]) -> Mapping[str, object]:
        """The rows, checked."""
        robots = moment.state.robots
        return self._call(
            moment.state.iteration, self._part.sample, moment, check=lambda found: wrong(found, self.tables, robots)
        )


def watching(scenario: Scenario, setting: Setting, parts: Parts) -> tuple[Watching, ...]:
    """The probes of a scenario, which can read what the parts let be read. Raises InputError."""
    found: list[Watching] = []
    for number, part in enumerate(scenario.probes):
        try:
            probe = built(part, replace(setting, gauges=parts.gauges))
            declared = _declared(part.parameters, probe, part.use)
            if declared.name in (one.declared.name for one in found):
                raise InputError(f"name: another probe is called {declared.name!r} already; expected a name for each")
            for name in map(declared.called, declared.tables):
                if problem := layout.wrong_name(name, "probe"):
                    raise InputError(f"name: {problem}")
        except InputError as problem:
            raise InputError(f"probes[{number}].{problem}") from problem
        found.append(Watching(declared, GuardedProbe(probe, declared.tables)))
    return tuple(found)


def _declared(parameters: msgspec.Struct, probe: Probe, use: str) -> Declared:
    """What a probe records. Raises InputError for tables that cannot be."""
    if not isinstance(parameters, Sampled):
        raise InputError(
            f"use: {use!r} has no keys 'name' and 'every'; expected a class of swarmsim.core.probes.Sampled"
        )
    try:
        tables = probe.tables
    except (Exception, SystemExit) as problem:
        raise InputError(f"use: {use!r} cannot say what it records: {told(problem)}") from problem
    if not isinstance(tables, tuple) or not tables or not all(isinstance(one, ProbeTable) for one in tables):
        raise InputError(f"use: {use!r} declares {brief(tables)} as its tables; expected a tuple of ProbeTable")
    try:  # a struct does not check what it is made of, and what is read back is checked
        declared = msgspec.convert(msgspec.to_builtins(Declared(parameters.name, parameters.every, tables)), Declared)
    except (msgspec.ValidationError, TypeError) as problem:
        raise InputError(f"use: {use!r} declares a table that cannot be: {problem}") from problem
    names = [table.name for table in declared.tables]
    if len(set(names)) < len(names):
        raise InputError(f"use: {use!r} declares {', '.join(map(repr, names))}; expected different names")
    return declared
