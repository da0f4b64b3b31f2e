"""The package is well typed, and its files import one another in one direction."""

from __future__ import annotations

import ast
from functools import cache

import grimp
import networkx as nx
from conftest import ROOT

PACKAGE = ROOT / "swarmsim"
MOST_ANY = 90  # in annotations and code; mypy does not check them
MOST_ASSERTS = 2  # `assert x is not None`: a better type needs none


@cache
def nodes() -> list[ast.AST]:
    """All nodes of the package's code."""
    files = sorted(PACKAGE.rglob("*.py"))
    return [node for file in files for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"), str(file)))]


def test_little_is_typed_as_any() -> None:
    assert sum(isinstance(node, ast.Name) and node.id == "Any" for node in nodes()) <= MOST_ANY


def test_few_values_have_to_be_asserted_to_be_there() -> None:
    tests = [ast.unparse(node.test) for node in nodes() if isinstance(node, ast.Assert)]
    assert sum(test.endswith("is not None") for test in tests) <= MOST_ASSERTS


def test_no_file_imports_one_that_imports_it() -> None:
    """Directly or through others, at the top, in a function, or for types alone."""
    found = grimp.build_graph("swarmsim", cache_dir=None)
    imported = {one: found.find_modules_directly_imported_by(one) for one in found.modules}
    assert [sorted(one) for one in nx.strongly_connected_components(nx.DiGraph(imported)) if len(one) > 1] == []
