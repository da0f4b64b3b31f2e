"""Finds parts by name, ours and third-party ones alike."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from importlib.metadata import EntryPoint

import msgspec

from swarmsim.core.adapters.forms import adapted
from swarmsim.core.code import distributions, snapshot
from swarmsim.core.code.snapshot import Snapshot
from swarmsim.core.errors import InputError, lacks, nearest
from swarmsim.core.own import is_failure, told
from swarmsim.core.seams import SEAMS

_OWN_CODE: ContextVar[bool] = ContextVar("own code", default=False)


@contextmanager
def own_code(allowed: bool) -> Iterator[None]:
    """Whether a scenario may name its own code within this context: `./file.py:Name` or `module:Name`."""
    token = _OWN_CODE.set(allowed)
    try:
        yield
    finally:
        _OWN_CODE.reset(token)


def own_code_is_allowed() -> bool:
    """Whether the present context lets scenarios name their own code."""
    return _OWN_CODE.get()


def entries(seam: str) -> dict[str, EntryPoint]:
    """The entry points of all installed parts for a seam, by name."""
    return distributions.parts().get(seam, {})


def known(seam: str) -> dict[str, type[msgspec.Struct]]:
    """The parameter structs of all installed parts for a seam, by name."""
    return {name: find(seam, name) for name in entries(seam)}


def find(seam: str, use: str) -> type[msgspec.Struct]:
    """The parameter struct of the part called `use`.

    That is an entry point's name or, where own code is allowed, "./file.py:Name" or "module:Name". Raises InputError
    for an unknown name.
    """
    if ":" in use:
        if not own_code_is_allowed():
            raise InputError(
                f"use: {use!r} is the scenario's own code, which runs only with permission; expected --allow-code "
                "(in Python allow_code=True) if you trust it, or the name of an installed part"
            )
        return _own(snapshot.present(), seam, use)
    return _installed(seam, use)


@lru_cache(maxsize=256)
def _installed(seam: str, use: str) -> type[msgspec.Struct]:
    if use in entries(seam):
        try:
            return _part(seam, use, entries(seam)[use].load())
        except ModuleNotFoundError as problem:
            raise lacks(f"use: the {seam} {use!r}", problem) from problem
    raise InputError(f"use: no {seam} is called {use!r}; {nearest(use, entries(seam))}")


@lru_cache(maxsize=256)
def _own(code: Snapshot, seam: str, use: str) -> type[msgspec.Struct]:
    place, _, name = use.rpartition(":")
    try:
        module = code.load(place)
        found = getattr(module, name, None)
    except BaseException as problem:  # user code may raise anything on import
        if not is_failure(problem):
            raise
        why = told(problem) if not isinstance(problem, OSError) else problem
        raise InputError(f"use: {use!r} cannot be imported; expected './file.py:Name' or 'module:Name': {why}") from (
            problem
        )
    if found is None:
        there = {one: kind for one, kind in vars(module).items() if getattr(kind, "__module__", "") == module.__name__}
        raise InputError(f"use: {place!r} has no {name!r}; {nearest(name, there)}")
    part = _part(seam, use, found)
    code.makes(part)
    return part


def _part(seam: str, use: str, found: object) -> type[msgspec.Struct]:
    """The parameter struct behind what `use` names; a simpler form is adapted to its seam."""
    of_seam = SEAMS[seam]
    if isinstance(found, type) and issubclass(found, msgspec.Struct):
        is_part = not of_seam.missing(found)  # which needs nothing of a run to be built from
        if is_part or callable(getattr(found, "build", None)):
            return found
    simpler = adapted(found, of_seam.function, of_seam.mind)
    if simpler is None:
        raise InputError(
            f"use: {use!r} is not a {seam}: expected a msgspec.Struct with a method 'build', or with "
            f"{', '.join(of_seam.verbs)} of its own, or one of the simpler forms: a function or, for minds, a class "
            "with a method 'step(self, me)'"
        )
    return simpler


def author_of(part: object) -> type:
    """The class or function that the author of this part or parameter struct wrote."""
    return part if isinstance(part, type) else getattr(part, "written_by", type(part))


def is_ours(part: object) -> bool:
    """Whether a part, or a parameter struct, belongs to this package; others are checked against their contracts."""
    return str(author_of(part).__module__).split(".")[0] == "swarmsim"


def is_own(kind: object) -> bool:
    """Whether a class or function is in a file that a scenario names."""
    return str(kind.__module__).startswith(snapshot.PREFIX)
