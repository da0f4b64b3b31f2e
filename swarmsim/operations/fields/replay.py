"""The field as robots estimated it at any iteration, from the weights that a recording holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.operations.fields.estimate import Basis, FieldEstimate
from swarmsim.recording.reader import Recording


def holds_estimates(recording: Recording) -> bool:
    """Whether a recording is of robots that estimated a field."""
    return _parameters(recording) is not None and "weights" in recording


def _parameters(recording: Recording) -> FieldEstimate | None:
    try:
        found = recording.scenario.mind.computation.parameters
    except InputError:  # code of somebody's own
        return None
    return found if isinstance(found, FieldEstimate) else None


class FieldReplay:
    """The estimates of a recorded run, at the centres of the lattice's cells."""

    def __init__(self, recording: Recording, bounds: Box) -> None:
        """`bounds` of the floor plan's page: left, lower, right, upper in m. Raises InputError without estimates."""
        lattice = recording.lattice
        estimate = _parameters(recording)
        if estimate is None:
            raise InputError(f"{recording.path}: holds no estimates of a field; expected a run with field-estimate")
        basis = Basis(bounds, estimate.spacing)
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
