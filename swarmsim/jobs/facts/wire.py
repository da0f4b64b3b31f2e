"""Facts, and their form on the wire."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER, FrameError, MessageBatch, header_of

#: The kinds: the teller's checksum of all that it knows, a key with its value, and a data item.
SIGN, ENTRY, ITEM = range(3)
#: Big-endian: kind, key, version, robot, bytes of the value; then the value.
FORM: Final = struct.Struct(">BIIHH")
LONGEST: Final = (1 << 16) - 1  #: bytes of a value


class Fact(NamedTuple):
    """One thing told. Of two entries of a key the one with the higher version wins, then robot, then value."""

    kind: int
    key: int
    version: int = 0
    robot: int = 0  # that wrote it
    value: bytes = b""

    @property
    def rank(self) -> tuple[int, int, bytes]:
        """What decides between two entries of a key: a total order, so the winner does not depend on arrival."""
        return self.version, self.robot, self.value

    @property
    def size(self) -> int:
        """Its bytes on the wire."""
        return FORM.size + len(self.value)

    def packed(self) -> bytes:
        """On the wire."""
        return FORM.pack(*self[:4], len(self.value)) + self.value


def within(facts: Iterable[Fact], budget: int | None) -> list[Fact]:
    """Those of them, the most urgent first, that find a place in a message of `budget` bytes."""
    if budget is None:
        return list(facts)
    left, found = budget - HEADER.size, []
    for fact in facts:
        if fact.size <= left:
            left -= fact.size
            found.append(fact)
    return found


def check_budget(budget: int | None, sizes: Sequence[int], what: str) -> None:
    """Raise InputError for a budget without room for a checksum and values of these sizes, which are told as `what`."""
    least = HEADER.size + FORM.size + sum(FORM.size + size for size in sizes)
    if budget is not None and budget < least:
        raise InputError(
            f"budget: {budget} bytes a message; a checksum and {what} take {least}; expected {least} or more"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Facts(MessageBatch):
    """Facts in a table; the values of each have their own length."""

    RAGGED: ClassVar[bool] = True

    facts: NDArray[np.object_]  # (t,): Fact

    @classmethod
    def of(cls, facts: Sequence[Fact]) -> Self:
        """A table of facts."""
        column = np.empty(len(facts), object)
        for row, fact in enumerate(facts):
            column[row] = fact
        return cls(column)

    def rows(self) -> list[Fact]:
        """The facts."""
        found: list[Fact] = self.facts.tolist()
        return found

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """The numbers (t, 4), the lengths of the values, and these one after another."""
        facts = self.rows()
        numbers = np.array([fact[:4] for fact in facts], np.int64).reshape(-1, 4)
        lengths = np.array([len(fact.value) for fact in facts], np.int64)
        return numbers, lengths, np.frombuffer(b"".join(fact.value for fact in facts), np.uint8)

    def take(self, rows: NDArray[np.generic]) -> Self:
        """The facts at these indices or under this mask."""
        return type(self)(self.facts[rows])

    @classmethod
    def joined(cls, tables: Sequence[Self]) -> Self:
        """The facts of one or more tables, concatenated."""
        return cls(np.concatenate([one.facts for one in tables]))

    def __len__(self) -> int:
        return len(self.facts)


class FactCodec:
    """The header, then fact after fact.

    In a `compact` one, each has the key with the kind in its last two bits, version, robot, and the length of its value
    as short numbers.
    """

    def __init__(self, compact: bool = False, check: Callable[[Fact], None] = lambda fact: None) -> None:
        """`check` raises FrameError for a fact that none of its tellers says."""
        self._compact, self._check = compact, check

    def size(self, fact: Fact) -> int:
        """The bytes of a fact."""
        if not self._compact:
            return fact.size
        numbers = fact.key << 2 | fact.kind, fact.version, fact.robot, len(fact.value)
        return sum(max(1, -(-number.bit_length() // 7)) for number in numbers) + len(fact.value)

    def pack(self, sender: int, iteration: int, items: Facts) -> bytes:
        """One message."""
        return HEADER.pack(sender, iteration) + b"".join(map(self._packed, items.rows()))

    def _packed(self, fact: Fact) -> bytes:
        if not self._compact:
            return fact.packed()
        return short((fact.key << 2 | fact.kind, fact.version, fact.robot, len(fact.value))) + fact.value

    def unpack(self, data: bytes) -> tuple[int, int, Facts]:
        """Its sender, exchange and facts. Raises FrameError for an unknown kind or a wrong length."""
        sender, iteration = header_of(data)
        at, facts = HEADER.size, list[Fact]()
        while at < len(data):
            (*numbers, length), at = self._numbers(data, at)
            at += length
            if numbers[0] > ITEM or at > len(data):
                raise FrameError(f"a fact of the kind {numbers[0]} up to byte {at} of {len(data)}")
            facts.append(Fact._make((*numbers, data[at - length : at])))
            self._check(facts[-1])
        return sender, iteration, Facts.of(facts)

    def _numbers(self, data: bytes, at: int) -> tuple[Sequence[int], int]:
        """The numbers of the fact that begins at a byte, and where they end."""
        if not self._compact:
            if len(data) - at < FORM.size:
                raise FrameError(f"{len(data) - at} bytes at the end; expected a fact of {FORM.size} or more")
            return FORM.unpack_from(data, at), at + FORM.size
        found = list[int]()
        while len(found) < 4:
            number, at = short_at(data, at)
            found.append(number)
        return (found[0] & 3, found[0] >> 2, *found[1:]), at


def short(numbers: Iterable[int]) -> bytes:
    """Numbers of 0 and more, seven bits in a byte, the lowest first; all bytes but a number's last are over 127."""
    found = bytearray()
    for number in numbers:
        left = number
        while left > 127:
            found.append(left & 127 | 128)
            left >>= 7
        found.append(left)
    return bytes(found)


def long(data: bytes) -> list[int]:
    """The numbers that `short` made shorter. Raises FrameError for bytes that it cannot have made."""
    at, found = 0, list[int]()
    while at < len(data):
        number, at = short_at(data, at)
        found.append(number)
    return found


def short_at(data: bytes, at: int) -> tuple[int, int]:
    """The short number that begins at a byte, and where it ends.

    Raises FrameError for one that does not end within 63 bits, or is longer than it has to be.
    """
    number = 0
    for shift in range(0, 63, 7):
        if at >= len(data):
            break
        byte, at = data[at], at + 1
        number |= (byte & 127) << shift
        if byte < 128 and (byte or not shift):
            return number, at
        if byte < 128:
            raise FrameError(f"a number that ends in 0 at byte {at} of {len(data)}; expected a shorter one")
    raise FrameError(f"a number that does not end by byte {at} of {len(data)}; expected a fact")
