"""Reads tables from TOML texts, even hostile ones."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Final

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.budget import begin, reading
from swarmsim.core.scenario.files import Table, content

DEEPEST: Final = 20  # nested tables and lists, and names in a dotted key
TOO_DEEP: Final = f"tables or lists are nested more than {DEEPEST} deep"
_NAME: Final = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_DOTTED: Final = re.compile(rf"(?<![\w-])(?:{_NAME}\.[ \t]*){{{DEEPEST}}}")


def read_toml(path: Path, expected: str) -> Table:
    """The table in a TOML file. Raises InputError, which names what was `expected`."""
    try:
        text = content(path, expected).decode("utf-8-sig")  # editors may mark UTF-8 in the first bytes
    except UnicodeDecodeError as problem:
        raise InputError(f"{path}: not UTF-8 text (byte {problem.start}); expected {expected}") from problem
    try:
        return parsed(text)
    except ValueError as problem:
        raise InputError(f"{path}: not valid TOML: {problem}") from problem


def parsed(text: str) -> Table:
    """The table in a TOML text. Raises ValueError for text that tomllib cannot read, or not in reasonable time."""
    begin(reading(len(text)))
    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > DEEPEST and _DOTTED.search(line):
            raise ValueError(f"line {number} has a key of more than {DEEPEST} names with dots between them")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as problem:  # from Python's limit on integers
        raise ValueError("a number in it has thousands of digits") from problem
    except RecursionError as problem:
        raise ValueError(TOO_DEEP) from problem
    level: list[object] = [table]
    for _ in range(DEEPEST + 1):
        tables = [one for one in level if isinstance(one, dict | list)]
        level = [inner for one in tables for inner in (one.values() if isinstance(one, dict) else one)]
    if level:
        raise ValueError(TOO_DEEP)
    return table
