"""What robots tell each other of a job in pieces, item by item, and its form on the wire."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import Values
from swarmsim.core.messages import HEADER, LATEST, FrameError, MessageBatch, header_of
from swarmsim.jobs.plan import JobPlan

#: The kinds of items: who computes a piece, who keeps a copy of it, what it shows to others, and its state.
CLAIM, KEEP, SHOW, STATE = range(4)
#: On the wire, big-endian: kind, piece, robot, step, exchange, hops, distance; then without the last two; then no more
#: than kind, piece and step.
FORMS: Final = tuple(struct.Struct(one) for one in (">BHHIIBH", ">BHHII", ">BHI", ">BHI"))
NOTHING: Final = np.empty(0)
NOBODY: Final = np.empty(0, np.uint8)


class Item(NamedTuple):
    """One thing told; what its kind does not have is 0."""

    kind: int
    piece: int
    step: int
    who: int = 0  # the robot that a claim or a copy is of
    beat: int = 0  # the exchange in which that robot said so itself
    hops: int = 0  # how often a claim has been passed on
    far: int = 0  # cells, from that robot to the piece
    values: Values = NOTHING
    aims: NDArray[np.uint8] = NOBODY  # hops from the teller to each piece that reads what is shown; see Router


@dataclass(frozen=True, slots=True, eq=False)
class Items(MessageBatch):
    """Items in a table; the values of each have their own length. Receivers share the items, which never change."""

    RAGGED: ClassVar[bool] = True

    items: NDArray[np.object_]  # (t,): Item

    @classmethod
    def of(cls, items: Sequence[Item]) -> Self:
        """A table of items."""
        column = np.empty(len(items), object)
        for row, item in enumerate(items):
            column[row] = item
        return cls(column)

    def rows(self) -> list[Item]:
        """The items."""
        found: list[Item] = self.items.tolist()
        return found

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """The numbers (t, 7), the lengths, and all values and bytes one after another."""
        items = self.rows()
        numbers = np.array([item[:7] for item in items], np.int32).reshape(-1, 7)
        lengths = np.array([(item.values.size, item.aims.size) for item in items], np.int64)
        return (
            numbers, lengths, np.concatenate([NOTHING, *(item.values.ravel() for item in items)]),
            np.concatenate([NOBODY, *(item.aims for item in items)]),
        )  # fmt: skip

    def take(self, rows: NDArray[np.generic]) -> Self:
        """The items at these indices or under this mask."""
        return type(self)(self.items[rows])

    @classmethod
    def joined(cls, tables: Sequence[Self]) -> Self:
        """The items of one or more tables, concatenated."""
        return cls(np.concatenate([one.items for one in tables]))

    def __len__(self) -> int:
        return len(self.items)


class ItemCodec:
    """The header, then item after item, each in its kind's form; then a number for each value, big-endian."""

    def __init__(self, plan: JobPlan) -> None:
        self._plan = plan
        self._shown = np.dtype(f">f{plan.keys.value}")

    def size(self, item: Item) -> int:
        """The bytes of an item."""
        width = self._shown.itemsize if item.kind == SHOW else 8
        return FORMS[item.kind].size + len(item.aims) + width * item.values.size

    def pack(self, sender: int, iteration: int, items: Items) -> bytes:
        """One message."""
        return HEADER.pack(sender, iteration) + b"".join(self._packed(item) for item in items.rows())

    def _packed(self, item: Item) -> bytes:
        if item.kind in (CLAIM, KEEP):
            told = (item.kind, item.piece, item.who, item.step, item.beat, item.hops, item.far)
            return FORMS[item.kind].pack(*(told if item.kind == CLAIM else told[:5]))
        kind = self._shown if item.kind == SHOW else np.dtype(">f8")
        return (
            FORMS[item.kind].pack(item.kind, item.piece, item.step) + item.aims.tobytes()
            + item.values.astype(kind).tobytes()
        )  # fmt: skip

    def unpack(self, data: bytes) -> tuple[int, int, Items]:
        """Its sender, exchange and items. Raises FrameError."""
        sender, iteration = header_of(data)
        at, items = HEADER.size, list[Item]()
        while at < len(data):
            item = self._unpacked(data, at)
            at += self.size(item)
            items.append(item)
        return sender, iteration, Items.of(items)

    def _unpacked(self, data: bytes, at: int) -> Item:
        kind = data[at]
        if kind >= len(FORMS):
            raise FrameError(f"an item of the kind {kind}; expected 0 to {len(FORMS) - 1}")
        if at + FORMS[kind].size > len(data):
            raise FrameError(f"{len(data) - at} bytes at the end; expected an item of {FORMS[kind].size} or more")
        told = FORMS[kind].unpack_from(data, at)
        at, piece = at + FORMS[kind].size, told[1]
        if piece >= len(self._plan.pieces):
            raise FrameError(f"piece {piece}; expected 0 to {len(self._plan.pieces) - 1}")
        if max(told[2:]) > LATEST:
            raise FrameError(f"piece {piece}: {max(told[2:])}; expected {LATEST} at most")
        if kind in (CLAIM, KEEP):
            return Item(kind, piece, told[3], told[2], *told[4:])
        shape = self._plan.shown[piece] if kind == SHOW else self._plan.state[piece]
        aims = len(self._plan.readers[piece]) if kind == SHOW else 0
        form, count = self._shown if kind == SHOW else np.dtype(">f8"), int(np.prod(shape))
        if at + aims + count * form.itemsize > len(data):
            raise FrameError(f"piece {piece}: {len(data) - at} bytes; expected {aims + count * form.itemsize}")
        values = np.frombuffer(data, form, count, at + aims).astype(np.float64).reshape(shape)
        return Item(kind, piece, told[2], values=values, aims=np.frombuffer(data, np.uint8, aims, at).copy())
