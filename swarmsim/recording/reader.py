"""A recorded run, read back from its HDF5 file."""

from __future__ import annotations

import hashlib
import json
import tomllib
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import h5py
import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmsim.core import hdf5
from swarmsim.core.errors import InputError
from swarmsim.core.events import Ended, Event, decoded
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Curve
from swarmsim.core.scenario import Scenario, shape

FORMAT: Final = 3  # raised whenever an older reader would misread a newer file
SHARES: Final = (0.5, 0.75, 0.9, 0.95, 0.99, 1.0)  # of the task, whose times a summary tells


class Recording:
    """A recorded run, read back; row t of every array is iteration t, row i of that robot i."""

    def __init__(self, path: Path, file: h5py.File | None = None) -> None:
        """Open a recording, or the folder of a run that holds one; `file` is one that this process still writes.

        Raises InputError.
        """
        self.path = path / "recording.h5" if path.is_dir() else path
        if not self.path.is_file():
            raise InputError(f"{path}: no such recording; expected a run's folder or its recording.h5")
        self._growing = file
        try:
            if file is not None:
                self._read(file)
            else:
                with hdf5.open_for_reading(self.path) as opened:
                    self._read(opened)
        except (OSError, KeyError, ValueError, RuntimeError) as problem:
            raise InputError(
                f"{self.path}: not a whole recording ({problem}); expected an HDF5 file written by 'swarmsim run'"
            ) from problem

    def _read(self, file: h5py.File) -> None:
        found = file.attrs.get("swarmsim-recording")
        if found != FORMAT:
            raise InputError(
                f"{self.path}: format {found if found is not None else 'unknown'}, but this swarmsim "
                f"{version('swarmsim-lab')} reads format {FORMAT}; run the scenario again, or read it with the "
                f"version that wrote it"
            )
        self.versions: dict[str, str] = json.loads(file.attrs["versions"])
        self.scenario: Scenario = shape(tomllib.loads(file.attrs["scenario"]), str(self.path))
        x0, y0, cell, rows, columns = file.attrs["lattice"]
        self.lattice = Lattice(float(x0), float(y0), float(cell), int(rows), int(columns))
        self.digested: list[str] = file.attrs["digested"].split()
        #: The names of what the task measured of the swarm.
        self.measures: list[str] = json.loads(file.attrs["measures"])
        #: What the task is about, and how it is drawn.
        self.curve: Curve = msgspec.json.decode(file.attrs["curve"], type=Curve)
        self._rows: set[str] = set(json.loads(file.attrs["rows"]))  # tables with one row for each iteration
        self._arrays: dict[str, NDArray[Any]] = {name: file[name][()] for name in file}
        self.iterations = len(self._arrays["digests"])

    def refresh(self) -> None:
        """Take in what has been flushed since, of a recording that this process still writes."""
        assert self._growing is not None
        for name, array in self._arrays.items():
            table = self._growing[name]
            if len(table) > len(array):
                self._arrays[name] = np.concatenate([array, table[len(array) :]])
        self.iterations = len(self._arrays["digests"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A table of the file by its name, cut to whole iterations where it has one row for each."""
        array = self._arrays[name]
        return array[: self.iterations] if name in self._rows else array

    def __contains__(self, name: str) -> bool:
        """Whether the file has a table of this name."""
        return name in self._arrays

    @property
    def progress(self) -> NDArray[np.float64]:
        """How much of the task was done after each iteration (t,), 0 to 1."""
        return self["progress"]

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

    def changes(self, iteration: int) -> NDArray[np.int32]:
        """What became of cells of the robots' maps in one iteration (c, 3): robot, row-major cell, new state."""
        return self._of("changes", iteration)

    @property
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
        text = self._arrays["events"].tobytes() if "events" in self else b""
        return [decoded(line) for line in text.splitlines()]

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
        """The number of iterations after which this share of the task was done, or None."""
        hits = np.flatnonzero(self.progress >= share)
        return int(hits[0]) + 1 if len(hits) else None

    def summary(self) -> dict[str, Any]:
        """The run in a few numbers, for tables and JSON."""
        events = self.events()
        ends = ["finished" if event.finished else "not finished" for event in events if isinstance(event, Ended)]
        ran = self.iterations > 0
        return {
            "title": self.scenario.title,
            "status": ends[-1] if ends else "interrupted",
            "iterations": self.iterations,
            "measures": {name: float(self[name][-1]) for name in self.measures} if ran else {},
            "progress": float(self.progress[-1]) if ran else 0.0,
            "reached": {f"{100 * share:g} %": self.reached(share) for share in SHARES} if ran else {},
            "robots": self.scenario.robots.count,
            "alive": int(self["alive"][-1].sum()) if ran else self.scenario.robots.count,
            "domain cells": int(self._arrays["domain"].sum()),
            "messages": int(self["messages"].sum()) if ran else 0,
            "bytes": int(self._arrays["letters"][:, 3].sum(where=self._arrays["letters"][:, 4] == 0)) if ran else 0,
            "lost": self._lost() if ran else {},
            "events": [msgspec.to_builtins(event) for event in events],
            "seed": self.scenario.seed,
            "digest": self.digest(),
            "versions": self.versions,
        }
