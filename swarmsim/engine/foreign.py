"""Third-party parts: building them, checking their arguments, and finding the one whose code failed."""

from __future__ import annotations

import inspect
import sys
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, Final, TypeVar

from swarmsim.core.adapters.minds import OwnMinds
from swarmsim.core.capabilities import verbs_of
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lending import lent
from swarmsim.core.own import is_failure, line_of, told
from swarmsim.core.parts import Fault, Parts, Sensor
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.core.seams import SEAMS
from swarmsim.core.state import Estimates

P = TypeVar("P")

MARGIN: Final = 12  # cells around a building for a sensor that does not declare its tiles' reach


def margin_of(sensor: Part[Sensor]) -> int:
    """How many cells a sensor's tiles reach beyond their robot's cell, at most."""
    return sensor.declares("margin", MARGIN)


def built(asked: Part[P], context: BuildContext) -> P:
    """The built part of a scenario. Raises InputError, also for anything that a third-party `build` raises."""
    if registry.is_ours(asked.parameters):
        return asked.build(context)
    try:
        part = asked.build(lent(context))
    except InputError:
        raise
    except BaseException as problem:
        if not is_failure(problem):
            raise
        raise InputError(f"use: {asked.use!r} cannot be built: {told(problem)}") from problem
    _check_arguments(asked.seam, part, f"use: what {asked.use!r} builds")
    return part


def make(part: Part[P], context: BuildContext, place: str = "") -> P:
    """The built part. Raises InputError that starts with its place in the scenario."""
    try:
        return built(part, context)
    except InputError as problem:
        raise problem.inside(place or SEAMS[part.seam].at) from problem


def _check_arguments(seam: str, part: object, what: str) -> None:
    """Raise InputError, with the right `def` line, for a verb with wrong parameters."""
    protocol = SEAMS[seam].protocol_of(part)
    for verb in verbs_of(protocol):
        asked = inspect.getattr_static(protocol, verb, None)
        if not inspect.isfunction(asked):
            continue
        expected = list(inspect.signature(asked).parameters)
        try:
            takes = inspect.signature(getattr(part, verb))
        except (TypeError, ValueError):  # written in C, or not callable
            continue
        try:
            takes.bind(*expected[1:])
        except TypeError:
            kind = registry.author_of(part)
            raise InputError(
                f"{what}, {kind.__qualname__}, has '{verb}' with the wrong parameters {takes}; "
                f"expected 'def {verb}({', '.join(expected)}):'{line_of(kind, verb)}"
            ) from None


def announced(seam: str, part: Any) -> Iterator[tuple[str, str, tuple[type, str]]]:  # noqa: ANN401 - a computation, task
    """The names of a part's recorded tables, as far as it declares them before the run.

    Each comes with its source in words, and what `line_of` takes to tell the line of code.
    """
    kind = registry.author_of(part)
    if seam == "task":
        yield part.curve.name, f"measures {part.curve.name!r}", (kind, "")
        return
    known = part.knowledge_type
    for name in getattr(part, "recorded", ()) if issubclass(known, OwnMinds) else ():
        yield name, f"records {name!r}", (kind, "recorded")
    for field in fields(known) if issubclass(known, Estimates) else ():
        yield field.name, f"gives {known.__name__} with a field {field.name!r}", (known, field.name)


def installed(fault: Fault, use: str, parts: Parts) -> Parts:
    """The parts with a fault installed. Raises InputError, also for a third-party `install` that fails."""
    try:
        found = fault.install(parts)
    except InputError:
        raise
    except BaseException as problem:
        if registry.is_ours(fault) or not is_failure(problem):
            raise
        raise InputError(f"use: {use!r} cannot be installed: {told(problem)}") from problem
    if not isinstance(found, Parts):
        raise InputError(f"use: {use!r} installs {type(found).__name__}; expected the Parts, changed")
    for seam in ("computation", "strategy") if not registry.is_ours(fault) else ():
        if getattr(found, seam) is not getattr(parts, seam):
            _check_arguments(seam, getattr(found, seam), f"use: what {use!r} installs")
    return found


def foreign(part: Part[object]) -> dict[str, str]:
    """The third-party files of a part and of the parts inside it, with the part's name."""
    return {
        str(getattr(sys.modules[type(one.parameters).__module__], "__file__", None)): f"{one.seam} {one.use}"
        for one in part.inside()
        if not registry.is_ours(one.parameters)
    }


def blamed(problem: BaseException, files: Mapping[str, str]) -> str | None:
    """The third-party part whose file raised an exception, with the lines outside of this package; or None."""
    raised = {frame.filename for frame in traceback.extract_tb(problem.__traceback__)}
    return next((f"{name}: {told(problem)}" for file, name in files.items() if file in raised), None)
