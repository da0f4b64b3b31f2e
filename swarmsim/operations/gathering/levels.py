"""One computer's way with a field: a level in time on the whole floor, drawn towards samples."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Values
from swarmsim.operations.methods.problem import Cells, Problem

TOLERANCE: Final = 1e-6  #: of the residual, of the right side


class WholeFloor:
    """Euler's implicit step, drawn towards samples with a rate: Newtonian relaxation (Hoke and Anthes 1976).

    (1 + dt rate H - dt L) u' = u + dt gain + dt rate H y, where H is 1 in cells with samples and y their mean. It is
    solved by conjugate gradients to TOLERANCE from the old field; nothing but six vectors is kept.
    """

    def __init__(self, problem: Problem, rate: float) -> None:
        """Raises InputError, which starts with the key at fault, for a model that is not one symmetric field."""
        equations = problem.equations
        operator = equations.operators[0]
        plain = equations.order == 1 and equations.fields == 1 and equations.reaction is None
        if not plain or abs(operator - operator.T).max() > 1e-9 * abs(operator).max():
            raise InputError("model: waves, reactions and draughts are not gathered; expected diffusion")
        self._problem, self._rate = problem, rate
        self._matrix = (sparse.eye_array(operator.shape[0]) - problem.dt * operator).tocsr()
        self._all = np.arange(operator.shape[0])

    @property
    def cells(self) -> int:
        """Of the floor."""
        return len(self._all)

    def after(self, field: Values, level: int, cells: Cells, values: Values) -> tuple[Values, float]:
        """The field (n,) after a level, from samples (k,) in it, and the floating-point operations that this took."""
        hits = np.bincount(cells, minlength=self.cells)
        pull = self._problem.dt * self._rate * (hits > 0)
        mean = np.bincount(cells, values, self.cells) / np.maximum(hits, 1)
        begin, end = level * self._problem.dt, (level + 1) * self._problem.dt
        gain = self._problem.gain(field[:, None], self._all, begin, end)[:, 0]
        matrix = (self._matrix + sparse.diags_array(pull)).tocsr()
        rounds = list[None]()
        found, _ = linalg.cg(
            matrix, field + self._problem.dt * gain + pull * mean, x0=field, rtol=TOLERANCE,
            callback=lambda _: rounds.append(None),
        )  # fmt: skip
        found.setflags(write=False)
        return found, self.work(len(rounds))

    def work(self, rounds: int) -> float:
        """Floating-point operations of so many iterations: a product with the matrix, two sums, three updates each."""
        return (rounds + 1.0) * (2.0 * float(self._matrix.nnz) + 10.0 * self.cells)
