"""Checks before a run that its parts fit together: knowledge, sensor channels, and names of recorded tables."""

from __future__ import annotations

from collections.abc import Sequence

from swarmsim.core.assembly import BuiltMind
from swarmsim.core.errors import InputError
from swarmsim.core.own import line_of
from swarmsim.core.parts import AnyComputation, AnyStrategy, AnyTask, Parts
from swarmsim.core.readings import Channels
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.core.seams import SEAMS
from swarmsim.engine.foreign import announced
from swarmsim.recording import layout

TASK = SEAMS["task"].at


def check(parts: Parts, minds: Sequence[BuiltMind], task: Part[AnyTask]) -> None:
    """Raise InputError, which names the part at fault, unless the parts of a run fit together."""
    for one in minds:
        _check_knowledge(one)
    _check_task(parts, minds, task)
    channels = parts.sensor.channels
    for one in minds:
        for seam, part in (("computation", one.computation), ("strategy", one.strategy)):
            _check_channels(one.context.channels, f"{one.minded.places[seam]}.use: {_use(one, seam)!r}", part)
    _check_channels(channels, f"{TASK}.use: {task.use!r}", parts.task)
    _check_names(parts, minds, task)


def _use(one: BuiltMind, seam: str) -> str:
    part: Part[object] = getattr(one.minded.mind, seam)
    return part.use


def _check_knowledge(one: BuiltMind) -> None:
    """Raise InputError unless a mind's strategy reads its computation's knowledge."""
    known, wanted = one.computation.knowledge_type, one.strategy.requires_knowledge
    if not issubclass(known, wanted):
        raise InputError(
            f"{one.minded.places['strategy']}.use: {_use(one, 'strategy')!r} reads {wanted.__name__}, and "
            f"{_use(one, 'computation')!r} gives {known.__name__}; expected a strategy and a computation that go "
            "together"
        )


def _check_task(parts: Parts, minds: Sequence[BuiltMind], task: Part[AnyTask]) -> None:
    """Raise InputError unless the task reads the robots' knowledge."""
    known, wanted = parts.computation.knowledge_type, parts.task.requires_knowledge
    if issubclass(known, wanted):
        return
    why, how = "groups of robots have their own minds", "a task that reads any knowledge"
    if len(minds) == 1:
        why = f"{_use(minds[0], 'computation')!r} gives {known.__name__}"
        how = "a task and a computation that go together"
    raise InputError(f"{TASK}.use: {task.use!r} reads {wanted.__name__}, and {why}; expected {how}")


def _check_channels(channels: Channels, whose: str, part: AnyComputation | AnyStrategy | AnyTask) -> None:
    """Raise InputError for a part that needs a channel that its robots' sensors lack."""
    for name in getattr(part, "requires", ()):
        if name in channels:
            continue
        parted = [one.name for one in channels if one.name.partition(".")[0] == name]
        if parted:
            why = f"groups of robots have different ones ({', '.join(parted)}); expected equal sensors"
        else:
            why = f"their sensors give {channels.listed()}; expected {_giving(name)}"
        raise InputError(f"{whose} needs {name!r} from the sensors of robots: {why}")


def _giving(name: str) -> str:
    """The sensors that give a channel, as far as is known before they are built."""
    known = {use: getattr(kind, "gives", {}) for use, kind in registry.known("sensor").items()}
    found = [f"{use!r}{gives[name] and f' with {gives[name]}'}" for use, gives in known.items() if name in gives]
    return f"the sensor {' or '.join(found)}" if found else "a sensor that gives it"


def _check_names(parts: Parts, minds: Sequence[BuiltMind], task: Part[AnyTask]) -> None:
    """Raise InputError for a recorded name that is already taken, as far as is known before the run."""
    bodily = {one.recorded_as: "sensor" for one in parts.sensor.channels if one.recorded_as}  # each name's owner
    for one in parts.actuator.channels:
        if one.recorded_as in bodily:
            raise InputError(f"actuators: {one.recorded_as!r} is already given by a sensor; expected another name")
        bodily |= {one.recorded_as: "actuator"} if one.recorded_as else {}
    computed: set[str] = set()  # minds may share names: their tables are merged
    for mind in minds:
        place = f"{mind.minded.places['computation']}.use: {_use(mind, 'computation')!r}"
        computed |= _free_names("computation", mind.computation, place, bodily)
    used = bodily | dict.fromkeys(computed, "computation")
    _free_names("task", parts.task, f"{TASK}.use: {task.use!r}", used)


def _free_names(seam: str, part: object, place: str, used: dict[str, str]) -> set[str]:
    """The names that a part announces. Raises InputError for one `used` by another seam's part."""
    found = set()
    for name, says, at in announced(seam, part):
        wrong = layout.wrong_name(name, seam)
        if wrong is None and name in used:
            wrong = f"{name!r} is already recorded by the {used[name]}; expected such as 'own_{name}'"
        if wrong is not None:
            raise InputError(f"{place} {says}: {wrong}{line_of(*at)}")
        found.add(name)
    return found
