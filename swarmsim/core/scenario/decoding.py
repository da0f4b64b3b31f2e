"""Decodes tables into structs, and the tables of parts inside them into parts."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, get_origin

import msgspec
from msgspec import inspect as types

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.own import not_ending
from swarmsim.core.renamed import key_now
from swarmsim.core.scenario.toml import read_toml

T = TypeVar("T", bound=msgspec.Struct)


class Nested(ABC):
    """A field's value that decodes itself from a table."""

    __slots__ = ()

    @classmethod
    @abstractmethod
    def of_table(cls, kind: object, given: Nested | dict[str, Any], take: Take | None) -> Nested:
        """The value of a field of this type, from a table or ready-made, passed through `take`.

        Raises InputError, which starts with the key at fault.
        """


Take = Callable[[Any], Nested]  # applied to each nested value in a table


class _WrongKindError(ValueError):
    """A value that is not a table, in msgspec's words."""


class _InsideError(ValueError):
    """An error inside a nested table: starts with its key, not with a reason."""


def convert(given: Mapping[str, Any], kind: type[T], take: Take | None = None) -> T:
    """The struct that a table describes; `take` is applied to parts in it, and decodes them by default.

    Raises InputError that starts with the key, or all missing keys, at fault.
    """

    def hook(wanted: type, value: object) -> object:
        nested: type = get_origin(wanted) or wanted
        if not issubclass(nested, Nested):
            return value
        if not isinstance(value, dict | nested):
            raise _WrongKindError(f"Expected `object`, got `{called(value)}`")
        try:
            return nested.of_table(wanted, value, take)
        except InputError as problem:
            raise _InsideError(str(problem)) from problem

    missing = _faults_of(given, kind)
    if missing:
        choices = _choices(kind, missing[0]) if len(missing) == 1 else ""
        raise InputError(f"{', '.join(missing)}: required key{'s are' if len(missing) > 1 else ' is'} missing{choices}")
    try:
        with not_ending():
            return msgspec.convert(given, kind, dec_hook=hook)
    except msgspec.ValidationError as problem:
        what, _, where = str(problem).rpartition(" - at `$")
        what, key = (what, where.strip(".`")) if what else (where, "")
        if isinstance(problem.__cause__, _InsideError):
            raise InputError(f"{key}.{what}") from problem
        text = what[:1].lower() + what[1:] + (_choices(kind, key) if what.startswith("Invalid enum value") else "")
        raise InputError(f"{key}: {text}" if key else text) from problem


def read_struct(path: Path, expected: str, kind: type[T]) -> T:
    """The struct that a TOML file describes. Raises InputError, which names the file, and the key at fault."""
    table = read_toml(path, expected)
    try:
        return convert(table, kind)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem


def called(value: object) -> str:
    """A TOML value's type name in messages, as msgspec calls it."""
    names = {list: "array", tuple: "array", dict: "object", type(None): "null"}
    return names.get(type(value), type(value).__name__)


def _choices(kind: type[msgspec.Struct], key: str) -> str:
    """A clause that lists a key's possible values, if they are a few words."""
    known = [choice for one in _at(types.type_info(kind), key.replace("[", ".[").split(".")) for choice in _words(one)]
    return f"; expected {' or '.join(map(repr, known))}" if known else ""


def _at(kind: types.Type, keys: list[str]) -> Iterator[types.Type]:
    """The types at a place of keys, with [0] for list items, inside a type."""
    match kind:
        case types.Metadata():
            yield from _at(kind.type, keys)
        case types.UnionType():
            for one in kind.types:
                yield from _at(one, keys)
        case types.StructType() if keys:
            for field in kind.fields:
                if field.encode_name == keys[0]:
                    yield from _at(field.type, keys[1:])
        case types.ListType() | types.VarTupleType() if keys:
            yield from _at(kind.item_type, keys[1:])
        case types.TupleType() if keys:
            for one in kind.item_types:
                yield from _at(one, keys[1:])
        case types.DictType() if keys:
            yield from _at(kind.value_type, keys[1:])
        case _ if not keys:
            yield kind


def _words(kind: types.Type) -> list[Any]:
    return list(kind.values) if isinstance(kind, types.LiteralType) else []


def _faults_of(given: Mapping[str, Any], kind: type[msgspec.Struct], place: str = "") -> list[str]:
    """The missing required keys, dotted, at any depth.

    Raises InputError for the first key that the struct lacks or that is not finite.
    """
    fields = _fields_of(kind)
    for key in given:
        if key not in fields:
            now = key_now(key, fields)
            told = f"is called {now} now" if now else f"unknown key; {nearest(key, fields)}"
            raise InputError(f"{place}{key}: {told}")
    missing = []
    for key, field in fields.items():
        inner = next((k for k in (field.type, *getattr(field.type, "__args__", ())) if _is_struct(k)), None)
        value = given.get(key, {} if field.required and inner is not None and key not in given else None)
        if (wrong := _infinite(value)) is not None:
            raise InputError(f"{place}{key}: {wrong} is not a number to compute with; expected a finite one")
        if inner is not None and isinstance(value, dict):
            missing += _faults_of(value, inner, f"{place}{key}.")
        elif inner is not None and isinstance(value, list):
            for i, one in enumerate(value):
                missing += _faults_of(one, inner, f"{place}{key}[{i}].") if isinstance(one, dict) else []
        elif field.required and key not in given:
            missing.append(f"{place}{key}")
    return missing


@lru_cache(maxsize=256)
def _fields_of(kind: type[msgspec.Struct]) -> dict[str, msgspec.structs.FieldInfo]:
    return {field.encode_name: field for field in msgspec.structs.fields(kind)}


def _infinite(value: object) -> float | None:
    """The first number in a value, or in a list, that is not finite."""
    if isinstance(value, list | tuple):
        return next((wrong for one in value if (wrong := _infinite(one)) is not None), None)
    return value if isinstance(value, float) and not math.isfinite(value) else None


def _is_struct(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)
