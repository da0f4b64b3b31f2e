"""The field as robots estimated it at any iteration, from the weights that a recording holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.events import Box
from swarmsim.operations.fields.estimate import Basis
from swarmsim.recording.reader import Recording


def holds_estimates(recording: Recording) -> bool:
    """Whether a recording is of robots that estimated a field."""
    return recording.scenario.mind.computation.get("use") == "field-estimate" and "weights" in recording


class FieldReplay:
    """The estimates of a recorded run, at the centres of the lattice's cells."""

    def __init__(self, recording: Recording, bounds: Box) -> None:
        """`bounds` of the floor plan's page: left, lower, right, upper in m."""
        lattice = recording.lattice
        basis = Basis(bounds, recording.scenario.mind.computation["spacing"])
        cells = np.indices(lattice.shape).reshape(2, -1).T
        self._functions = basis.at(lattice.centres(cells)).T
        self._recording, self._shape = recording, lattice.shape

    def mean(self, row: int) -> NDArray[np.float64]:
        """The mean of live robots' estimates (rows, columns) at a row of the recording; of nobody's NaN."""
        alive = self._recording["alive"][row]
        if not alive.any():
            return np.full(self._shape, np.nan)
        weights = self._recording.rows("weights", len(alive), len(self._functions))[row][alive].mean(axis=0)
        return np.asarray((weights @ self._functions).reshape(self._shape))
