"""Finds parts by name: ours and other people's in the same way."""

from __future__ import annotations

import difflib
import importlib
import math
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Any, TypeVar

import msgspec

from swarmsim.core.errors import InputError

T = TypeVar("T", bound=msgspec.Struct)

#: The seams of a scenario, each with the part that is used where the file names none.
SEAMS = {
    "sensor": "ir-ring",
    "localisation": "perfect",
    "sharing": "current-tile",
    "topology": None,
    "channel": "perfect",
    "behaviour": "collective-mapping",
    "motion": "pure-pursuit",
    "fault": None,
}


def known(seam: str) -> dict[str, type[msgspec.Struct]]:
    """The parameter structs of all installed parts for a seam, by name."""
    found = sorted(entry_points(group=f"swarmsim.{seam}"), key=lambda entry: entry.name)
    return {entry.name: entry.load() for entry in found}


def nearest(word: str, words: Mapping[str, object]) -> str:
    """A clause that suggests the known word most like `word`, or lists all of them."""
    similar = difflib.get_close_matches(word, words, n=1)
    listed = ", ".join(sorted(words)) or "none"
    return f"did you mean {similar[0]!r}? Known: {listed}" if similar else f"known: {listed}"


@lru_cache(maxsize=256)
def find(seam: str, use: str) -> type[msgspec.Struct]:
    """The parameter struct of the part called `use`: an entry point's name, or "module:Name".

    Its `build` makes the part. Raises InputError if there is none of that name.
    """
    if ":" in use:
        module, _, name = use.partition(":")
        try:
            kind: type[msgspec.Struct] = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, TypeError, ValueError) as problem:
            raise InputError(f"use: {use!r} cannot be imported ({problem}); expected 'module:Name'") from problem
        if not (isinstance(kind, type) and issubclass(kind, msgspec.Struct) and callable(getattr(kind, "build", None))):
            raise InputError(f"use: {use!r} is not a part: expected a msgspec.Struct with a method 'build'")
        return kind
    entries = entry_points(group=f"swarmsim.{seam}", name=use)
    for entry in entries:
        found: type[msgspec.Struct] = entry.load()
        return found
    raise InputError(f"use: no {seam} is called {use!r}; {nearest(use, known(seam))}")


def _refuse_what_no_struct_takes(given: Mapping[str, Any], kind: type[msgspec.Struct], place: str = "") -> None:
    """Raise InputError for the first key, at any depth, that the struct lacks or that is not finite."""
    fields = {field.encode_name: field.type for field in msgspec.structs.fields(kind)}
    for key, value in given.items():
        if key not in fields:
            raise InputError(f"{place}{key}: unknown key; {nearest(key, fields)}")
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{place}{key}: {value} is not a number to compute with; expected a finite one")
        for inner in (fields[key], *getattr(fields[key], "__args__", ())):
            if isinstance(value, dict) and isinstance(inner, type) and issubclass(inner, msgspec.Struct):
                _refuse_what_no_struct_takes(value, inner, f"{place}{key}.")


def convert(given: Mapping[str, Any], kind: type[T]) -> T:
    """The struct that a table describes. Raises InputError that starts with the key at fault."""
    _refuse_what_no_struct_takes(given, kind)
    try:
        return msgspec.convert(given, kind)
    except msgspec.ValidationError as problem:
        what, _, where = str(problem).partition(" - at `$")
        missing = what.partition("missing required field `")[2].rstrip("`")
        key = ".".join(part for part in (where.strip(".`"), missing) if part)
        text = "required key is missing" if missing else what[:1].lower() + what[1:]
        raise InputError(f"{key}: {text}" if key else text) from problem


def part(seam: str, table: Mapping[str, Any]) -> Any:
    """The parameter struct that `table` (`use` and the part's own keys) describes, checked and complete."""
    use = table.get("use", SEAMS[seam])
    if not isinstance(use, str):
        raise InputError(f"use: required key is missing or not a string; {nearest('', known(seam))}")
    parameters = {key: value for key, value in table.items() if key != "use"}
    return convert(parameters, find(seam, use))


def complete(seam: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The same table with every default written out, as far as TOML can: it has no null."""
    plain = msgspec.json.decode(msgspec.json.encode(part(seam, table)))
    return {"use": table.get("use", SEAMS[seam]), **{key: value for key, value in plain.items() if value is not None}}
