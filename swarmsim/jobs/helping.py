"""Which piece a robot takes off another one that has more pieces than its processor does in time."""

from __future__ import annotations

from collections import defaultdict

from swarmsim.core.processors import OwnProcessor
from swarmsim.jobs.plan import JobPlan
from swarmsim.jobs.reports import Hearsay
from swarmsim.jobs.worker import Worker


class Helper:
    """One robot's help for others, where rates are limited.

    It goes by its own processor: if the pieces of another robot take it more than an exchange, and that robot has at
    least two more than it, it computes one of them as well, from its copy. If it comes ahead, the other one lets go.
    """

    def __init__(self, plan: JobPlan, me: int, processor: OwnProcessor) -> None:
        self._plan, self._me, self._processor = plan, me, processor
        self._piece: int | None = None  # that it helps with

    def piece(self, worker: Worker, claims: Hearsay, now: int) -> int | None:
        """A piece to begin with; None if there is no need, or nothing that it could do."""
        if not self._processor.timed or self._plan.keys.fence != "data" or worker.again:
            return None
        mine = sum(thread.step < thread.goal for thread in worker.threads.values())
        loads: defaultdict[int, list[int]] = defaultdict(list)
        for who, news in claims.fresh(now):
            if who != self._me:
                loads[who] += [piece for piece, claim in news.report.claims.items() if claim.step < self._plan.steps]
        heavy = {
            who: len(its) for who, its in loads.items()
            if len(its) >= mine + 2 and sum(self._plan.work[one] for one in its) > self._processor.exchange
        }  # fmt: skip
        found = [
            (-heavy[who], (piece + self._me) % len(self._plan.pieces), piece)
            for piece in worker.copies.pieces() if heavy and piece not in worker.threads
            for who in self._alone(piece, worker, claims, now) if who in heavy
        ]  # fmt: skip
        self._piece = min(found)[-1] if found else None
        return self._piece

    def _alone(self, piece: int, worker: Worker, claims: Hearsay, now: int) -> list[int]:
        """The robot that computes a piece, if it is one alone and this one's copy is of its present level."""
        doing = [(who, claim.step) for who, claim, _ in claims.of(piece, now) if who != self._me]
        newest = worker.copies.newest(piece)
        return [who for who, step in doing if len(doing) == 1 and newest >= self._plan.level_of(step)]

    def promote(self, worker: Worker, claims: Hearsay, now: int) -> None:
        """Hold the piece that it helps with once it is ahead of all others."""
        thread = None if self._piece is None else worker.again.get(self._piece)
        if self._piece is None or thread is None:
            return
        if all(thread.step > claim.step for who, claim, _ in claims.of(self._piece, now) if who != self._me):
            worker.threads[self._piece] = worker.again.pop(self._piece)
            thread.goal, self._piece = self._plan.steps, None
