"""Virtual stigmergy: a table that a swarm shares, written by any robot (Pinciroli, Lee-Brown and Beltrame 2016)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Self

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.probes import ProbeTable, Row
from swarmsim.core.state import Record
from swarmsim.jobs.facts.board import FactBoard
from swarmsim.jobs.facts.tellers import JobStanding, Tellers
from swarmsim.jobs.facts.wire import Fact, check_budget, within

VALUE: Final = struct.Struct(">d")
NEWEST: Final = ProbeTable("newest", "i4", ("robots",), "", "newest entries known", 0.0, drawn="robots")

Name = Annotated[str, Meta(pattern="^([a-z][a-z0-9_]*)?$")]


class Stigmergy(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table that all robots share, and that random robots write to at random times.

    A write raises the version of its key, and the newest version wins; of two robots that write without having heard of
    each other, the one with the higher number. Entries are told when they are news, and again after at most `repeat`
    iterations. A robot that is not alive when its write is due does not make it.
    """

    name: Name = ""  # in recordings; default: the part's
    keys: Annotated[int, Meta(ge=1, le=10_000)] = 8  # of the table
    writes: Annotated[int, Meta(ge=0, le=100_000)] = 40  # in all, by robots drawn at random
    during: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 100  # iterations from the start in which robots write
    repeat: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 10  # iterations
    budget: Annotated[int, Meta(ge=1, le=1_000_000_000)] | None = None  # bytes a message

    def build(self, context: BuildContext) -> Tellers[Writer]:
        """The job. Raises InputError for a budget without room for an entry."""
        check_budget(self.budget, [VALUE.size], "an entry")
        dice = context.streams.open(f"stigmergy {self.name}")
        columns = (
            dice.integers(self.during, size=self.writes), dice.integers(context.swarm, size=self.writes),
            dice.integers(self.keys, size=self.writes), dice.random(self.writes),
        )  # fmt: skip
        plan = sorted(zip(*(column.tolist() for column in columns), strict=True))

        def new(robot: int) -> Writer:
            mine = [(when, key, value) for when, who, key, value in plan if who == robot]
            return Writer(FactBoard(robot, self.repeat * context.rounds), mine, self.budget)

        name = self.name or "stigmergy"
        return Tellers(context, new, lambda parts, now: _standing(parts, self.keys, name), tables=(NEWEST,))


class Writer:
    """One robot: its table, and what it is going to write (iteration, key, value)."""

    def __init__(self, board: FactBoard, writes: Sequence[tuple[int, int, float]], budget: int | None) -> None:
        self.board, self._budget = board, budget
        #: What is still to come, in order.
        self.writes = list(writes)

    def wake(self, now: int) -> None:
        """Skip what was to be written meanwhile."""
        self.writes = [write for write in self.writes if write[0] >= now]

    def say(self, now: int, clock: int) -> list[Fact]:
        """Write what is due, then tell."""
        while self.writes and self.writes[0][0] <= now:
            _, key, value = self.writes.pop(0)
            self.board.write(key, VALUE.pack(value))
        told = within(self.board.wanted(clock), self._budget)
        self.board.told(told, clock)
        return told

    def hear(self, facts: list[Fact], now: int, clock: int) -> None:
        """Keep the newest."""
        self.board.hear(facts)

    def learn(self, other: Self) -> None:
        """Take in another robot's table."""
        self.board.learn(other.board)


@dataclass(frozen=True, slots=True, eq=False)
class SharedTable(JobStanding):
    """Every robot's table; all arrays are read-only."""

    name: str
    version: NDArray[np.int64]  # (n, k): 0 for keys not known
    robot: NDArray[np.int32]  # (n, k): that wrote it; -1 for keys not known
    value: NDArray[np.float64]  # (n, k): NaN for keys not known
    left: NDArray[np.int32]  # (n,): writes still to come

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All columns, in order."""
        return self.version, self.robot, self.value, self.left

    def record(self) -> Record:
        """The tables, and the writes to come."""
        columns = zip(("version", "robot", "value", "left"), self.arrays(), strict=True)
        return Record({f"{self.name}_{column}": rows for column, rows in columns})

    def newest(self, alive: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether each living robot has the newest entry that any of them has, of each key (n, k)."""
        same = np.repeat(alive[:, None], self.version.shape[1], axis=1)
        for key in range(self.version.shape[1]) if alive.any() else ():
            columns = self.value[:, key], self.robot[:, key], self.version[:, key]
            last = np.flatnonzero(alive)[np.lexsort([column[alive] for column in columns])[-1]]
            for column in columns:
                same[:, key] &= np.equal(column, column[last]) | (np.isnan(column) & np.isnan(column[last]))
        return same

    def sample(self, alive: NDArray[np.bool_]) -> dict[str, Row]:
        """How many keys each robot knows as they are; keys that nobody has written do not count."""
        return {"newest": (self.newest(alive) & (self.version > 0)).sum(axis=1)}

    def share(self, alive: NDArray[np.bool_]) -> float:
        """The share of living robots whose table is the newest."""
        return float(self.newest(alive)[alive].all(axis=1).mean()) if alive.any() else 0.0

    def ended(self, alive: NDArray[np.bool_]) -> bool:
        """Whether all tables are equal, and nobody has anything left to write."""
        return not self.left[alive].any() and self.share(alive) == 1.0

    def numbers(self, alive: NDArray[np.bool_]) -> dict[str, float]:
        """The share of equal tables, and the keys that have been written."""
        return {"equal_share": self.share(alive), "keys": float(np.count_nonzero(self.version[alive].any(axis=0)))}


def _standing(parts: Sequence[Writer], keys: int, name: str) -> SharedTable:
    shape = len(parts), keys
    version, robot = np.zeros(shape, np.int64), np.full(shape, -1, np.int32)
    value, left = np.full(shape, np.nan), np.array([len(part.writes) for part in parts], np.int32)
    for row, part in enumerate(parts):
        for key, fact in part.board.entries.items():
            version[row, key], robot[row, key] = fact.version, fact.robot
            (value[row, key],) = VALUE.unpack(fact.value)
    for array in (version, robot, value, left):
        array.setflags(write=False)
    return SharedTable(name, version, robot, value, left)
