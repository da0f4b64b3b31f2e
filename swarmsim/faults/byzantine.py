"""Byzantine robots: members of the swarm that send false messages (Lamport, Shostak and Pease 1982)."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Annotated, Final, Protocol

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.bundle import EnvelopeCodec, whole
from swarmsim.core.capabilities import FALSIFIABLE
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.groups import GroupKnowledge
from swarmsim.core.kinds import Mixed
from swarmsim.core.messages import Broadcast, C, Codec, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, Parts
from swarmsim.core.state import Knowledge, Senses
from swarmsim.faults.delegate import ComputationDelegate
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.timeline import Timed, Timeline

Shift = Annotated[int, Meta(ge=-10_000, le=10_000)]
OF_ANY: Final = {"replay": "age", "spoof": "id"}  # the lies that any robot can tell, each with its key


class Byzantine(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots lie in every item of every message; their own sensing, knowledge and actions stay right.

    `replay`: each item is the one sent `age` iterations ago (at first the oldest there is), dated now.
    `spoof`: messages and own items heard directly from a liar carry the name of another robot; relays pass them on
    under that name. All other lies depend on the robots' computation. Robots that map tell `inverted` tiles (free and
    occupied swapped), all `free` or all `occupied` ones, whether seen or not, or give them another `origin`, `offset`
    cells from where they were sensed.
    """

    failure: str  # replay, spoof or, for robots that map, inverted, free, occupied, origin; else their mind's own
    offset: tuple[Shift, Shift] | None = None  # for lies that have one, such as origin: rows (up) and columns (right)
    age: Annotated[int, Meta(ge=1, le=100_000)] | None = None  # for replay: iterations
    id: Annotated[int, Meta(ge=0)] | None = None  # for spoof: the robot it pretends to be; default: any, anew each time

    @property
    def of_mind(self) -> bool:
        """Whether a robot that is a process of its own has it in its mind: what it says, and not in whose name."""
        return self.failure != "spoof"

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for a key that its failure does not have, or lacks."""
        for failure, key in OF_ANY.items():
            if getattr(self, key) is not None and self.failure != failure:
                raise self._has_none(key, f"failure = {failure!r}")
        if self.offset is not None and self.failure in OF_ANY:
            raise self._has_none("offset", "it left out")
        others = context.swarm - 1
        if self.id is not None and self.id > others:
            raise InputError(f"id: there is no robot {self.id}; expected one from 0 to {others}")
        if self.failure == "spoof" and others == 0:
            raise InputError(
                "failure: a single robot has no other to pass itself off as; expected robots.count = 2 or more"
            )
        if self.failure == "replay" and self.age is None:
            raise InputError("age: required key is missing; expected iterations for failure = 'replay'")
        return TimedFault(Timeline(self, context), Lying(self, context), context.number)

    def lie(self, computation: AnyComputation) -> Telling | None:
        """What changes messages, if anything does. Raises InputError for an unknown lie."""
        if self.failure == "spoof":
            return None
        if self.age is not None:
            return Replayed(self.age)
        known = FALSIFIABLE.needed(computation, f"failure: {self.failure!r}", " or ".join(map(repr, OF_ANY))).lies
        if self.failure not in known:
            told = nearest(self.failure, {**known, **OF_ANY})
            raise InputError(f"failure: these robots know no lie called {self.failure!r}; {told}")
        lie = known[self.failure]
        if self.offset is not None and not lie.offset:
            having = " or ".join(f"failure = {name!r}" for name, one in known.items() if one.offset)
            raise self._has_none("offset", having or "it left out")
        if self.offset is None and lie.offset:
            raise InputError(f"offset: required key is missing; expected {lie.offset} for failure = {self.failure!r}")
        offset = self.offset or (0, 0)
        return lambda said, rows: replace(said, content=lie.told(said.content, rows, offset))

    def _has_none(self, key: str, expected: str) -> InputError:
        return InputError(f"{key}: a lie of kind {self.failure!r} has none; expected {expected}")


class Telling(Protocol):
    """Turns the truth into something else."""

    def __call__(self, said: Broadcast[MessageBatch], rows: NDArray[np.bool_], /) -> Broadcast[MessageBatch]:
        """The message with lies in these items, `rows` (t,); called in every iteration."""
        ...


class Replayed:
    """Repeats an earlier message: its first item for the first of this one, and so on."""

    def __init__(self, age: int) -> None:
        self._past: deque[Broadcast[MessageBatch]] = deque(maxlen=age + 1)

    def __call__(self, said: Broadcast[C], rows: NDArray[np.bool_], /) -> Broadcast[C]:
        """Replace new items by old ones, dated now. Where the old message had fewer, the others are left out.

        A message keeps its first item, which says nothing if the old message had none.
        """
        content = said.content
        self._past.append(replace(said, content=content.take(np.arange(len(content)))))
        before = self._past[0]
        starts, old_starts = said.starts(), before.starts()
        owners = np.repeat(np.arange(len(said.ends)), said.ends - starts)
        old = old_starts[owners] + np.arange(len(owners)) - starts[owners]
        there = rows & (old < before.ends[owners])
        columns = {}
        for name, now, past in zip(
            type(content).__match_args__, content.arrays(), before.content.arrays(), strict=True
        ):
            if name not in content.PROVENANCE:
                columns[name] = column = now.copy()
                if name in content.SILENT:
                    column[rows] = content.SILENT[name]
                column[there] = past[old[there]]
        kept = ~rows | there | (old == old_starts[owners])
        ends = np.concatenate([np.zeros(1, np.int64), np.cumsum(kept)])[said.ends]
        return replace(said, content=replace(content, **columns).take(kept), ends=ends)


class FalseNames:
    """The name on each liar's message, remembered while messages are under way."""

    def __init__(self, context: BuildContext, name: int | None, purpose: str) -> None:
        """`name`: the robot that all liars pass themselves off as; without it they draw from streams of `purpose`."""
        robots = context.swarm
        self._name, self._ids = name, np.arange(robots, dtype=np.int32)
        self._streams = [context.streams.open(purpose, robot) for robot in range(robots)]
        self._given: dict[int, NDArray[np.int32]] = {}  # (n,) by iteration

    def give(self, iteration: int, liars: NDArray[np.bool_]) -> None:
        """Name the messages of an iteration: any robot but the liar, all equally likely."""
        names = self._ids.copy()
        for robot in np.flatnonzero(liars):
            if self._name is None:
                drawn = int(self._streams[robot].integers(len(names) - 1))
                names[robot] = drawn + (drawn >= robot)
            else:
                names[robot] = self._name
        self._given[iteration] = names

    def signed(self, inbox: Inbox[MessageBatch]) -> Inbox[MessageBatch]:
        """The inbox as it appears to its receivers."""
        names = inbox.senders.copy()
        for iteration in np.unique(inbox.sent).tolist():
            rows: NDArray[np.bool_] = inbox.sent == iteration
            names[rows] = self._given[iteration][names[rows]]
        for iteration in [t for t in self._given if t < inbox.oldest]:
            del self._given[iteration]
        if (names == inbox.senders).all():
            return inbox

        def renamed(items: NDArray[np.bool_], content: MessageBatch) -> MessageBatch:
            if not content.SOURCE:
                return content
            sources, said_by = getattr(content, content.SOURCE), inbox.senders[items]
            return replace(content, **{content.SOURCE: np.where(sources == said_by, names[items], sources)})

        content, everything = inbox.content, np.ones(len(names), np.bool_)
        content = content.each(renamed) if isinstance(content, Mixed) else renamed(everything, content)
        believed = replace(inbox, senders=names, content=content)
        return believed.take(np.lexsort([names, inbox.receivers]))


class Lying(StatelessEffect):
    """Wraps the computation."""

    def __init__(self, fault: Byzantine, context: BuildContext) -> None:
        self._fault = fault
        spoofs = fault.failure == "spoof"
        self._names = FalseNames(context, fault.id, f"fault byzantine {context.number}") if spoofs else None

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the computation wrapped. Raises InputError for a lie that their messages cannot hold."""
        lie = self._fault.lie(parts.computation)
        if lie is not None and issubclass(parts.computation.knowledge_type, GroupKnowledge):
            raise InputError("failure: 'replay' is for robots of one mind; expected 'spoof' for groups of several")
        return replace(parts, computation=LyingComputation(parts.computation, active, lie, self._names))


class LyingComputation(ComputationDelegate):
    """A computation in which some robots misstate their knowledge or their identity."""

    def __init__(
        self, inner: AnyComputation, active: NDArray[np.bool_], lie: Telling | None, names: FalseNames | None
    ) -> None:
        super().__init__(inner)
        self._active, self._lie, self._names = active, lie, names
        self._own: Codec[MessageBatch] = inner.codec.own if isinstance(inner.codec, EnvelopeCodec) else inner.codec

    def say(self, senses: Senses) -> Broadcast[MessageBatch]:
        """The message of every robot, with lies in those of the liars, which themselves know the truth."""
        said = self._inner.say(senses)
        if self._lie is not None:
            lies = self._lie(said, np.repeat(self._active, said.ends - said.starts()))
            said = self._on_air(lies, senses.iteration)
        if self._names is not None:
            self._names.give(senses.iteration, self._active & senses.alive)
        return said

    def _on_air(self, said: Broadcast[MessageBatch], iteration: int) -> Broadcast[MessageBatch]:
        """The same with what the liars' messages can hold of their lies, and with the sizes that these have."""
        speaking = said.ends > said.starts()
        liars = np.flatnonzero(self._active & speaking).tolist()
        if not liars:
            return said
        items = [said.of(robot) for robot in range(len(said.ends))]
        for robot in liars:
            *_, items[robot] = self._own.unpack(self._own.pack(robot, iteration, items[robot]))
        ends = np.cumsum([len(one) for one in items], dtype=np.int64)
        told = replace(said, content=type(said.content).joined(items), ends=ends, sizes=said.sizes.copy())
        for robot in liars:
            told.sizes[robot] = len(self._inner.codec.pack(robot, 0, whole(told, robot)))
        return told

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> Knowledge:
        """The robots' knowledge from messages attributed to the names on them."""
        return self._inner.hear(senses, inbox if self._names is None else self._names.signed(inbox))
