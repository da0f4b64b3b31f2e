"""Mapping is one operation of many: no shared folder knows it by name."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT

PACKAGE = ROOT / "swarmsim"
#: The operations themselves; commands, pictures and texts, which may be maps; and drawings of buildings.
SPECIAL = {"operations", "cli", "api", "view", "studies", "kernels", "world"}
ROOMS = sorted(path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file() and path.name not in SPECIAL)
WORD = re.compile(
    r"maps|mapping|sharing|coverage|covered|frontiers?|occupancy-?grids?|nearest-frontier|tileitems", re.IGNORECASE
)
#: Exceptions, with reasons.
EXCEPT = {
    "core/renamed.py": "old names lead to the new ones",
    "core/scenario/file.py": "keys of older scenarios lead to the new ones",
    "core/seams.py": "scenarios that name no mind and no task map",
    "faults/people.py": "the path-planning kernel names its argument so",
    "recording/layout.py": "tables that pictures use as indices have bounds",
}


def named(tree: ast.Module) -> Iterator[str]:
    """All names and texts of a file, without comments and docstrings."""
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    first = [node.body[0] for node in ast.walk(tree) if isinstance(node, kinds) and node.body]
    told = {id(node.value) for node in first if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            yield node.value
        for field in ("id", "attr", "arg", "name"):
            name = getattr(node, field, None)
            if isinstance(name, str) and name not in ("Mapping", "collections.abc"):
                yield name


def words(path: Path) -> set[str]:
    """The mapping words that a file uses."""
    found = (piece for name in named(ast.parse(path.read_text())) for piece in re.findall("[A-Za-z-]+", name))
    return {piece for piece in found if WORD.fullmatch(piece)}


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_that_serves_all_operations_does_not_know_mapping_by_name(room: str) -> None:
    files = sorted((PACKAGE / room).rglob("*.py"))
    found = {str(path.relative_to(PACKAGE)): words(path) for path in files}
    assert {name: known for name, known in found.items() if known and name not in EXCEPT} == {}


def test_no_exception_is_without_need() -> None:
    assert [name for name in EXCEPT if not words(PACKAGE / name)] == []
