"""The robots' equipment: the sensors of a swarm, or of its groups, as one, and their actuators."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.adapters.minds import OF_ME
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.kinematics import Drives, Wheels
from swarmsim.core.parts import Actuator, Sensor
from swarmsim.core.readings import Channels
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import Scenario, Sensors, fitted, kinematics_of
from swarmsim.core.scenario.part import Part
from swarmsim.core.scenario.robots import Robots
from swarmsim.engine import contracts
from swarmsim.engine.foreign import make
from swarmsim.engine.guard import Clock, held
from swarmsim.recording import layout
from swarmsim.robots.suites import MixedSensor, Rig, Suite, TwiceError


def sensors(scenario: Scenario, context: BuildContext, strict: bool, clock: Clock) -> Sensor:
    """The sensors of a swarm as one; of a mixed swarm, those of its groups. Raises InputError."""
    suites = [_suite(sensors, context, strict, clock) for sensors in fitted(scenario)]
    if len(suites) == 1:
        return suites[0]
    return MixedSensor(list(zip(suites, _ids_of_groups(scenario.robots), strict=True)))


def _ids_of_groups(robots: Robots) -> list[NDArray[np.int64]]:
    """The numbers (r,) of the robots of each group."""
    return np.split(np.arange(robots.count), np.cumsum([group.count for group in robots.groups])[:-1])


def drives(scenario: Scenario, context: BuildContext, strict: bool, clock: Clock) -> Drives:
    """The kinematics of a swarm; of a mixed swarm, those of its groups. Raises InputError."""
    asked = kinematics_of(scenario)
    every = _ids_of_groups(scenario.robots) if len(asked) > 1 else [context.ids]
    kinds: list[Wheels] = []
    for (place, one), ids in zip(asked, every, strict=True):
        mine = context.serving(ids)
        kinematics = make(one, mine, place)
        if strict or not registry.is_ours(kinematics):
            kinematics = held("kinematics", kinematics, mine, clock, not registry.is_ours(kinematics))
        rows = slice(int(ids[0]), int(ids[-1]) + 1)
        kinds.append(Wheels(one.use, kinematics, rows, one.declares("sideways", False), one.declares("bend", 0.0)))
    return Drives(kinds)


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


def actuators(listed: tuple[Part[Actuator], ...], context: BuildContext, strict: bool, clock: Clock) -> Rig:
    """The actuators of all robots as one. Raises InputError that starts with the place in the scenario."""
    made: list[Actuator] = []
    places = [f"actuators[{number}]" for number in range(len(listed))]
    for number, (place, one) in enumerate(zip(places, listed, strict=True)):
        part = make(one, replace(context, number=number), place)
        wrong = contracts.acting(part.channels, context.swarm) or _wrong_names(part.channels, "actuator")
        if wrong is not None:
            raise InputError(f"{place}.use: {one.use!r} declares {wrong}")
        if strict or not registry.is_ours(part):
            part = held("actuator", part, context, clock, not registry.is_ours(part))
        made.append(part)
    try:
        return Rig(made, [str(one.declares("name", None) or "") for one in listed])
    except TwiceError as problem:
        raise InputError(problem.told(places)) from problem


def _wrong_names(channels: Channels, seam: str = "sensor") -> str | None:
    """Why a channel cannot have its name, or None: minds find a sensor's under it, and recordings a table."""
    for channel in channels:
        if channel.name in OF_ME and seam == "sensor":
            return f"{channel.name!r}: me.{channel.name} is taken; expected 'my_{channel.name}'"
        table = channel.recorded_as
        wrong = table and (
            layout.wrong_name(table, seam)
            or layout.wrong_form(table, np.empty((1, *channel.shape), channel.dtype), layout.EACH, 1)
        )
        if wrong:
            return f"{channel.name!r}: {wrong}"
    return None
