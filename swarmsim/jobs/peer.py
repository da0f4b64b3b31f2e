"""One robot's part in a job in pieces: what it computes, keeps, has heard, and says."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Final, Self

import numpy as np

from swarmsim.core.jobs import Values
from swarmsim.core.messages import HEADER
from swarmsim.core.processors import OwnProcessor
from swarmsim.jobs.facts.wire import Fact, FactCodec
from swarmsim.jobs.helping import Helper, relieves
from swarmsim.jobs.log import KEPT
from swarmsim.jobs.plan import STATE_NUMBER, JobPlan, packed, unpacked
from swarmsim.jobs.reports import AFAR, FARTHEST, REPORT, SHOW, STATE, Hearsay, PieceClaim, Report
from swarmsim.jobs.router import Router
from swarmsim.jobs.worker import Thread, Worker

MOST_HOPS: Final = AFAR - 1
SIGNS: Final = 4  # of life within the patience that others have
CALL: Final = 2  # iterations until a copy is offered again
SIZES: Final = FactCodec(compact=True)

Starts = Callable[[int], Iterable[tuple[int, Values]]]  # the pieces and states that a robot begins with


class Peer:
    """One robot, see `Teller`. It reads its own pose and messages alone.

    It computes a step of each of its pieces in an exchange, once it knows what the piece reads. If it keeps a copy of a
    piece of which nothing has been heard for long, it goes on with it. If others have long needed a value that nobody
    is known to compute, it computes it once more from an earlier copy, beside the piece itself.
    """

    def __init__(self, plan: JobPlan, me: int, rounds: int, processor: OwnProcessor, starts: Starts) -> None:
        self._plan, self._me, self._rounds, self._processor, self._starts = plan, me, rounds, processor, starts
        self._every = max(1, plan.keys.patience // SIGNS) * rounds
        self._claims = Hearsay(plan.keys.patience)
        self._router = Router(plan, me, rounds)
        self.worker, self._helper = Worker(plan, processor), Helper(plan, me, processor)
        self._offered: dict[int, tuple[int, int, int]] = {}  # step, next exchange and pause, by piece
        self._lacked: dict[int, tuple[int, int]] = {}  # the step that others lack, and since when, by piece
        self._heard_at = 0  # the last iteration in which it heard anybody
        self._room, self._near = math.inf, set[int]()  # bytes for what is not of these pieces, in this exchange
        #: x, y in m: where it believes to be.
        self.place = np.zeros(2)
        for robot in range(min(plan.robots, len(plan.pieces))):
            its = range(robot, len(plan.pieces), plan.robots)
            self._claims.note(robot, Report(-1, dict.fromkeys(its, PieceClaim(0)), {}), AFAR, 0)

    def wake(self, now: int) -> None:
        """Count all silence from now on; at first, begin with the states that it alone knows."""
        self._heard_at = now
        self._lacked.clear()
        self._claims.wake(now)
        for piece, state in self._starts(self._me):
            self.worker.begin(self.worker.threads, piece, 0, state, self._plan.steps, now * self._rounds)

    def learn(self, other: Self) -> None:
        """Take over the values and copies that another robot has."""
        self.worker.log = self.worker.log.merged(other.worker.log)
        self.worker.copies = self.worker.copies.merged(other.worker.copies)

    def ended(self) -> dict[int, Values]:
        """The last states that it has, by piece."""
        last = self._plan.steps
        return {
            piece: found[1]
            for piece in self.worker.copies.pieces()
            if (found := self.worker.copies.before(piece, last)) is not None and found[0] == last
        }

    def silent(self, now: int) -> int:
        """For how many iterations it has heard nobody."""
        return now - self._heard_at

    # --- saying

    def say(self, now: int, clock: int) -> list[Fact]:
        """What it says in an exchange, within the budget."""
        self._claims.note(self._me, self._report(clock), 0, now)
        left = math.inf if self._plan.keys.budget is None else self._plan.keys.budget - HEADER.size
        found = []
        for fact in self._wanted(now, clock):
            size = SIZES.size(fact)
            if size > left:
                continue
            left -= size
            found.append(fact)
            if fact.kind == REPORT:
                news = self._claims.news[fact.key]
                news.said, news.when = news.report, clock
            elif fact.kind == SHOW:
                self._router.said(fact, clock)
            else:
                pause = self._offered[fact.key][2]
                longest = self._plan.keys.patience * self._rounds
                self._offered[fact.key] = fact.version, clock + pause, min(2 * pause, max(longest, 1))
        return found

    def _report(self, clock: int) -> Report:
        """What it computes and keeps."""
        worker, claims = self.worker, dict[int, PieceClaim]()
        for piece in worker.own:
            step = min(threads[piece].step for threads in (worker.threads, worker.again) if piece in threads)
            claims[piece] = PieceClaim(step, self._far(piece), worker.has(piece, step))
        keeps = {piece: worker.copies.newest(piece) for piece in worker.copies.pieces() if piece not in worker.threads}
        return Report(clock, claims, keeps)

    def _far(self, piece: int) -> int:
        """Cells from this robot to a piece."""
        far = float(np.hypot(*(self._plan.centres[piece] - self.place))) / self._plan.cell
        return int(min(far, FARTHEST)) if math.isfinite(far) else FARTHEST

    def _wanted(self, now: int, clock: int) -> Iterator[Fact]:
        """All that it would say, the most urgent first: reports, values, states."""
        for who, news in self._claims.due(now, clock, self._every):
            yield news.report.fact(who, news.hops)
        yield from self._router.wanted(self.worker, self._claims, now, clock)
        for piece in sorted(self.worker.threads):
            step = self.worker.copies.newest(piece)
            if self._lacks_copies(piece, step, now, clock):
                found = self.worker.copies.before(piece, step)
                if found is not None:
                    yield Fact(STATE, piece, step, value=packed(found[1], STATE_NUMBER))

    def _lacks_copies(self, piece: int, step: int, now: int, clock: int) -> bool:
        """Whether a copy has to be offered now."""
        if self._plan.keys.copies == 0:
            return False
        if self._offered.get(piece, (-1, 0, 0))[0] != step:
            self._offered[piece] = step, clock, CALL * self._rounds
        enough = self._plan.keys.copies != "all" and self._keepers(piece, step, now) >= self._plan.keys.copies
        return not enough and clock >= self._offered[piece][1]

    def _keepers(self, piece: int, step: int, now: int, first: bool = False) -> int:
        """How many others keep a state of a piece no older than a step; with `first`, of those before it in line."""
        mine = (self._me - piece) % self._plan.robots
        return sum(kept >= step and not (first and place > mine) for kept, place in self._others(piece, now))

    def _others(self, piece: int, now: int) -> Iterator[tuple[int, int]]:
        """The copies that others keep of a piece and do not compute it: their steps, and the robots' places in line."""
        holders = {self._me, *(who for who, *_ in self._claims.of(piece, now))}
        its = ((who, kept) for who, kept in self._claims.keeping(piece, now) if who not in holders)
        return ((kept, (who - piece) % self._plan.robots) for who, kept in its)

    def _before_me(self, piece: int, now: int, latest: int) -> int:
        """How many others have a newer copy of a piece that is not later than a step, or come first with the same."""
        found, place = self.worker.copies.before(piece, latest), (self._me - piece) % self._plan.robots
        mine = -1 if found is None else found[0]
        return sum((mine, -place) < (kept, -its) and kept <= latest for kept, its in self._others(piece, now))

    # --- hearing

    def hear(self, facts: list[Fact], now: int, clock: int) -> None:
        """Take in what was said, go on with its pieces, and take over others'."""
        self._make_room()
        for fact in facts:
            self._heard_at = now
            (self._hear_report, self._hear_value, self._hear_state)[fact.kind](fact, now, clock)
        self._give_up(now)
        self.worker.advance(clock)
        self._take_over(now, clock)
        self._help(now, clock)
        if self._plan.keys.fence == "data":
            self.worker.log.forget(self._horizon(now))

    def _make_room(self) -> None:
        """Count the memory that is left beside what its own pieces need."""
        if math.isfinite(self._processor.room):
            mine, others = self.worker.held()
            taken = max(mine, sum(map(self._plan.need, self.worker.own))) + others
            self._processor.hold(taken)
            self._room, self._near = self._processor.room - taken, self.worker.near

    def _fits(self, size: int) -> bool:
        """Whether there is memory for so many bytes more, which are then taken."""
        if size > self._room:
            return False
        self._room -= size
        return True

    def _hear_report(self, fact: Fact, now: int, clock: int) -> None:
        if fact.key != self._me and not self._claims.older(fact):
            self._claims.note(fact.key, Report.of(fact), min(fact.robot + 1, MOST_HOPS), now)

    def _hear_value(self, fact: Fact, now: int, clock: int) -> None:
        log = self.worker.log
        for reader, values in self._router.heard(fact, self.worker, self._claims, now, clock):
            stale = self._plan.keys.fence == "clock" and fact.version <= (log.newest(fact.key, reader) or -1)
            fits = fact.key in self._near or self._fits(values.nbytes)
            new = not stale and fits and log.put(fact.key, fact.version, reader, values)
            if new and self._plan.keys.fence == "clock":
                log.only_newest()

    def _hear_state(self, fact: Fact, now: int, clock: int) -> None:
        """Keep a copy if others keep too few, and if there is memory for it or an older one makes room."""
        worker, piece = self.worker, fact.key
        if piece in worker.threads:
            return
        wanted, keeps = self._plan.keys.copies, worker.copies.newest(piece) >= 0
        if wanted != "all" and not keeps and self._keepers(piece, fact.version, now) >= wanted:
            return
        state = unpacked(fact.value, STATE_NUMBER)
        if worker.copies.count(piece) and state.nbytes > self._room:
            self._room += worker.copies.count(piece) * state.nbytes
            worker.copies.drop(piece)
        if self._fits(state.nbytes):
            worker.copies.put(piece, fact.version, state)

    def _give_up(self, now: int) -> None:
        """Leave pieces to others that are ahead or, if not, nearer; and copies if others have enough."""
        ahead = self._plan.ahead
        for piece, thread in list(self.worker.threads.items()):
            mine, its = (thread.step // ahead, -self._far(piece), -self._me), self._claims.of(piece, now)
            if any((claim.step // ahead, -claim.far, -who) > mine for who, claim, _ in its if who != self._me):
                del self.worker.threads[piece]
        copies = self._plan.keys.copies
        for piece in self.worker.copies.pieces() if copies != "all" else ():
            newest = self.worker.copies.newest(piece)
            if piece not in self.worker.threads and self._keepers(piece, newest, now, first=True) >= int(copies):
                self.worker.copies.drop(piece)

    def _horizon(self, now: int) -> int:
        """The step before which nobody needs values any more: a level before the slowest piece's."""
        pieces = range(len(self._plan.pieces))
        kept = [step for piece in pieces if (step := self._claims.kept(piece)) > 0]
        present = self._claims.present(now)
        own = [thread.step for thread in (*self.worker.threads.values(), *self.worker.again.values())]
        slowest = min([*(present.get(piece, 0) for piece in pieces), *own])
        return min(self._plan.level_of(slowest) - self._plan.job.level, *kept, self._plan.steps)

    # --- taking over

    def _take_over(self, now: int, clock: int) -> None:
        """Go on with pieces of which nothing is heard, and compute values once more that are lacked for long."""
        horizon = self._horizon(now)  # what is older would be forgotten at once
        for piece in self.worker.copies.pieces():
            wait = self._plan.keys.patience + int(self._far(piece) * self._plan.cell / self._plan.reach[piece])
            active = [claim for who, claim, _ in self._claims.of(piece, now) if who != self._me]
            if piece not in self.worker.threads and self._falls_to_me(piece, active, wait, now):
                self._resume(self.worker.threads, piece, self._plan.steps, self._plan.steps, clock)
            elif self._plan.keys.fence == "data" and piece not in self.worker.again:
                lacked = self._lack(piece, [claim.step for claim in active], horizon, now)
                if lacked is None:
                    self._lacked.pop(piece, None)
                    continue
                if self._lacked.get(piece, (-1, 0))[0] != lacked:
                    self._lacked[piece] = lacked, now
                if now - self._lacked[piece][1] > wait * (1 + self._before_me(piece, now, lacked)):
                    self._resume(self.worker.again, piece, lacked, lacked, clock)

    def _falls_to_me(self, piece: int, active: list[PieceClaim], wait: int, now: int) -> bool:
        """Whether this robot relieves others of a piece, or nobody computes it or has a newer copy to do so."""
        newest = self.worker.copies.newest(piece)
        if active:
            return relieves(self._plan, self._far(piece), newest, active)
        newer = any(who != self._me and step > newest for who, step in self._claims.keeping(piece, now))
        return not newer and self._claims.silence(piece, now) > wait

    def _help(self, now: int, clock: int) -> None:
        """Compute a piece beside a robot that has too many, and hold it once this robot is ahead."""
        self._helper.promote(self.worker, self._claims, now)
        piece = self._helper.piece(self.worker, self._claims, now)
        if piece is not None:
            newest = self.worker.copies.newest(piece)
            goal = min(newest + KEPT * self._plan.job.level, self._plan.steps)
            self._resume(self.worker.again, piece, newest, goal, clock)

    def _lack(self, piece: int, active: list[int], since: int, now: int) -> int | None:
        """The first step from `since` on to which others need what a piece shows, and this robot comes before them.

        Who is on the way to it from an earlier step than this robot's copy may itself lack what nobody has any more.
        """
        needed = [
            claim.step
            for reader in self._plan.readers[piece]
            for _, claim, _ in self._claims.of(reader, now)
            if since <= claim.step < self._plan.steps and not claim.has >> self._plan.bit(reader, piece) & 1
            and self.worker.log.get(piece, claim.step, reader) is None
        ]  # fmt: skip
        found = ((step, self.worker.copies.before(piece, step)) for step in sorted(set(needed)))
        first, copy = next(((step, copy[0]) for step, copy in found if copy is not None), (None, 0))
        mine = [self.worker.threads[piece].step] if piece in self.worker.threads else []
        return None if first is None or any(copy <= step <= first for step in (*active, *mine)) else first

    def _resume(self, where: dict[int, Thread], piece: int, latest: int, goal: int, clock: int) -> None:
        """Go on with a piece from its newest copy that is not later than a step."""
        found = self.worker.copies.before(piece, latest)
        if found is None or not self._fits(self._plan.need(piece)):
            return
        step, state = found
        self.worker.counts.taken += where is self.worker.threads
        self.worker.begin(where, piece, step, state, goal, clock, known=self._claims.newest(piece))
