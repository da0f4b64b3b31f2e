"""What a run asks for: the part of its key that does not depend on code."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from swarmsim.core.scenario import budget
from swarmsim.core.scenario.file import Scenario, every_part, without_later
from swarmsim.core.scenario.part import plain


def asked(scenario: Scenario) -> bytes:
    """A scenario's request in JSON, independent of its name and of the places of floor plan and code."""
    scenario = msgspec.structs.replace(scenario, title="", budget=budget.BUDGET)
    table = without_later(msgspec.structs.asdict(scenario))
    unnamed = {**msgspec.structs.asdict(scenario.world), "file": ""}
    whole = msgspec.to_builtins({**table, "world": unnamed}, enc_hook=plain, order="deterministic")
    files = [Path(part.use.rpartition(":")[0]) for part in every_part(scenario) if ".py:" in part.use]
    if files:
        whole = _placed(whole, os.path.commonpath([Path.cwd() / file.parent for file in files]))
    return msgspec.json.encode(whole)


def _placed(value: object, folder: str) -> object:
    """The same with parts' files relative to a folder."""
    if isinstance(value, dict):
        found = {key: _placed(inner, folder) for key, inner in value.items()}
        file, _, name = str(value.get("use", "")).rpartition(":")
        return {**found, "use": f"{os.path.relpath(file, folder)}:{name}"} if file.endswith(".py") else found
    return [_placed(inner, folder) for inner in value] if isinstance(value, list) else value


def libraries(found: dict[str, str]) -> dict[str, str]:
    """The versions in a run's identity, without Python and the machine, which affect few results."""
    return {name: version for name, version in found.items() if name not in ("python", "platform")}
