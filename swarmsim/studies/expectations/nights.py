"""Evidence that goes on from night to night, on new seeds, as long as the swarm behaves the same."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Final

from swarmsim.core.errors import InputError, StorageError

ALIKE: Final = 3  # whole runs, of the seeds 1, 2, ..., whose digests say whether a swarm behaves the same
TABLE: Final = """
create table if not exists outcomes (
    number integer primary key autoincrement,
    expectation text not null,
    behaviour text not null,
    night text not null,
    seed integer not null,
    met integer not null,
    unique (expectation, behaviour, seed)
);
"""


class Nights:
    """The outcomes of all nights, in their order, in one SQLite file."""

    def __init__(self, path: Path, night: str) -> None:
        """Open or create the file. `night` is tonight's date or number. Raises InputError, and StorageError."""
        self.night, self._path = night, path
        with self._told():
            path.parent.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(path)
            self._base.executescript(TABLE)

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.DatabaseError as problem:
            if "not a database" in str(problem) or "no such column" in str(problem):
                raise InputError(
                    f"{self._path}: not a store of nights ({problem}); expected an SQLite file"
                ) from problem
            raise StorageError(f"{self._path}: cannot be read or written ({problem})") from problem

    def before(self, expectation: str, behaviour: str) -> list[bool]:
        """The outcomes of other nights with this behaviour; those with any other are forgotten.

        Evidence that many runs were good would hide for as long that a change has made them bad.
        """
        with self._told(), self._base:
            self._base.execute(
                "delete from outcomes where expectation = ? and behaviour != ?", (expectation, behaviour)
            )
            rows = self._base.execute(
                "select met from outcomes where expectation = ? and night != ? order by number",
                (expectation, self.night),
            )
            return [bool(met) for (met,) in rows]

    def keep(self, expectation: str, behaviour: str, outcomes: Sequence[tuple[int, bool]]) -> None:
        """Add tonight's outcomes, each with its seed; those that are there stay."""
        with self._told(), self._base:
            self._base.executemany(
                "insert or ignore into outcomes (expectation, behaviour, night, seed, met) values (?, ?, ?, ?, ?)",
                [(expectation, behaviour, self.night, seed, int(met)) for seed, met in outcomes],
            )

    def seeds(self, behaviour: str) -> Iterator[int]:
        """Tonight's seeds, drawn by the behaviour and the night."""
        for number in count():
            text = f"{behaviour} {self.night} {number}".encode()
            yield int.from_bytes(hashlib.blake2b(text, digest_size=8).digest()) >> 1

    def close(self) -> None:
        self._base.close()

    def __enter__(self) -> Nights:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
