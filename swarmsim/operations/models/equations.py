"""An equation on the cells of a domain, discrete in space and continuous in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swarmsim.core.jobs import Values


def alone(values: Values) -> Values:
    """The fields (c, 1) of a model of one field, from its values (c,) at the start."""
    return values[:, None]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Equations:
    """d^m u / dt^m + damping du/dt = L u + inflow + reaction(u), m = `order`, for k fields on n cells.

    The first field is the one that is measured, emitted and answered.
    """

    operators: tuple[sparse.csr_array, ...]  # L (n, n) of each field, 1/s^m
    inflow: Values  # (n, k): from the walls, unit/s^m
    pace: tuple[str, float]  # the number that limits explicit steps, and its value in a step of 1 s (to the power of m)
    order: int = 1  # in time
    damping: NDArray[np.float64] | None = None  # (n,), 1/s, of equations of order 2
    reaction: Callable[[Values], Values] | None = None  # (c, k) to (c, k), unit/s, each cell for itself
    reacting: float = 0.0  # 1/s: the fastest at which the reaction takes away
    start: Callable[[Values], Values] = alone  # (c,), the first field, to (c, k)

    @property
    def fields(self) -> int:
        """The number of fields."""
        return len(self.operators)

    @property
    def fastest(self) -> float:
        """An upper bound of the eigenvalues of -L, 1/s^m: the largest sum_j |L_ij| (Gershgorin 1931).

        It is inf for an operator whose circles reach into the half-plane of growth.
        """
        found = 0.0
        for operator in self.operators:
            own = -operator.diagonal()
            sums = abs(operator).sum(axis=1)
            if (sums - own > own * (1.0 + 1e-9)).any():
                return np.inf
            found = max(found, float(sums.max()))
        return found
