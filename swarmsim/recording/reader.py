"""A recorded run, read back from its HDF5 file."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, NotRequired, TypedDict

import h5py
import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core import declarations
from swarmsim.core.errors import InputError, StorageError, is_of_the_machine, nearest
from swarmsim.core.events import Ended, Event, decoded
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Curve
from swarmsim.core.probes import Declared, Row, wrong_picture
from swarmsim.core.renamed import in_new_words
from swarmsim.core.scenario import files
from swarmsim.core.scenario.file import Scenario, shape
from swarmsim.recording import hdf5, layout
from swarmsim.recording.layout import FAR
from swarmsim.recording.measures import times_of

FORMAT_NAME: Final = "swarmsim-recording"  # the attribute with the number
FORMAT: Final = 4  # raised if an older reader would misread a newer file
READING: Final = (
    OSError,
    KeyError,
    ValueError,
    RuntimeError,
    TypeError,
    OverflowError,
    MemoryError,
    msgspec.MsgspecError,
)
READ_AHEAD: Final = 1 << 20  # rows of large tables
PENDING: Final = {True: "under way", False: "interrupted", None: "under way or interrupted"}
Column = NDArray[Any]  # a table as in the file, typed in `layout`

#: A run in a few numbers.
Summary = TypedDict(
    "Summary",
    {
        "title": str,
        "status": str,
        "iterations": int,
        "measures": dict[str, float],
        "progress": float,
        "reached": dict[str, int | None],
        "robots": int,
        "alive": int,
        "domain cells": int,
        "messages": int,
        "bytes": int,
        "lost": dict[str, int],
        "events": list[dict[str, object]],
        "seed": int,
        "digest": str,
        "versions": dict[str, str],
        "absent": NotRequired[list[str]],
    },
)


class Recording:
    """A recorded run, read back; row t of every array is iteration t, row i of that robot i."""

    def __init__(self, path: Path, file: h5py.File | None = None) -> None:
        """Open a recording, or a run's folder with one; `file` is one that this process still writes.

        Raises InputError, and StorageError for a disk that cannot be read.
        """
        self.path = path / "recording.h5" if path.is_dir() else path
        if not self.path.is_file():
            raise InputError(f"{path}: no such recording; expected a run's folder or its recording.h5")
        files.check_plain(self.path, "a run's folder or its recording.h5", None)
        self._growing = file
        self._arrays: dict[str, Column] = {}  # what has been read
        self._near: dict[str, tuple[int, Column]] = {}  # for large tables: some rows, and the first one's number
        try:
            with self._file() as opened:
                self._read(opened)
                #: The state of an unfinished run: written by this process, by another, or by none any more.
                self.pending = PENDING[True if self._growing else hdf5.being_written(self.path)]
        except READING as problem:
            raise self._damaged(problem) from problem

    @contextmanager
    def _file(self) -> Iterator[h5py.File]:
        if self._growing:  # false once the file is closed
            yield self._growing
        else:
            with hdf5.open_for_reading(self.path) as opened:
                yield opened

    def _damaged(self, problem: Exception) -> InputError | StorageError:
        told = str(problem).partition("\n")[0]
        if is_of_the_machine(problem):
            return StorageError(f"{self.path}: cannot be read ({told})")
        return InputError(
            f"{self.path}: not a whole recording ({told}); expected an HDF5 file written by 'swarmsim run'"
        )

    def _read(self, file: h5py.File) -> None:
        found = layout.attribute(file, FORMAT_NAME, "iu").item() if FORMAT_NAME in file.attrs else None
        if found != FORMAT:
            raise InputError(
                f"{self.path}: format {found if found is not None else 'unknown'}, but this swarmsim "
                f"{version('swarmsim-lab')} reads format {FORMAT}; run the scenario again, or read it with the "
                f"version that wrote it"
            )
        text: dict[str, str] = {name: layout.text(file, name).decode() for name in layout.TEXTS}
        self.versions = msgspec.json.decode(text["versions"], type=dict[str, str])
        #: A hash of each piece of code behind it; empty in recordings older than these hashes.
        self.code = msgspec.json.decode(layout.text(file, "code", b"{}"), type=dict[str, str])
        self.scenario: Scenario = shape(in_new_words(tomllib.loads(text["scenario"])), str(self.path))
        place: list[float] = layout.attribute(file, "lattice", "f", (5,)).tolist()
        x0, y0, cell, rows, columns = place
        if not (abs(x0) < FAR and abs(y0) < FAR and 0.0 < cell < FAR and 0.0 < rows < FAR and 0.0 < columns < FAR):
            raise ValueError("the lattice is invalid")
        self.lattice = Lattice(x0, y0, cell, int(rows), int(columns))
        self.digested: list[str] = text["digested"].split()
        #: The names of the task's measures of the swarm.
        self.measures = msgspec.json.decode(text["measures"], type=list[str])
        #: The task's main measure, and how it is drawn.
        self.curve = msgspec.json.decode(text["curve"], type=Curve)
        self._rows = set(msgspec.json.decode(text["rows"], type=list[str]))  # tables with one row for each iteration
        self._names = set(file)
        #: The declarations of probes, and of what jobs show.
        self.probes = msgspec.json.decode(layout.text(file, "probes", b"[]"), type=list[Declared])
        robots = self.scenario.robots.count
        for table in (table for probe in self.probes for table in probe.tables):
            if wrong := wrong_picture(table, self.lattice.shape, robots):
                raise ValueError(wrong)
        #: What nobody has recorded, in words, such as true poses, in whose place are the robots' estimates.
        self.absent = msgspec.json.decode(layout.text(file, "absent", b"[]"), type=list[str])
        #: The channels of the robots' sensors; empty in recordings older than declarations.
        self.channels = declarations.read(layout.text(file, "channels", b"[]").decode(), robots)
        #: The channels of the robots' actuators; empty without any.
        self.actuators = declarations.read(layout.text(file, "actuators", b"[]").decode(), robots)
        self._declared = {
            **layout.declared_by(self.probes), **layout.tables_of(self.actuators, "actuator"),
            **layout.tables_of(self.channels, "sensor"),
        }  # fmt: skip
        self._sizes = {
            "robots": robots, "rows": int(rows), "columns": int(columns), "fields": len(self.digested),
            "last robot": robots - 1, "last row": int(rows) - 1, "last column": int(columns) - 1,
            "last cell": int(rows) * int(columns) - 1,
        }  # fmt: skip
        layout.check(file, self._sizes, self.measures, self._rows, self._declared)
        self._sizes |= {name: len(file[name]) for name in ("waypoints",) if name in file}
        self._sizes["last fate"] = len(file["fates"]) - 1 if "fates" in file else 0
        self.iterations = len(file["digests"])
        if self.curve.name not in self.measures and self.measures:
            raise ValueError(f"the curve {self.curve.name!r} is not measured")

    def refresh(self) -> None:
        """Read newly flushed data of a recording that this process still writes; others do not grow."""
        if self._growing is None:
            return
        self._near.clear()
        for name, array in self._arrays.items():
            table: layout.Stored = self._growing[name]
            if len(table) > len(array):
                self._arrays[name] = np.concatenate([array, table[len(array) :]])
        self._sizes |= {"waypoints": len(self._growing["waypoints"]), "last fate": len(self._growing["fates"]) - 1}
        self.iterations = len(self._growing["digests"])

    def _loaded(self, name: str) -> Column:
        """A whole table, read at first use. Raises InputError for one with invalid numbers."""
        if name not in self._arrays:
            if name not in self._names and name not in layout.TABLES:
                known = dict.fromkeys(self._names)
                raise InputError(f"{self.path}: no table {name!r} is recorded; {nearest(name, known)}")
            try:
                with self._file() as file:
                    rows: Column = file[name][()]
                layout.check_values(name, rows, self._sizes, self._declared)
            except READING as problem:
                raise self._damaged(problem) from problem
            self._arrays[name] = self._as_points(rows) if name == "goals" else rows
        return self._arrays[name]

    def _as_points(self, goals: Column) -> Column:
        """Goals (t, n, 2) in m; older recordings have cells."""
        if goals.dtype.kind == "f":
            return goals
        return np.where(goals >= 0, self.lattice.centres(goals), np.nan)

    def _some(self, name: str, first: int, last: int) -> Column:
        """Rows `first` to `last` of a table, reading READ_AHEAD more with them. Raises InputError as `_loaded`."""
        start, rows = self._near.get(name, (last + 1, np.empty(0)))  # no usable rows
        if first < start or last > start + len(rows):
            try:
                with self._file() as file:
                    rows = file[name][first : max(last, first + READ_AHEAD)]
                if len(rows) < last - first:
                    raise ValueError(f"table {name!r} ends before row {last}")
                layout.check_values(name, rows, self._sizes, self._declared)
            except READING as problem:
                raise self._damaged(problem) from problem
            start, self._near[name] = first, (first, rows)
        return rows[first - start : last - start]

    def __getitem__(self, name: str) -> Column:
        """A table of the file by name, cut to whole iterations if it has rows for them."""
        array = self._loaded(name)
        if name in self._declared:
            return array[: -(-self.iterations // self._declared[name].every)]
        return array[: self.iterations] if name in self._rows else array

    def rows(self, name: str, *shape: int) -> Column:
        """A table with one row of this shape for each iteration. Raises InputError unless the file has it."""
        if name not in self._names or name not in self._rows or self[name].shape[1:] != shape:
            raise self._damaged(ValueError(f"no table {name!r} with rows of shape {shape}"))
        return self[name]

    def row(self, name: str, iteration: int) -> Column:
        """A table's row for an iteration; a probe's latest. Raises InputError for a table without such rows."""
        if name not in self._rows and name not in self._declared:
            known = dict.fromkeys([*self._rows, *self._declared])
            raise InputError(f"no table {name!r} with a row for each iteration is recorded; {nearest(name, known)}")
        row: Column = self[name][iteration // (self._declared[name].every if name in self._declared else 1)]
        return row

    def __contains__(self, name: str) -> bool:
        """Whether the file has this table."""
        return name in self._names

    @property
    def progress(self) -> NDArray[np.float64]:
        """The task's progress after each iteration (t,), 0 to 1."""
        return self["progress"]

    @cached_property
    def world(self) -> str:
        """The floor plan's SVG text."""
        try:
            return bytes(self._loaded("world")).decode()
        except UnicodeDecodeError as problem:
            raise self._damaged(problem) from problem

    def links(self, iteration: int) -> NDArray[np.int32]:
        """The links (m, 2) of one iteration: receiver, sender."""
        return self._of("links", iteration)

    def letters(self, iteration: int) -> NDArray[np.int32]:
        """The fates of messages in one iteration (m, 5): receiver, sender, iteration sent, bytes, fate."""
        return self._of("letters", iteration)

    def changes(self, iteration: int) -> NDArray[np.int32]:
        """Changed cells of the robots' maps in one iteration (c, 3): robot, row-major cell, new state."""
        return self._of("changes", iteration)

    @property
    def fates(self) -> list[str]:
        """The meanings of fate numbers: 0 is heard, all others why a message was lost."""
        return [name.decode(errors="replace") for name in self._loaded("fates")]

    def _of(self, name: str, iteration: int) -> Column:
        ends = self._loaded(f"{name}_end")
        return self._some(name, int(ends[iteration - 1]) if iteration else 0, int(ends[iteration]))

    def paths(self) -> list[tuple[int, int, NDArray[np.float32]]]:
        """Every new path: iteration, robot, and its waypoints (w, 2) in m."""
        rows, waypoints = self._loaded("paths"), self._loaded("waypoints")
        starts = np.concatenate([[0], rows[:, 2]])
        return [
            (int(iteration), int(robot), waypoints[start:end])
            for (iteration, robot, end), start in zip(rows, starts, strict=False)
        ]

    def events(self) -> list[Event]:
        """All events, in order."""
        text = self._loaded("events").tobytes() if "events" in self else b""
        try:
            found = [decoded(line) for line in text.splitlines()]
            if any(
                not 0 <= robot <= self._sizes["last robot"] for event in found for robot in getattr(event, "robots", ())
            ):
                raise ValueError("an event names a robot that does not exist")
        except (msgspec.MsgspecError, ValueError) as problem:
            raise self._damaged(problem) from problem
        return found

    def digest(self) -> str:
        """The digest of the whole run, in hexadecimal; equal for equal runs."""
        return hashlib.blake2b(self["digests"].tobytes(), digest_size=16).hexdigest()

    def difference(self, iteration: int, row: bytes, probed: Mapping[str, Row]) -> str | None:
        """The first difference of a recorded iteration from one with the digests `row` and these probe rows."""
        recorded = self["digests"][iteration].tobytes()
        for field, name in enumerate(self.digested):
            if recorded[8 * field : 8 * field + 8] != row[8 * field : 8 * field + 8]:
                return f"iteration {iteration}, field {name!r}"
        for name, sample in probed.items():
            if sample.tobytes() != self[name][iteration // self._declared[name].every].tobytes():
                return f"iteration {iteration}, table {name!r} of a probe"
        return None

    def _lost(self) -> dict[str, int]:
        """The number of lost messages, by reason."""
        return {name: int(count) for name, count in zip(self.fates[1:], self._letters[0][1:], strict=True)}

    @cached_property
    def _letters(self) -> tuple[NDArray[np.int64], int]:
        """The number of messages by fate, and the bytes of those heard."""
        counts, heard = np.zeros(len(self.fates), np.int64), 0
        with self._file() as file:
            total = len(file["letters"])
        for first in range(0, total, READ_AHEAD):
            size, fate = self._some("letters", first, min(total, first + READ_AHEAD))[:, 3:].T
            counts += np.bincount(fate, minlength=len(counts))
            heard += int(size.sum(where=fate == 0, dtype=np.int64))
        return counts, heard

    def summary(self) -> Summary:
        """The run in a few numbers, for tables and JSON."""
        events = self.events()
        ends = ["finished" if event.finished else "not finished" for event in events if isinstance(event, Ended)]
        ran = self.iterations > 0
        times = times_of(self[self.curve.name], self.curve) if ran and self.measures else {}
        found: Summary = {
            "title": self.scenario.title,
            "status": ends[-1] if ends else self.pending,
            "iterations": self.iterations,
            "measures": {name: float(self[name][-1]) for name in self.measures} if ran else {},
            "progress": float(self.progress[-1]) if ran else 0.0,
            "reached": {f"{share} %": at for share, at in times.items()},
            "robots": self.scenario.robots.count,
            "alive": int(self["alive"][-1].sum()) if ran else self.scenario.robots.count,
            "domain cells": int(self["domain"].sum()),
            "messages": int(self["messages"].sum()) if ran else 0,
            "bytes": self._letters[1] if ran else 0,
            "lost": self._lost() if ran else {},
            "events": [msgspec.to_builtins(event) for event in events],
            "seed": self.scenario.seed,
            "digest": self.digest(),
            "versions": self.versions,
        }
        if self.absent:
            found["absent"] = self.absent
        return found
