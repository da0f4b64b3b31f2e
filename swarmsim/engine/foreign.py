"""Other people's parts, from what they are called to what they are built as; and whose code it was that failed."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from swarmsim.core import registry
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Fault, Parts, Setting

MARGIN: Final = 12  # cells around a building for a sensor that does not say how far its tiles reach
_PACKAGE: Final = Path(__file__).parents[1]
#: What the part of each seam has to have, besides what is found out when it is used.
VERBS: Final = {
    "generator": ("draw",),
    "physics": ("drive", "state", "solid", "remove", "crash", "place", "push", "retire"),
    "sensor": ("sense",),
    "field": ("value",),
    "localisation": ("locate",),
    "computation": ("knows", "say", "hear", "forget", "adopt"),
    "sharing": ("say", "taken"),
    "strategy": ("reads", "step"),
    "topology": ("links",),
    "channel": ("deliver",),
    "motion": ("follow", "command"),
    "task": ("reads", "curve", "measure", "summaries"),
    "fault": ("install",),
}


def margin_of(sensor: msgspec.Struct) -> int:
    """How many cells a sensor's tiles reach beyond the cell of their robot, at most."""
    margin: int = getattr(sensor, "margin", MARGIN)
    return margin


def built(seam: str, table: dict[str, Any], setting: Setting) -> Any:
    """The part that a table describes. Raises InputError, also for whatever somebody else's `build` raises."""
    parameters = registry.part(seam, table)
    if registry.is_ours(parameters):
        return parameters.build(setting)
    try:
        part = parameters.build(setting)
    except InputError:
        raise
    except Exception as problem:
        raise InputError(f"use: {table['use']!r} cannot be built: {told(problem)}") from problem
    missing = [verb for verb in VERBS[seam] if not hasattr(part, verb)]
    if missing:
        kind = f"{type(part).__module__.rpartition('.')[2]}.{type(part).__qualname__}"
        raise InputError(f"use: what {table['use']!r} builds, {kind}, lacks {', '.join(missing)}; expected a {seam}")
    return part


def installed(fault: Fault, parts: Parts, table: dict[str, Any]) -> Parts:
    """The parts with a fault in them. Raises InputError, also for what somebody else's `install` raises or gives."""
    try:
        found = fault.install(parts)
    except InputError:
        raise
    except Exception as problem:
        if registry.is_ours(fault):
            raise
        raise InputError(f"use: {table['use']!r} cannot be installed: {told(problem)}") from problem
    if not isinstance(found, Parts):
        raise InputError(f"use: {table['use']!r} installs {type(found).__name__}; expected the Parts, changed")
    return found


def told(problem: BaseException) -> str:
    """An exception in words, with the lines of code outside of this package that led to it."""
    frames = [f for f in traceback.extract_tb(problem.__traceback__) if _PACKAGE not in Path(f.filename).parents]
    own = [f for f in frames if "site-packages" not in f.filename] or frames
    lines = "".join(f"\n  {frame.filename}, line {frame.lineno}, in {frame.name}: {frame.line}" for frame in own)
    whose = "".join(f", {note}" for note in getattr(problem, "__notes__", ()))
    return f"{type(problem).__name__}: {problem}{whose}{lines}"


def foreign(seam: str, table: dict[str, Any]) -> dict[str, str]:
    """The files of the part that a table describes, and of what it shares, that are not ours; with the part's name."""
    kind, share = registry.find(seam, table["use"]), table.get("share")
    found = foreign("sharing", share) if isinstance(share, dict) and "use" in share else {}
    if not registry.is_ours(kind):
        found[str(getattr(sys.modules[kind.__module__], "__file__", None))] = f"{seam} {table['use']}"
    return found


def blamed(problem: BaseException, files: Mapping[str, str]) -> str | None:
    """Which part, by the file that it is in, raised something, with the lines outside of this package; or None."""
    raised = {frame.filename for frame in traceback.extract_tb(problem.__traceback__)}
    return next((f"{name}: {told(problem)}" for file, name in files.items() if file in raised), None)
