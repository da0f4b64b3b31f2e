"""Classes are abstract or final, and each class name stands for one thing."""

from __future__ import annotations

import ast
import inspect
import pkgutil
from collections import defaultdict
from functools import cache
from importlib import import_module
from pathlib import Path

import msgspec
from conftest import ROOT

import swarmsim
from swarmsim.core.code import distributions


@cache
def trees() -> dict[Path, ast.Module]:
    """The code of every file of the package."""
    return {file: ast.parse(file.read_text(encoding="utf-8")) for file in sorted((ROOT / "swarmsim").rglob("*.py"))}


@cache
def classes() -> set[type]:
    """All top-level classes of the package."""
    names = [one.name for one in pkgutil.walk_packages(swarmsim.__path__, "swarmsim.") if "__main__" not in one.name]
    found = [kind for name in names for kind in vars(import_module(name)).values() if inspect.isclass(kind)]
    return {kind for kind in found if kind.__module__ in names}


def called(node: ast.Call, file: Path) -> object:
    """The called name, if the file binds it; else its text."""
    text = ast.unparse(node.func).partition("[")[0]
    parts = file.relative_to(ROOT).with_suffix("").parts
    found: object = import_module(".".join(parts if parts[-1] != "__init__" else parts[:-1]))
    for name in text.split("."):
        found = getattr(found, name, text)
    return found if inspect.isclass(found) else text


@cache
def made() -> set[object]:
    """Everything that the package's code calls or registers as a part."""
    files = [(file, tree) for file, tree in trees().items() if file.name != "__main__.py"]
    calls = {called(one, file) for file, tree in files for one in ast.walk(tree) if isinstance(one, ast.Call)}
    return calls | {entry.load() for parts in distributions.parts().values() for entry in parts.values()}


def why_concrete(base: type, is_made: bool) -> str | None:
    """Why a class may have no subclasses, or None.

    A class with subclasses must be a Protocol, have ABC among its own bases, or be an exception, since `except` tells
    its kinds apart. A struct of parameters cannot be an ABC: it is abstract if it is no part itself and gives its
    keys to parts. None of these is ever instantiated.
    """
    if issubclass(base, BaseException) or getattr(base, "_is_protocol", False):
        return None
    if is_made:
        return "is made itself"
    if not issubclass(base, msgspec.Struct) and not any(one.__name__ == "ABC" for one in base.__bases__):
        return "does not say that it is abstract"
    return None


def test_classes_that_are_subclassed_are_abstract() -> None:
    bases = defaultdict(list)
    for kind in classes():
        for base in kind.__bases__:
            if base in classes():
                bases[base].append(kind.__name__)
    assert len(bases) > 10
    wrong = {base.__qualname__: why_concrete(base, bool({base, base.__name__} & made())) for base in bases}
    assert {name: why for name, why in wrong.items() if why is not None} == {}


def test_the_rule_finds_concrete_classes() -> None:
    class Plain:
        pass

    class Keys(msgspec.Struct):
        pass

    assert why_concrete(Plain, False) == "does not say that it is abstract"
    assert why_concrete(Plain, True) == why_concrete(Keys, True) == "is made itself"
    assert why_concrete(Keys, False) is None


#: Kernels' tuple of maps' arrays, beside the knowledge of mapping robots: numba's files on a user's disk name the types
#: of arguments, and numba raises an error for a missing one.
TWICE = {"Maps"}


def test_each_name_of_a_class_stands_for_one_thing() -> None:
    places = defaultdict(list)
    for file, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert {name: where for name, where in places.items() if len(where) > 1 and name not in TWICE} == {}
    assert all(len(places[name]) > 1 for name in TWICE)
