"""What is kept of a run: one HDF5 file, readable up to its last flush, and a digest of every iteration."""

from __future__ import annotations

import hashlib
import json
import platform
import tomllib
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import hdf5
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario import Scenario, decode
from swarmsim.core.state import Event, Moment

FORMAT: Final = 2  # raised whenever an older reader would misread a newer file
DIGESTED: Final = (
    "pose", "velocity", "wheels", "alive", "tiles", "links", "heard", "goals", "waypoints", "coverage",
)  # fmt: skip
PER_ITERATION: Final = (
    "pose", "alive", "tiles", "origins", "goals", "coverage", "covered", "messages",
    "links_end", "letters_end", "changes_end", "digests",
)  # fmt: skip
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

    def changes(self, iteration: int) -> NDArray[np.int32]:
        """What became of cells of the robots' maps in one iteration (c, 3): robot, row-major cell, new state."""
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
