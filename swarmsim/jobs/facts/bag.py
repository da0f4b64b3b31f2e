"""A bag of independent work: who is idle takes an item that nobody claims.

The result of an item is a function of the item alone. So an item may be done twice, by robots that have not heard of
each other or after a claim has lapsed, and the answer still has the same bits as that of one computer.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Piece, PieceJob, Values
from swarmsim.core.probes import ProbeTable, Row
from swarmsim.core.state import Record
from swarmsim.jobs.facts.board import FactBoard
from swarmsim.jobs.facts.tellers import JobStanding, Tellers
from swarmsim.jobs.facts.wire import LONGEST, Fact, check_budget, within

DONE: Final = (1 << 32) - 1  #: the version of a result: higher than that of any claim
SIGNS: Final = 6  # of life within the patience that others have
NUMBER: Final = np.dtype(">f8")
RESULTS: Final = ProbeTable("results", "i4", ("robots",), "", "results known", 0.0, drawn="robots")


class BagWork(Protocol):
    """A bag's items: one instance serves all robots and keeps no state, so equal arguments give equal bits."""

    @property
    def items(self) -> int:
        """How many there are, numbered from 0."""
        ...

    @property
    def length(self) -> int:
        """How many numbers each result has."""
        ...

    def work(self, item: int) -> float:
        """Floating-point operations of an item."""
        ...

    def result(self, item: int) -> Values:
        """The result (length,) of an item."""
        ...

    def answer(self, results: NDArray[np.float64]) -> dict[str, float]:
        """What all results (items, length) come to, by name."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Carried:
    """How a swarm shares a bag."""

    name: str  # in recordings
    rate: float | None = None  # operations a second of a robot; none: an item an exchange
    patience: int = 12  # iterations of silence after which a claim lapses
    budget: int | None = None  # bytes a message


class Independent:
    """A job in pieces without halos as a bag: an item is a piece, from its start to its last step.

    What a piece's first holder alone senses is left out: every robot has to be able to do every item. The result is the
    piece's last state.
    """

    def __init__(self, job: PieceJob, pieces: Sequence[Piece]) -> None:
        """Raises InputError for pieces with halos."""
        for piece in pieces:
            if len(piece.halo):
                raise InputError(f"halo: piece {piece.number} reads {len(piece.halo)} cells of others; expected none")
        self._job, self._pieces = job, pieces
        self._starts = [self._start(piece) for piece in pieces]
        self.items, self.length = len(pieces), max(state.size for state in self._starts)

    def _start(self, piece: Piece) -> Values:
        return self._job.start(piece, np.zeros(len(piece.cells)))

    def work(self, item: int) -> float:
        """Of all steps."""
        return self._job.work(self._pieces[item]) * self._job.steps

    def result(self, item: int) -> Values:
        """The last state, one number after another; zeros after the end of shorter ones."""
        state, piece = self._starts[item], self._pieces[item]
        for step in range(self._job.steps):
            state = self._job.step(piece, state, np.empty((0, *state.shape[1:])), step)
        found = np.zeros(self.length)
        found[: state.size] = state.ravel()
        return found

    def answer(self, results: NDArray[np.float64]) -> dict[str, float]:
        """None: the answer is a field."""
        return {}


def bag(work: BagWork, keys: Carried, context: BuildContext) -> Tellers[Hand]:
    """The job of doing all items of a bag. Raises InputError for a bag that no swarm can do."""
    items, size = work.items, work.length * NUMBER.itemsize
    if not 1 <= items < 1 << 32:
        raise InputError(f"items: {items}; expected 1 or more")
    if not 0 < size <= LONGEST:
        raise InputError(f"items: results of {size} bytes; expected 1 to {LONGEST // NUMBER.itemsize} numbers")
    check_budget(keys.budget, [size], "a result")
    tally = BagTally(work, keys.name, len(context.ids))
    return Tellers(context, lambda robot: Hand(work, keys, context, robot), tally, type(work), tables=(RESULTS,))


class Hand:
    """One robot: what it works at, and the claims and results that it knows."""

    def __init__(self, work: BagWork, keys: Carried, context: BuildContext, me: int) -> None:
        self._work, self._keys, self._me, self._swarm = work, keys, me, context.swarm
        self.board = FactBoard(me, keys.patience * context.rounds)
        self._every = max(1, keys.patience // SIGNS)  # iterations between signs of life
        self._pace = math.inf if keys.rate is None else keys.rate * context.period / context.rounds  # in an exchange
        self._seen: dict[int, int] = {}  # iteration of the last news, by item
        self._order = sorted(range(work.items), key=lambda item: (self.takes(item), self._turn(item)))
        self._item, self._left, self._claimed = -1, 0.0, 0  # at work, operations left, iteration of the last claim
        #: Items that it has done itself, until they are summed up.
        self.did: list[int] = []

    def _turn(self, item: int) -> int:
        """Its own order of items: idle robots do not all turn to the same one."""
        return zlib.crc32(item.to_bytes(4) + self._me.to_bytes(4))

    def wake(self, now: int) -> None:
        """Let no claim lapse for what was not heard."""
        self._seen = dict.fromkeys(self._seen, now)

    def _open(self, item: int, now: int) -> bool:
        """Whether nobody has done or claims an item, as far as is known."""
        known = self.board.entries.get(item)
        if known is None:
            return True
        return known.version != DONE and (known.robot == self._me or now - self._seen[item] > self._keys.patience)

    def say(self, now: int, clock: int) -> list[Fact]:
        """Take an item if idle, and tell of claims and results."""
        if self._item < 0:
            self._item = next((item for item in self._order if self._open(item, now)), -1)
            self._left = 0.0 if self._item < 0 else self._work.work(self._item)
            self._claim(now)
        elif now - self._claimed >= self._every:
            self._claim(now)
        told = within(self.board.wanted(clock), self._keys.budget)
        self.board.told(told, clock)
        return told

    def _claim(self, now: int) -> None:
        if self._item >= 0:
            self._claimed = self._seen[self._item] = now
            self.board.write(self._item, b"")

    def hear(self, facts: list[Fact], now: int, clock: int) -> None:
        """Give up what others do or have done; then work for an exchange."""
        for fact in self.board.hear(facts):
            self._seen[fact.key] = now
            if fact.key == self._item:
                self._item = -1
        self._left -= self._pace
        if self._item >= 0 and self._left <= 0.0:
            self.board.write(self._item, self._done(self._item), DONE, 0)
            self.did.append(self._item)
            self._order.remove(self._item)
            self._item = -1

    def _done(self, item: int) -> bytes:
        """An item's result. Raises ValueError for another shape than announced, InputError for what is not finite."""
        found = np.asarray(self._work.result(item), np.float64)
        if found.shape != (self._work.length,):
            raise ValueError(f"result: item {item} gives shape {found.shape}; expected ({self._work.length},)")
        if not np.isfinite(found).all():
            raise InputError(f"jobs: {self._keys.name!r}: the result of item {item} is not finite; expected numbers")
        return found.astype(NUMBER).tobytes()

    def takes(self, item: int) -> bool:
        """Whether an item is in another robot's share."""
        return item % self._swarm != self._me

    def learn(self, other: Self) -> None:
        """Take in another robot's claims and results."""
        self.board.learn(other.board)
        self._seen = {**other._seen, **self._seen}

    def results(self) -> dict[int, bytes]:
        """All that it knows."""
        return {item: fact.value for item, fact in self.board.entries.items() if fact.version == DONE}


@dataclass(frozen=True, slots=True, eq=False)
class Results(JobStanding):
    """What robots know of a bag, and did; all arrays are read-only."""

    bag: BagWork
    name: str
    results: tuple[dict[int, bytes], ...]  # of each robot
    known: NDArray[np.bool_]  # (n, items): whose results the robot has
    did: NDArray[np.int32]  # (n, items): how often the robot has done each
    stolen: NDArray[np.int32]  # (n,): of these, how many were in another robot's share

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """What is known and done, and all results one after another."""
        told = b"".join(found[item] for found in self.results for item in sorted(found))
        return self.known, self.did, self.stolen, np.frombuffer(told, NUMBER)

    def record(self) -> Record:
        """What is known and done."""
        columns = zip(("known", "did", "stolen"), self.arrays(), strict=False)
        return Record({f"{self.name}_{column}": rows for column, rows in columns})

    def sample(self, alive: NDArray[np.bool_]) -> dict[str, Row]:
        """How many results each robot has."""
        return {"results": self.known.sum(axis=1)}

    def share(self, alive: NDArray[np.bool_]) -> float:
        """The share of items of which the living robot with the most results has the results."""
        return float(self.known[alive].mean(axis=1).max(initial=0.0))

    def ended(self, alive: NDArray[np.bool_]) -> bool:
        """Whether a living robot has all results."""
        return bool(self.known[alive].all(axis=1).any())

    def numbers(self, alive: NDArray[np.bool_]) -> dict[str, float]:
        """How many items were done, done more than once, or by another robot than their own, by dead robots too."""
        done = self.did.sum(axis=0)
        return {
            "items_done": float(np.count_nonzero(done)), "items_again": float(np.maximum(done - 1, 0).sum()),
            "items_stolen": float(self.stolen.sum()),
        }  # fmt: skip

    def found(self, alive: NDArray[np.bool_]) -> NDArray[np.float64] | None:
        """All results (items, length), if a living robot has them."""
        for robot in np.flatnonzero(alive & self.known.all(axis=1)).tolist():
            told = self.results[robot]
            return np.array([np.frombuffer(told[item], NUMBER) for item in range(self.bag.items)], np.float64)
        return None

    def answer(self, alive: NDArray[np.bool_]) -> dict[str, float | None]:
        """What the results come to; nothing while some are missing."""
        results = self.found(alive)
        return {} if results is None else dict(self.bag.answer(results))


class BagTally:
    """Sums up what robots know and did; what was done stays done when a robot loses everything."""

    def __init__(self, work: BagWork, name: str, rows: int) -> None:
        self._work, self._name = work, name
        self._did, self._stolen = np.zeros((rows, work.items), np.int32), np.zeros(rows, np.int32)

    def __call__(self, parts: Sequence[Hand], now: int) -> Results:
        known, results = np.zeros(self._did.shape, np.bool_), [part.results() for part in parts]
        for row, part in enumerate(parts):
            known[row, list(results[row])] = True
            for item in part.did:
                self._did[row, item] += 1
                self._stolen[row] += part.takes(item)
            part.did.clear()
        columns = known, self._did.copy(), self._stolen.copy()
        for array in columns:
            array.setflags(write=False)
        return Results(self._work, self._name, tuple(results), *columns)
