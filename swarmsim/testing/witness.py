"""What goes into minds and comes out of them, noted in a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import Broadcast, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, AnyStrategy, Exchanges
from swarmsim.core.probes import ProbeTable
from swarmsim.core.processors import Processors
from swarmsim.core.state import Intents, JobReport, Knowledge, Senses
from swarmsim.faults.delegate import ComputationDelegate


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """A mind's inputs and outputs in one iteration."""

    changes: Sequence[tuple[NDArray[np.int64], int | None]]  # before it: resets, and copies from a source
    speaks: Senses  # when it sent
    hears: tuple[Senses, Inbox[MessageBatch]]  # when it received
    decides: tuple[Senses, Inbox[MessageBatch]]  # when it decided
    said: Broadcast[MessageBatch]
    intents: Intents
    more: Sequence[tuple[Senses, Broadcast[MessageBatch], Inbox[MessageBatch]]] = ()  # further exchanges, of jobs
    pace: NDArray[np.float64] | None = None  # (n,): the share of their rates that processors had, if there are jobs


class Witness(ComputationDelegate):
    """Notes the inputs of a computation and of the strategy beside it."""

    def __init__(self, inner: AnyComputation, strategy: AnyStrategy) -> None:
        super().__init__(inner)
        #: Everything so far, in order.
        self.heard: list[Heard] = []
        #: The strategy, also noted.
        self.strategy = WitnessedStrategy(strategy, self)
        self._changes: list[tuple[NDArray[np.int64], int | None]] = []
        self._spoken: list[tuple[Senses, Broadcast[MessageBatch]]] = []
        self._given: list[tuple[Senses, Inbox[MessageBatch]]] = []
        #: The further exchanges of this iteration.
        self.more: list[tuple[Senses, Broadcast[MessageBatch], Inbox[MessageBatch]]] = []
        #: The processors of jobs, if there are any.
        self.processors: Processors | None = None

    def say(self, senses: Senses) -> Broadcast[MessageBatch]:
        said = self._inner.say(senses)
        kept = replace(said, content=said.content.take(np.arange(len(said.content))))
        self._spoken.append((copied(senses), kept))
        return said

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> Knowledge:
        self._given.append((copied(senses), inbox))
        return self._inner.hear(senses, inbox)

    def decided(self, senses: Senses, inbox: Inbox[MessageBatch], intents: Intents) -> None:
        """The end of an iteration."""
        speaks, said = self._spoken[-1]
        decides = (copied(senses), inbox)
        pace = None if self.processors is None else self.processors.speed
        self.heard.append(Heard(self._changes, speaks, self._given[-1], decides, said, intents, self.more, pace))
        self._changes, self.more = [], []

    def reset(self, robots: NDArray[np.int64]) -> None:
        self._changes.append((robots.copy(), None))
        self._inner.reset(robots)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """The robots that get another one's knowledge."""
        self._changes.append((robots.copy(), source))
        self._inner.copy_from(robots, source)


class WitnessedJobs:
    """Notes the further exchanges of jobs."""

    def __init__(self, inner: Exchanges, witness: Witness) -> None:
        self._inner, self._witness, witness.processors = inner, witness, inner.processors
        self._said: Broadcast[MessageBatch] | None = None

    @property
    def told(self) -> tuple[JobReport, ...]:
        """What the jobs have found."""
        return self._inner.told

    @property
    def processors(self) -> Processors:
        """What robots compute them on."""
        return self._inner.processors

    @property
    def tables(self) -> Mapping[str, tuple[ProbeTable, ...]]:
        """What the jobs show."""
        return self._inner.tables

    def say_more(self, senses: Senses) -> Broadcast[MessageBatch]:
        self._said = self._inner.say_more(senses)
        return self._said

    def hear_more(self, senses: Senses, inbox: Inbox[MessageBatch]) -> None:
        """Note the exchange, and pass it on."""
        if self._said is not None:
            self._witness.more.append((copied(senses), self._said, inbox))
        self._inner.hear_more(senses, inbox)


class WitnessedStrategy:
    """Notes a strategy's inputs and decisions."""

    def __init__(self, inner: AnyStrategy, witness: Witness) -> None:
        self._inner, self._witness = inner, witness

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """The knowledge that the inner strategy reads."""
        return self._inner.requires_knowledge

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        intents = self._inner.step(senses, inbox, knowledge)
        self._witness.decided(senses, inbox, intents)
        return intents


def copied(senses: Senses) -> Senses:
    return chosen(senses, np.arange(len(senses.alive)))


def chosen(senses: Senses, rows: NDArray[np.int64]) -> Senses:
    """The same with the rows of arrays in this order."""
    decided = senses.decided
    if decided is not None:
        columns = {one.name: getattr(decided, one.name) for one in fields(decided) if one.name != "commands"}
        decided = replace(
            decided, commands={name: column[rows] for name, column in decided.commands.items()},
            **{name: column[rows] for name, column in columns.items() if column is not None},
        )  # fmt: skip
    return replace(
        senses, pose=senses.pose[rows], velocity=senses.velocity[rows], alive=senses.alive[rows],
        readings=senses.readings.take(rows), decided=decided,
    )  # fmt: skip
