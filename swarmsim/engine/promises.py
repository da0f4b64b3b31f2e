"""The contract of each verb of each seam, as one table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from swarmsim.core.context import BuildContext
from swarmsim.core.jobs import AnyJob
from swarmsim.core.kinematics import Kinematics
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, AnyTask, Curve
from swarmsim.core.state import Done, Knowledge, Measured, Record, Senses
from swarmsim.engine import contracts
from swarmsim.recording.measures import RunMeasures

Check = Callable[..., str | None]  # from a verb's result and arguments: what is wrong, or None
Checks = Mapping[str, Check]  # by verb


def nothing(found: object, *given: object) -> None:
    """There is nothing to check."""


def _of_computation(part: AnyComputation, context: BuildContext) -> Checks:
    auditor, form, count = part.knowledge_type.auditor(context), _Form("computation"), len(context.ids)

    def heard(found: object, senses: Senses, inbox: Inbox[MessageBatch]) -> str | None:
        wrong = contracts.knowledge(found, part.knowledge_type)
        if wrong is not None or not isinstance(found, Knowledge):
            return wrong
        wrong = form.check(found.record(), count)
        return wrong if wrong is not None else auditor.audit(found, senses, inbox)

    return {
        "say": contracts.said,
        "hear": heard,
        "reset": lambda found, robots: auditor.reset(robots),
        "copy_from": lambda found, robots, source: auditor.copy_from(robots, source),
    }


def _of_job(part: AnyJob, context: BuildContext) -> Checks:
    form, count = _Form("job"), len(context.ids)

    def heard(found: object, senses: Senses, inbox: Inbox[MessageBatch]) -> str | None:
        if not isinstance(found, Knowledge):
            return f"hear: {type(found).__name__}; expected Knowledge"
        return contracts.knowledge(found, type(found)) or form.check(found.record(), count)

    return {"say": contracts.said, "hear": heard, "reset": nothing, "copy_from": nothing}


def _of_task(part: AnyTask, context: BuildContext) -> Checks:
    form, count = _Form("task"), context.swarm

    def measures(found: object, done: Done[Knowledge]) -> str | None:
        wrong = contracts.measured(found, count, part.curve)
        if wrong is not None or not isinstance(found, Measured):
            return wrong
        return form.check(found.record(), count)

    return {"measure": measures, "summaries": nothing}


def of_summaries(curve: Curve, context: BuildContext) -> Checks:
    """The contract of the observers of a task with this curve."""
    taken = RunMeasures(context.robots, context.period, curve).summary().keys()
    return {"sample": nothing, "summary": lambda found: contracts.summary(found, taken)}


def _width(context: BuildContext) -> int:
    """The length of the swarm's commands."""
    return 2 if context.kinematics is None else context.kinematics.width


def _of_kinematics(part: Kinematics, context: BuildContext) -> Checks:
    """Each verb gives a row per robot, with a number for each column of the kinematics."""
    robots, columns = len(context.ids), len(part.columns)

    def forces(found: object, *given: object) -> str | None:
        if not isinstance(found, tuple) or len(found) != 2:
            return f"forces: {type(found).__name__}; expected what wheels do, and forces"
        wheels, push = found
        return contracts.array("wheels", wheels, np.float64, robots, columns) or contracts.array(
            "forces", push, np.float64, robots, 3
        )

    return {
        "command": lambda found, twists: contracts.array("command", found, np.float64, robots, columns),
        "approach": lambda found, aims: contracts.array("approach", found, np.float64, robots, columns),
        "forces": forces,
    }


class _Form:
    """A part's recorded data has the same form in every iteration."""

    def __init__(self, seam: str) -> None:
        self._seam = seam
        self._before: contracts.Form | None = None

    def check(self, found: Record, robots: int) -> str | None:
        self._before, wrong = contracts.record(found, self._seam, robots, self._before)
        return wrong


#: By seam, makes the checks of a part's verbs for one run. The tick never calls verbs of a seam missing here.
CHECKS: Final[Mapping[str, Callable[[Any, BuildContext], Checks]]] = {
    "sensor": lambda part, context: {"sense": lambda found, state: contracts.readings(found, state, part.channels)},
    "actuator": lambda part, context: {
        "act": lambda found, told, state: contracts.readings(found, state, part.channels, "act")
    },
    "field": lambda part, context: {
        "value": lambda found, time, points: contracts.array("value", found, np.float64, len(points))
    },
    "localisation": lambda part, context: {"locate": contracts.located},
    "computation": _of_computation,
    "job": _of_job,
    "strategy": lambda part, context: {
        "step": lambda found, senses, inbox, known: contracts.intents(found, senses, context.actuators)
    },
    "topology": lambda part, context: {"links": contracts.links},
    "channel": lambda part, context: {
        "deliver": lambda found, state, linked, sizes: contracts.delivery(found, state, len(linked))
    },
    "motion": lambda part, context: {
        "follow": nothing,
        "command": lambda found, pose: contracts.array("command", found, np.float64, context.swarm, _width(context)),
    },
    "kinematics": _of_kinematics,
    "task": _of_task,
}
#: Why parts of some seams have no checks here. Those of seams without a place work inside checked parts.
WITHOUT: Final = {
    "generator": "it runs before a run, and its text is checked as any floor plan",
    "physics": "its state is the reference for all others; the end of a run checks for bodies in walls",
    "fault": "it may break other parts' contracts; swarmsim/engine/guard.py makes their arguments read-only",
    "layer": "it is called when a recording is viewed; swarmsim/view/layers/own.py checks its shapes",
    "probe": "each declares its own tables, checked by swarmsim/engine/probing.py",
}
