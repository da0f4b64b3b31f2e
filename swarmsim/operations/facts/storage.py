"""Storage that outlives its keepers: data items with copies that are made anew when one of their holders is lost."""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Final, Self

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.probes import ProbeTable, Row
from swarmsim.core.state import Record
from swarmsim.jobs.facts.board import FIRST, FactBoard
from swarmsim.jobs.facts.tellers import JobStanding, Tellers
from swarmsim.jobs.facts.wire import ITEM, LONGEST, Fact, check_budget, within
from swarmsim.operations.facts.stigmergy import Name

SIGNS: Final = 6  # of life within the patience that others have
NUMBER: Final = np.dtype(">u2")  # of an item, in what a robot says that it holds
ITEMS: Final = ProbeTable("items", "i4", ("robots",), "", "items held", 0.0, drawn="robots")


class Storage(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Random robots make data items at random times, and the swarm keeps `copies` of each besides the maker's.

    Who holds an item with too few copies offers it, with its data; who hears that and has room takes it. If too many
    hold it, those last in the item's own order of robots let it go. A robot that has not been heard of for `patience`
    iterations is taken for lost, and with it what it held.

    A robot holds `capacity` bytes of data. One that has no room for what it makes refuses it.
    """

    name: Name = ""  # in recordings; default: the part's
    items: Annotated[int, Meta(ge=1, le=10_000)] = 40  # in all, made by robots drawn at random
    smallest: Annotated[int, Meta(ge=1, le=LONGEST)] = 64  # bytes
    largest: Annotated[int, Meta(ge=1, le=LONGEST)] = 256  # bytes
    during: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 100  # iterations from the start in which items are made
    copies: Annotated[int, Meta(ge=0, le=1_000_000_000)] = 2  # of each item, besides its maker's
    capacity: Annotated[int, Meta(ge=1, le=1_000_000_000)] | None = None  # bytes a robot
    patience: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 12  # iterations
    budget: Annotated[int, Meta(ge=1, le=1_000_000_000)] | None = None  # bytes a message

    def build(self, context: BuildContext) -> Tellers[Keeper]:
        """The job. Raises InputError for what cannot be kept."""
        self._check(context.swarm)
        goods = Goods.of(self, context)
        return Tellers(context, lambda robot: Keeper(goods, robot), Ledger(goods, len(context.ids)), tables=(ITEMS,))

    def _check(self, swarm: int) -> None:
        if self.smallest > self.largest:
            raise InputError(f"smallest: {self.smallest} bytes, more than 'largest' {self.largest}; expected no more")
        if self.capacity is not None and self.capacity < self.largest:
            raise InputError(
                f"capacity: {self.capacity} bytes; expected {self.largest} or more, as 'largest' asks: no robot could "
                "hold such an item"
            )
        if self.copies >= swarm:
            raise InputError(f"copies: {self.copies} for {swarm} robots; expected {swarm - 1} or less")
        held = self.items * (self.copies + 1) * NUMBER.itemsize
        lists = [held, *[0] * (swarm - 1)]
        check_budget(self.budget, [*lists, self.largest], f"what {swarm} robots hold, and an item of {self.largest},")


@dataclass(frozen=True, slots=True, eq=False)
class Goods:
    """Which robot makes which item, and when; each robot uses its own rows alone."""

    keys: Storage
    context: BuildContext
    maker: NDArray[np.int64]  # (items,)
    time: NDArray[np.int64]  # (items,): iterations
    size: NDArray[np.int64]  # (items,): bytes

    @classmethod
    def of(cls, keys: Storage, context: BuildContext) -> Self:
        """The items of a run."""
        dice, count = context.streams.open(f"storage {keys.name}"), keys.items
        maker, time = dice.integers(context.swarm, size=count), dice.integers(keys.during, size=count)
        return cls(keys, context, maker, time, dice.integers(keys.smallest, keys.largest + 1, count))

    def data(self, item: int) -> bytes:
        """What an item holds."""
        return self.context.streams.open(f"storage {self.keys.name} data", item).bytes(int(self.size[item]))


@lru_cache(maxsize=1 << 20)
def place_in_line(item: int, robot: int) -> tuple[bytes, int]:
    """An item's own order of robots, by hash: the highest random weight (Thaler and Ravishankar 1998)."""
    return hashlib.blake2b(struct.pack(">II", item, robot), digest_size=8).digest(), robot


class Keeper:
    """One robot: what it holds, and what it has heard that others hold."""

    def __init__(self, goods: Goods, me: int) -> None:
        keys, rounds = goods.keys, goods.context.rounds
        self._goods, self._me, self._keys = goods, me, keys
        self._longest, self._every = keys.patience * rounds, max(1, keys.patience // SIGNS)
        self._board = FactBoard(
            me, self._longest
        )  # by robot: the items that it holds, with a version for each sign of life
        self._others: dict[int, frozenset[int]] = {}
        self._seen: dict[int, int] = {}  # iteration of the last news, by robot
        self._offers: dict[int, tuple[int, int]] = {}  # next exchange and pause, by item
        self._signed: tuple[int, list[int] | None] = (0, None)  # iteration, items
        self._coming = np.flatnonzero(goods.maker == me).tolist()
        #: The data of each item that it holds.
        self.held: dict[int, bytes] = {}
        #: Items made, and those of them without room.
        self.made: list[int] = []
        self.refused: list[int] = []

    @property
    def used(self) -> int:
        """Bytes that it holds."""
        return sum(map(len, self.held.values()))

    def _fits(self, size: int) -> bool:
        return self._keys.capacity is None or self.used + size <= self._keys.capacity

    def wake(self, now: int) -> None:
        """Make nothing that was due meanwhile, and take nobody for lost yet."""
        self._coming = [item for item in self._coming if self._goods.time[item] >= now]
        self._seen = dict.fromkeys(self._seen, now)

    def say(self, now: int, clock: int) -> list[Fact]:
        """Tell what it holds, and offer what has too few copies."""
        self._make(now)
        items = sorted(self.held)
        if self._signed[1] != items or now - self._signed[0] >= self._every:
            self._signed = now, items
            self._board.write(self._me, np.array(items, NUMBER).tobytes())
        told = within([*self._board.wanted(clock), *self._offered(now, clock)], self._keys.budget)
        self._board.told(told, clock)
        for fact in told:
            if fact.kind == ITEM:
                pause = self._offers[fact.key][1]
                self._offers[fact.key] = clock + pause, min(2 * pause, self._longest)
        return told

    def _make(self, now: int) -> None:
        for item in [one for one in self._coming if self._goods.time[one] <= now]:
            self._coming.remove(item)
            self.made.append(item)
            if self._fits(int(self._goods.size[item])):
                self.held[item] = self._goods.data(item)
            else:
                self.refused.append(item)

    def _holders(self, item: int, now: int) -> list[int]:
        """The others that are known to hold an item, and not taken for lost."""
        return [
            robot for robot, items in self._others.items()
            if item in items and now - self._seen[robot] <= self._keys.patience
        ]  # fmt: skip

    def _offered(self, now: int, clock: int) -> list[Fact]:
        """The items with too few copies whose offer is due: the first holder's at once, others' later."""
        found = []
        for item, data in sorted(self.held.items()):
            others = self._holders(item, now)
            if len(others) >= self._keys.copies:
                self._offers.pop(item, None)
                continue
            mine = place_in_line(item, self._me)
            first = all(mine < place_in_line(item, robot) for robot in others)
            start = (clock, FIRST) if first else (clock + self._longest, self._longest)
            if self._offers.setdefault(item, start)[0] <= clock:
                found.append(Fact(ITEM, item, value=data))
        return found

    def hear(self, facts: list[Fact], now: int, clock: int) -> None:
        """Note what others hold, take what is offered, and let go of what enough others hold."""
        for fact in self._board.hear(facts):
            self._seen[fact.key] = now
            self._others[fact.key] = frozenset(np.frombuffer(fact.value, NUMBER).tolist())
        if self._others.pop(self._me, None) is not None:  # what it held before it lost everything
            self._signed = now, None
        for fact in facts:
            wanted = fact.kind == ITEM and fact.key not in self.held and self._fits(len(fact.value))
            if wanted and len(self._holders(fact.key, now)) <= self._keys.copies:
                self.held[fact.key] = fact.value
        for item in list(self.held):
            mine = place_in_line(item, self._me)
            better = sum(place_in_line(item, robot) < mine for robot in self._holders(item, now))
            if better > self._keys.copies:
                del self.held[item]

    def learn(self, other: Self) -> None:
        """Take in what another robot knows and, as far as there is room, holds."""
        self._board.learn(other._board)
        self._others, self._seen = {**other._others, **self._others}, {**other._seen, **self._seen}
        for item, data in sorted(other.held.items()):
            if item not in self.held and self._fits(len(data)):
                self.held[item] = data


@dataclass(frozen=True, slots=True, eq=False)
class Stocks(JobStanding):
    """What every robot holds; all arrays are read-only."""

    goods: Goods
    held: NDArray[np.bool_]  # (n, items)
    made: NDArray[np.bool_]  # (n, items): by this robot, so far
    refused: NDArray[np.bool_]  # (n, items): made by this robot, which had no room
    used: NDArray[np.int64]  # (n,): bytes
    content: NDArray[np.uint32]  # (n,): checksum of the data
    now: int  # iteration

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All columns, in order."""
        return self.held, self.made, self.refused, self.used, self.content

    def record(self) -> Record:
        """Who holds and made what, and the bytes."""
        columns = zip(("held", "made", "refused", "used"), self.arrays(), strict=False)
        return Record({f"{self.goods.keys.name or 'storage'}_{column}": rows for column, rows in columns})

    def sample(self, alive: NDArray[np.bool_]) -> dict[str, Row]:
        """How many items each robot holds."""
        return {"items": self.held.sum(axis=1)}

    def _holders(self, alive: NDArray[np.bool_]) -> NDArray[np.int64]:
        """The living holders of each item that was made and not refused."""
        accepted = (self.made & ~self.refused).any(axis=0)
        return np.asarray(self.held[alive].sum(axis=0)[accepted])

    def share(self, alive: NDArray[np.bool_]) -> float:
        """The share of items, made and not refused, that a living robot holds; 1 while there are none."""
        holders = self._holders(alive)
        return float((holders > 0).mean()) if len(holders) else 1.0

    def ended(self, alive: NDArray[np.bool_]) -> bool:
        """Whether all items have been made and have all their copies, as far as there are living robots."""
        least = min(self.goods.keys.copies + 1, int(np.count_nonzero(alive)))
        return self.now + 1 >= self.goods.keys.during and bool((self._holders(alive) >= max(least, 1)).all())

    def numbers(self, alive: NDArray[np.bool_]) -> dict[str, float]:
        """Items made and refused, how many of them are held by whom, and the fullest robot's bytes."""
        holders = self._holders(alive)
        return {
            "items": float(np.count_nonzero(self.made)), "items_refused": float(np.count_nonzero(self.refused)),
            "kept_share": self.share(alive), "holders": float(holders.mean()) if len(holders) else 0.0,
            "used_bytes": float(self.used[alive].sum()), "used_bytes_most": float(self.used[alive].max(initial=0)),
        }  # fmt: skip


class Ledger:
    """Sums up what robots hold; what was made stays made when a robot loses everything."""

    def __init__(self, goods: Goods, rows: int) -> None:
        self._goods = goods
        self._made, self._refused = np.zeros((2, rows, goods.keys.items), np.bool_)

    def __call__(self, parts: Sequence[Keeper], now: int) -> Stocks:
        held = np.zeros(self._made.shape, np.bool_)
        for row, part in enumerate(parts):
            held[row, list(part.held)] = True
            self._made[row, part.made] = True
            self._refused[row, part.refused] = True
        used = np.array([part.used for part in parts], np.int64)
        content = [zlib.crc32(b"".join(part.held[item] for item in sorted(part.held))) for part in parts]
        columns = (held, self._made.copy(), self._refused.copy(), used, np.array(content, np.uint32))
        for array in columns:
            array.setflags(write=False)
        return Stocks(self._goods, *columns, now)
