"""One robot's part in a job in pieces: what it computes, keeps, has heard, and says."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import Values
from swarmsim.core.messages import HEADER
from swarmsim.core.processors import OwnProcessor
from swarmsim.jobs.claims import AFAR, Hearsay, News
from swarmsim.jobs.helping import Helper
from swarmsim.jobs.items import CLAIM, KEEP, SHOW, STATE, Item, ItemCodec
from swarmsim.jobs.log import KEPT
from swarmsim.jobs.plan import JobPlan
from swarmsim.jobs.router import Router
from swarmsim.jobs.worker import Thread, Worker

MOST_HOPS: Final = AFAR - 1
SIGNS: Final = 4  # of life within the patience that others have
CALL: Final = 2  # iterations until a copy is offered again


class Peer:
    """One robot. It reads its own pose and messages alone.

    It computes a step of each of its pieces in an exchange, once it knows what the piece reads. If it keeps a copy of a
    piece of which nothing has been heard for long, it goes on with it. If others have long needed a value that nobody
    is known to compute, it computes it once more from an earlier copy, beside the piece itself.
    """

    def __init__(self, plan: JobPlan, me: int, rounds: int, processor: OwnProcessor) -> None:
        self._plan, self._me, self._rounds, self._processor = plan, me, rounds, processor
        self._every = max(1, plan.keys.patience // SIGNS) * rounds
        self._claims, self._keeps = Hearsay(plan.keys.patience), Hearsay(plan.keys.patience)
        self._router = Router(plan, me, rounds)
        self.worker, self._helper = Worker(plan, self._router.made, processor), Helper(plan, me, processor)
        self._offered: dict[int, tuple[int, int, int]] = {}  # step, next exchange and pause, by piece
        self._lacked: dict[tuple[int, int], int] = {}  # iteration in which a lack was first noticed
        self._heard_at = 0  # the last iteration in which it heard anybody
        self._room, self._near = math.inf, set[int]()  # bytes for what is not of these pieces, in this exchange
        for piece in range(len(plan.pieces)):
            self._claims.note(piece, plan.first_holder(piece), 0, -1, AFAR, 0, 0)

    def wake(self, now: int) -> None:
        """Count all silence from now on."""
        self._heard_at = now
        self._lacked.clear()
        for claims in (self._claims, self._keeps):
            claims.wake(now)

    def begin(self, states: Iterable[tuple[int, Values]], clock: int) -> None:
        """Start with its own pieces' states."""
        for piece, state in states:
            self.worker.begin(self.worker.threads, piece, 0, state, self._plan.steps, clock)

    def learn(self, other: Peer) -> None:
        """Take over the values and copies that another robot has."""
        self.worker.log, self.worker.copies = (
            self.worker.log.merged(other.worker.log),
            self.worker.copies.merged(other.worker.copies),
        )

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

    def say(self, now: int, clock: int, place: NDArray[np.float64], codec: ItemCodec) -> list[Item]:
        """What it says in an exchange, within the budget; `place` (2,) is where it believes to be, in m."""
        self._sign(now, clock, place)
        left = math.inf if self._plan.keys.budget is None else self._plan.keys.budget - HEADER.size
        found = []
        for item, entry in self._wanted(now, clock):
            size = codec.size(item)
            if size > left:
                continue
            left -= size
            found.append(item)
            if entry is not None:
                entry.said = entry.step, entry.beat
            elif item.kind == SHOW:
                self._router.said(item, clock)
            else:
                pause = self._offered[item.piece][2]
                longest = self._plan.keys.patience * self._rounds
                self._offered[item.piece] = item.step, clock + pause, min(2 * pause, max(longest, 1))
        return found

    def _sign(self, now: int, clock: int, place: NDArray[np.float64]) -> None:
        """Claim its pieces and copies in its own books."""
        for piece in {**self.worker.threads, **self.worker.again}:
            step = min(thread[piece].step for thread in (self.worker.threads, self.worker.again) if piece in thread)
            self._claims.note(piece, self._me, step, clock, 0, self._far(piece, place), now)
        for piece in self.worker.copies.pieces():
            if piece not in self.worker.threads:
                self._keeps.note(piece, self._me, self.worker.copies.newest(piece), clock, 0, 0, now)

    def _far(self, piece: int, place: NDArray[np.float64]) -> int:
        far = float(np.hypot(*(self._plan.centres[piece] - place))) / self._plan.cell
        return int(min(far, 65535.0)) if math.isfinite(far) else 65535

    def _wanted(self, now: int, clock: int) -> Iterator[tuple[Item, News | None]]:
        """All that it would say, the most urgent first: claims, copies' claims, values, states."""
        for kind, claims in ((CLAIM, self._claims), (KEEP, self._keeps)):
            for piece, who, entry in claims.due(now, self._every):
                if entry.beat >= 0:  # heard, not presumed
                    of_claims = (entry.hops, entry.far) if kind == CLAIM else (0, 0)
                    yield Item(kind, piece, entry.step, who, entry.beat, *of_claims), entry
        for item in self._router.items(self.worker.log, self._claims, now, clock):
            yield item, None
        for piece in sorted(self.worker.threads):
            step = self.worker.copies.newest(piece)
            if self._lacks_copies(piece, step, now, clock):
                found = self.worker.copies.before(piece, step)
                if found is not None:
                    yield Item(STATE, piece, step, values=found[1]), None

    def _lacks_copies(self, piece: int, step: int, now: int, clock: int) -> bool:
        """Whether a copy has to be offered now."""
        if self._plan.keys.copies == 0:
            return False
        if self._offered.get(piece, (-1, 0, 0))[0] != step:
            self._offered[piece] = step, clock, CALL * self._rounds
        enough = self._plan.keys.copies != "all" and self._keepers(piece, step, now) >= self._plan.keys.copies
        return not enough and clock >= self._offered[piece][1]

    def _keepers(self, piece: int, step: int, now: int, better: bool = False) -> int:
        """How many others keep a state of a piece no older than a step; with `better`, of those before it in line."""
        holders = {who for who, _ in self._claims.of(piece, now)}
        mine = (self._me - piece) % self._plan.robots
        return sum(
            entry.step >= step and who != self._me and who not in holders
            and (not better or (who - piece) % self._plan.robots < mine)
            for who, entry in self._keeps.of(piece, now)
        )  # fmt: skip

    # --- hearing

    def hear(self, items: Iterable[Item], now: int, clock: int, place: NDArray[np.float64]) -> None:
        """Take in what was said, go on with its pieces, and take over others'."""
        self._make_room()
        for item in items:
            self._heard_at = now
            self._take_in(item, now, clock)
        self._give_up(now, place)
        before = set(self.worker.again)
        self.worker.advance(clock)
        for piece in before - self.worker.again.keys() - self.worker.threads.keys():
            self._claims.withdraw(piece, self._me)
        self._take_over(now, clock, place)
        self._help(now, clock)
        if self._plan.keys.fence == "data":
            horizon = self._horizon()
            self.worker.log.forget(horizon)
            self._router.forget(horizon)

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

    def _take_in(self, item: Item, now: int, clock: int) -> None:
        if item.kind in (CLAIM, KEEP):
            books = self._claims if item.kind == CLAIM else self._keeps
            if item.who != self._me:
                books.note(item.piece, item.who, item.step, item.beat, min(item.hops + 1, MOST_HOPS), item.far, now)
        elif item.kind == SHOW:
            stale = self._plan.keys.fence == "clock" and item.step <= (self.worker.log.newest(item.piece) or -1)
            fits = item.piece in self._near or self._fits(item.values.nbytes)
            if not stale and fits and self.worker.log.put(item.piece, item.step, item.values):
                if self._plan.keys.fence == "clock":
                    self.worker.log.only_newest(item.piece)
                self._router.heard(item, self._claims, now, clock)
        elif item.piece not in self.worker.threads:
            copies = self._plan.keys.copies
            keeps = self.worker.copies.newest(item.piece) >= 0
            asked = copies == "all" or keeps or self._keepers(item.piece, item.step, now) < copies
            if asked:
                self._keep(item)

    def _keep(self, item: Item) -> None:
        """Keep a copy, if there is memory for it or an older one makes room."""
        copies, size = self.worker.copies, item.values.nbytes
        if copies.count(item.piece) and size > self._room:
            self._room += copies.count(item.piece) * size
            copies.drop(item.piece)
        if self._fits(size):
            copies.put(item.piece, item.step, item.values)

    def _give_up(self, now: int, place: NDArray[np.float64]) -> None:
        """Leave pieces to others that are ahead or, at the same step, nearer; and copies if others have enough."""
        for piece, thread in list(self.worker.threads.items()):
            mine = thread.step, -self._far(piece, place), -self._me
            if any((one.step, -one.far, -who) > mine for who, one in self._claims.of(piece, now) if who != self._me):
                del self.worker.threads[piece]
                self._claims.withdraw(piece, self._me)
        copies = self._plan.keys.copies
        for piece in self.worker.copies.pieces() if copies != "all" else ():
            newest = self.worker.copies.newest(piece)
            if piece not in self.worker.threads and self._keepers(piece, newest, now, better=True) >= int(copies):
                self.worker.copies.drop(piece)
                self._keeps.withdraw(piece, self._me)

    def _horizon(self) -> int:
        """The step before which nobody needs values any more: a level before the slowest piece's."""
        slowest = min(self._claims.newest(piece) for piece in range(len(self._plan.pieces)))
        kept = [step for piece in range(len(self._plan.pieces)) if (step := self._keeps.newest(piece)) > 0]
        own = [thread.step for thread in (*self.worker.threads.values(), *self.worker.again.values())]
        return min(self._plan.level_of(min([slowest, *own])) - self._plan.job.level, *kept, self._plan.steps)

    # --- taking over

    def _take_over(self, now: int, clock: int, place: NDArray[np.float64]) -> None:
        """Go on with pieces of which nothing is heard, and compute values once more that are lacked for long."""
        for piece in self.worker.copies.pieces():
            wait = self._plan.keys.patience + int(self._far(piece, place) * self._plan.cell / self._plan.reach[piece])
            active = [entry.step for who, entry in self._claims.of(piece, now) if who != self._me]
            if piece not in self.worker.threads and self._orphaned(piece, active, wait, now):
                self._resume(self.worker.threads, piece, self._plan.steps, self._plan.steps, clock)
            elif self._plan.keys.fence == "data" and piece not in self.worker.again:
                lacked = self._lack(piece, active, now)
                if lacked is not None and now - self._lacked.setdefault((piece, lacked), now) > wait:
                    self._resume(self.worker.again, piece, lacked, lacked, clock)

    def _orphaned(self, piece: int, active: list[int], wait: int, now: int) -> bool:
        """Whether nobody goes on with a piece, and nobody else has a newer copy to do so.

        Who holds it but is more than a level behind this robot's copy may lack values that all others have forgotten.
        """
        newest = self.worker.copies.newest(piece)
        if active:
            return max(active) < newest - self._plan.job.level
        newer = any(who != self._me and entry.step > newest for who, entry in self._keeps.of(piece, now))
        return not newer and self._claims.silence(piece, now) > wait

    def _help(self, now: int, clock: int) -> None:
        """Compute a piece beside a robot that has too many, and hold it once this robot is ahead."""
        self._helper.promote(self.worker, self._claims, now)
        piece = self._helper.piece(self.worker, self._claims, now)
        if piece is not None:
            newest = self.worker.copies.newest(piece)
            goal = min(newest + KEPT * self._plan.job.level, self._plan.steps)
            self._resume(self.worker.again, piece, newest, goal, clock)

    def _lack(self, piece: int, active: list[int], now: int) -> int | None:
        """The first step to which others need what a piece shows, if nobody is known to come to it."""
        needed = [
            entry.step
            for reader in self._plan.readers[piece]
            for _, entry in self._claims.of(reader, now)
            if entry.step < self._plan.steps and self.worker.log.get(piece, entry.step) is None
        ]
        mine = [self.worker.threads[piece].step] if piece in self.worker.threads else []
        first = min(needed, default=None)
        return None if first is None or any(step <= first for step in (*active, *mine)) else first

    def _resume(self, where: dict[int, Thread], piece: int, latest: int, goal: int, clock: int) -> None:
        """Go on with a piece from its newest copy that is not later than a step."""
        found = self.worker.copies.before(piece, latest)
        if found is None or not self._fits(self._plan.need(piece)):
            return
        step, state = found
        self.worker.counts.taken += 1
        self.worker.counts.redone += max(0, self._claims.newest(piece) - step)
        self._keeps.withdraw(piece, self._me)
        self.worker.begin(where, piece, step, state, goal, clock)
