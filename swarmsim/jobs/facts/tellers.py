"""A job of facts: each robot's part in it, the same for one robot as for a swarm."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.messages import HEADER, Broadcast, Inbox
from swarmsim.core.probes import ProbeTable, Row
from swarmsim.core.state import Knowledge, Senses
from swarmsim.jobs.facts.wire import Fact, FactCodec, Facts


class Teller(Protocol):
    """One robot's part. It reads what it has heard alone. `now` counts iterations, `clock` exchanges."""

    def wake(self, now: int) -> None:
        """Count all silence from now on, having been away."""
        ...

    def say(self, now: int, clock: int) -> list[Fact]:
        """What it tells in an exchange."""
        ...

    def hear(self, facts: list[Fact], now: int, clock: int) -> None:
        """Take in what was told to it."""
        ...

    def learn(self, other: Self) -> None:
        """Take in what another robot knows."""
        ...


T = TypeVar("T", bound=Teller)
S = TypeVar("S", bound="JobStanding")


class JobStanding(Knowledge, ABC):
    """How a job of facts stands."""

    __slots__ = ()

    @abstractmethod
    def share(self, alive: NDArray[np.bool_]) -> float:
        """How much of it living robots (n,) have done, 0 to 1."""

    @abstractmethod
    def ended(self, alive: NDArray[np.bool_]) -> bool:
        """Whether living robots have nothing left to do."""

    @abstractmethod
    def numbers(self, alive: NDArray[np.bool_]) -> dict[str, float]:
        """What is measured of it besides, always the same names."""

    def answer(self, alive: NDArray[np.bool_]) -> dict[str, float | None]:
        """What living robots have found in the end, by name."""
        return {}

    def sample(self, alive: NDArray[np.bool_]) -> dict[str, Row]:
        """A row of each table that the job declares."""
        return {}


class SharedJob(ABC, Generic[T, S]):
    """A job for some robots, or all, in which each has a part."""

    def __init__(
        self, context: BuildContext, new: Callable[[int], T], standing: Callable[[Sequence[T], int], S],
        written_by: type | None = None, look: Callable[[Sequence[T], Senses], None] | None = None,
        tables: tuple[ProbeTable, ...] = (), knowledge_type: type[Knowledge] = JobStanding,
        codec: FactCodec | None = None,
    ) -> None:  # fmt: skip
        """`new` makes the part of a robot by number; `standing` tells how all stand after an exchange.

        `written_by` is the class whose code it runs, if that is not this package's. `look` gives all parts what their
        robots sense, before they say anything. `tables` are those that `JobStanding.sample` gives rows of, for
        recordings and pictures. `knowledge_type` is what `standing` gives. `codec` is the form of its messages.
        """
        #: What it tells, where it is the minds' computation too.
        self.knowledge_type = knowledge_type
        #: What it shows.
        self.tables = tables
        #: The class named in messages about broken contracts.
        self.written_by: type = written_by or type(self)
        #: The form of its messages.
        self.codec = codec or FactCodec()
        self._ids, self._rounds = context.ids.tolist(), context.rounds
        self._new, self._standing, self._look = new, standing, look
        self._parts = [new(robot) for robot in self._ids]
        self._awake = np.zeros(len(self._ids), np.bool_)
        self._clock = self._iteration = -1

    def say(self, senses: Senses) -> Broadcast[Facts]:
        """Every robot's part in one exchange."""
        new = senses.iteration != self._iteration
        self._clock = senses.iteration * self._rounds if new else self._clock + 1
        self._iteration = senses.iteration
        if self._look is not None:
            self._look(self._parts, senses)
        told = [self._told(row, senses) for row in range(len(self._parts))]
        sizes = [HEADER.size + sum(map(self.codec.size, facts)) if facts else 0 for facts in told]
        ends = np.cumsum([len(facts) for facts in told], dtype=np.int64)
        return Broadcast(Facts.of([fact for facts in told for fact in facts]), ends, np.array(sizes, np.int32))

    def _told(self, row: int, senses: Senses) -> list[Fact]:
        if senses.alive[row] and not self._awake[row]:
            self._parts[row].wake(senses.iteration)
        self._awake[row] = senses.alive[row]
        return self._parts[row].say(senses.iteration, self._clock) if senses.alive[row] else []

    def hear(self, senses: Senses, inbox: Inbox[Facts]) -> S:
        """How the job stands after an exchange."""
        facts = inbox.content.rows()
        ends = np.searchsorted(inbox.receivers, np.arange(len(self._parts) + 1))
        for row, part in enumerate(self._parts):
            if senses.alive[row] and self._awake[row]:
                part.hear(facts[ends[row] : ends[row + 1]], senses.iteration, self._clock)
        return self._standing(self._parts, senses.iteration)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase all that these rows (r,) have of the job."""
        for row in robots.tolist():
            self._parts[row] = self._new(self._ids[row])
            self._awake[row] = False

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give these rows (r,) what the row `source` knows."""
        for row in robots.tolist():
            self._parts[row].learn(self._parts[source])


class Tellers(SharedJob[T, JobStanding]):
    """A job of facts."""
