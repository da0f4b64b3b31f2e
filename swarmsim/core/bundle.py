"""A computation and the jobs beside it, whose messages share one envelope."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import AnyJob
from swarmsim.core.messages import HEADER, Broadcast, Codec, FrameError, Inbox, MessageBatch, header_of
from swarmsim.core.parts import AnyComputation
from swarmsim.core.probes import ProbeTable
from swarmsim.core.processors import Processors
from swarmsim.core.state import JobReport, Knowledge, Senses

#: The length of each part in an envelope.
LENGTH: Final = struct.Struct(">I")


@dataclass(frozen=True, slots=True, eq=False)
class Envelope(MessageBatch):
    """One robot's message: its computation's part, then each job's."""

    parts: tuple[MessageBatch, ...]

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """How many items each part has, then their columns."""
        counts = np.array([len(one) for one in self.parts])
        return counts, *(column for one in self.parts if len(one) for column in one.arrays())

    def take(self, rows: NDArray[np.generic]) -> Self:
        """Not possible: it is one message. Raises TypeError."""
        raise TypeError("an envelope is one message; expected one of its parts")

    def __len__(self) -> int:
        return sum(len(one) for one in self.parts)


class EnvelopeCodec:
    """The sender and the exchange; then each part, packed by its own codec, after its length. Empty parts have none.

    Jobs date by exchanges, a computation by iterations, of `rounds` exchanges each.
    """

    def __init__(self, codecs: Sequence[Codec[MessageBatch]], rounds: int) -> None:
        self._codecs, self._rounds = codecs, rounds

    @property
    def own(self) -> Codec[MessageBatch]:
        """The computation's codec."""
        return self._codecs[0]

    def pack(self, sender: int, iteration: int, items: Envelope) -> bytes:
        """One message, of an exchange that is given as `iteration`."""
        packed = [
            codec.pack(sender, date, one) if len(one) else b""
            for codec, date, one in zip(self._codecs, self._dates(iteration), items.parts, strict=True)
        ]
        return HEADER.pack(sender, iteration) + b"".join(LENGTH.pack(len(one)) + one for one in packed)

    def unpack(self, data: bytes) -> tuple[int, int, Envelope]:
        """Its sender, exchange and parts; an empty one has no columns. Raises FrameError, also for a part's bytes."""
        sender, exchange = header_of(data)
        at, parts = HEADER.size, list[MessageBatch]()
        for codec, date in zip(self._codecs, self._dates(exchange), strict=True):
            if at + LENGTH.size > len(data):
                raise FrameError(f"an envelope of {len(data)} bytes, without the length of part {len(parts)}")
            (length,) = LENGTH.unpack_from(data, at)
            at += LENGTH.size + length
            if at > len(data):
                raise FrameError(f"an envelope of {len(data)} bytes with parts up to {at}")
            *its, part = codec.unpack(data[at - length : at]) if length else (sender, date, Nothing())
            if its != [sender, date] or (length and not len(part)):
                raise FrameError(f"part {len(parts)} of an envelope has another header, or is empty")
            parts.append(part)
        if at < len(data):
            raise FrameError(f"an envelope of {len(data)} bytes with parts up to {at}")
        return sender, exchange, Envelope(tuple(parts))

    def _dates(self, exchange: int) -> list[int]:
        """How each part is dated."""
        return [exchange // self._rounds, *[exchange] * (len(self._codecs) - 1)]


@dataclass(frozen=True, slots=True, eq=False)
class Nothing(MessageBatch):
    """An empty part of an envelope."""

    def __len__(self) -> int:
        return 0


class Bundle:
    """A computation that shares its messages with jobs.

    In the first exchange of an iteration it stands for the computation; further exchanges are for the jobs alone.
    What robots know is the computation's; what the jobs have found is in `told`. For the jobs, a robot whose processor
    stands still is as if dead.
    """

    def __init__(
        self, computation: AnyComputation, jobs: Mapping[str, AnyJob], processors: Processors, rounds: int
    ) -> None:
        """An iteration has `rounds` exchanges."""
        self._computation: Final = computation
        self._rounds: Final = rounds
        self._jobs: Final = dict(jobs)
        #: What robots compute the jobs on.
        self.processors: Final = processors
        #: What the jobs have found, and what that took, in the present iteration.
        self.told: tuple[JobReport, ...] = ()
        self._said: Broadcast[MessageBatch] | None = None
        self._sent, self._heard = ([0] * len(jobs) for _ in range(2))  # bytes of each job in the present iteration
        self._takes_in = np.zeros(0, np.bool_)  # (n,): which robots take anything in

    @property
    def tables(self) -> Mapping[str, tuple[ProbeTable, ...]]:
        """What each job shows, by its name; see `core.jobs`."""
        return {name: getattr(job, "tables", ()) for name, job in self._jobs.items()}

    @property
    def knowledge_type(self) -> type[Knowledge]:
        """The computation's."""
        return self._computation.knowledge_type

    @property
    def codec(self) -> EnvelopeCodec:
        """The envelope's."""
        codecs = [self._computation.codec, *(job.codec for job in self._jobs.values())]
        return EnvelopeCodec(codecs, self._rounds)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - what the computation has
        """Other attributes of the computation."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._computation, name)

    def say(self, senses: Senses) -> Broadcast[MessageBatch]:
        """The computation's messages, with the jobs' beside them."""
        self._said = said = self._computation.say(senses)
        self._sent, self._heard = ([0] * len(self._jobs) for _ in range(2))
        return self._with_jobs(said, senses)

    def say_more(self, senses: Senses) -> Broadcast[MessageBatch]:
        """The jobs' messages in a further exchange."""
        if self._said is None:
            raise RuntimeError("a further exchange before the first one")
        count, content = len(self._said.ends), self._said.content
        empty = Broadcast(content.take(np.zeros(0, np.int64)), np.zeros(count, np.int64), np.zeros(count, np.int32))
        return self._with_jobs(empty, senses)

    def _with_jobs(self, said: Broadcast[MessageBatch], senses: Senses) -> Broadcast[MessageBatch]:
        able = replace(senses, alive=senses.alive & self.processors.running)
        beside = tuple(job.say(able) for job in self._jobs.values())
        for number, one in enumerate(beside):
            self._sent[number] += int(one.sizes[senses.alive].sum())
        own = np.where(said.ends > said.starts(), said.sizes, 0)  # an envelope has no empty parts
        sizes = own + sum(one.sizes for one in beside)
        envelope = HEADER.size + LENGTH.size * (1 + len(beside))
        return replace(said, sizes=np.where(sizes > 0, sizes + envelope, 0).astype(np.int32), beside=beside)

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> Knowledge:
        """What robots know after the first exchange; the jobs take in their parts of what was heard."""
        known = self._computation.hear(senses, inbox)
        self._takes_in = senses.alive
        self.hear_more(senses, inbox)
        return known

    def hear_more(self, senses: Senses, inbox: Inbox[MessageBatch]) -> None:
        """The jobs take in their parts of what was heard."""
        awake = replace(senses, alive=senses.alive & self._takes_in & self.processors.running)
        self.processors.refill(awake.alive)
        found = []
        for number, (name, job) in enumerate(self._jobs.items()):
            part = inbox.beside[number]
            self._heard[number] += part.bytes
            found.append(JobReport(name, job.hear(awake, part), self._sent[number], self._heard[number]))
        self.told = tuple(found)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase what robots (r,) know, and their parts of the jobs."""
        self._computation.reset(robots)
        for job in self._jobs.values():
            job.reset(robots)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's knowledge, and its parts of the jobs, to robots (r,)."""
        self._computation.copy_from(robots, source)
        for job in self._jobs.values():
            job.copy_from(robots, source)


def whole(said: Broadcast[MessageBatch], robot: int) -> MessageBatch:
    """One robot's whole message: an envelope if there are jobs, else the items of its computation."""
    own = said.of(robot)
    return Envelope((own, *(one.of(robot) for one in said.beside))) if said.beside else own
