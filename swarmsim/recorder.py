"""Writes a recording while the run goes: whatever kills the run, what was flushed can be read."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import h5py
import msgspec
import numpy as np
import tomli_w
from numpy.typing import NDArray

from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Behaviour
from swarmsim.core.scenario import Scenario
from swarmsim.core.state import Delivery, Letters, Moment
from swarmsim.kernels import occupancy
from swarmsim.recording import DIGESTED, EVENT, FORMAT, Digests, versions

BLOCK: Final = 64  # iterations held back between two flushes, and the length of a chunk
MANY: Final = 4096  # rows in a chunk of tables that have many for each iteration
FATE: Final = np.dtype("S32")


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
        self._tables: dict[str, Any] = {}  # looking one up in the file takes longer than appending to it
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
        self._table("links", (2,), np.int32, MANY)
        self._table("links_end", (), np.int64)  # links of iteration t: links[links_end[t - 1]:links_end[t]]
        self._table("letters", (5,), np.int32, MANY)  # receiver, sender, iteration sent, bytes, fate; ends as of links
        self._table("letters_end", (), np.int64)
        self._table("fates", (), FATE)  # what became of a letter: 0 is heard, all others why it was lost
        self._table("changes", (3,), np.int32, MANY)  # of maps: robot, row-major cell, new state; ends as of links
        self._table("changes_end", (), np.int64)
        self._append("fates", np.array(self._fates, FATE))
        self._table("waypoints", (2,), np.float32, MANY)
        self._table("paths", (3,), np.int64)  # iteration, robot, end of its waypoints: one row per new path
        self._table("events", (), EVENT)
        self._table("digests", (len(DIGESTED), 8), np.uint8)
        self._file.swmr_mode = True

    def _table(self, name: str, row: tuple[int, ...], kind: Any, chunk: int = BLOCK) -> None:
        self._tables[name] = self._file.create_dataset(
            name, (0, *row), kind, chunks=(chunk, *row), maxshape=(None, *row), compression="gzip", compression_opts=1,
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
        for name, table in self._tables.items():
            if name != "digests":
                table.flush()
        rows = self._digests.rows[-len(held) :]
        self._append("digests", np.frombuffer(b"".join(rows), np.uint8).reshape(-1, len(DIGESTED), 8))
        self._tables["digests"].flush()

    def _append(self, name: str, rows: Any) -> None:
        if len(rows):
            table = self._tables[name]
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
        self._noted: list[NDArray[np.int32]] = []

    def sample(self, moment: Moment) -> None:
        """Compare the maps with those of the iteration before: under its tiles or, if need be, everywhere."""
        shown, tiles, inbox = self._shown, moment.tiles, moment.inbox
        log_odds = self._behaviour.log_odds.reshape(shown.shape)
        observed = self._behaviour.observed.reshape(shown.shape)
        if self._behaviour.forgets or moment.events:
            found = np.empty((shown.size, 3), np.int32)
            count = occupancy.changes_anywhere(log_odds, observed, shown, found)
        else:
            owners = np.concatenate([self._robots, inbox.receivers])
            origins = np.concatenate([tiles.origins, inbox.origins])
            shape = tiles.values.shape[1:]
            found = np.empty((len(owners) * shape[0] * shape[1] + 1, 3), np.int32)
            count = occupancy.changes_under(log_odds, observed, shown, owners, origins, shape, self._columns, found)
        self._noted.append(found[:count].copy())

    def taken(self) -> list[NDArray[np.int32]]:
        """The changes (c, 3) of each iteration since this was last asked: robot, row-major cell, new state."""
        noted, self._noted = self._noted, []
        return noted
