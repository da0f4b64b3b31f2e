"""The task of reconstructing a field: the error of every robot's estimate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext, Field
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Knowledge, Measured, Moment
from swarmsim.operations.fields.estimate import Reconstruction

CURVE: Final = Curve("error", "relative error, %", scale=100.0, low=0.0, robots="errors", format=".1f", rises=False)
POINTS: Final = 2000  # where truth and estimates are compared, at most


class FieldError(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The mean error of live robots' estimates falls to a share of the field's deviation.

    A robot's error is the root-mean-square difference of its estimate and the truth over the floor, as a share of the
    truth's standard deviation over the floor at that moment: 1 is as good as knowing only the mean.
    """

    error: Annotated[float, Meta(gt=0.0)] = 0.1  # finishes the run

    def build(self, context: BuildContext) -> FieldTask:
        """The task. Raises InputError without a field."""
        if context.scalar_field is None:
            raise InputError("use: 'field-error' measures estimates of a field; expected a table [field]")
        return FieldTask(self.error, context.scalar_field, context)


class FieldTask:
    """Compares estimates with the truth at the cells that can be explored at the start."""

    requires_knowledge: type[Knowledge] = Reconstruction
    curve = CURVE

    def __init__(self, wanted: float, field: Field, context: BuildContext) -> None:
        cells = np.argwhere(context.building.explorable & ~context.building.occupied)
        self._points = context.lattice.centres(cells[:: -(-len(cells) // POINTS) or 1])
        self._wanted, self._field, self._period = wanted, field, context.period

    def measure(self, done: Done[Reconstruction]) -> Measured:
        """The mean and the largest error of the live, and the error of each."""
        truth = self._field.value(done.state.iteration * self._period, self._points)
        errors = errors_of(done.knowledge, self._points, truth)
        live = errors[done.state.alive]
        error = float(live.mean()) if len(live) else float("nan")
        values = {"error": error, "worst": float(live.max(initial=0.0))}
        finished = error <= self._wanted  # never without live robots: no error
        progress = 1.0 if finished else self._wanted / error if len(live) else 0.0
        return Measured(values, {"errors": errors}, progress, finished)

    def summaries(self) -> Sequence[Summary[Reconstruction]]:
        return (ErrorMeasures(),)


def errors_of(
    knowledge: Reconstruction, points: NDArray[np.float64], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Every robot's root-mean-square error (n,) at points (k, 2), as a share of the deviation of the truth (k,)."""
    apart = knowledge.at(points) - truth
    return np.asarray(np.sqrt((apart**2).mean(axis=1)) / (float(truth.std()) or 1.0))


class ErrorMeasures:
    """An observer that keeps the errors."""

    def __init__(self) -> None:
        self._errors: list[float] = []
        self._worst = float("nan")

    def sample(self, moment: Moment[Reconstruction]) -> None:
        """Take note of one iteration."""
        self._errors.append(moment.measured.values["error"])
        self._worst = moment.measured.values["worst"]

    def summary(self) -> dict[str, float | int | None]:
        """The mean and the largest error at the end, and the mean error over the second half of the run."""
        errors = np.array(self._errors)
        there = len(errors) > 0
        return {
            "error_end": float(errors[-1]) if there else None,
            "worst_end": self._worst if there else None,
            "error_late": float(errors[len(errors) // 2 :].mean()) if there else None,
        }
