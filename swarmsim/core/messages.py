"""Messages: columns of any kind, packets under way, and what arrives."""

from __future__ import annotations

import struct
from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final, Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

Packets = NDArray[np.int32]  # (m, 4): receiver, sender, the iteration in which it was sent, bytes

#: The header of every message: sender (2 bytes) and iteration (4), big-endian.
HEADER: Final = struct.Struct(">HI")
LATEST: Final = (1 << 31) - 1  #: iteration that a message can tell of


class FrameError(ValueError):
    """Bytes that no robot of this scenario can have packed, found before memory is taken for what they claim."""


def check_length(data: bytes, least: int, most: int | None = None) -> None:
    """Raise FrameError unless there are from `least` to `most` bytes; None: exactly `least`."""
    most = least if most is None else most
    if not least <= len(data) <= most:
        raise FrameError(f"{len(data)} bytes; expected {least}{f' to {most}' if most > least else ''}")


def header_of(data: bytes) -> tuple[int, int]:
    """The sender and iteration of a message. Raises FrameError if it ends before, or lies in no run's time."""
    if len(data) < HEADER.size:
        raise FrameError(f"{len(data)} bytes; expected a header of {HEADER.size} and what follows")
    sender, iteration = HEADER.unpack_from(data)
    if iteration > LATEST:
        raise FrameError(f"iteration {iteration}; expected {LATEST} at most")
    return sender, iteration


@dataclass(frozen=True, slots=True, eq=False)
class MessageBatch(ABC):
    """A table of items; every field of a subclass is an array whose first axis counts them."""

    __match_args__: ClassVar[tuple[str, ...]] = ()  # the field names, kept here by dataclasses

    #: Whether `arrays` has other lengths than a row for each item.
    RAGGED: ClassVar[bool] = False
    #: The columns that tell an item's source and route, not its content.
    PROVENANCE: ClassVar[tuple[str, ...]] = ()
    #: The one of these that holds the source robot's number, if any.
    SOURCE: ClassVar[str] = ""
    #: Column values of an item that says nothing, where such values exist.
    SILENT: ClassVar[Mapping[str, int]] = {}

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All columns, in order."""
        return tuple([getattr(self, name) for name in self.__match_args__])

    def take(self, rows: NDArray[np.generic]) -> Self:
        """The items at these indices or under this mask."""
        return type(self)(*(column[rows] for column in self.arrays()))

    @classmethod
    def joined(cls, tables: Sequence[Self]) -> Self:
        """The items of one or more tables, concatenated."""
        return cls(*map(np.concatenate, zip(*(table.arrays() for table in tables), strict=True)))

    def __len__(self) -> int:
        return len(self.arrays()[0])


C = TypeVar("C", bound=MessageBatch)
C_co = TypeVar("C_co", bound=MessageBatch, covariant=True)


@dataclass(frozen=True, slots=True, eq=False)
class Broadcast(Generic[C_co]):
    """All robots' messages in one iteration: one each, with any number of items."""

    content: C_co  # (t,): the items of all messages
    ends: NDArray[np.int64]  # (n,): robot i sends the items ends[i - 1] to ends[i]
    sizes: NDArray[np.int32]  # (n,): bytes of each robot's message, header included
    one_each: bool = False  # whether item i is robot i's whole message: faster to look up
    beside: tuple[Broadcast[Any], ...] = ()  # each job's part of the same messages, which `sizes` includes

    @staticmethod
    def each(content: C, size: int) -> Broadcast[C]:
        """Item i is robot i's message, of `size` bytes."""
        count = len(content)
        return Broadcast(content, np.arange(1, count + 1), np.full(count, size, np.int32), one_each=True)

    def starts(self) -> NDArray[np.int64]:
        """Where each robot's items begin (n,)."""
        return np.concatenate([np.zeros(1, np.int64), self.ends[:-1]])

    def of(self, robot: int) -> C_co:
        """The items of one robot's message."""
        return self.content.take(np.arange(self.ends[robot - 1] if robot else 0, self.ends[robot]))


@dataclass(frozen=True, slots=True, eq=False)
class Delivery:
    """The fate of messages in one iteration: heard, lost, or still under way."""

    heard: Packets  # sorted by receiver, sender, iteration sent
    lost: tuple[tuple[str, Packets], ...]  # by reason
    oldest: int  # no message still under way was sent before this iteration


@dataclass(frozen=True, slots=True, eq=False)
class Inbox(Generic[C_co]):
    """The items heard in one iteration, sorted by receiver, sender and iteration sent."""

    receivers: NDArray[np.int32]  # (t,): the receivers' rows among the robots that a mind serves
    senders: NDArray[np.int32]  # (t,): the senders' numbers in the whole swarm
    sent: NDArray[np.int32]  # (t,): the iteration in which it was sent
    content: C_co  # (t,)
    oldest: int = 0  # no message still under way was sent before this iteration
    #: Messages of other kinds, from groups with other computations, by the kind's name.
    others: Mapping[str, Inbox[MessageBatch]] = field(default_factory=dict)
    beside: tuple[Inbox[Any], ...] = ()  # each job's part of all messages heard, whatever items were taken
    bytes: int = 0  # of a job's part

    def take(self, rows: NDArray[np.generic]) -> Inbox[C_co]:
        """Some of the items; messages of other kinds stay."""
        columns = (self.receivers[rows], self.senders[rows], self.sent[rows], self.content.take(rows))
        return Inbox(*columns, self.oldest, self.others, self.beside, self.bytes)

    def dates(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
        """Receivers, senders, and iterations sent."""
        return self.receivers, self.senders, self.sent

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All columns: receivers, senders, iterations sent, and the content's."""
        return *self.dates(), *self.content.arrays()

    def __len__(self) -> int:
        return len(self.receivers)


class Codec(Protocol[C]):
    """The wire format of a computation's messages; their lengths are the sizes that channels charge for."""

    def pack(self, sender: int, iteration: int, items: C) -> bytes:
        """One message."""
        ...

    def unpack(self, data: bytes) -> tuple[int, int, C]:
        """Its sender, the iteration in which it was sent, and its items, exactly as packed.

        Raises FrameError for bytes that `pack` cannot have made, before it takes memory for what they claim.
        """
        ...


def longest_of(codec: Codec[Any]) -> int:
    """The bytes of the longest message that a codec packs, if it tells in its `longest`; else 0."""
    found = getattr(codec, "longest", 0)
    return found if isinstance(found, int) else 0


class PlainCodec(Generic[C]):
    """One item per message: the header, then the item's fields in order, big-endian."""

    def __init__(self, example: C) -> None:
        """`example` has every column with an item's type and shape, for any number of items."""
        self._kind = type(example)
        self._columns = [(column.dtype.newbyteorder(">"), column.shape[1:]) for column in example.arrays()]
        #: Bytes of every message.
        self.size: int = HEADER.size + sum(kind.itemsize * int(np.prod(shape)) for kind, shape in self._columns)
        self.longest = self.size

    def pack(self, sender: int, iteration: int, items: C) -> bytes:
        """One message; raises ValueError unless it has one item."""
        if len(items) != 1:
            raise ValueError(f"{len(items)} items in a message that holds one")
        packed = (
            column.astype(kind).tobytes() for column, (kind, _) in zip(items.arrays(), self._columns, strict=True)
        )
        return HEADER.pack(sender, iteration) + b"".join(packed)

    def unpack(self, data: bytes) -> tuple[int, int, C]:
        """Its sender, iteration and item."""
        check_length(data, self.size)
        sender, iteration = header_of(data)
        at, columns = HEADER.size, []
        for kind, shape in self._columns:
            count = int(np.prod(shape))
            if kind.kind == "b" and max(data[at : at + count], default=0) > 1:
                raise FrameError("a truth value that is neither 0 nor 1")
            column = np.frombuffer(data, kind, count, at).reshape(1, *shape)
            columns.append(column.astype(kind.newbyteorder("=")))
            at += kind.itemsize * count
        return sender, iteration, self._kind(*columns)


class MessageBuffer(Generic[C]):
    """Keeps messages until they arrive; channels see only their packets."""

    def __init__(self) -> None:
        self._said: dict[int, Broadcast[C]] = {}  # by iteration

    def post(self, iteration: int, said: Broadcast[C]) -> None:
        """Take all robots' messages of an iteration."""
        self._said[iteration] = said

    def open(self, iteration: int, delivery: Delivery) -> Inbox[C]:
        """The content of the packets heard in this iteration; content that no packet under way refers to is dropped."""
        inbox = self._opened(iteration, delivery)
        if jobs := len(next(iter(self._said.values())).beside):
            beside = [self._opened(iteration, delivery, job) for job in range(jobs)]
            weights = [self._weight(delivery.heard, job) for job in range(jobs)]
            parts = (replace(one, bytes=weight) for one, weight in zip(beside, weights, strict=True))
            inbox = replace(inbox, beside=tuple(parts))
        for t in [t for t in self._said if t < min(delivery.oldest, iteration)]:
            del self._said[t]
        return inbox

    def _weight(self, heard: Packets, job: int) -> int:
        """The bytes of a job's parts of packets (m, 4)."""
        return sum(
            int(self._said[t].beside[job].sizes[heard[heard[:, 2] == t, 1]].sum()) for t in set(heard[:, 2].tolist())
        )

    def _part(self, iteration: int, job: int | None) -> Broadcast[Any]:
        """The messages of an iteration, or a job's part of them."""
        return self._said[iteration] if job is None else self._said[iteration].beside[job]

    def _opened(self, iteration: int, delivery: Delivery, job: int | None = None) -> Inbox[Any]:
        """The packets heard, or a job's part of them."""
        heard = delivery.heard
        sent = heard[:, 2]
        if len(heard) == 0 or sent.min() == iteration:
            return _of(self._part(iteration, job), heard, delivery.oldest)
        parts = [_of(self._part(int(t), job), heard[sent == t], delivery.oldest) for t in np.unique(sent)]
        columns = [np.concatenate(column) for column in zip(*(one.dates() for one in parts), strict=True)]
        content = type(parts[0].content).joined([one.content for one in parts])
        unsorted = Inbox(columns[0], columns[1], columns[2], content, delivery.oldest)
        return unsorted.take(np.lexsort(columns[::-1]))


def _of(said: Broadcast[C], heard: Packets, oldest: int) -> Inbox[C]:
    """The content of packets (m, 4) of one iteration, message by message."""
    receivers, senders, sent = heard[:, 0], heard[:, 1], heard[:, 2]
    rows: NDArray[np.generic] = senders
    if not said.one_each:
        starts = said.starts()
        counts = (said.ends - starts)[senders]
        first = np.repeat(starts[senders] - np.cumsum(counts) + counts, counts)
        receivers, senders, sent = (np.repeat(column, counts) for column in (receivers, senders, sent))
        rows = first + np.arange(len(receivers))
    return Inbox(receivers, senders, sent, said.content.take(rows), oldest)
