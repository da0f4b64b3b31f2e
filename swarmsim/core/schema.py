"""The JSON Schema of scenario files, for editors."""

from __future__ import annotations

from typing import Any

import msgspec

from swarmsim.core import registry
from swarmsim.core.scenario import PLACES, Scenario


def schema() -> dict[str, Any]:
    """The JSON Schema of scenario files, with every installed part, for editors."""
    _, parts = msgspec.json.schema_components([Scenario], ref_template="#/$defs/{name}")
    root: dict[str, Any] = parts.pop("Scenario")
    defs: dict[str, Any] = dict(parts)
    root["properties"]["world"] = {"anyOf": [{"type": "string"}, {"$ref": "#/$defs/World"}]}
    group = {key: value for key, value in defs["Group"]["properties"].items() if key != "sensor"}
    of_a_kind = {**defs["Group"], "properties": {**group, "spawn": {"type": "string"}, "sensor": {"type": "object"}}}
    root["properties"]["robots"] = {"anyOf": [{"$ref": "#/$defs/Robots"}, {"type": "array", "items": of_a_kind}]}
    for seam in registry.SEAMS:
        choices: list[dict[str, Any]] = []
        for name, kind in registry.known(seam).items():
            (described,), inner = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
            part = inner.pop(described["$ref"].rpartition("/")[2])
            defs.update(inner)
            keys = {key: _or_file(value) for key, value in part["properties"].items()}
            part["properties"] = {"use": {"const": name}, **keys}
            required = [] if name == registry.SEAMS[seam] else ["use"]
            part["required"] = required + part.get("required", [])
            choices.append(part)
        choices.append(
            {"type": "object", "properties": {"use": {"type": "string", "pattern": ":"}}, "required": ["use"]}
        )
        if seam == "fault":
            root["properties"]["faults"] = {"type": "array", "items": {"anyOf": choices}}
        elif seam in PLACES:
            *outer, key = PLACES[seam]
            place = defs[outer[0].capitalize()] if outer else root
            place["properties"][key] = {"anyOf": choices}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **root,
        "title": "swarmsim scenario",
        "$defs": defs,
    }


def _or_file(described: dict[str, Any]) -> dict[str, Any]:
    """A key's schema; an array may be the rows of a file instead."""
    rows = {"type": "object", "properties": {"file": {"type": "string"}}, "required": ["file"]}
    return {"anyOf": [described, rows]} if described.get("type") == "array" else described
