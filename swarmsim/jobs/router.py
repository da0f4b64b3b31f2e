"""Which values a robot says, for which readers, and when."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from swarmsim.core.jobs import Values
from swarmsim.jobs.facts.wire import Fact
from swarmsim.jobs.log import Log
from swarmsim.jobs.plan import JobPlan, packed, unpacked
from swarmsim.jobs.reports import AFAR, SHOW, Hearsay
from swarmsim.jobs.worker import Worker

AHEAD: Final = 4  # steps beyond the one that a reader does, to which values are said already
FIRST: Final = 2  # exchanges until a value is said again: until it can have been heard that somebody passed it on
HOP: Final = 4  # exchanges that a value takes for a hop at most, with the news of it, where messages get lost

Key = tuple[int, int, int]  # piece, step, reader


@dataclass(slots=True)
class Errand:
    """A value that a reader lacks, as far as is known."""

    step: int  # to which it is
    due: int  # the exchange in which it is to be said
    times: int = 0  # that it was said
    aim: int = AFAR  # with which it was said last
    passed: bool = False  # on, to another robot

    def said(self, aim: int, clock: int, longest: int) -> None:
        """Note that it was said; pauses grow by half."""
        self.due, self.aim = clock + min(int(FIRST * 1.5 ** max(0, self.times - 1)), longest), aim
        self.times, self.passed = self.times + 1, False


class Router:
    """One robot's part in bringing values to who reads them.

    A value says for which readers it is, and how many hops its teller is from each. Who hears it and is nearer to one
    passes it on, for that one alone. The teller hears that, and is silent; else it says the value again, after pauses
    that grow by half, as if it were a hop farther each time, so that others find a way. A reader, or who has passed a
    value on already, answers without the numbers.

    Who knows a value that is on its way over so many hops says it again if the reader still lacks it after HOP
    exchanges for each.

    With a clock readers lack whatever is newest. A newer value takes the place of an older one, and its turn.
    """

    def __init__(self, plan: JobPlan, me: int, rounds: int) -> None:
        self._plan, self._me, self._clocked = plan, me, plan.keys.fence == "clock"
        self._longest = max(plan.keys.patience * rounds, FIRST)
        self._errands: dict[Key, Errand] = {}  # see `_at`
        self._answers: defaultdict[tuple[int, int], dict[int, int]] = defaultdict(dict)  # hops, by reader

    def _at(self, key: Key) -> Key:
        """Where the errand for a value is kept: with a clock the same for all steps."""
        return (key[0], 0, key[2]) if self._clocked else key

    def heard(self, fact: Fact, worker: Worker, claims: Hearsay, now: int, clock: int) -> Iterator[tuple[int, Values]]:
        """Take in where a value has got to; what it holds for each reader."""
        readers = self._plan.named(fact.key, fact.robot)
        aims = dict(zip(readers, fact.value, strict=False))
        parts = dict(self._parts(fact, readers))
        for reader, aim in aims.items():
            key = fact.key, fact.version, reader
            if reader in worker.own:
                if parts and not self._clocked:
                    self._answers[key[:2]][reader] = 0
                continue
            hops = self._hops(claims, reader, fact.version, now)
            newest = worker.log.newest(fact.key, reader) if self._clocked else None
            if hops is not None and (newest is None or fact.version >= newest):
                self._judge(key, aim, hops, bool(parts), worker.log.get(*key) is None, clock)
        yield from parts.items()

    def _judge(self, key: Key, aim: int, hops: int, full: bool, new: bool, clock: int) -> None:
        """What is to be done about a value that somebody else said, or answered, with an aim at a reader."""
        errand = self._errands.get(self._at(key))
        if full and new:
            due = clock if aim > hops else min(clock + self._wait(hops), math.inf if errand is None else errand.due)
            self._errands[self._at(key)] = Errand(key[1], int(due), passed=aim < hops)
        elif errand is not None and aim < (errand.aim if errand.times else hops):
            errand.due, errand.passed = clock + self._wait(hops), True
        elif errand is not None and errand.passed and full and aim > hops:  # who has it now does not get on
            errand.due = min(errand.due, clock + FIRST + 1)
        elif errand is not None and not errand.times and full and aim > hops:
            errand.due = clock
        elif full and aim > hops:
            self._answers[key[:2]][key[2]] = 0 if errand is None else hops

    def _parts(self, fact: Fact, readers: tuple[int, ...]) -> Iterator[tuple[int, Values]]:
        """The numbers for each reader; nothing in an answer."""
        if len(fact.value) > len(readers):
            values = unpacked(fact.value[len(readers) :], self._plan.number)
            for reader, rows in zip(readers, self._plan.rows(fact.key, fact.robot)[1], strict=True):
                yield reader, values[rows]

    def _wait(self, hops: int) -> int:
        """The exchanges in which a value that is on its way over so many hops should be there."""
        return min(HOP * (hops + 1), self._longest)

    def _hops(self, claims: Hearsay, reader: int, step: int, now: int) -> int | None:
        """Hops to the nearest other robot that needs what a piece shows to a step; none if nobody does."""
        return min(
            (
                hops
                for who, claim, hops in claims.of(reader, now)
                if who != self._me and (self._clocked or claim.step <= step)
            ),
            default=None,
        )

    def wanted(self, worker: Worker, claims: Hearsay, now: int, clock: int) -> list[Fact]:
        """Answers, and the values that are due, those of the earliest steps first."""
        lacked, every = self._lacked(worker.log, claims, now), dict[tuple[int, int], dict[int, int]]()
        own = worker.own
        self._errands = {self._at(key): self._errand(key, hops, key[0] in own, clock) for key, hops in lacked.items()}
        for (piece, step, reader), hops in lacked.items():
            errand = self._errands[self._at((piece, step, reader))]
            if errand.due <= clock:
                every.setdefault((piece, step), {})[reader] = min(hops + errand.times, AFAR)
        found = [self._fact(*key, aims) for key, aims in self._answers.items()]
        self._answers.clear()
        order = sorted(every.items(), key=lambda one: one[0][::-1])
        return found + [self._fact(*key, aims, worker.log) for key, aims in order]

    def _errand(self, key: Key, hops: int, own: bool, clock: int) -> Errand:
        """What is to be done about a value that a reader lacks; a new one of one's own is said at once."""
        known = self._errands.get(self._at(key))
        if known is None or (own and known.step != key[1]):
            return Errand(key[1], clock if own else clock + self._wait(hops))
        return known

    def _fact(self, piece: int, step: int, aims: dict[int, int], log: Log | None = None) -> Fact:
        """A value for some readers, or an answer."""
        readers = self._plan.readers[piece]
        mask = sum(1 << readers.index(reader) for reader in aims)
        mine = self._plan.named(piece, mask)
        value = bytes(aims[reader] for reader in mine)
        if log is not None:
            count, rows = self._plan.rows(piece, mask)
            parts = [log.get(piece, step, reader) for reader in mine]
            values = np.empty((count, *next(part.shape[1:] for part in parts if part is not None)))
            for part, at in zip(parts, rows, strict=True):
                values[at] = part
            value += packed(values, self._plan.number)
        return Fact(SHOW, piece, step, mask, value)

    def said(self, fact: Fact, clock: int) -> None:
        """Note that something has been said."""
        readers = self._plan.named(fact.key, fact.robot)
        for reader, aim in zip(readers, fact.value, strict=False) if len(fact.value) > len(readers) else ():
            self._errands[self._at((fact.key, fact.version, reader))].said(aim, clock, self._longest)

    def _lacked(self, log: Log, claims: Hearsay, now: int) -> dict[Key, int]:
        """The known values that other robots' pieces lack for their next steps, with the hops to the nearest robot."""
        found: dict[Key, int] = {}
        for who, news in claims.fresh(now):
            for reader, claim in news.report.claims.items() if who != self._me else ():
                for number, joint in enumerate(self._plan.joints[reader]):
                    for step in self._steps(log, joint.piece, reader, claim.step, claim.has >> number & 1):
                        key = joint.piece, step, reader
                        if log.get(*key) is not None:
                            found[key] = min(news.hops, found.get(key, AFAR))
        return found

    def _steps(self, log: Log, piece: int, reader: int, step: int, has: int) -> range:
        """The steps to which a reader that is at a step lacks what a piece shows."""
        if not self._clocked:
            return range(step + has, step + AHEAD + 1)
        newest = log.newest(piece, reader)
        return range(0) if newest is None else range(newest, newest + 1)
