"""What robots compute together: how warm it will be, and where it is coldest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta

from swarmsim.core.context import BuildContext
from swarmsim.core.jobs import Domain, Piece, Shared, Values
from swarmsim.jobs.pieces import bisected
from swarmsim.operations.methods.explicit import Explicit
from swarmsim.operations.methods.problem import Patch, Problem
from swarmsim.operations.methods.seam import Solver
from swarmsim.operations.models.diffusion import Diffusivity, Rate, Walled, diffusive, mesh_ratio
from swarmsim.operations.models.equations import Equations
from swarmsim.operations.models.faces import Faces


class Night(Walled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Warmth spreads and leaves through the glass above: du/dt = D laplace(u) - k (u - outside)."""

    diffusivity: Diffusivity = 0.01  # m^2/s
    loss: Rate = 0.002  # 1/s, k
    outside: float = 5.0  # degrees Celsius

    def on(self, domain: Domain) -> Equations:
        self.closed()
        operator, inflow = diffusive(Faces.of(domain), self.diffusivity, self.loss, self.fixed())
        inflow += self.loss * self.outside
        return Equations(operators=(operator,), inflow=inflow[:, None], pace=mesh_ratio(self.diffusivity, domain))


class Heun(Explicit, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A trial step, then one with the mean of both slopes: of second order in time (Heun 1900)."""

    @property
    def exchanges(self) -> int:
        """One for each slope."""
        return 2

    def solvers(self, problem: Problem, patches: Sequence[Patch]) -> Sequence[Solver]:
        Explicit.solvers(self, problem, patches)  # whose longest step is its own too; raises InputError beyond it
        return [HeunPiece(problem, patch) for patch in patches]


class HeunPiece:
    """Heun's method on one piece. A state is the fields and their trial step (2, c, k)."""

    def __init__(self, problem: Problem, patch: Patch) -> None:
        self._problem, self._patch = problem, patch
        self._rows = [patch.rows(one, patch.own) for one in problem.equations.operators]
        self.work = sum(2.0 * one.nnz + 6.0 * len(patch.own) for one in self._rows)

    def start(self, fields: Values) -> Values:
        return np.stack([fields, fields])

    def shows(self, state: Values, step: int) -> Values:
        return np.asarray(state[step % 2, self._patch.rim])

    def step(self, state: Values, around: Values, step: int) -> Values:
        dt, trial = self._problem.dt, step % 2
        seen, time = self._patch.joined(state[trial], around), step // 2 * dt
        flow = np.stack([rows @ seen[:, field] for field, rows in enumerate(self._rows)], axis=1)
        ahead = state[trial] + dt * (flow + self._problem.gain(state[trial], self._patch.own, time, time + dt))
        return np.stack([0.5 * (state[0] + ahead)] * 2) if trial else np.stack([state[0], ahead])

    def fields(self, state: Values) -> Values:
        return np.asarray(state[0])


class Coldest(Shared, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The lowest temperature within `steps` cells of each cell, as it was at the start."""

    steps: Annotated[int, Meta(ge=1, le=10**6)] = 20
    parts: Annotated[int, Meta(ge=1, le=10**6)] = 4

    halo, level = 1, 1  # cells around a piece that a step reads; steps between copies of its state

    def build(self, context: BuildContext) -> Coldest:
        """The parameters are the job."""
        return self

    def pieces(self, domain: Domain) -> Sequence[Piece]:
        return bisected(domain, self.parts, self.halo)

    def start(self, piece: Piece, sensed: Values) -> Values:
        return sensed

    def shows(self, piece: Piece, state: Values, step: int) -> Values:
        return np.asarray(state[piece.rim])

    def step(self, piece: Piece, state: Values, around: Values, step: int) -> Values:
        cells = np.concatenate([piece.cells, piece.halo]) + 1
        grid = np.full(cells.max(axis=0) + 2, np.inf)
        grid[tuple(cells.T)] = np.concatenate([state, around])
        row, column = piece.cells.T + 1
        near = grid[row - 1, column], grid[row, column - 1], grid[row, column + 1], grid[row + 1, column]
        return np.asarray(np.minimum.reduce([state, *near]))

    def work(self, piece: Piece) -> float:
        return 4.0 * len(piece.cells)

    def answer(self, piece: Piece, state: Values) -> Values:
        return state
