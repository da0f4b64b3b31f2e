"""Messages of several kinds on one network: sent together, told apart by a byte, and sorted on receipt."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import Broadcast, Codec, FrameError, Inbox, MessageBatch, longest_of

MOST: Final = 256  # kinds, which a byte tells apart


@dataclass(frozen=True, slots=True, eq=False)
class Mixed(MessageBatch):
    """Items of several kinds, each in the table of its kind."""

    kind: NDArray[np.uint8]  # (t,)
    row: NDArray[np.int64]  # (t,): each item's row in the table of its kind
    tables: Mapping[int, MessageBatch]  # by kind

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """The kinds, then all columns of the items of each kind."""
        kinds = np.unique(self.kind).tolist()
        return self.kind, *(column for kind in kinds for column in self.of(kind).arrays())

    def of(self, kind: int) -> MessageBatch:
        """The items of one kind."""
        return self.tables[kind].take(self.row[self.kind == kind])

    def each(self, change: Callable[[NDArray[np.bool_], MessageBatch], MessageBatch]) -> Mixed:
        """The same with the items of each kind changed; `change` gets their indices (t,)."""
        row, tables = self.row.copy(), dict[int, MessageBatch]()
        for kind in self.tables:
            mine: NDArray[np.bool_] = self.kind == kind
            row[mine], tables[kind] = np.arange(np.count_nonzero(mine)), change(mine, self.of(kind))
        return Mixed(self.kind, row, tables)

    def take(self, rows: NDArray[np.generic]) -> Self:
        """The items at these indices or under this mask."""
        return type(self)(self.kind[rows], self.row[rows], self.tables)

    @classmethod
    def joined(cls, tables: Sequence[Self]) -> Self:
        """The items of one or more tables, concatenated."""
        kinds = sorted({kind for one in tables for kind in one.tables})
        rows, found = [one.row.copy() for one in tables], dict[int, MessageBatch]()
        for kind in kinds:
            theirs = [one.tables[kind] for one in tables if kind in one.tables]
            first = 0
            for one, row in zip(tables, rows, strict=True):
                row[one.kind == kind] += first
                first += len(one.tables.get(kind, ()))
            found[kind] = type(theirs[0]).joined(theirs)
        return cls(np.concatenate([one.kind for one in tables]), np.concatenate(rows), found)

    def __len__(self) -> int:
        return len(self.kind)


class KindCodec:
    """A byte for the kind, then the message packed by that kind's codec, which alone unpacks it."""

    def __init__(self, codecs: Mapping[int, Codec[MessageBatch]], kinds: NDArray[np.uint8]) -> None:
        """The `codecs` are by kind; `kinds` (N,) gives the kind of each robot's messages."""
        self._codecs, self._kinds = codecs, kinds
        #: Bytes of the longest message; 0 if one kind does not tell.
        self.longest: int = 1 + max(each) if all(each := [longest_of(one) for one in codecs.values()]) else 0

    def pack(self, sender: int, iteration: int, items: Mixed) -> bytes:
        """One message. Raises ValueError for items whose kind is not their sender's."""
        kind = int(self._kinds[sender])
        if (items.kind != kind).any():
            raise ValueError(f"robot {sender} says messages of the kind {kind}, not {np.unique(items.kind).tolist()}")
        return bytes([kind]) + self._codecs[kind].pack(sender, iteration, items.of(kind))

    def unpack(self, data: bytes) -> tuple[int, int, Mixed]:
        """Its sender, iteration and items. Raises FrameError for an unknown kind, or one that is not the sender's."""
        kind = data[0] if data else -1
        if kind not in self._codecs:
            raise FrameError(f"a message of the kind {kind}; expected one of {sorted(self._codecs)}")
        sender, iteration, items = self._codecs[kind].unpack(data[1:])
        if sender >= len(self._kinds) or self._kinds[sender] != kind:
            raise FrameError(f"a message of the kind {kind} from robot {sender}, which says none")
        return sender, iteration, Mixed(np.full(len(items), kind, np.uint8), np.arange(len(items)), {kind: items})


@dataclass(frozen=True, slots=True, eq=False)
class Roster:
    """The groups of a swarm, and the kind of each one's messages."""

    names: tuple[str, ...]  # of the groups
    group: NDArray[np.int64]  # (N,): the number of each robot's group
    kinds: tuple[int, ...]  # of the messages of each group
    kind: NDArray[np.uint8]  # (N,): of each robot's messages

    @classmethod
    def of(cls, names: tuple[str, ...], group: NDArray[np.int64], kinds: Sequence[int]) -> Self:
        """The roster of these groups."""
        return cls(names, group, tuple(kinds), np.array(kinds, np.uint8)[group])

    @property
    def several(self) -> bool:
        """Whether there is more than one kind."""
        return len(set(self.kinds)) > 1


@dataclass(frozen=True, slots=True, eq=False)
class FromKind:
    """The messages of some robots."""

    rows: NDArray[np.int64]  # (r,): the robots' rows
    kind: int  # of their messages
    said: Broadcast[MessageBatch]


def together(shares: Sequence[FromKind], robots: int, several: bool) -> Broadcast[MessageBatch]:
    """All robots' messages, from `shares`; each message is one byte longer if there are `several` kinds.

    Items of one kind stay as they are.
    """
    counts, sizes = np.zeros(robots, np.int64), np.zeros(robots, np.int32)
    for one in shares:
        counts[one.rows] = one.said.ends - one.said.starts()
        sizes[one.rows] = one.said.sizes + ((one.said.sizes > 0) & several)
    ends = np.cumsum(counts)
    where = [_places(one, ends - counts) for one in shares]
    place, kind = np.concatenate(where), np.repeat([one.kind for one in shares], [len(one) for one in where])
    order = np.argsort(place)
    tables = {
        kind: type(contents[0]).joined(contents)
        for kind in sorted({one.kind for one in shares})
        if (contents := [one.said.content for one in shares if one.kind == kind])
    }
    one_each = all(one.said.one_each for one in shares)
    if not several:
        return Broadcast(tables[shares[0].kind].take(order), ends, sizes, one_each)
    row = np.empty(len(kind), np.int64)
    for each, table in tables.items():
        row[kind == each] = np.arange(len(table))
    return Broadcast(Mixed(kind[order].astype(np.uint8), row[order], tables), ends, sizes, one_each)


def _places(share: FromKind, starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """The indices of a share's items (t,) among all robots' items, which begin at `starts` (n,)."""
    mine = share.said.starts()
    owner = np.repeat(np.arange(len(mine)), share.said.ends - mine)
    return np.asarray(starts[share.rows][owner] + np.arange(len(owner)) - mine[owner])


def sorted_out(inbox: Inbox[MessageBatch], row: NDArray[np.int64], kind: int, roster: Roster) -> Inbox[MessageBatch]:
    """The inbox of robots with a `row` (n,), -1 for others: messages of their own kind, and of others.

    A message whose kind is not its sender's is dropped.
    """
    mine: NDArray[np.bool_] = row[inbox.receivers] >= 0
    heard = inbox.take(mine)
    receivers, senders, content = row[heard.receivers].astype(np.int32), heard.senders, heard.content
    if not isinstance(content, Mixed):
        return Inbox(receivers, senders, heard.sent, content, inbox.oldest)
    mixed, spoken = content, content.kind == roster.kind[senders]

    def some(items: NDArray[np.bool_], of: int) -> Inbox[MessageBatch]:
        columns = receivers[items], senders[items], heard.sent[items]
        return Inbox(*columns, mixed.take(items).of(of), inbox.oldest)

    others = {
        name: some(spoken & (roster.group[senders] == number), each)
        for number, (name, each) in enumerate(zip(roster.names, roster.kinds, strict=True))
        if each != kind and each in mixed.tables
    }
    return replace(some(spoken & (mixed.kind == kind), kind), others=others)
