"""Which modules the import statements of a text name."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from importlib.util import resolve_name


def imported(text: bytes, package: str) -> Iterator[str]:
    """Every module that a text of Python may import, wherever the statement stands: functions import late.

    What is imported from a module may be a module as well, so both are named. Relative names are resolved from
    `package`; a text that cannot be read names none, which is told when it is run.
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
            except ImportError:  # beyond the package, as it says when it is run
                continue
            yield from (base, *(f"{base}.{alias.name}" for alias in node.names))
