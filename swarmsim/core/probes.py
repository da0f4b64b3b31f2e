"""Declarations of probes and jobs: the tables they add to a recording, how often, and how pictures show them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Final, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import own
from swarmsim.core.drawing import LARGEST

NAME: Final = r"^[a-z][a-z0-9_]{0,40}$"  # names become tables, keys and columns
Name = Annotated[str, Meta(pattern=NAME)]
Word = Annotated[str, Meta(max_length=200)]
Side = Annotated[int, Meta(ge=0, le=100_000)] | Literal["robots"]
Row = NDArray[np.generic]  # type and shape as its table declares
Every = Annotated[int, Meta(ge=1, le=100_000)]
ONCE: Final = 100_000  # iterations between samples of what does not change
PIECES: Final = 1 << 16
#: How pictures show a table. Of the lattice (rows, columns): a `field` of numbers, NaN where there is none; the number
#: of the piece that a cell is in, -1 for none (`pieces`). Of these pieces (p,): the robots that are their `holders`,
#: NOBODY, or GONE. Of the robots: a number each (`robots`); the robots (n, k) that each has got something from, -1 for
#: none (`links`); where each takes something to be, and a standard deviation (n, 3), in m (`places`). And
#: where something is that all see in pictures alone (k, 2), in m, NaN while it is not there (`spots`).
Drawn = Literal["", "field", "pieces", "holders", "robots", "links", "places", "spots"]
NOBODY, GONE = -1, -2  # no robot computes a piece; and none has a state of it


class ProbeTable(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One table of a probe: the form of its rows. A side of `robots` has an entry for each robot."""

    name: Name
    dtype: Literal["u1", "i4", "i8", "f4", "f8", "?"] = "f8"
    shape: Annotated[tuple[Side, ...], Meta(max_length=4)] = ()
    unit: Word = ""
    meaning: Word = ""
    low: float = -math.inf  # numbers lie within, both ends included; NaN may stand where there is none
    high: float = math.inf
    columns: Annotated[tuple[Word, ...], Meta(max_length=100)] = ()  # what its last side holds
    every: Annotated[int, Meta(ge=0, le=ONCE)] = 0  # iterations from one sample to the next; 0: as the others
    drawn: Drawn = ""

    def row(self, found: object, robots: int) -> Row:
        """A copy of a probe's row. Raises ValueError, which says what is wrong, for an invalid one."""
        shape = tuple(robots if side == "robots" else side for side in self.shape)
        try:
            given = own.array_of(found, *shape)
        except ValueError as problem:
            raise ValueError(f"{self.name!r} is {problem}; expected numbers of shape {shape}") from None
        if np.any(np.less(given, self.low) | np.greater(given, self.high)):
            raise ValueError(f"{self.name!r} is not within {self.low:g} and {self.high:g}, as declared")
        with np.errstate(all="ignore"):
            kept = given.astype(self.dtype)
        if kept.dtype.kind != "f" and not (kept == given).all():
            raise ValueError(f"{self.name!r} has numbers that {kept.dtype} cannot hold")
        return kept


class Sampled(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys of every probe; parameters of probes derive from it."""

    name: Name  # what its tables and its frame are called by
    every: Every = 1  # iterations from one sample to the next


class Declared(Struct, frozen=True, forbid_unknown_fields=True):
    """A recording's entry for one probe."""

    name: Name
    every: Every
    tables: tuple[ProbeTable, ...]

    def called(self, table: ProbeTable) -> str:
        """The name of a table in the recording."""
        return f"{self.name}.{table.name}"

    def due(self, table: ProbeTable) -> int:
        """The iterations from one sample of a table to the next; the first is of iteration 0."""
        return table.every or self.every

    def samples(self, iterations: int) -> int:
        """The number of samples after this many iterations, of tables without a rate of their own."""
        return -(-iterations // self.every)


def wrong_picture(table: ProbeTable, cells: tuple[int, int], robots: int) -> str | None:
    """Why pictures on a lattice of so many rows and columns cannot show a table as it says, or None."""
    form = table.dtype, table.shape, table.low, table.high
    match table.drawn:
        case "field":
            expected, fits = f"f4 or f8 of shape {cells}", table.dtype[0] == "f" and table.shape == cells
        case "pieces":
            expected, fits = f"i4 of shape {cells}, from -1", form[:3] == ("i4", cells, -1.0) and table.high < PIECES
        case "holders":
            expected = f"i4 of shape (pieces,), from {GONE} to {robots - 1}"
            fits = table.dtype == "i4" and table.shape not in ((), ("robots",)) and form[2:] == (GONE, robots - 1)
            fits = fits and len(table.shape) == 1
        case "robots":
            expected, fits = "shape ('robots',)", table.shape == ("robots",)
        case "links":
            expected = f"i4 of shape ('robots', k), from -1 to {robots - 1}"
            fits = table.dtype == "i4" and table.shape[:1] == ("robots",) and len(table.shape) == 2
            fits = fits and form[2:] == (-1.0, robots - 1)
        case "places":
            expected = f"f8 of shape ('robots', 3), within {LARGEST:g}"
            fits = form[:2] == ("f8", ("robots", 3)) and max(-table.low, table.high) <= LARGEST
        case "spots":
            expected = f"f8 of shape (k, 2), within {LARGEST:g}"
            fits = table.dtype == "f8" and table.shape[0:1] != ("robots",) and table.shape[1:] == (2,)
            fits = fits and max(-table.low, table.high) <= LARGEST
        case _:
            return None
    return None if fits else f"{table.name!r} is drawn as {table.drawn}; expected {expected}"


def wrong(found: object, tables: tuple[ProbeTable, ...], robots: int) -> str | None:
    """What is wrong with a sample of these tables, or None."""
    if not isinstance(found, Mapping):
        return f"sample gave {own.brief(found)}; expected a row for each of its tables, by name"
    names = [one.name for one in tables]
    if set(found) != set(names):
        return f"sample gave {', '.join(map(repr, found)) or 'nothing'}; expected {', '.join(map(repr, names))}"
    try:
        for one in tables:
            one.row(found[one.name], robots)
    except ValueError as problem:
        return f"sample gave what it does not declare: {problem}"
    return None
