"""What robots are equipped with: the sensors of a swarm, or of its groups, as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from swarmsim.core.adapters.minds import OF_ME
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Sensor
from swarmsim.core.readings import Channels
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, Sensors, fitted
from swarmsim.engine import contracts
from swarmsim.engine.foreign import make
from swarmsim.engine.guard import Clock, held
from swarmsim.recording import layout
from swarmsim.robots.suites import MixedSensor, Suite, TwiceError


def sensors(scenario: Scenario, context: BuildContext, strict: bool, clock: Clock) -> Sensor:
    """The sensors of a swarm as one; of a mixed swarm, those of its groups. Raises InputError."""
    suites = [_suite(sensors, context, strict, clock) for sensors in fitted(scenario)]
    if len(suites) == 1:
        return suites[0]
    counts = [group.count for group in scenario.robots.groups]
    ends = np.cumsum(counts)
    return MixedSensor(
        [(suite, np.arange(end - n, end)) for suite, end, n in zip(suites, ends.tolist(), counts, strict=True)]
    )


def _suite(sensors: Sensors, context: BuildContext, strict: bool, clock: Clock) -> Sensor:
    """The sensors of the same robots as one. Raises InputError that starts with the place in the scenario."""
    made: list[Sensor] = []
    for number, (place, one) in enumerate(sensors):
        part = make(one, replace(context, number=number), place)
        wrong = contracts.declared(part.channels, context.swarm) or _wrong_names(part.channels)
        if wrong is not None:
            raise InputError(f"{place}.use: {one.use!r} declares {wrong}")
        if strict or not registry.is_ours(part):
            part = held("sensor", part, context, clock, not registry.is_ours(part))
        made.append(part)
    names = [str(one.declares("name", None) or "") for _, one in sensors]
    try:
        return made[0] if len(made) == 1 and not names[0] else Suite(made, names)
    except TwiceError as problem:
        raise InputError(problem.told([place for place, _ in sensors])) from problem


def _wrong_names(channels: Channels) -> str | None:
    """Why a channel of a sensor cannot be called so, or None: minds find it under that name, and recordings a table."""
    for channel in channels:
        if channel.name in OF_ME:
            return f"{channel.name!r}: a mind finds something else as me.{channel.name}; expected 'my_{channel.name}'"
        table = channel.recorded_as
        wrong = table and (
            layout.wrong_name(table, "sensor")
            or layout.wrong_form(table, np.empty((1, *channel.shape), channel.dtype), layout.EACH, 1)
        )
        if wrong:
            return f"{channel.name!r}: {wrong}"
    return None
