"""One robot's part in gathering samples: what it takes, passes on, computes and is told."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import Values
from swarmsim.jobs.facts.wire import ENTRY, ITEM, SIGN, Fact, within
from swarmsim.operations.gathering.eyes import Eyes
from swarmsim.operations.gathering.levels import WholeFloor
from swarmsim.operations.gathering.ways import Ways

#: What is told: how far a computer is, a sample, and what was computed of a piece.
BEACON, SAMPLE, ANSWER = SIGN, ENTRY, ITEM
#: On the wire after a fact's own numbers: the sample's value, hops from its robot, the computer nearest to it, and the
#: level of its own piece that it knows; then hops to each computer that the sample goes to.
TAIL: Final = struct.Struct(">fBHH")
AFAR, DONE = 254, 255  #: hops: not known; and to a computer that others bring it to
EVERYBODY: Final = (1 << 16) - 1  #: to whom an answer goes
BEACONS: Final = 5  # iterations between two of a computer
EVERY: Final = 5  # iterations until an answer that did not arrive is told again
PATIENCE: Final = 15  # iterations for which a way is known
NUMBER: Final = np.dtype(">f4")

Cells = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class GatherPlan:
    """What all robots know before: who computes, and who is told what."""

    flood: bool  # whether samples go to everybody
    computers: tuple[int, ...]  # robots that compute the whole floor
    sinks: tuple[tuple[int, ...], ...]  # of each piece: robots that samples in it go to, if not to everybody
    piece: Cells  # (n,): of each cell
    cells: tuple[Cells, ...]  # of each piece
    whole: bool  # whether everybody is told the whole field
    every: int  # iterations of a level
    levels: int
    solver: WholeFloor
    budget: int | None  # bytes a message


class Gatherer:
    """One robot. It reads its own place, sample and messages alone.

    Samples are said once, since newer ones follow; an answer to one robot again, until its samples tell that it came.
    Who hears a sample passes it on if it is nearer to a computer that the sample goes to, and who hears an answer if it
    is nearer to whom that goes to.
    """

    def __init__(self, scheme: GatherPlan, eyes: Eyes, me: int) -> None:
        self._scheme, self._eyes, self._me = scheme, eyes, me
        self._out: dict[tuple[int, ...], Fact] = {}
        self._computes = me in scheme.computers
        self._answers = self._computes and len(scheme.computers) < len(scheme.cells)  # else everybody computes
        self._collects = any(me in sinks for sinks in scheme.sinks)
        self._towards, self._back = Ways(PATIENCE), Ways(PATIENCE)  # to computers; to robots whose samples came by
        self._last: dict[int, tuple[int, int]] = {}  # the nearest computer and the level that robots told last
        self._samples: dict[tuple[int, int], tuple[int, float]] = {}  # cell and value, by robot and iteration
        self._sent: dict[tuple[int, int], set[int]] = {}  # to whom a sample was passed on, by robot and iteration
        self._told: dict[int, tuple[int, int]] = {}  # level and iteration of the last answer passed on, by robot
        self._now = -1
        #: The field as it knows it (n,), and the level of each piece in it.
        self.field: Values = np.zeros(scheme.solver.cells)
        self.level = np.zeros(len(scheme.cells), np.int32)
        #: Operations; own samples; samples taken in, of all robots; bytes said of each kind.
        self.work, self.made, self.taken = 0.0, 0, 0
        self.bytes = [0, 0, 0]

    def wake(self, now: int) -> None:
        """Forget ways that are no more."""
        self._towards, self._back = Ways(PATIENCE), Ways(PATIENCE)

    def learn(self, other: Self) -> None:
        """Take over the field that another robot knows."""
        newer = other.level > self.level
        self.level = np.maximum(self.level, other.level)
        self.field = np.where(newer[self._scheme.piece], other.field, self.field)

    # --- saying

    def say(self, now: int, clock: int) -> list[Fact]:
        """What is due of it: beacons, the newest samples, then the newest answers."""
        if now != self._now:
            self._now = now
            self._begin(now)
        order = sorted(self._out, key=lambda key: (key[0], -self._out[key].version, key))
        told = within((self._out[key] for key in order), self._scheme.budget)
        for fact in told:
            self.bytes[fact.kind] += fact.size
            del self._out[_key(fact)]
        return told

    def _begin(self, now: int) -> None:
        """Take a sample, compute a level, and tell where it is."""
        level, rest = divmod(now, self._scheme.every)
        if rest == 0 and 0 < level <= self._scheme.levels:
            self._end_level(level, now)
        if self._answers and not self._scheme.whole:
            self._answer_each(now)
        if self._collects and now % BEACONS == self._me % BEACONS:
            self._tell(Fact(BEACON, self._me, now, self._me, b"\0"))
        cell, value = self._eyes.of(self._me)
        if cell < 0:
            return
        self.made += not self._scheme.computers or now < self._scheme.every * self._scheme.levels
        if self._computes or self._me in self._scheme.sinks[self._scheme.piece[cell]]:
            self._take(self._me, now, cell, value)
        if self._scheme.flood:
            self._tell(Fact(SAMPLE, cell, now, self._me, struct.pack(">f", value)))
        else:
            known = int(self.level[self._me])
            self._send(cell, now, self._me, (value, 0, self._nearest(now), known), None)

    def _nearest(self, now: int) -> int:
        """The computer that answers it."""
        if self._computes:
            return self._me
        hops = [(self._towards.hops(one, now), one) for one in self._scheme.computers]
        return min(hops, default=(0, EVERYBODY))[1]

    def _tell(self, fact: Fact) -> None:
        self._out[_key(fact)] = fact

    def _send(self, cell: int, time: int, robot: int, tail: tuple[float, int, int, int], theirs: bytes | None) -> None:
        """Say a sample, its own or, if this robot is nearer to a computer that it goes to than its teller, another's.

        `theirs` are the teller's hops to each computer.
        """
        sinks = self._scheme.sinks[self._scheme.piece[cell]]
        sent = self._sent.setdefault((robot, time), set())
        mine = [self._towards.hops(sink, self._now) for sink in sinks]
        goes = [
            hops < limit and limit != DONE and sink != self._me and sink not in sent
            for sink, hops, limit in zip(sinks, mine, theirs or [DONE + 1] * len(sinks), strict=True)
        ]
        if any(goes):
            sent.update(sink for sink, on in zip(sinks, goes, strict=True) if on)
            waits = self._waiting(cell, time, robot, len(sinks))
            aims = bytes(hops if on or more else DONE for hops, on, more in zip(mine, goes, waits, strict=True))
            self._tell(Fact(SAMPLE, cell, time, robot, TAIL.pack(*tail) + aims))

    def _waiting(self, cell: int, time: int, robot: int, count: int) -> list[bool]:
        """To which computers it is about to pass a sample on already."""
        fact = self._out.get((SAMPLE, cell, robot, time))
        return [False] * count if fact is None else [aim != DONE for aim in fact.value[TAIL.size :]]

    # --- computing

    def _end_level(self, level: int, now: int) -> None:
        """Compute a level from the samples of its time, and tell the others; forget what is older."""
        scheme = self._scheme
        if self._computes:
            used = [told for (_, time), told in sorted(self._samples.items()) if time >= now - scheme.every]
            cells = np.array([cell for cell, _ in used], np.int64)
            values = np.array([value for _, value in used], np.float64)
            self.field, work = scheme.solver.after(self.field, level - 1, cells, values)
            self.work += work
            self.taken += len(used)
            self.level = np.full_like(self.level, level)
            if scheme.whole and self._answers:
                self._answer_all(level)
        self._samples = {key: told for key, told in self._samples.items() if key[1] >= now - scheme.every}
        self._sent = {key: sent for key, sent in self._sent.items() if key[1] >= now - scheme.every}

    def _answer_all(self, level: int) -> None:
        """Tell everybody this computer's share of the floor."""
        mine, many = self._scheme.computers.index(self._me), len(self._scheme.computers)
        for piece in range(mine, len(self._scheme.cells), many):
            self._tell(self._answer(piece, level, EVERYBODY, 0))

    def _answer_each(self, now: int) -> None:
        """Tell each robot whose nearest computer this is its own piece, if it does not have it."""
        level = int(self.level[self._me])
        for robot, (home, known) in sorted(self._last.items()):
            hops, (before, when) = self._back.hops(robot, now), self._told.get(robot, (0, 0))
            due = home == self._me and known < level and hops < AFAR and (before < level or now - when >= EVERY)
            if due and robot not in self._scheme.computers:
                self._told[robot] = level, now
                self._tell(self._answer(robot, level, robot, hops))

    def _answer(self, piece: int, level: int, to: int, hops: int) -> Fact:
        values = self.field[self._scheme.cells[piece]].astype(NUMBER)
        return Fact(ANSWER, piece, level, to, bytes([hops]) + values.tobytes())

    # --- hearing

    def hear(self, facts: Iterable[Fact], now: int, clock: int) -> None:
        """Take in what it needs, and keep for passing on what others need."""
        for fact in facts:
            (self._hear_beacon, self._hear_sample, self._hear_answer)[fact.kind](fact, now)

    def _hear_beacon(self, fact: Fact, now: int) -> None:
        if fact.robot != self._me and self._towards.note(fact.robot, fact.version, fact.value[0] + 1):
            self._tell(fact._replace(value=bytes([min(fact.value[0] + 1, AFAR)])))

    def _hear_sample(self, fact: Fact, now: int) -> None:
        if fact.robot == self._me or fact.version < now - self._scheme.every:
            return
        (value,) = struct.unpack_from(">f", fact.value)
        sinks = self._scheme.sinks[self._scheme.piece[fact.key]]
        new = (fact.robot, fact.version) not in self._samples
        if self._scheme.flood:
            if new:
                self._take(fact.robot, fact.version, fact.key, value)
                self._tell(fact)
            return
        _, came, home, known = TAIL.unpack_from(fact.value)
        if self._back.note(fact.robot, fact.version, came + 1):
            self._last[fact.robot] = home, known
        if new and self._me in sinks:
            self._take(fact.robot, fact.version, fact.key, value)
        tail = value, min(came + 1, AFAR), home, known
        self._send(fact.key, fact.version, fact.robot, tail, fact.value[TAIL.size :])

    def _take(self, robot: int, time: int, cell: int, value: float) -> None:
        self._samples[robot, time] = cell, float(np.float32(value))
        self.taken += not self._computes

    def _hear_answer(self, fact: Fact, now: int) -> None:
        if fact.robot in (self._me, EVERYBODY) and fact.version > self.level[fact.key]:
            self.level = self.level.copy()
            self.level[fact.key], self.field = fact.version, self.field.copy()
            self.field[self._scheme.cells[fact.key]] = np.frombuffer(fact.value, NUMBER, offset=1)
            if fact.robot == EVERYBODY:
                self._tell(fact)
        elif fact.robot not in (self._me, EVERYBODY):
            hops, (level, when) = self._back.hops(fact.robot, now), self._told.get(fact.robot, (0, 0))
            if hops < fact.value[0] and (fact.version > level or now - when >= EVERY):
                self._told[fact.robot] = fact.version, now
                self._tell(fact._replace(value=bytes([hops]) + fact.value[1:]))


def _key(fact: Fact) -> tuple[int, ...]:
    """What a newer fact takes the place of: a computer's beacon, nothing of a sample, an answer of the same piece."""
    return (fact.kind, fact.key, fact.robot, fact.version if fact.kind == SAMPLE else 0)
