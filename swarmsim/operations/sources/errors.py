"""How far off predictions of a field are, beside those that nothing changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import Field
from swarmsim.operations.sources.inversion import FoundSource
from swarmsim.operations.sources.locate import Located


@dataclass(frozen=True, slots=True)
class Errors:
    """Mean square errors of one prediction over the floor, in the field's unit squared."""

    ahead: float  # s
    prediction: float
    persistence: float  # of the same robot's estimate of the present field, taken for the later one
    truth_persistence: float  # of the true present field, taken for the later one
    variance: float  # of the true later field over the floor


def errors_of(
    located: Located, robots: Sequence[int], field: Field, time: float, ahead: Sequence[float]
) -> Iterator[Errors]:
    """The errors of robots (r,) that predict a field at a time (s), so many seconds ahead (h,).

    Times after the end of the job's Green's functions are left out.
    """
    inversion = located.plan.inversion
    cells, places = np.arange(inversion.greens.cells), inversion.candidates.places
    truth = field.value(time, places)
    later = {one: field.value(time + one, places) for one in ahead if time + one <= inversion.greens.duration}
    for robot in robots:
        finding = located.findings[robot]
        assert isinstance(finding, FoundSource)
        present = finding.forecast(inversion.greens, time, cells)
        for one, then in later.items():
            predicted = finding.forecast(inversion.greens, time + one, cells)
            yield Errors(one, _square(predicted, then), _square(present, then), _square(truth, then), float(then.var()))


def _square(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(((first - second) ** 2).mean())
