"""Finds parts by name: ours and other people's in the same way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from importlib.metadata import EntryPoint
from typing import Any, TypeVar

import msgspec

from swarmsim.core import distributions, snapshot
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.forms import adapted
from swarmsim.core.own import told
from swarmsim.core.seams import SEAMS
from swarmsim.core.snapshot import Snapshot

T = TypeVar("T", bound=msgspec.Struct)

_OWN_CODE: ContextVar[bool] = ContextVar("own code", default=False)


@contextmanager
def own_code(allowed: bool) -> Iterator[None]:
    """Whether a scenario may name code of its own within this context: `./file.py:Name` or `module:Name`."""
    token = _OWN_CODE.set(allowed)
    try:
        yield
    finally:
        _OWN_CODE.reset(token)


def own_code_is_allowed() -> bool:
    """Whether the present context lets scenarios name code of their own."""
    return _OWN_CODE.get()


def entries(seam: str) -> dict[str, EntryPoint]:
    """The entry points of all installed parts for a seam, by name."""
    return distributions.parts().get(seam, {})


def known(seam: str) -> dict[str, type[msgspec.Struct]]:
    """The parameter structs of all installed parts for a seam, by name."""
    return {name: find(seam, name) for name in entries(seam)}


def find(seam: str, use: str) -> type[msgspec.Struct]:
    """The parameter struct of the part called `use`.

    That is an entry point's name or, where own code is allowed, "./file.py:Name" or "module:Name". Its `build` makes
    the part. Raises InputError if there is none of that name.
    """
    if ":" in use:
        if not own_code_is_allowed():
            raise InputError(
                f"use: {use!r} is code of the scenario's own, which runs only if you say so; expected --allow-code "
                "(in Python allow_code=True) if you trust it, or the name of an installed part"
            )
        return _own(snapshot.present(), seam, use)
    return _installed(seam, use)


@lru_cache(maxsize=256)
def _installed(seam: str, use: str) -> type[msgspec.Struct]:
    if use in entries(seam):
        return _part(seam, use, entries(seam)[use].load())
    raise InputError(f"use: no {seam} is called {use!r}; {nearest(use, entries(seam))}")


@lru_cache(maxsize=256)
def _own(code: Snapshot, seam: str, use: str) -> type[msgspec.Struct]:
    place, _, name = use.rpartition(":")
    try:
        module = code.load(place)
        found = getattr(module, name, None)
    except (Exception, SystemExit) as problem:  # whatever a file of somebody's own does while it is read
        why = told(problem) if not isinstance(problem, OSError) else problem
        raise InputError(f"use: {use!r} cannot be imported; expected './file.py:Name' or 'module:Name': {why}") from (
            problem
        )
    if found is None:
        there = {one: kind for one, kind in vars(module).items() if getattr(kind, "__module__", "") == module.__name__}
        raise InputError(f"use: {place!r} has no {name!r}; {nearest(name, there)}")
    return _part(seam, use, found)


def _part(seam: str, use: str, found: Any) -> type[msgspec.Struct]:
    """The parameter struct behind whatever `use` names; a part of a simpler form is adapted to its seam."""
    if isinstance(found, type) and issubclass(found, msgspec.Struct) and callable(getattr(found, "build", None)):
        return found
    simpler = adapted(found, SEAMS[seam].function, SEAMS[seam].mind)
    if simpler is None:
        raise InputError(
            f"use: {use!r} is not a {seam}: expected a msgspec.Struct with a method 'build', or one of the simpler "
            "forms: a function or, for minds, a class with a method 'step(self, me)'"
        )
    return simpler


def author_of(part: object) -> Any:
    """The class, or the function, that somebody wrote to make this part or parameter struct."""
    return part if isinstance(part, type) else getattr(part, "written_by", type(part))


def is_ours(part: object) -> bool:
    """Whether a part, or a parameter struct, belongs to this package; all others are held to their contracts."""
    return str(author_of(part).__module__).split(".")[0] == "swarmsim"


def is_own(kind: Any) -> bool:
    """Whether a class or function stands in a file that a scenario names."""
    return str(kind.__module__).startswith(snapshot.PREFIX)


def _faults_of(given: Mapping[str, Any], kind: type[msgspec.Struct], place: str = "") -> list[str]:
    """The dotted required keys that are missing, at any depth.

    Raises InputError for the first key that the struct lacks or that is not finite.
    """
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    for key in given:
        if key not in fields:
            raise InputError(f"{place}{key}: unknown key; {nearest(key, fields)}")
    missing = []
    for key, field in fields.items():
        inner = next((k for k in (field.type, *getattr(field.type, "__args__", ())) if _is_struct(k)), None)
        value = given.get(key, {} if field.required and inner is not None and key not in given else None)
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{place}{key}: {value} is not a number to compute with; expected a finite one")
        if inner is not None and isinstance(value, dict):
            missing += _faults_of(value, inner, f"{place}{key}.")
        elif inner is not None and isinstance(value, list):
            for i, one in enumerate(value):
                missing += _faults_of(one, inner, f"{place}{key}[{i}].") if isinstance(one, dict) else []
        elif field.required and key not in given:
            missing.append(f"{place}{key}")
    return missing


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def convert(given: Mapping[str, Any], kind: type[T]) -> T:
    """The struct that a table describes. Raises InputError that starts with the key, or all missing keys, at fault."""
    missing = _faults_of(given, kind)
    if missing:
        raise InputError(f"{', '.join(missing)}: required key{'s are' if len(missing) > 1 else ' is'} missing")
    try:
        return msgspec.convert(given, kind)
    except msgspec.ValidationError as problem:
        what, _, where = str(problem).partition(" - at `$")
        key = where.strip(".`")
        text = what[:1].lower() + what[1:]
        raise InputError(f"{key}: {text}" if key else text) from problem


def part(seam: str, table: Mapping[str, Any]) -> Any:
    """The parameter struct that `table` (`use` and the part's own keys) describes, checked and complete."""
    use = table.get("use", SEAMS[seam].default)
    if not isinstance(use, str):
        raise InputError(f"use: required key is missing or not a string; {nearest('', entries(seam))}")
    parameters = {key: value for key, value in table.items() if key != "use"}
    return convert(parameters, find(seam, use))


def complete(seam: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The same table with every default written out, as far as TOML can: it has no null."""
    plain = msgspec.json.decode(msgspec.json.encode(part(seam, table)))
    return {
        "use": table.get("use", SEAMS[seam].default),
        **{key: value for key, value in plain.items() if value is not None},
    }
