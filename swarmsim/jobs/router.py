"""Which values a robot passes on, and when: towards the pieces that read them, more seldom each time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.jobs.claims import AFAR, Hearsay, News
from swarmsim.jobs.items import SHOW, Item
from swarmsim.jobs.log import Log
from swarmsim.jobs.plan import JobPlan

SATED: Final = 255  #: of a reader that has no need of the value, as far as is known
FIRST: Final = 2  # exchanges until a value is said again: until a claim can have told that it arrived
DETOUR: Final = 4  # iterations after which values are passed on that seem to have gone the right way already

Key = tuple[int, int]  # piece, step


class Router:
    """One robot's part in bringing values to whoever needs them.

    Each value says how many hops its teller is from each piece that needs it. Who hears it passes it on if it is nearer
    to one of them, and otherwise only if the need lasts. A value is said until all readers' claims are past it, after
    pauses that grow by half.
    """

    def __init__(self, plan: JobPlan, me: int, rounds: int) -> None:
        self._plan, self._me, self._rounds = plan, me, rounds
        self._clocked = plan.keys.fence == "clock"
        self._due: dict[Key, tuple[int, int]] = {}  # the exchange, and the pause after it

    def _key(self, piece: int, step: int) -> Key:
        """With a clock, a newer value takes the place of an older one, and its turn."""
        return piece, -1 if self._clocked else step

    def made(self, piece: int, step: int, clock: int) -> None:
        """Pass on a value of one's own."""
        self._due[self._key(piece, step)] = clock, FIRST

    def heard(self, item: Item, claims: Hearsay, now: int, clock: int) -> None:
        """Pass on a new value at once if this robot is nearer to a reader than its teller, else later."""
        nearer = any(
            hops != SATED and any(entry.hops < hops for entry in self._needing(claims, reader, item.step, now))
            for reader, hops in zip(self._plan.readers[item.piece], item.aims.tolist(), strict=True)
        )
        key, later = self._key(item.piece, item.step), clock + DETOUR * self._rounds
        self._due[key] = clock if nearer else min(later, self._due.get(key, (later, FIRST))[0]), FIRST

    def _needing(self, claims: Hearsay, reader: int, step: int, now: int) -> Iterator[News]:
        """Who computes a reader and is not past a step; with a clock all who do, since they read what is newest."""
        everyone = claims.of(reader, now)
        return (entry for who, entry in everyone if who != self._me and (self._clocked or entry.step <= step))

    def items(self, log: Log, claims: Hearsay, now: int, clock: int) -> list[Item]:
        """The values that are due, those of the earliest steps first."""
        found = []
        for (piece, step), aims in sorted(self._needed(log, claims, now).items(), key=lambda one: one[0][::-1]):
            values = log.get(piece, step)
            if values is not None and self._due.get(self._key(piece, step), (0, 0))[0] <= clock:
                found.append(Item(SHOW, piece, step, values=values, aims=aims))
        return found

    def said(self, item: Item, clock: int) -> None:
        """Note that a value has been said."""
        key = self._key(item.piece, item.step)
        pause = self._due.get(key, (0, FIRST))[1]
        longest = self._plan.keys.patience * self._rounds
        self._due[key] = clock + pause, min(pause + (pause + 1) // 2, max(longest, FIRST))

    def forget(self, before: int) -> None:
        """Forget values older than a step."""
        self._due = {key: due for key, due in self._due.items() if key[1] >= before}

    def _needed(self, log: Log, claims: Hearsay, now: int) -> dict[Key, NDArray[np.uint8]]:
        """The known values that other robots' pieces need now or next, with the hops to each reader."""
        found: dict[Key, NDArray[np.uint8]] = {}
        for reader, who, entry in claims.fresh(now):
            for joint in self._plan.joints[reader] if who != self._me else ():
                piece, readers = joint.piece, self._plan.readers[joint.piece]
                steps = (entry.step, entry.step + 1)
                if self._clocked:
                    steps = (log.newest(piece) or 0,) * 2
                for step in steps:
                    if log.get(piece, step) is not None:
                        aims = found.setdefault((piece, step), np.full(len(readers), SATED, np.uint8))
                        aims[readers.index(reader)] = min(int(aims[readers.index(reader)]), entry.hops, AFAR)
        return found
