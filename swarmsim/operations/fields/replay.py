"""The robots' estimates of the field at any iteration, from a recording's weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.file import minds_of
from swarmsim.operations.fields.estimate import Basis, FieldEstimate
from swarmsim.recording.reader import Recording


def holds_estimates(recording: Recording) -> bool:
    """Whether a recording is of robots that estimated a field."""
    return _parameters(recording) is not None and "weights" in recording


def _parameters(recording: Recording) -> FieldEstimate | None:
    """The parameters of the robots that estimate a field, of all or of one group."""
    for one in minds_of(recording.scenario):
        try:
            found = one.mind.computation.parameters
        except InputError:  # third-party code
            continue
        if isinstance(found, FieldEstimate):
            return found
    return None


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
        """The mean of live robots' estimates (rows, columns) at a row of the recording; NaN without any."""
        alive = self._recording["alive"][row]
        weights = self._recording.rows("weights", len(alive), len(self._functions))[row][alive]
        weights = weights[~np.isnan(weights).any(axis=1)]  # groups with another mind have none
        if not len(weights):
            return np.full(self._shape, np.nan)
        return np.asarray((weights.mean(axis=0) @ self._functions).reshape(self._shape))
