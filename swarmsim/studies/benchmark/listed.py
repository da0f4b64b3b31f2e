"""Structs as the lines of a CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

import msgspec
from msgspec import Struct

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.files import content

R = TypeVar("R", bound=Struct)


def read_lines(path: Path, kind: type[R]) -> list[R]:
    """The lines of a CSV file as structs; an empty cell is None, or an empty text. Raises InputError."""
    text = content(path, "a CSV file of a set of tasks").decode("utf-8-sig", "replace")
    try:
        rows = list(csv.reader(io.StringIO(text), strict=True))
    except csv.Error as problem:
        raise InputError(f"{path}: not CSV: {problem}") from problem
    names = [field.name for field in msgspec.structs.fields(kind)]
    if not rows or rows[0] != names:
        raise InputError(f"{path}: line 1: expected the columns {', '.join(names)}")
    found = []
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise InputError(f"{path}: line {number}: {len(row)} cells; expected {len(names)}")
        texts = {"file", "ways"}
        table = {name: cell if cell or name in texts else None for name, cell in zip(names, row, strict=True)}
        try:
            found.append(msgspec.convert(table, kind, strict=False))
        except msgspec.ValidationError as problem:
            raise InputError(f"{path}: line {number}: {problem}") from problem
    return found


def lines_of(rows: Iterable[Struct], kind: type[Struct]) -> str:
    """Structs as the text of a CSV file that `read_lines` reads."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([field.name for field in msgspec.structs.fields(kind)])
    writer.writerows([_cell(value) for value in msgspec.structs.astuple(row)] for row in rows)
    return out.getvalue()


def _cell(value: object) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
