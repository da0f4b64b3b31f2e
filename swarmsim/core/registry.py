"""Finds parts by name: ours and other people's in the same way."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import msgspec

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.forms import adapted
from swarmsim.core.own import is_failure, told
from swarmsim.core.seams import SEAMS

_OWN: Final = "swarmsim_own_"  # what the modules of scenarios' own files are called first
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


@lru_cache(maxsize=1)
def _installed_entries() -> Any:  # what it is differs between versions of Python; all have `select`
    return entry_points()  # which reads the files of all installed packages


def entries(seam: str) -> dict[str, EntryPoint]:
    """The entry points of all installed parts for a seam, by name."""
    found = sorted(_installed_entries().select(group=SEAMS[seam].group), key=lambda entry: entry.name)
    return {entry.name: entry for entry in found}


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
        return _own(seam, use)
    return _installed(seam, use)


@lru_cache(maxsize=256)
def _installed(seam: str, use: str) -> type[msgspec.Struct]:
    for entry in _installed_entries().select(group=SEAMS[seam].group, name=use):
        return _part(seam, use, entry.load())
    raise InputError(f"use: no {seam} is called {use!r}; {nearest(use, entries(seam))}")


@lru_cache(maxsize=256)
def _own(seam: str, use: str) -> type[msgspec.Struct]:
    place, _, name = use.rpartition(":")
    try:
        module = _loaded(Path(place)) if place.endswith(".py") else importlib.import_module(place)
        found = getattr(module, name, None)
    except BaseException as problem:  # whatever a file of somebody's own does while it is read
        if not is_failure(problem):
            raise
        why = told(problem) if not isinstance(problem, ImportError | OSError) else problem
        raise InputError(f"use: {use!r} cannot be imported; expected './file.py:Name' or 'module:Name': {why}") from (
            problem
        )
    if found is None:
        there = {one: kind for one, kind in vars(module).items() if getattr(kind, "__module__", "") == module.__name__}
        raise InputError(f"use: {place!r} has no {name!r}; {nearest(name, there)}")
    return _part(seam, use, found)


def _loaded(path: Path) -> ModuleType:
    """The module in a file, under a name that no other module has."""
    name = f"{_OWN}{hashlib.blake2b(str(path.resolve()).encode(), digest_size=6).hexdigest()}_{path.stem}"
    if name in sys.modules:
        return sys.modules[name]  # parts of one file share its classes
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


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
    return str(kind.__module__).startswith(_OWN)


def source_of(seam: str, use: str) -> bytes:
    """A hash of the file that a foreign part comes from; nothing for ours, which versions tell apart."""
    kind = find(seam, use)
    if is_ours(kind):
        return b""
    file = getattr(sys.modules[kind.__module__], "__file__", None)
    return hashlib.blake2b(Path(file).read_bytes(), digest_size=16).digest() if file else b""
