"""What no robot can have said of a job in pieces."""

from __future__ import annotations

from swarmsim.core.messages import LATEST, FrameError
from swarmsim.jobs.facts.wire import Fact
from swarmsim.jobs.plan import STATE_NUMBER, JobPlan, shape_of
from swarmsim.jobs.reports import AFAR, FARTHEST, REPORT, SHOW, Report


class PieceLaw:
    """Holds reports, values and states to what all robots know before the run."""

    def __init__(self, plan: JobPlan) -> None:
        self._plan = plan

    def __call__(self, fact: Fact) -> None:
        """Raise FrameError for a fact that no robot says."""
        plan = self._plan
        most = plan.robots if fact.kind == REPORT else len(plan.pieces)
        if fact.key >= most:
            raise FrameError(f"robot or piece {fact.key}; expected 0 to {most - 1}")
        if fact.kind == REPORT:
            self._check_report(fact)
        elif fact.version > plan.steps:
            raise FrameError(f"piece {fact.key}: step {fact.version}; expected {plan.steps} at most")
        elif fact.kind == SHOW:
            self._check_value(fact)
        elif fact.robot:
            raise FrameError(f"piece {fact.key}: a state for {fact.robot}; expected 0")
        else:
            shape_of(fact.value, STATE_NUMBER)

    def _check_report(self, fact: Fact) -> None:
        if fact.version > LATEST or fact.robot > AFAR:
            raise FrameError(f"a report of exchange {fact.version}, {fact.robot} hops away")
        report, plan = Report.of(fact), self._plan
        for piece, claim in report.claims.items():
            most = plan.steps, FARTHEST, (1 << len(plan.joints[piece])) - 1 if piece < len(plan.pieces) else -1
            if any(number > bound for number, bound in zip(claim, most, strict=True)):
                raise FrameError(f"robot {fact.key} claims piece {piece}: {tuple(claim)}; expected {most} at most")
        for piece, step in report.keeps.items():
            if piece >= len(plan.pieces) or step > plan.steps:
                raise FrameError(f"robot {fact.key} keeps step {step} of piece {piece}")

    def _check_value(self, fact: Fact) -> None:
        readers = self._plan.readers[fact.key]
        if not 0 < fact.robot < 1 << len(readers):
            raise FrameError(f"piece {fact.key}: for the readers {fact.robot:b}; expected some of {len(readers)}")
        count = fact.robot.bit_count()
        if len(fact.value) < count or max(fact.value[:count]) > AFAR:
            raise FrameError(f"piece {fact.key}: no hops for each of {count} readers; expected 0 to {AFAR}")
        if len(fact.value) == count:
            return
        shape, rows = shape_of(fact.value[count:], self._plan.number)[0], self._plan.rows(fact.key, fact.robot)[0]
        if shape[:1] != (rows,):
            raise FrameError(f"piece {fact.key}: values of shape {shape}; expected {rows} rows")
