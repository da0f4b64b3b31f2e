"""Functions and files are short. The counts of long ones may only fall."""

from __future__ import annotations

import ast

import pytest
from conftest import ROOT

FUNCTION, FILE = 40, 300  # lines, docstring and all
MOST_LONG_FUNCTIONS = 43
MOST_LONG_FILES = 28

CODE = {file: file.read_text(encoding="utf-8") for file in sorted((ROOT / "swarmsim").rglob("*.py"))}


def long_functions(code: str) -> list[tuple[str, int]]:
    """The functions with more lines than FUNCTION, each with its count."""
    defined = [one for one in ast.walk(ast.parse(code)) if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)]
    sizes = [(one.name, (one.end_lineno or 0) - one.lineno + 1) for one in defined]
    return [(name, lines) for name, lines in sizes if lines > FUNCTION]


def test_no_more_functions_are_long() -> None:
    found = {f"{file.relative_to(ROOT)}: {name}": n for file, code in CODE.items() for name, n in long_functions(code)}
    assert len(found) <= MOST_LONG_FUNCTIONS, sorted(found.items(), key=lambda one: -one[1])


def test_no_more_files_are_long() -> None:
    sizes = {str(file.relative_to(ROOT)): code.count("\n") for file, code in CODE.items()}
    found = {file: lines for file, lines in sizes.items() if lines > FILE}
    assert len(found) <= MOST_LONG_FILES, sorted(found.items(), key=lambda one: -one[1])


@pytest.mark.parametrize(("lines", "found"), [(40, []), (41, [("f", 41)])])
def test_lines_of_a_function_are_counted(lines: int, found: list) -> None:
    assert long_functions("def f():\n" + "    pass\n" * (lines - 1)) == found
