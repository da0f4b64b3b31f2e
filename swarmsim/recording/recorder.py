"""Writes a recording during a run; if the run is killed, flushed data can still be read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final

import h5py
import msgspec
import numpy as np
import tomli_w
from numpy.typing import DTypeLike, NDArray

from swarmsim.core import declarations
from swarmsim.core.errors import InputError
from swarmsim.core.events import encoded
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Delivery, Packets
from swarmsim.core.parts import Curve
from swarmsim.core.probes import Row
from swarmsim.core.readings import NOTHING, Channels
from swarmsim.core.scenario.file import Scenario, table_of
from swarmsim.core.state import Knowledge, Moment, Record
from swarmsim.recording.digests import ACTUATED, DIGESTED, Digests, versions
from swarmsim.recording.hdf5 import Growing, to_the_end
from swarmsim.recording.layout import declared_by
from swarmsim.recording.probes import Watching
from swarmsim.recording.reader import FORMAT, FORMAT_NAME

BLOCK: Final = 64  # iterations between two flushes, and the length of a chunk
MANY: Final = 4096  # rows in a chunk of tables with many per iteration
FATE: Final = np.dtype("S32")


@dataclass(frozen=True, slots=True)
class Held:
    """The written part of one iteration; whole moments also hold old paths, and may be large."""

    rows: dict[str, object]
    lists: dict[str, NDArray[np.generic]]
    probed: dict[str, Row]  # a row per table, in sampled iterations
    letters: NDArray[np.int32]  # (m, 5)
    ways: list[tuple[int, int, NDArray[np.float64]]]  # iteration, robot, its new waypoints (w, 2) in m
    events: bytes


class Recorder:
    """An observer that writes every iteration to a new file.

    The file is in HDF5's single-writer mode: if the run is killed, everything up to the last flush, at
    most BLOCK iterations ago, can still be read.
    """

    def __init__(
        self,
        path: Path,
        scenario: Scenario,
        world: str,
        lattice: Lattice,
        domain: NDArray[np.bool_],
        truth: NDArray[np.bool_],
        curve: Curve,
        errs: bool,
        channels: Channels,
        code: Mapping[str, str],
        probes: Sequence[Watching] = (),
        actuators: Channels = NOTHING,
        absent: Sequence[str] = (),
    ) -> None:
        """`world` is the floor plan's text, `curve` the task's, `code` a hash of each piece of code behind
        the run.

        `errs` tells whether pose estimates may be wrong and are kept; `channels` are the sensors',
        `actuators` the actuators'.

        `absent` says what nobody has recorded, such as true poses, in whose place the robots' estimates are.

        `domain` and `truth` (occupied) are (rows, columns) at the start.
        """
        self._path, self._growing, self._kept, self._probes = path, Growing(path), 0, probes
        self._digests = Digests()
        self._held: list[Held] = []
        self._tables: dict[str, h5py.Dataset] = {}  # looking one up in the file is slower than appending to it
        self._totals: dict[str, int] = {}
        self._fates = ["heard"]
        self._errs = errs
        self._fields = (*DIGESTED, *([ACTUATED] if len(actuators) else []))
        #: The HDF5 file, which the same process may read while it grows.
        self.file = self._growing.file
        place = [lattice.x0, lattice.y0, lattice.cell, float(lattice.rows), float(lattice.columns)]
        texts = {
            "scenario": text_of(scenario),
            "versions": json.dumps(versions()),
            "code": json.dumps(dict(code)),
            "digested": " ".join(self._fields),
            "curve": msgspec.json.encode(curve).decode(),
            "channels": declarations.text_of(channels),
            "measures": "[]",
            "rows": "[]",
            **({"actuators": declarations.text_of(actuators)} if len(actuators) else {}),
            **({"absent": json.dumps(list(absent))} if absent else {}),
            **({"probes": msgspec.json.encode([one.declared for one in probes]).decode()} if probes else {}),
        }
        plan = np.frombuffer(world.encode(), np.uint8)
        with self._growing.writing("no iteration is kept"):
            self.file.attrs[FORMAT_NAME] = FORMAT
            self.file.attrs["lattice"] = place
            for name, text in texts.items():
                self._tell(name, text)
            # kept open: closing a table writes it, and HDF5 cannot report failures there
            self._once = [self.file.create_dataset("world", data=plan)]
            for name, mask in (("domain", domain), ("truth", truth)):
                self._once.append(self.file.create_dataset(name, data=mask, compression="gzip"))
            self._table("digests", (len(self._fields), 8), np.uint8)

    def _tell(self, name: str, text: str) -> None:
        """Write a text of fixed length: HDF5 stores others without a checksum."""
        self.file.attrs[name] = np.bytes_(text.encode())

    def _open(self, first: dict[str, object], lists: dict[str, NDArray[np.generic]], measures: list[str]) -> None:
        """Make the tables for a run with such moments; from here on the file can be read while it grows."""
        for name, row in first.items():
            self._table(name, np.asarray(row).shape, np.asarray(row).dtype)
        for name, rows in lists.items():
            self._table(name, rows.shape[1:], rows.dtype, MANY)
            self._table(f"{name}_end", (), np.int64)  # rows of iteration t: NAME[NAME_end[t - 1]:NAME_end[t]]
            self._totals[name] = 0
        self._table("letters", (5,), np.int32, MANY)  # receiver, sender, iteration sent, bytes, fate; ends as of links
        self._table("letters_end", (), np.int64)
        self._totals |= {"letters": 0, "waypoints": 0}
        self._table("fates", (), FATE)  # 0 is heard, all others why a letter was lost
        self._append("fates", np.array(self._fates, FATE))
        self._table("waypoints", (2,), np.float32, MANY)
        self._table("paths", (3,), np.int64)  # iteration, robot, end of its waypoints: one row per new path
        self._table("events", (), np.uint8, MANY)  # text: an event in JSON a line
        once = ["fates", "waypoints", "paths", "events"]
        for name, table in declared_by(one.declared for one in self._probes).items():
            row = [len(np.asarray(first["alive"])) if side == "robots" else side for side in table.row]
            self._table(name, tuple(int(side) for side in row), table.kind)
            once.append(name)
        self._tell("rows", json.dumps([name for name in self._tables if name not in (*once, *self._totals)]))
        self._tell("measures", json.dumps(measures))
        self.file.swmr_mode = True

    def _rows(self, moment: Moment[Knowledge]) -> dict[str, object]:
        """The data with one row of fixed shape in every iteration, by table name."""
        return {
            "pose": moment.state.pose,
            **({"believed": moment.believed} if self._errs else {}),
            **({} if moment.people is None else {"people": moment.people}),
            "alive": moment.state.alive,
            "messages": len(moment.delivery.heard),
            "progress": moment.measured.progress,
            **{name: row for _, record in _records(moment) for name, row in record.rows.items()},
        }

    def _table(self, name: str, row: tuple[int, ...], kind: DTypeLike, chunk: int = BLOCK) -> None:
        self._tables[name] = self.file.create_dataset(
            name, (0, *row), kind, chunks=(chunk, *row), maxshape=(None, *row), compression="gzip", compression_opts=1,
            shuffle=True,
        )  # fmt: skip

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Keep one iteration; write and flush every BLOCK iterations."""
        rows, lists, letters = self._rows(moment), _lists(moment), self._with_fates(moment.delivery)
        probed = {name: row for probe in self._probes for name, row in probe.rows(moment).items()}
        if len(self._tables) == 1:
            _check_names((*_records(moment), ("the probes", Record(probed))), self._path)
            with self._growing.writing("no iteration is kept"):
                self._open(rows, lists, list(moment.measured.values))
        self._digests.sample(moment)
        events = b"".join(encoded(event) + b"\n" for event in moment.events)
        self._held.append(Held(rows, lists, probed, letters, _new_ways(moment), events))
        if len(self._held) == BLOCK:
            self.flush()

    def flush(self) -> None:
        """Write what is held back. The digests come last: their length is the number of whole iterations.

        Raises StorageError if writing fails; then nothing more is written, and earlier flushes can be read.
        """
        held, self._held = self._held, []
        if not held or not self._growing.whole:
            return
        with self._growing.writing(f"{self._kept} iterations are kept"):
            to_the_end(lambda: self._write(held))
        self._kept += len(held)

    def _write(self, held: list[Held]) -> None:
        for name in held[0].rows:
            self._append(name, [one.rows[name] for one in held])
        for name in held[0].lists:
            self._append_each(name, [one.lists[name] for one in held])
        for name in {name: None for one in held for name in one.probed}:
            self._append(name, [one.probed[name] for one in held if name in one.probed])
        self._append_each("letters", [one.letters for one in held])
        self._append("fates", np.array(self._fates[len(self._tables["fates"]) :], FATE))
        self._append_ways([way for one in held for way in one.ways])
        self._append("events", np.frombuffer(b"".join(one.events for one in held), np.uint8))
        self.file.flush()
        digests = self._digests.rows[-len(held) :]
        self._append("digests", np.frombuffer(b"".join(digests), np.uint8).reshape(-1, len(self._fields), 8))
        self._tables["digests"].flush()

    def _append_ways(self, ways: list[tuple[int, int, NDArray[np.float64]]]) -> None:
        """Append every new path."""
        if ways:
            ends = self._totals["waypoints"] + np.cumsum([len(way) for _, _, way in ways], dtype=np.int64)
            self._append("waypoints", np.concatenate([way for _, _, way in ways]))
            which = [(iteration, robot) for iteration, robot, _ in ways]
            self._append("paths", np.column_stack([np.array(which, np.int64), ends]))
            self._totals["waypoints"] = int(ends[-1])

    def _append(self, name: str, rows: Sequence[object] | NDArray[np.generic]) -> None:
        if len(rows):
            table = self._tables[name]
            table.resize(len(table) + len(rows), axis=0)
            table[-len(rows) :] = np.asarray(rows, table.dtype)

    def _append_each(self, name: str, pieces: list[NDArray[np.generic]]) -> None:
        """Append one piece per iteration, and its end to the table NAME_end."""
        self._append(name, np.concatenate(pieces))
        ends = self._totals[name] + np.cumsum([len(piece) for piece in pieces])
        self._append(f"{name}_end", ends)
        self._totals[name] = int(ends[-1])

    def _with_fates(self, delivery: Delivery) -> NDArray[np.int32]:
        """The messages heard or lost in an iteration (m, 5), each with its fate's number."""
        rows = [_with_column(delivery.heard, 0)]
        for reason, letters in delivery.lost:
            if reason not in self._fates:
                self._fates.append(reason)
            rows.append(_with_column(letters, self._fates.index(reason)))
        return np.concatenate(rows)

    def close(self) -> None:
        """Write the rest and close the file. Raises StorageError as `flush` does."""
        self.flush()
        self._growing.close(f"{self._kept} iterations are kept")

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _check_names(records: Sequence[tuple[str, Record]], path: Path) -> None:
    """Raise InputError if two parts record under one name: one of the two would be lost."""
    names = [name for _, record in records for name in (*record.rows, *record.lists)]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        parts = " and ".join(part for part, record in records if twice[0] in {**record.rows, **record.lists})
        raise InputError(f"{path}: {twice[0]!r} is given by {parts}; expected different names")


def _records(moment: Moment[Knowledge]) -> tuple[tuple[str, Record], ...]:
    """The parts' recorded data, with its source."""
    return (
        ("the actuators", Record(moment.state.actuators.rows())), ("the readings", Record(moment.readings.rows())),
        ("the knowledge", moment.knowledge.record()), ("the intents", moment.intents.record()),
        ("the task", moment.measured.record()), *((f"the job {one.name!r}", one.record()) for one in moment.jobs),
    )  # fmt: skip


def _lists(moment: Moment[Knowledge]) -> dict[str, NDArray[np.generic]]:
    """The data with any number of rows, by table name."""
    of_jobs = {name: rows for one in moment.jobs for name, rows in one.record().lists.items()}
    return {"links": moment.links, **moment.knowledge.record().lists, **of_jobs}


def _new_ways(moment: Moment[Knowledge]) -> list[tuple[int, int, NDArray[np.float64]]]:
    """The iteration, robot and waypoints (w, 2) of every new path."""
    intents = moment.intents
    return [
        (moment.state.iteration, int(robot), intents.waypoints[robot, : intents.counts[robot]].copy())
        for robot in np.flatnonzero(intents.planned)
    ]


def text_of(scenario: Scenario) -> str:
    """The scenario as recordings keep it: TOML, complete."""
    return tomli_w.dumps(table_of(scenario))


def _with_column(letters: Packets, fate: int) -> NDArray[np.int32]:
    return np.column_stack([letters, np.full(len(letters), fate, np.int32)])
