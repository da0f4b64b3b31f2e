"""How wrong a job's answer is: against one computer's, and against the field."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.jobs import Values
from swarmsim.jobs.alone import alone
from swarmsim.jobs.plan import JobPlan
from swarmsim.jobs.runtime import Parcel


class AnswerCheck:
    """The answers of one job in sequence, done once at the start, and the field's values at any time."""

    def __init__(self, plan: JobPlan, context: BuildContext) -> None:
        self._plan, self._field, self._period = plan, context.scalar_field, context.period
        self._points = [context.lattice.centres(one.cells) for one in plan.pieces]
        sensed = [np.zeros(len(at)) if self._field is None else self._field.value(0.0, at) for at in self._points]
        states = alone(plan.job, plan.pieces, sensed, plan.steps, plan.keys.value)
        self._right = [self._answer(piece, state) for piece, state in enumerate(states)]

    def _answer(self, piece: int, state: Values) -> Values:
        found = self._plan.job.answer(self._plan.pieces[piece], state)
        return np.asarray(found, np.float64).reshape(len(self._points[piece]), -1)[:, 0]

    def errors(self, parcel: Parcel, alive: NDArray[np.bool_], time: float) -> tuple[float, float]:
        """The root mean squares of both errors, as shares of that of what is right.

        The first is against the last answer in sequence; pieces that no living robot computes count as 0. The second
        is of the pieces computed, against the field at the time (s) of their steps; NaN without a field.
        """
        step = np.where(alive[:, None], parcel.step, -1)
        wrong, apart, truth = list[Values](), list[Values](), list[Values]()
        for piece, robot in enumerate(step.argmax(axis=0).tolist()):
            if step[robot, piece] < 0:
                wrong.append(self._right[piece])
                continue
            answer = self._answer(piece, parcel.states[robot][piece][1])
            wrong.append(answer - self._right[piece])
            if self._field is not None:
                truth.append(self._field.value(self._time(int(step[robot, piece]), time), self._points[piece]))
                apart.append(answer - truth[-1])
        return _share(wrong, self._right), _share(apart, truth)

    def _time(self, step: int, now: float) -> float:
        """The time (s) that a step is for: as the rule says, if it has a verb `time`, else the present."""
        told = getattr(self._plan.job, "time", None)
        return now if told is None else float(told(step))


def _share(wrong: list[Values], right: list[Values]) -> float:
    """The root mean square of errors over that of what is right; NaN without any, inf where all is 0 but the errors."""
    if not right:
        return math.nan
    above, below = (float(np.sqrt((np.concatenate(one) ** 2).mean())) for one in (wrong, right))
    return above / below if below else (0.0 if above == 0.0 else math.inf)
