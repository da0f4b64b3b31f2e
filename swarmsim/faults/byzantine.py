"""Byzantine robots: members of the swarm that say what is not so (Lamport, Shostak and Pease 1982)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields, replace
from typing import Annotated, Literal, Protocol

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Broadcast, C, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, Parts
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Knowledge, Senses
from swarmsim.faults.delegate import ComputationDelegate
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.timeline import Timed, Timeline
from swarmsim.operations.mapping.maps import Maps, TileItems

Cells = Annotated[int, Meta(ge=-10_000, le=10_000)]
KEYS = {"offset": "origin", "age": "replay", "id": "spoof"}  # which failure has which key
SWAPPED = np.array([UNKNOWN, OCCUPIED, FREE], np.uint8)  # what a tile's values turn into


class Byzantine(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots lie in every tile of every message; what they sense, map and do themselves stays right.

    `inverted`: free is said to be occupied, and occupied free. `free`, `occupied`: so is every cell, whether seen or
    not. `origin`: each tile lies `offset` cells from where it was sensed. `replay`: each tile is the one said `age`
    iterations ago, or at first the oldest there is, as if sensed now. `spoof`: what is heard directly of a liar seems
    to come from another robot; under its false name, its own tile as well. A relay passes it on under the
    name that it heard.
    """

    failure: Literal["inverted", "free", "occupied", "origin", "replay", "spoof"]
    offset: tuple[Cells, Cells] | None = None  # for origin: rows (up) and columns (right)
    age: Annotated[int, Meta(ge=1, le=100_000)] | None = None  # for replay: iterations
    id: Annotated[int, Meta(ge=0)] | None = None  # for spoof: whom it pretends to be; default: anybody, anew each time

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for a key that its failure does not have, or lacks."""
        for key, failure in KEYS.items():
            if getattr(self, key) is not None and self.failure != failure:
                raise InputError(f"{key}: a lie of kind {self.failure!r} has none; expected failure = {failure!r}")
        others = context.swarm - 1
        if self.id is not None and self.id > others:
            raise InputError(f"id: there is no robot {self.id}; expected one from 0 to {others}")
        if self.failure == "spoof" and others == 0:
            raise InputError(
                "failure: a robot alone has nobody to pass itself off as; expected robots.count = 2 or more"
            )
        effect = Lying(self.failure, self._lie(), self._names(context))
        return TimedFault(Timeline(self, context), effect, context.number)

    def _lie(self) -> Lie | None:
        """What happens to tiles, if anything does."""
        if self.failure == "inverted":
            return Inverted()
        if self.failure in ("free", "occupied"):
            return Uniform(FREE if self.failure == "free" else OCCUPIED)
        if self.failure == "origin":
            if self.offset is None:
                raise InputError("offset: required key is missing; expected [rows, columns] for failure = 'origin'")
            return Displaced(np.array(self.offset, np.int32))
        if self.failure == "replay":
            if self.age is None:
                raise InputError("age: required key is missing; expected iterations for failure = 'replay'")
            return Replayed(self.age)
        return None

    def _names(self, context: BuildContext) -> FalseNames | None:
        """Whom liars pretend to be, if they do."""
        return FalseNames(context, self.id, f"fault byzantine {context.number}") if self.failure == "spoof" else None


class Lie(Protocol):
    """Turns the truth into something else."""

    @property
    def needs_tiles(self) -> bool:
        """Whether it can be told of tiles alone."""
        ...

    def told(self, said: Broadcast[TileItems], rows: NDArray[np.bool_]) -> Broadcast[TileItems]:
        """What is said, but for some items, `rows` (t,), that are lies; asked in every iteration."""
        ...


class Inverted:
    """Says free of what is occupied, and occupied of what is free."""

    needs_tiles = True

    def told(self, said: Broadcast[TileItems], rows: NDArray[np.bool_]) -> Broadcast[TileItems]:
        """Swap the two."""
        values = said.content.values.copy()
        values[rows] = SWAPPED[values[rows]]
        return replace(said, content=replace(said.content, values=values))


@dataclass(frozen=True, slots=True)
class Uniform:
    """Says the same of every cell, seen or not."""

    value: int
    needs_tiles: bool = True

    def told(self, said: Broadcast[TileItems], rows: NDArray[np.bool_]) -> Broadcast[TileItems]:
        """Write it everywhere."""
        values = said.content.values.copy()
        values[rows] = self.value
        return replace(said, content=replace(said.content, values=values))


@dataclass(frozen=True, slots=True, eq=False)
class Displaced:
    """Says that tiles lie elsewhere."""

    offset: NDArray[np.int32]  # (2,): rows, columns
    needs_tiles: bool = True

    def told(self, said: Broadcast[TileItems], rows: NDArray[np.bool_]) -> Broadcast[TileItems]:
        """Move them."""
        origins = said.content.origins.copy()
        origins[rows] += self.offset
        return replace(said, content=replace(said.content, origins=origins))


class Replayed:
    """Says what was true some iterations ago: the first item of that message for the first of this, and so on."""

    needs_tiles = False

    def __init__(self, age: int) -> None:
        self._past: deque[Broadcast[MessageBatch]] = deque(maxlen=age + 1)

    def told(self, said: Broadcast[C], rows: NDArray[np.bool_]) -> Broadcast[C]:
        """Put old items in the place of new ones; where the old message had fewer, tiles are unknown all over.

        Tiles are told as if they had been sensed now.
        """
        self._past.append(replace(said, content=said.content.take(np.arange(len(said.content)))))
        before = self._past[0]
        starts, old_starts = said.starts(), before.starts()
        owners = np.repeat(np.arange(len(said.ends)), said.ends - starts)
        old = old_starts[owners] + np.arange(len(owners)) - starts[owners]
        there = rows & (old < before.ends[owners])
        columns = {}
        for field in fields(said.content):
            if field.name not in ("sources", "sensed", "hops"):
                column = getattr(said.content, field.name).copy()
                if field.name == "values":
                    column[rows] = UNKNOWN
                column[there] = getattr(before.content, field.name)[old[there]]
                columns[field.name] = column
        return replace(said, content=replace(said.content, **columns))


class FalseNames:
    """Under whose name each liar's message goes, remembered while messages are under way."""

    def __init__(self, context: BuildContext, name: int | None, purpose: str) -> None:
        """`name` is the one robot that all pass themselves off as; without it they draw from streams of `purpose`."""
        robots = context.swarm
        self._name, self._ids = name, np.arange(robots, dtype=np.int32)
        self._streams = [context.streams.open(purpose, robot) for robot in range(robots)]
        self._given: dict[int, NDArray[np.int32]] = {}  # (n,) by iteration

    def give(self, iteration: int, liars: NDArray[np.bool_]) -> None:
        """Name the messages of an iteration: anybody but the liar, each as likely."""
        names = self._ids.copy()
        for robot in np.flatnonzero(liars):
            if self._name is None:
                drawn = int(self._streams[robot].integers(len(names) - 1))
                names[robot] = drawn + (drawn >= robot)
            else:
                names[robot] = self._name
        self._given[iteration] = names

    def signed(self, inbox: Inbox[MessageBatch]) -> Inbox[MessageBatch]:
        """The inbox as its receivers believe it to be."""
        names = inbox.senders.copy()
        for iteration in np.unique(inbox.sent).tolist():
            rows: NDArray[np.bool_] = inbox.sent == iteration
            names[rows] = self._given[iteration][names[rows]]
        for iteration in [t for t in self._given if t < inbox.oldest]:
            del self._given[iteration]
        if (names == inbox.senders).all():
            return inbox
        content = inbox.content
        if isinstance(content, TileItems):
            content = replace(content, sources=np.where(content.sources == inbox.senders, names, content.sources))
        believed = replace(inbox, senders=names, content=content)
        return believed.take(np.lexsort([names, inbox.receivers]))


class Lying(StatelessEffect):
    """Wraps the computation."""

    def __init__(self, failure: str, lie: Lie | None, names: FalseNames | None) -> None:
        self._failure, self._lie, self._names = failure, lie, names

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the computation wrapped. Raises InputError for a lie that their messages cannot hold."""
        if self._lie is not None and self._lie.needs_tiles and not issubclass(parts.computation.knowledge_type, Maps):
            raise InputError(
                f"failure: {self._failure!r} is a lie about tiles, and these robots tell none; expected 'replay' or "
                "'spoof'"
            )
        return replace(parts, computation=LyingComputation(parts.computation, active, self._lie, self._names))


class LyingComputation(ComputationDelegate):
    """A computation of which some robots do not say what they know, or not who they are."""

    def __init__(
        self, inner: AnyComputation, active: NDArray[np.bool_], lie: Lie | None, names: FalseNames | None
    ) -> None:
        super().__init__(inner)
        self._active, self._lie, self._names = active, lie, names

    def say(self, senses: Senses) -> Broadcast[TileItems]:
        """The message of every robot, with lies in those of the liars, who know the truth themselves."""
        said = self._inner.say(senses)
        if self._lie is not None:
            said = self._lie.told(said, np.repeat(self._active, said.ends - said.starts()))
        if self._names is not None:
            self._names.give(senses.iteration, self._active & senses.alive)
        return said

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> Knowledge:
        """What robots know by what they heard of those who seem to have said it."""
        return self._inner.hear(senses, inbox if self._names is None else self._names.signed(inbox))
