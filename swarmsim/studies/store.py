"""A study's results so far: SQLite, one row per run, written as the run ends."""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError, StorageError, is_of_the_machine

FORMAT = 2
AT_ONCE = 900  # identities in one query: older SQLite takes 999 at most
TABLES = """
create table if not exists runs (
    identity text primary key,
    condition text not null,
    seed integer not null,
    status text not null check (status in ('finished', 'not finished', 'failed')),
    iterations integer,
    summary text not null,
    curve blob,
    digest text,
    versions text not null,
    seconds real not null,
    message text,
    asks text not null default '',
    code text not null default '{}',
    kept real not null default 0
) without rowid;
"""
#: Columns that a store of format 1 lacks; the code of its rows is unknown.
ADDED = (
    "alter table runs add column asks text not null default ''",
    "alter table runs add column code text not null default '{}'",
    "alter table runs add column kept real not null default 0",
)


@dataclass(frozen=True, slots=True)
class Row:
    """One completed run."""

    identity: str  # a hash of everything that the run depends on
    condition: str
    seed: int
    status: str  # finished, not finished or failed
    iterations: int | None  # None where it failed
    summary: dict[str, float | int | None]  # measures by name
    curve: NDArray[np.float32] | None  # (t,): the task's measure after each iteration
    digest: str | None
    versions: dict[str, str]
    seconds: float  # of wall clock
    message: str | None  # of a failure, with the command that repeats it
    asks: str = ""  # a hash of the request, independent of code
    code: dict[str, str] = field(default_factory=dict)  # a hash of each piece of code that made it


class Store:
    """One study's rows in one file; `add` returns when its row is on disk."""

    def __init__(self, path: Path) -> None:
        """Open or create the file. Raises InputError, and StorageError for a full disk."""
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(path)
            self._base.execute("pragma journal_mode = wal")
            found = self._base.execute("pragma user_version").fetchone()[0]
            if found not in (0, 1, FORMAT):
                raise InputError(f"{path}: a store of format {found}; this swarmsim reads format {FORMAT}")
            if found == 1:
                self._add_columns()
            self._base.executescript(TABLES)
            self._base.execute(f"pragma user_version = {FORMAT}")
        except (sqlite3.Error, OSError, ValueError) as problem:  # ValueError: names that are not UTF-8
            if _of_the_machine(problem):
                raise StorageError(f"{path}: cannot be written ({problem})") from problem
            raise InputError(f"{path}: not a store of results ({problem}); expected an SQLite file") from problem

    def _add_columns(self) -> None:
        with self._base:
            self._base.execute("begin immediate")
            if self._base.execute("pragma user_version").fetchone()[0] == 1:  # no other process did it meanwhile
                for change in ADDED:
                    self._base.execute(change)
                self._base.execute(f"pragma user_version = {FORMAT}")

    def add(self, row: Row) -> None:
        """Add a run; an existing one stays unchanged unless it failed.

        Raises StorageError if it cannot be written; earlier rows are kept.
        """
        curve = None if row.curve is None else row.curve.astype("<f4").tobytes()
        values = (
            row.identity, row.condition, row.seed, row.status, row.iterations, json.dumps(row.summary), curve,
            row.digest, json.dumps(row.versions), row.seconds, row.message, row.asks, json.dumps(row.code), time.time(),
        )  # fmt: skip
        try:
            with self._base:
                self._base.execute("delete from runs where identity = ? and status = 'failed'", (row.identity,))
                marks = ", ".join("?" * len(values))
                self._base.execute(f"insert or ignore into runs values ({marks})", values)
        except sqlite3.Error as problem:
            raise StorageError(f"{self.path}: cannot be written ({problem}); the runs before are kept") from problem

    def rows(self, identities: Iterable[str]) -> dict[str, Row]:
        """The stored rows among the requested runs, by identity. Raises InputError if one is damaged."""
        wanted = list(dict.fromkeys(identities))
        found: dict[str, Row] = {}
        for start in range(0, len(wanted), AT_ONCE):
            some = wanted[start : start + AT_ONCE]
            marks = ", ".join("?" * len(some))
            found |= {row.identity: row for row in self._read(f"where identity in ({marks}) order by identity", some)}
        return found

    def every(self) -> dict[str, Row]:
        """All stored rows, by identity. Raises InputError if one is damaged."""
        return {row.identity: row for row in self._read("order by identity")}

    def of_other_code(self, asked: Mapping[str, str]) -> dict[str, Row]:
        """Other code's latest successful run, by request; `asked` has the present code's identities.

        Raises InputError if one is damaged.
        """
        rows = self._read("where asks != '' and status != 'failed' order by kept, identity")
        return {row.asks: row for row in rows if row.asks in asked and row.identity != asked[row.asks]}

    def _read(self, which: str, of: Sequence[str] = ()) -> list[Row]:
        try:
            return [_row(values) for values in self._base.execute(f"select * from runs {which}", of)]
        except (sqlite3.Error, ValueError, TypeError, msgspec.ValidationError) as problem:
            if _of_the_machine(problem):
                raise StorageError(f"{self.path}: cannot be read ({problem})") from problem
            raise InputError(
                f"{self.path}: a run in it is damaged ({str(problem)[:100]}); expected an intact store: "
                "restore an earlier copy, or delete it and repeat the study"
            ) from problem

    def close(self) -> None:
        self._base.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _of_the_machine(problem: Exception) -> bool:
    """Whether SQLite or the system reports a full or broken disk."""
    kind = getattr(problem, "sqlite_errorcode", 0) & 0xFF  # Python's own errors lack it
    return kind in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR) or is_of_the_machine(problem)


def _row(values: tuple[Any, ...]) -> Row:
    names = [field.name for field in fields(Row)]
    read = dict(zip(names, values, strict=False))  # the rest is when it was kept
    curve = read.pop("curve")
    read |= {
        "summary": json.loads(read["summary"]),
        "versions": json.loads(read["versions"]),
        "curve": None,
        "code": json.loads(read["code"]),
    }
    return replace(msgspec.convert(read, Row), curve=None if curve is None else np.frombuffer(curve, "<f4"))
