"""What is kept of a run: one HDF5 file, appended while the run goes and readable up to its last flush."""

from __future__ import annotations

import hashlib
import json
import platform
import tomllib
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import h5py
import msgspec
import numpy as np
import tomli_w
from numpy.typing import NDArray

from swarmsim.core import hdf5
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Behaviour
from swarmsim.core.scenario import Scenario, decode
from swarmsim.core.state import Delivery, Event, Letters, Moment
from swarmsim.kernels import grid

FORMAT: Final = 2  # raised whenever an older reader would misread a newer file
BLOCK: Final = 64  # iterations held back between two flushes, and the length of a chunk
DIGESTED: Final = (
    "pose", "velocity", "wheels", "alive", "tiles", "links", "heard", "goals", "waypoints", "coverage",
)  # fmt: skip
PER_ITERATION: Final = (
    "pose", "alive", "tiles", "origins", "goals", "coverage", "covered", "messages",
    "links_end", "letters_end", "changes_end", "digests",
)  # fmt: skip
FATE: Final = np.dtype("S32")
CHANGE: Final = np.dtype([("robot", "<i4"), ("cell", "<i4"), ("state", "u1")])
EVENT: Final = np.dtype([("iteration", "<i4"), ("robot", "<i4"), ("kind", "S32"), ("cause", "S192")])


class Digests:
    """A probe that hashes each field of every iteration, eight bytes each (BLAKE2b, RFC 7693)."""

    def __init__(self) -> None:
        self.rows: list[bytes] = []

    def sample(self, moment: Moment) -> None:
        """Append one row: the hashes of DIGESTED, in that order."""
        self.rows.append(b"".join(_hash(*arrays) for arrays in _digested(moment)))

    def total(self) -> str:
        """The digest of the whole run so far, in hexadecimal."""
        return hashlib.blake2b(b"".join(self.rows), digest_size=16).hexdigest()


def _digested(moment: Moment) -> tuple[tuple[NDArray[Any], ...], ...]:
    state, tiles, inbox, intents = moment.state, moment.tiles, moment.inbox, moment.intents
    coverage = moment.coverage
    return (
        (state.pose,),
        (state.velocity,),
        (state.wheels,),
        (state.alive,),
        (tiles.values, tiles.origins),
        (moment.links,),
        (inbox.receivers, inbox.senders, inbox.values, inbox.origins, inbox.sources, inbox.sensed),
        (intents.goals,),
        (intents.counts, intents.waypoints),
        (np.array([coverage.union, coverage.domain]), coverage.each),
    )


def _hash(*arrays: NDArray[Any]) -> bytes:
    hashed = hashlib.blake2b(digest_size=8)
    for array in arrays:
        hashed.update(np.ascontiguousarray(array).data)
    return hashed.digest()


def versions() -> dict[str, str]:
    """What a run's bytes depend on besides its scenario and seed."""
    packages = {name: version(name) for name in ("numpy", "numba", "pymunk", "shapely", "svgelements")}
    return {
        "swarmsim": version("swarmsim-lab"),
        "python": platform.python_version(),
        **packages,
        "platform": f"{platform.system()} {platform.machine()}",
    }


class Recorder:
    """A probe that writes every iteration to a new file.

    The file is in HDF5's single-writer mode: whatever kills the run, everything up to the last flush, at
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
        behaviour: Behaviour,
    ) -> None:
        """`world` is the floor plan's SVG text; `domain` and `truth` (occupied) are (rows, columns) at the start."""
        self._digests = Digests()
        self._held: list[Moment] = []
        self._totals = {"links": 0, "waypoints": 0, "letters": 0, "changes": 0}
        self._fates = ["heard"]
        count = scenario.robots.count
        self._maps = MapChanges(behaviour, count, lattice)
        tile = tuple(scenario.sensor.get("tile", (6, 7)))
        self._file = h5py.File(path, "x", libver="latest")
        self._file.attrs.update(
            {
                "swarmsim-recording": FORMAT,
                "scenario": tomli_w.dumps(msgspec.to_builtins(scenario)),
                "versions": json.dumps(versions()),
                "lattice": [lattice.x0, lattice.y0, lattice.cell, lattice.rows, lattice.columns],
                "digested": " ".join(DIGESTED),
            }
        )
        self._file["world"] = np.frombuffer(world.encode(), np.uint8)
        for name, mask in (("domain", domain), ("truth", truth)):
            self._file.create_dataset(name, data=mask, compression="gzip")
        self._table("pose", (count, 3), np.float64)
        self._table("alive", (count,), np.bool_)
        self._table("tiles", (count, *tile), np.uint8)
        self._table("origins", (count, 2), np.int32)
        self._table("goals", (count, 2), np.int32)
        self._table("coverage", (), np.float64)
        self._table("covered", (count,), np.int32)
        self._table("messages", (), np.int32)
        self._table("links", (2,), np.int32)
        self._table("links_end", (), np.int64)  # links of iteration t: links[links_end[t - 1]:links_end[t]]
        self._table("letters", (5,), np.int32)  # receiver, sender, iteration sent, bytes, fate; ends as of links
        self._table("letters_end", (), np.int64)
        self._table("fates", (), FATE)  # what became of a letter: 0 is heard, all others why it was lost
        self._table("changes", (), CHANGE)  # of maps; ends as of links
        self._table("changes_end", (), np.int64)
        self._append("fates", np.array(self._fates, FATE))
        self._table("waypoints", (2,), np.float32)
        self._table("paths", (3,), np.int64)  # iteration, robot, end of its waypoints: one row per new path
        self._table("events", (), EVENT)
        self._table("digests", (len(DIGESTED), 8), np.uint8)
        self._file.swmr_mode = True

    def _table(self, name: str, row: tuple[int, ...], kind: Any) -> None:
        self._file.create_dataset(
            name, (0, *row), kind, chunks=(BLOCK, *row), maxshape=(None, *row), compression="gzip", compression_opts=1,
            shuffle=True,
        )  # fmt: skip

    def sample(self, moment: Moment) -> None:
        """Keep one iteration; every BLOCK iterations they are written and flushed."""
        self._digests.sample(moment)
        self._maps.sample(moment)
        self._held.append(moment)
        if len(self._held) == BLOCK:
            self.flush()

    def flush(self) -> None:
        """Write what is held back. The digests come last: their length is the number of whole iterations."""
        held, self._held = self._held, []
        if not held:
            return
        self._append("pose", [moment.state.pose for moment in held])
        self._append("alive", [moment.state.alive for moment in held])
        self._append("tiles", [moment.tiles.values for moment in held])
        self._append("origins", [moment.tiles.origins for moment in held])
        self._append("goals", [moment.intents.goals for moment in held])
        self._append("coverage", [moment.coverage.share for moment in held])
        self._append("covered", [moment.coverage.each for moment in held])
        self._append("messages", [len(moment.delivery.heard) for moment in held])
        self._append_each("links", [moment.links for moment in held])
        known = len(self._fates)
        self._append_each("letters", [self._with_fates(moment.delivery) for moment in held])
        self._append("fates", np.array(self._fates[known:], FATE))
        self._append_each("changes", self._maps.taken())
        planned = [(moment, robot) for moment in held for robot in np.flatnonzero(moment.intents.planned)]
        ways = [moment.intents.waypoints[robot, : moment.intents.counts[robot]] for moment, robot in planned]
        ends = self._totals["waypoints"] + np.cumsum([len(way) for way in ways], dtype=np.int64)
        if ways:
            self._append("waypoints", np.concatenate(ways))
            self._append(
                "paths",
                [(moment.state.iteration, robot, end) for (moment, robot), end in zip(planned, ends, strict=True)],
            )
            self._totals["waypoints"] = int(ends[-1])
        events = [(e.iteration, e.robot, e.kind.encode(), e.cause.encode()) for moment in held for e in moment.events]
        self._append("events", np.array(events, EVENT))
        for name in self._file:
            if name != "digests":
                self._file[name].flush()
        rows = self._digests.rows[-len(held) :]
        self._append("digests", np.frombuffer(b"".join(rows), np.uint8).reshape(-1, len(DIGESTED), 8))
        self._file["digests"].flush()

    def _append(self, name: str, rows: Any) -> None:
        if len(rows):
            table = self._file[name]
            table.resize(len(table) + len(rows), axis=0)
            table[-len(rows) :] = np.asarray(rows, table.dtype)

    def _append_each(self, name: str, pieces: list[NDArray[Any]]) -> None:
        """Append one piece for each iteration, and where it ends to the table NAME_end."""
        self._append(name, np.concatenate(pieces))
        ends = self._totals[name] + np.cumsum([len(piece) for piece in pieces])
        self._append(f"{name}_end", ends)
        self._totals[name] = int(ends[-1])

    def _with_fates(self, delivery: Delivery) -> NDArray[np.int32]:
        """The messages heard or lost in an iteration (m, 5), each with the number of its fate."""
        rows = [_with_column(delivery.heard, 0)]
        for reason, letters in delivery.lost:
            if reason not in self._fates:
                self._fates.append(reason)
            rows.append(_with_column(letters, self._fates.index(reason)))
        return np.concatenate(rows)

    def close(self) -> None:
        """Write the rest and close the file."""
        if self._file:
            self.flush()
            self._file.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _with_column(letters: Letters, fate: int) -> NDArray[np.int32]:
    return np.column_stack([letters, np.full(len(letters), fate, np.int32)])


class MapChanges:
    """A probe that notes which cells of the robots' maps have become unknown, free or occupied."""

    def __init__(self, behaviour: Behaviour, robots: int, lattice: Lattice) -> None:
        self._behaviour = behaviour
        self._columns = lattice.columns
        self._robots = np.arange(robots, dtype=np.int32)
        self._shown = np.zeros((robots, lattice.rows * lattice.columns), np.uint8)
        self._noted: list[NDArray[Any]] = []

    def sample(self, moment: Moment) -> None:
        """Compare the maps with those of the iteration before: under its tiles or, if need be, everywhere."""
        shown, tiles, inbox = self._shown, moment.tiles, moment.inbox
        log_odds = self._behaviour.log_odds.reshape(shown.shape)
        observed = self._behaviour.observed.reshape(shown.shape)
        if self._behaviour.forgets or moment.events:
            found = np.empty((shown.size, 3), np.int32)
            count = grid.changes_anywhere(log_odds, observed, shown, found)
        else:
            owners = np.concatenate([self._robots, inbox.receivers])
            origins = np.concatenate([tiles.origins, inbox.origins])
            shape = tiles.values.shape[1:]
            found = np.empty((len(owners) * shape[0] * shape[1] + 1, 3), np.int32)
            count = grid.changes_under(log_odds, observed, shown, owners, origins, shape, self._columns, found)
        noted = np.empty(count, CHANGE)
        noted["robot"], noted["cell"], noted["state"] = found[:count].T
        self._noted.append(noted)

    def taken(self) -> list[NDArray[Any]]:
        """The changes (CHANGE) of each iteration since this was last asked."""
        noted, self._noted = self._noted, []
        return noted


class Recording:
    """A recorded run, read back; row t of every array is iteration t, row i of that robot i."""

    def __init__(self, path: Path) -> None:
        """Open a recording, or the folder of a run that holds one. Raises InputError."""
        self.path = path / "recording.h5" if path.is_dir() else path
        if not self.path.is_file():
            raise InputError(f"{path}: no such recording; expected a run's folder or its recording.h5")
        try:
            with hdf5.open_for_reading(self.path) as file:
                found = file.attrs.get("swarmsim-recording")
                if found != FORMAT:
                    raise InputError(
                        f"{self.path}: format {found if found is not None else 'unknown'}, but this swarmsim "
                        f"{version('swarmsim-lab')} reads format {FORMAT}; run the scenario again, or read it with the "
                        f"version that wrote it"
                    )
                self.versions: dict[str, str] = json.loads(file.attrs["versions"])
                table = tomllib.loads(file.attrs["scenario"])
                x0, y0, cell, rows, columns = file.attrs["lattice"]
                self.digested: list[str] = file.attrs["digested"].split()
                self._arrays: dict[str, NDArray[Any]] = {name: file[name][()] for name in file}
        except (OSError, KeyError, ValueError, RuntimeError) as problem:
            raise InputError(
                f"{self.path}: not a whole recording ({problem}); expected an HDF5 file written by 'swarmsim run'"
            ) from problem
        self.scenario: Scenario = decode(table, str(self.path))
        self.lattice = Lattice(float(x0), float(y0), float(cell), int(rows), int(columns))
        self.iterations = len(self._arrays["digests"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A table of the file by its name, cut to whole iterations where it has one row for each."""
        array = self._arrays[name]
        return array[: self.iterations] if name in PER_ITERATION else array

    @cached_property
    def world(self) -> str:
        """The floor plan's SVG text."""
        return bytes(self._arrays["world"]).decode()

    def links(self, iteration: int) -> NDArray[np.int32]:
        """The links (m, 2) of one iteration: receiver, sender."""
        return self._of("links", iteration)

    def letters(self, iteration: int) -> NDArray[np.int32]:
        """What became of messages in one iteration (m, 5): receiver, sender, iteration sent, bytes, fate."""
        return self._of("letters", iteration)

    def changes(self, iteration: int) -> NDArray[Any]:
        """The cells (CHANGE) of the robots' maps that became unknown, free or occupied in one iteration."""
        return self._of("changes", iteration)

    @cached_property
    def fates(self) -> list[str]:
        """What the numbers of fates mean: 0 is heard, all others why a message was lost."""
        return [name.decode() for name in self._arrays["fates"]]

    def _of(self, name: str, iteration: int) -> NDArray[Any]:
        ends = self._arrays[f"{name}_end"]
        rows: NDArray[Any] = self._arrays[name][ends[iteration - 1] if iteration else 0 : ends[iteration]]
        return rows

    def paths(self) -> list[tuple[int, int, NDArray[np.float32]]]:
        """Every path when it was new: iteration, robot, and its waypoints (w, 2) in m."""
        rows = self._arrays["paths"]
        starts = np.concatenate([[0], rows[:, 2]])
        return [
            (int(iteration), int(robot), self._arrays["waypoints"][start:end])
            for (iteration, robot, end), start in zip(rows, starts, strict=False)
        ]

    def events(self) -> list[Event]:
        """All events in the order in which they happened."""
        return [
            Event(int(row["iteration"]), int(row["robot"]), row["kind"].decode(), row["cause"].decode())
            for row in self._arrays["events"]
        ]

    def digest(self) -> str:
        """The digest of the whole run, in hexadecimal; equal for equal runs."""
        return hashlib.blake2b(self["digests"].tobytes(), digest_size=16).hexdigest()

    def difference(self, iteration: int, row: bytes) -> str | None:
        """Where an iteration of this recording differs from one with the digests `row`, or None."""
        recorded = self["digests"][iteration].tobytes()
        for field, name in enumerate(self.digested):
            if recorded[8 * field : 8 * field + 8] != row[8 * field : 8 * field + 8]:
                return f"iteration {iteration}, field {name!r}"
        return None

    def _lost(self) -> dict[str, int]:
        """How many messages were lost, by reason."""
        counts = np.bincount(self._arrays["letters"][:, 4], minlength=len(self.fates))
        return {name: int(count) for name, count in zip(self.fates[1:], counts[1:], strict=True)}

    def reached(self, share: float) -> int | None:
        """The number of iterations after which the union covered this share, or None."""
        hits = np.flatnonzero(self["coverage"] >= share)
        return int(hits[0]) + 1 if len(hits) else None

    def summary(self) -> dict[str, Any]:
        """The run in a few numbers, for tables and JSON."""
        events = self.events()
        ends = [event.kind for event in events if event.kind in ("finished", "not finished")]
        coverage = self["coverage"]
        return {
            "title": self.scenario.title,
            "status": ends[-1] if ends else "interrupted",
            "iterations": self.iterations,
            "coverage": float(coverage[-1]) if self.iterations else 0.0,
            "reached": {f"{100 * share:g} %": self.reached(share) for share in (0.5, 0.75, 0.9, 0.95, 0.99, 1.0)},
            "robots": self.scenario.robots.count,
            "alive": int(self["alive"][-1].sum()) if self.iterations else self.scenario.robots.count,
            "domain cells": int(self._arrays["domain"].sum()),
            "messages": int(self["messages"].sum()),
            "bytes": int(self._arrays["letters"][:, 3].sum(where=self._arrays["letters"][:, 4] == 0)),
            "lost": self._lost(),
            "events": [
                {"iteration": iteration, "kind": kind, "cause": cause, "robots": list(robots)}
                for (iteration, kind, cause), robots in grouped(events).items()
            ],
            "seed": self.scenario.seed,
            "digest": self.digest(),
            "versions": self.versions,
        }


def grouped(events: list[Event]) -> dict[tuple[int, str, str], tuple[int, ...]]:
    """All robots with which the same happened: by iteration, kind and cause, in the order of the events."""
    groups: dict[tuple[int, str, str], tuple[int, ...]] = {}
    for event in events:
        key = (event.iteration, event.kind, event.cause)
        groups[key] = groups.get(key, ()) + ((event.robot,) if event.robot >= 0 else ())
    return groups
