"""A table that a swarm shares: virtual stigmergy (Pinciroli, Lee-Brown and Beltrame 2016)."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Final

from swarmsim.jobs.facts.wire import ENTRY, SIGN, Fact

FIRST: Final = 2  #: exchanges until an entry is told again to others who know something else


class FactBoard:
    """One robot's copy of a shared table.

    A write raises the version of its key (Lamport 1978), and the highest version wins; of equal ones, that of the
    higher robot. What is new to a robot it tells at once. Who hears an older entry answers with the newer one.

    Each message holds a checksum of the teller's table. Entries are told again, after pauses that double from FIRST to
    `longest` exchanges, while others' checksums differ, and every `longest` exchanges in any case: a robot may be heard
    by others that it does not hear.
    """

    def __init__(self, me: int, longest: int) -> None:
        self._me, self._longest = me, longest
        #: The newest known entry of each key.
        self.entries: dict[int, Fact] = {}
        self._checksum = 0
        self._told: dict[int, tuple[int, int]] = {}  # exchange in which told last, and the pause; none: news
        self._differ = False  # whether the last checksums heard were others

    def write(self, key: int, value: bytes, version: int | None = None, robot: int | None = None) -> None:
        """Set a key's value, by default one version on and as this robot."""
        known = self.entries.get(key)
        newer = known.version + 1 if known is not None else 1
        mine = Fact(
            ENTRY, key, newer if version is None else version, self._me if robot is None else robot, bytes(value)
        )
        self._put(mine)

    def _put(self, fact: Fact) -> None:
        """Keep an entry; checksums of tables with the same entries are the same, whatever came first."""
        known = self.entries.get(fact.key)
        self._checksum ^= zlib.crc32(fact.packed()) ^ (0 if known is None else zlib.crc32(known.packed()))
        self.entries[fact.key] = fact
        self._told.pop(fact.key, None)

    def hear(self, facts: Iterable[Fact]) -> list[Fact]:
        """Take in what was heard in an exchange; the entries that were newer."""
        signs, newer = list[int](), list[Fact]()
        for fact in facts:
            if fact.kind == SIGN:
                signs.append(fact.version)
            elif fact.kind == ENTRY and self._takes(fact):
                newer.append(fact)
        if signs:
            self._differ = any(sign != self._checksum for sign in signs)
        return newer

    def _takes(self, fact: Fact) -> bool:
        known = self.entries.get(fact.key)
        if known is None or fact.rank > known.rank:
            self._put(fact)
            return True
        if fact.rank < known.rank:
            self._told.pop(fact.key, None)  # answer
        return False

    def wanted(self, clock: int) -> list[Fact]:
        """What it would tell in an exchange: its checksum, what is news, then what was told longest ago."""
        due = [
            (said, key)
            for key, (said, pause) in self._told.items()
            if clock - said >= (pause if self._differ else self._longest)
        ]
        news = [(-1, key) for key in self.entries if key not in self._told]
        return [Fact(SIGN, 0, self._checksum), *(self.entries[key] for _, key in sorted(news + due))]

    def told(self, facts: Iterable[Fact], clock: int) -> None:
        """Note what was told in an exchange."""
        for fact in facts:
            if fact.kind == ENTRY:
                _, pause = self._told.get(fact.key, (0, FIRST // 2))
                self._told[fact.key] = clock, min(2 * pause, self._longest)

    def learn(self, other: FactBoard) -> None:
        """Take in all that another robot knows."""
        self.hear(list(other.entries.values()))
