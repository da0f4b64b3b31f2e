"""The JSON Schema of scenario files, for editors."""

from __future__ import annotations

from typing import Any

import msgspec

from swarmsim.core import registry
from swarmsim.core.scenario import Scenario
from swarmsim.core.seams import SEAMS


def schema() -> dict[str, Any]:
    """The JSON Schema of scenario files, with every installed part, for editors."""
    _, parts = msgspec.json.schema_components([Scenario], ref_template="#/$defs/{name}")
    root: dict[str, Any] = parts.pop(Scenario.__name__)
    defs: dict[str, Any] = dict(parts)
    root["properties"]["world"] = {"anyOf": [{"type": "string"}, {"$ref": "#/$defs/World"}]}
    own = {seam.name: {"type": "object"} for seam in SEAMS.values() if seam.of_groups}
    group = {key: value for key, value in defs["Group"]["properties"].items() if key not in own}
    of_a_kind = {**defs["Group"], "properties": {**group, "spawn": {"type": "string"}, **own}}
    root["properties"]["robots"] = {"anyOf": [{"$ref": "#/$defs/Robots"}, {"type": "array", "items": of_a_kind}]}
    for seam in SEAMS.values():
        choices: list[dict[str, Any]] = []
        for name, kind in registry.known(seam.name).items():
            (described,), inner = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
            part = inner.pop(described["$ref"].rpartition("/")[2])
            defs.update(inner)
            keys = {key: _or_file(value) for key, value in part["properties"].items()}
            part["properties"] = {"use": {"const": name}, **keys}
            required = [] if name == seam.default else ["use"]
            part["required"] = required + part.get("required", [])
            choices.append(part)
        choices.append(
            {"type": "object", "properties": {"use": {"type": "string", "pattern": ":"}}, "required": ["use"]}
        )
        if seam.place:
            part = {"anyOf": choices}
            where = _struct_at(seam.place[:-1])
            described = root if where is Scenario else defs[where.__name__]
            described["properties"][seam.place[-1]] = {"type": "array", "items": part} if seam.many else part
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **root,
        "title": "swarmsim scenario",
        "$defs": defs,
    }


def _struct_at(place: tuple[str, ...]) -> type[msgspec.Struct]:
    """The struct that stands at these keys of a scenario."""
    kind: type[msgspec.Struct] = Scenario
    for key in place:
        kind = next(field.type for field in msgspec.structs.fields(kind) if field.encode_name == key)
    return kind


def _or_file(described: dict[str, Any]) -> dict[str, Any]:
    """A key's schema; an array may be the rows of a file instead."""
    rows = {"type": "object", "properties": {"file": {"type": "string"}}, "required": ["file"]}
    return {"anyOf": [described, rows]} if described.get("type") == "array" else described
