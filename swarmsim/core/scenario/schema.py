"""The JSON Schema of scenario files, for editors."""

from __future__ import annotations

from functools import lru_cache
from operator import getitem
from typing import Annotated, Any, get_args, get_origin

import msgspec

from swarmsim.core.scenario import registry
from swarmsim.core.scenario.describe import comments
from swarmsim.core.scenario.expect import ExpectTable
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.part import Part, seam_of
from swarmsim.core.seams import SEAMS


def schema() -> dict[str, Any]:
    """The JSON Schema of scenario files, with every installed part, for editors: `swarmsim schema`."""
    defs = _components(Scenario)
    root = defs.pop(Scenario.__name__)
    root["properties"]["world"] = {**_said(root, "world"), "anyOf": [{"type": "string"}, {"$ref": "#/$defs/World"}]}
    both = {"type": "object", "properties": {"use": {"type": "string"}}, "required": ["use"]}
    root["properties"]["mind"] = {**_said(root, "mind"), "anyOf": [{"$ref": "#/$defs/Mind"}, both]}
    defs |= _components(ExpectTable)
    root["properties"] |= defs.pop(ExpectTable.__name__)["properties"]
    group = defs["Group"]
    group["properties"]["mind"] = {"anyOf": [{"$ref": "#/$defs/GroupMind"}, both]}
    of_a_kind = {**group, "properties": {**group["properties"], "spawn": {"type": "string"}}}
    root["properties"]["robots"] = {
        **_said(root, "robots"),
        "anyOf": [{"$ref": "#/$defs/Robots"}, {"type": "array", "items": of_a_kind}],
    }
    for seam in SEAMS.values():
        choices: list[dict[str, Any]] = []
        for name, kind in registry.known(seam.name).items():
            inner = _components(kind)
            part = inner.pop(kind.__name__)
            defs.update(inner)
            keys = {key: _or_file(value) for key, value in part["properties"].items()}
            part["properties"] = {"use": {"const": name}, **keys}
            required = [] if name == seam.default else ["use"]
            part["required"] = required + part.get("required", [])
            choices.append(part)
        choices.append(
            {"type": "object", "properties": {"use": {"type": "string", "pattern": ":"}}, "required": ["use"]}
        )
        defs[seam.name] = {"anyOf": choices}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **root,
        "title": "swarmsim scenario",
        "$defs": defs,
    }


def _said(root: dict[str, Any], key: str) -> dict[str, Any]:
    """The meaning of a key."""
    return {"description": root["properties"][key]["description"]}


def _components(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The schemas of a struct and of the structs in it, by name."""
    _, found = msgspec.json.schema_components([_shown(kind)], ref_template="#/$defs/{name}")
    return found


def _shown(kind: object) -> object:
    """A type, with parts replaced by tables that their seam's schema describes."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return _struct(kind)
    if get_origin(kind) is Part:
        seam = seam_of(kind)
        return Annotated[dict[str, Any], msgspec.Meta(extra_json_schema={"$ref": f"#/$defs/{seam}"} if seam else {})]
    if get_origin(kind) is Annotated:
        inner, *metadata = get_args(kind)
        return getitem(Annotated, (_shown(inner), *metadata))
    if msgspec.UnsetType in get_args(kind):
        return _shown(next(one for one in get_args(kind) if one is not msgspec.UnsetType))
    if get_origin(kind) is tuple:
        return tuple.__class_getitem__(tuple(_shown(one) for one in get_args(kind)))
    return kind


@lru_cache(maxsize=1024)  # a struct that is used twice is one
def _struct(kind: type[msgspec.Struct]) -> type[msgspec.Struct]:
    meanings = comments(kind)

    def told(one: msgspec.structs.FieldInfo) -> object:
        shown = _shown(one.type)
        return (
            getitem(Annotated, (shown, msgspec.Meta(description=said))) if (said := meanings.get(one.name)) else shown
        )

    fields = [(one.encode_name, told(one), *_default(one)) for one in msgspec.structs.fields(kind)]
    config = kind.__struct_config__
    return msgspec.defstruct(
        kind.__name__, fields, namespace={"__doc__": kind.__doc__}, kw_only=True,
        forbid_unknown_fields=config.forbid_unknown_fields,
    )  # fmt: skip


def _default(field: msgspec.structs.FieldInfo) -> list[Any]:
    """The default of an omitted key, if it has one."""
    if field.required:
        return []
    if field.default_factory is not msgspec.NODEFAULT:
        return [msgspec.field(default_factory=field.default_factory)]
    is_table = isinstance(field.default, Part | msgspec.Struct)
    return [msgspec.field(default_factory=dict) if is_table else msgspec.field(default=field.default)]


def _or_file(described: dict[str, Any]) -> dict[str, Any]:
    """A key's schema; an array may be the rows of a file instead."""
    rows = {"type": "object", "properties": {"file": {"type": "string"}}, "required": ["file"]}
    return {"anyOf": [described, rows]} if described.get("type") == "array" else described
