"""One robot that searches a source: its samples, what it heard of others', and what it makes of them."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import Domain
from swarmsim.core.lattice import Lattice
from swarmsim.jobs.facts.board import FactBoard
from swarmsim.jobs.facts.wire import Fact, within
from swarmsim.operations.models.truth import nearest_cells
from swarmsim.operations.sources.inversion import FoundSource, Inversion, Samples

#: A sample beside its robot, its number and its iteration: row and column of the cell, and the value.
SAMPLE: Final = struct.Struct(">HHf")
MOST: Final = float(np.finfo(np.float32).max)  # of a value


@dataclass(frozen=True, slots=True, eq=False)
class SearchPlan:
    """What all robots know before the run."""

    inversion: Inversion
    lattice: Lattice
    nearest: NDArray[np.int64]  # (rows, columns): the number of the free cell nearest to each
    cells: NDArray[np.int64]  # (c, 2): row and column of each free cell, by number
    period: float  # s
    every: int  # iterations between a robot's samples
    interval: int  # iterations between inversions
    budget: int | None  # bytes a message

    @classmethod
    def of(cls, inversion: Inversion, domain: Domain, period: float, keys: tuple[int, int, int | None]) -> Self:
        """A plan with the keys `every`, `interval` and `budget`."""
        return cls(inversion, domain.lattice, nearest_cells(domain), np.argwhere(domain.free), period, *keys)

    @property
    def last(self) -> float:
        """The time (s) of the last inversion that can be made."""
        return self.inversion.greens.duration


class Searcher:
    """See `Teller`. A sample is an entry of a table that is never written again, so all robots come to have it."""

    def __init__(self, plan: SearchPlan, me: int, board: FactBoard) -> None:
        self._plan, self._me, self._board = plan, me, board
        self._taken = 0
        self._sampled = -1  # iteration
        #: The iteration of the last inversion; -1 for none.
        self.made = -1
        #: What it found then.
        self.finding: FoundSource | None = None
        #: The candidates whose Green's functions it has used.
        self.tried: frozenset[int] = frozenset()

    def sample(self, now: int, place: NDArray[np.float64], value: float) -> None:
        """Take a sample (unit of the field) at a place (2,), once every so many iterations; none beyond 4 bytes."""
        if now == self._sampled or now % self._plan.every or not (np.isfinite(place).all() and abs(value) <= MOST):
            return
        self._sampled = now
        lattice = self._plan.lattice
        column, row = ((place - (lattice.x0, lattice.y0)) // lattice.cell).astype(int)
        limits = np.array(lattice.shape) - 1
        told = SAMPLE.pack(*np.clip((row, column), 0, limits).tolist(), value)
        self._board.write(self._me << 16 | self._taken, told, version=now)
        self._taken += 1

    def wake(self, now: int) -> None:
        """Having been away changes nothing."""

    def say(self, now: int, clock: int) -> list[Fact]:
        """Samples that are news, and old ones that others may lack."""
        told = within(self._board.wanted(clock), self._plan.budget)
        self._board.told(told, clock)
        return told

    def hear(self, facts: list[Fact], now: int, clock: int) -> None:
        """Keep all samples; invert them if it is time."""
        self._board.hear(facts)
        due = now % self._plan.interval == 0 and now * self._plan.period <= self._plan.last
        if due and now != self.made:
            self.made = now
            self.finding = self._plan.inversion.find(self.samples(now))
            if self.finding is not None:
                self.tried |= self.finding.tried

    def learn(self, other: Self) -> None:
        """Take in the samples that another robot has."""
        self._board.learn(other._board)

    def samples(self, now: int) -> Samples:
        """All samples known, but for those that cannot be: from the future, beyond the floor, or not finite."""
        facts = [self._board.entries[key] for key in sorted(self._board.entries)]
        found = [(fact.version, *SAMPLE.unpack(fact.value)) for fact in facts if len(fact.value) == SAMPLE.size]
        table = np.array(found, np.float64).reshape(-1, 4)
        rows, columns = self._plan.lattice.shape
        sound = (table[:, 0] <= now) & (table[:, 1] < rows) & (table[:, 2] < columns) & np.isfinite(table[:, 3])
        iteration, row, column, value = table[sound].T
        cells = self._plan.nearest[row.astype(np.int64), column.astype(np.int64)]
        return Samples(cells, iteration * self._plan.period, value)

    def count(self) -> int:
        """How many samples it has."""
        return len(self._board.entries)

    def age(self, now: int) -> float:
        """The mean time (s) since the newest sample of each other robot that it has heard of; NaN for none."""
        newest: dict[int, int] = {}
        for fact in self._board.entries.values():
            newest[fact.robot] = max(fact.version, newest.get(fact.robot, 0))
        ages = [now - version for robot, version in newest.items() if robot != self._me]
        return float(np.mean(ages)) * self._plan.period if ages else float("nan")
