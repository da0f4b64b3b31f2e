"""Which pieces a robot takes off others that are behind, have too many, or are too far from them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from swarmsim.core.processors import OwnProcessor
from swarmsim.jobs.plan import JobPlan
from swarmsim.jobs.reports import Hearsay, PieceClaim
from swarmsim.jobs.worker import Worker


def relieves(plan: JobPlan, far: int, newest: int, active: Sequence[PieceClaim]) -> bool:
    """Whether a robot `far` cells from a piece, with a copy of its step `newest`, takes it off those who compute it.

    Who is more than a level behind the copy may lack values that all others have forgotten. With `migrate` all of them
    have to be farther from it by more than that, and at the level that begins with the copy.
    """
    if max(claim.step for claim in active) < newest - plan.job.level:
        return True
    if plan.keys.migrate is None or newest == plan.steps:
        return False
    least = far + plan.keys.migrate / plan.cell
    return all(claim.far > least and plan.level_of(claim.step) == newest for claim in active)


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
