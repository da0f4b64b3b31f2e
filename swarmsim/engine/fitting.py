"""Checks before a run that its parts go together: knowledge, channels of sensors, and names of what is recorded."""

from __future__ import annotations

from swarmsim.core.errors import InputError
from swarmsim.core.parts import AnyComputation, AnyStrategy, AnyTask, Parts
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.core.seams import SEAMS
from swarmsim.engine.foreign import announced
from swarmsim.recording import layout

Asked = dict[str, Part[object]]  # the parts of a scenario, by seam


def check(parts: Parts, asked: Asked) -> None:
    """Raise InputError, which names the part at fault, unless the parts of a run go together."""
    for seam, part in (("strategy", parts.strategy), ("task", parts.task)):
        _check_knowledge(SEAMS[seam].at, part, parts.computation, asked)
    _check_channels(parts, asked)
    _check_names(parts, asked)


def _check_channels(parts: Parts, asked: Asked) -> None:
    """Raise InputError for a part that needs a channel which no sensor of these robots gives."""
    channels = parts.sensor.channels
    for seam, part in (("computation", parts.computation), ("strategy", parts.strategy), ("task", parts.task)):
        for name in getattr(part, "requires", ()):
            if name in channels:
                continue
            parted = [one.name for one in channels if one.name.partition(".")[0] == name]
            if parted:
                why = f"groups of robots have different ones ({', '.join(parted)}); expected equal sensors"
            else:
                why = f"their sensors give {channels.listed()}; expected {_giving(name)}"
            use = asked[seam].use
            raise InputError(f"{SEAMS[seam].at}.use: {use!r} needs {name!r} from the sensors of robots: {why}")


def _giving(name: str) -> str:
    """The sensors that give a channel, as far as they tell before they are built."""
    known = {use: getattr(kind, "gives", {}) for use, kind in registry.known("sensor").items()}
    found = [f"{use!r}{gives[name] and f' with {gives[name]}'}" for use, gives in known.items() if name in gives]
    return f"the sensor {' or '.join(found)}" if found else "a sensor that gives it"


def _check_knowledge(place: str, part: AnyStrategy | AnyTask, computation: AnyComputation, asked: Asked) -> None:
    """Raise InputError unless the part reads what the computation gives."""
    if not issubclass(computation.knowledge_type, part.requires_knowledge):
        raise InputError(
            f"{place}.use: {asked[place.rpartition('.')[2]].use!r} reads {part.requires_knowledge.__name__}, and "
            f"{asked['computation'].use!r} gives {computation.knowledge_type.__name__}; expected a "
            f"{place.rpartition('.')[2]} and a computation that go together"
        )


def _check_names(parts: Parts, asked: Asked) -> None:
    """Raise InputError for a name under which something is to be recorded, and that is taken, as far as it is known."""
    used = {one.recorded_as: "sensor" for one in parts.sensor.channels if one.recorded_as}  # whose each name is
    for one in parts.actuator.channels:
        if one.recorded_as in used:
            raise InputError(f"actuators: {one.recorded_as!r} is what a sensor gives already; expected another name")
        used |= {one.recorded_as: "actuator"} if one.recorded_as else {}
    for seam, part in (("computation", parts.computation), ("task", parts.task)):
        place = f"{SEAMS[seam].at}.use: {asked[seam].use!r}"
        for name, says, at in announced(seam, part):
            wrong = layout.wrong_name(name, seam)
            if wrong is None and name in used:
                wrong = f"{name!r} is what the {used[name]} gives already; expected such as 'own_{name}'"
            if wrong is not None:
                raise InputError(f"{place} {says}: {wrong}{at}")
            used[name] = seam
