"""The layout of a recording's file: its tables' names, types and shapes, and the numbers they may hold."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.probes import Declared
from swarmsim.core.readings import NAME, Channels, Column

if TYPE_CHECKING:
    import h5py

EACH, MANY, ONCE = "each", "many", "once"  # one row for each iteration; many, with their ends in NAME_end; neither
FAR: Final = 1e7  # m or cells: limit of coordinates
MOST: Final = 1 << 33  # bytes of a table
DENSEST: Final = 1100  # greatest compression ratio of deflate (RFC 1951)
SMALL: Final = 1 << 26  # bytes, up to which compression is not checked


class Stored(Protocol):
    """A table of an HDF5 file."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Its rows, then the shape of one."""
        ...

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """The type of its numbers."""
        ...

    @property
    def id(self) -> Identifier:
        """Its HDF5 identifier."""
        ...

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice | tuple[()]) -> Column: ...


class Identifier(Protocol):
    """A table's HDF5 identifier."""

    def get_storage_size(self) -> int:
        """Its size in the file, in bytes."""
        ...


@dataclass(frozen=True, slots=True)
class Table:
    """One table: its type and the shape of its rows, with words for sizes that the recording gives."""

    kind: str
    row: tuple[int | str, ...]
    rows: str
    #: Bounds of its numbers, or of each column's, both ends included; words as in `row`.
    low: tuple[float, ...] = ()
    high: tuple[float | str, ...] = ()
    blank: float | None = None  # allowed besides, as is NaN; None: nothing else
    by: str = ""  # the seam whose parts may write it in this form; empty: only the recording
    every: int = 1  # of EACH: iterations from one row to the next


TABLES: Final = {
    "world": Table("u1", (), ONCE),
    "domain": Table("?", ("columns",), ONCE),
    "truth": Table("?", ("columns",), ONCE),
    "digests": Table("u1", ("fields", 8), EACH),
    "pose": Table("f8", ("robots", 3), EACH, (-FAR,) * 3, (FAR,) * 3),
    "believed": Table("f8", ("robots", 3), EACH, (-FAR,) * 3, (FAR,) * 3),
    "people": Table("f8", ("any", 3), EACH, (-FAR, -FAR, 0.0), (FAR,) * 3),
    "alive": Table("?", ("robots",), EACH),
    "messages": Table("i8", (), EACH, (0.0,), (float(2**62),)),
    "progress": Table("f8", (), EACH, (0.0,), (1.0,)),
    "tiles": Table("u1", ("robots", "any", "any"), EACH, (0.0,), (2.0,), by="sensor"),
    "origins": Table("i4", ("robots", 2), EACH, (-FAR,) * 2, (FAR,) * 2, by="sensor"),
    "samples": Table("f8", ("robots",), EACH, by="sensor"),
    "goals": Table("f8", ("robots", 2), EACH, (-FAR,) * 2, (FAR,) * 2, math.nan),
    "twists": Table("f8", ("robots", "any"), EACH),
    "links": Table("i4", (2,), MANY, (0.0, 0.0), ("last robot",) * 2),
    "letters": Table("i4", (5,), MANY, (0.0,) * 5, ("last robot", "last robot", 2e9, 2e9, "last fate")),
    "changes": Table("i4", (3,), MANY, (0.0,) * 3, ("last robot", "last cell", 2.0), by="computation"),
    "heading": Table("f8", ("robots",), EACH, by="computation"),
    "covered": Table("f8", ("robots",), EACH, by="task"),
    "fates": Table("S32", (), ONCE),
    "waypoints": Table("f4", (2,), ONCE, (-FAR,) * 2, (FAR,) * 2),
    "paths": Table("i8", (3,), ONCE, (0.0,) * 3, (2e9, "last robot", "waypoints")),
    "events": Table("u1", (), ONCE),
}
#: Tables in the form of older recordings.
OLDER: Final = {
    "goals": Table("i4", ("robots", 2), EACH, (-1.0, -1.0), ("last row", "last column")),
}
#: The tables of every recording of a run that has begun.
NEEDED: Final = (
    "pose",
    "alive",
    "messages",
    "progress",
    "goals",
    "links",
    "letters",
    "fates",
    "waypoints",
    "paths",
    "events",
)
#: The file's text attributes: TOML, JSON, or words.
TEXTS: Final = ("versions", "scenario", "digested", "measures", "rows", "curve")
BEFORE: Final = ("world", "domain", "truth", "digests")  # present even before


def declared_by(probes: Iterable[Declared]) -> dict[str, Table]:
    """The tables of probes, by name. Raises ValueError for a name that is taken."""
    found: dict[str, Table] = {}
    for probe in probes:
        for one in probe.tables:
            name = probe.called(one)
            if name in found or wrong_name(name, "probe"):
                raise ValueError(f"table {name!r} is declared by a probe, and is something else already")
            low, high = ((one.low,), (one.high,)) if (one.low, one.high) != (-math.inf, math.inf) else ((), ())
            found[name] = Table(np.dtype(one.dtype).str[1:], one.shape, EACH, low, high, every=probe.due(one))
    return found


def wrong_name(name: object, seam: str) -> str | None:
    """Why a part of this seam cannot use a table's name, with an alternative; or None."""
    if not isinstance(name, str) or not name.isprintable() or not name.strip(".") or "/" in name:
        return f"{name!r} cannot be the name of a table; expected a word such as 'energy'"
    if name.endswith("_end"):
        return (
            f"{name!r} ends as the tables that tell where rows of others end; expected such as {name[:-4] + '_last'!r}"
        )
    if name not in TABLES or TABLES[name].by == seam:
        return None
    others = ", ".join(sorted(one for one, table in TABLES.items() if table.by != seam))
    return f"{name!r} names a table of the recording's own; expected another name, as 'own_{name}' (taken: {others})"


def wrong_form(name: str, row: NDArray[np.generic], rows: str, robots: int) -> str | None:
    """Why a row of this type and shape cannot be recorded in a table with EACH or MANY rows, or None."""
    if row.dtype.kind not in "fiub":
        return f"{name!r} is of {row.dtype}; expected numbers"
    table = TABLES.get(name)
    if table is None:
        return None
    shape = _sizes(table.row, (0, *row.shape), {"robots": robots})
    if (row.dtype, row.shape, rows) == (np.dtype(table.kind), shape, table.rows):
        return None
    many = ", as many as there are" if table.rows == MANY else ""
    return f"{name!r} is {row.dtype} of shape {row.shape}; expected {np.dtype(table.kind)} of {shape}{many}"


def attribute(file: h5py.File, name: str, kinds: str, shape: tuple[int, ...] = ()) -> NDArray[np.generic]:
    """An attribute of an HDF5 file, as an array.

    Raises ValueError unless it exists with one of these numpy kinds and this shape. Texts have fixed length, since
    damaged variable ones can keep HDF5 busy for ever.
    """
    if name not in file.attrs:
        raise ValueError(f"attribute {name!r} is missing")
    found = file.attrs.get_id(name)
    if found.dtype.kind not in kinds or found.shape != shape:
        raise ValueError(f"attribute {name!r} is {found.dtype} of shape {found.shape}")
    return np.asarray(file.attrs[name])


def text(file: h5py.File, name: str, default: bytes | None = None) -> bytes:
    """A text attribute. Raises ValueError if it is missing without a `default`."""
    if default is not None and name not in file.attrs:
        return default
    return bytes(attribute(file, name, "S").item())


def tables_of(channels: Channels, seam: str) -> dict[str, Table]:
    """The tables that parts of a seam declare, besides those with a fixed form.

    Raises ValueError for a name unfit for a table.
    """
    found: dict[str, Table] = {}
    for channel in channels:
        name = channel.recorded_as
        if not name or (name in TABLES and TABLES[name].by == seam):
            continue
        wrong = wrong_name(name, seam) or (f"{name!r} appears twice" if name in found else None)
        if wrong or not re.fullmatch(NAME, name):
            raise ValueError(f"the declaration of channels: {wrong or f'{name!r} cannot be the name of a table'}")
        bounded = channel.dtype != "?" and (channel.low, channel.high) != (-math.inf, math.inf)
        low, high = ((channel.low,), (channel.high,)) if bounded else ((), ())
        found[name] = Table(channel.dtype, ("robots", *channel.shape), EACH, low, high, channel.empty)
    return found


def check(
    file: Mapping[str, Stored], sizes: dict[str, int], measures: list[str], rows: set[str], declared: dict[str, Table]
) -> None:
    """Raise ValueError, which names the table and what is wrong with it, unless all tables are valid.

    `file` is an HDF5 file, `sizes` the words' values; `rows` are the tables that claim a row for each iteration,
    `measures` the task's among them, `declared` those of probes and sensors.
    """
    tables = {**TABLES, **declared}
    begun = "pose" in file
    for name in (*BEFORE, *((*NEEDED, *declared) if begun else ()), *rows, *measures):
        if name not in file:
            raise ValueError(f"table {name!r} is missing")
    for name, found in file.items():
        if not hasattr(found, "shape") or found.shape is None:
            raise ValueError(f"{name!r} is no table")
        _check_size(name, found)
        if name.endswith("_end"):
            _expect(name, found, np.dtype("i8"), (found.shape[0] if found.shape else 0,))
        elif name in tables:
            table = _form(name, found.dtype, tables)
            _expect(
                name, found, np.dtype(table.kind), (found.shape[:1] or (0,)) + _sizes(table.row, found.shape, sizes)
            )
            if table.rows == MANY and f"{name}_end" not in file:
                raise ValueError(f"table '{name}_end' is missing")
            if table.rows == EACH and name not in rows and name not in declared and name != "digests":
                raise ValueError(f"table {name!r} has no row for each iteration")
        elif found.dtype.kind not in "fiub":
            raise ValueError(f"table {name!r} is of {found.dtype}, not of numbers")
    _check_rows(file, sizes["rows"], measures, rows, declared if begun else {})


def _check_rows(
    file: Mapping[str, Stored], grid_rows: int, measures: list[str], rows: set[str], declared: dict[str, Table]
) -> None:
    """Raise ValueError unless all tables have the right length."""
    for name in ("domain", "truth"):
        if file[name].shape[0] != grid_rows:
            raise ValueError(f"table {name!r} has {file[name].shape[0]} rows, and the lattice {grid_rows}")
    iterations = file["digests"].shape[0]
    for name in rows:
        if not file[name].shape or file[name].shape[0] < iterations:
            raise ValueError(f"table {name!r} has not a row for each of {iterations} iterations")
    for name, table in declared.items():
        if file[name].shape[0] < -(-iterations // table.every):
            raise ValueError(f"table {name!r} has not a row for every {table.every} of {iterations} iterations")
    for name in measures:
        if file[name].shape != file[name].shape[:1]:
            raise ValueError(f"table {name!r} is of shape {file[name].shape}; a measure is one number an iteration")


def _form(name: str, kind: np.dtype[np.generic], tables: Mapping[str, Table]) -> Table:
    """The form of a table with this number type: today's or, if its type matches, an older one."""
    older = OLDER.get(name)
    return older if older is not None and kind == np.dtype(older.kind) else tables[name]


def _check_size(name: str, found: Stored) -> None:
    size = int(np.prod(found.shape, dtype=object)) * found.dtype.itemsize
    stored = found.id.get_storage_size()
    if size > MOST or (size > SMALL and size > DENSEST * max(stored, 1)):
        raise ValueError(f"table {name!r} would have {size} bytes from {stored} in the file; expected {MOST} at most")


def _sizes(row: tuple[int | str, ...], shape: tuple[int, ...], sizes: dict[str, int]) -> tuple[int, ...]:
    """The shape that a row should have; free sizes are taken as found."""
    given = [*shape[1:], *[0] * len(row)]
    return tuple(sizes.get(one, given[axis]) if isinstance(one, str) else one for axis, one in enumerate(row))


def _expect(name: str, found: Stored, kind: np.dtype[np.generic], shape: tuple[int, ...]) -> None:
    if found.dtype != kind or found.shape != shape:
        raise ValueError(f"table {name!r} is {found.dtype} of shape {found.shape}, not {kind} of {shape}")


def check_values(name: str, rows: NDArray[Any], sizes: dict[str, int], declared: dict[str, Table]) -> None:
    """Raise ValueError, which names the table, for invalid numbers; `sizes` and `declared` as for `check`."""
    if name.endswith("_end"):
        if len(rows) and (rows[0] < 0 or (np.diff(rows) < 0).any()):
            raise ValueError(f"table {name!r} does not rise")
        return
    tables = {**TABLES, **declared}
    if name not in tables or not tables[name].low or rows.size == 0:
        return
    table = _form(name, rows.dtype, tables)
    low = np.array(table.low)
    high = np.array([sizes.get(one, 0) if isinstance(one, str) else one for one in table.high])
    lacks = name in declared or table.blank is not None  # and may be NaN
    outside = (rows < low) | (rows > high) if lacks else ~((rows >= low) & (rows <= high))  # NaN fails both
    if table.blank is not None:
        outside &= rows != table.blank
    if outside.any():
        raise ValueError(f"table {name!r} has invalid numbers; expected {low.tolist()} to {high.tolist()}")
