"""The modules that a text's import statements name."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from importlib.util import resolve_name


def imported(text: bytes, package: str) -> Iterator[str]:
    """Every module that a Python text may import, anywhere in it, since functions import late.

    A name imported from a module may itself be a module, so both are listed. Relative names are resolved from
    `package`; a text that cannot be parsed names none, and fails when it is run.
    """
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            try:
                base = resolve_name("." * node.level + (node.module or ""), package)
            except ImportError:  # beyond the package; fails when it is run
                continue
            yield from (base, *(f"{base}.{alias.name}" for alias in node.names))
