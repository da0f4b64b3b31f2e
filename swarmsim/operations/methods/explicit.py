"""Explicit methods: one exchange a step, no system to solve, and a longest stable step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Values
from swarmsim.operations.methods.problem import Patch, Problem
from swarmsim.operations.methods.seam import Solver


class Explicit(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Euler's explicit method, of first order in time; for waves the leapfrog, of second order.

    u' = u + dt (L u + gain). The largest value cannot grow while dt is at most 2 / max_i sum_j |L_ij|, by
    Gershgorin's circles: r = D dt / h^2 <= 1/4 for diffusion alone. For waves, (1 + g dt / 2) u' = 2 u -
    (1 - g dt / 2) u_before + dt^2 (L u + gain), stable up to c dt / h = 1 / sqrt(2) (Courant, Friedrichs and Lewy
    1928). Its results do not depend on the pieces, to the bit.
    """

    level: Annotated[int, Meta(ge=1, le=10**6)] = 10  # steps between copies of a piece's state

    @property
    def halo(self) -> int:
        return 1

    @property
    def exchanges(self) -> int:
        return 1

    def solvers(self, problem: Problem, patches: Sequence[Patch]) -> Sequence[Solver]:
        """Raises InputError for a step that is too long."""
        equations, instead = problem.equations, ", larger cells, or a method that solves, such as block-jacobi"
        if equations.order == 2:
            if equations.reaction is not None:
                raise InputError("method: explicit has no reaction in equations of second order in time")
            problem.check_step(2.0 / equations.fastest**0.5, "leapfrog", ", or larger cells")
            return [_Leapfrog(problem, patch) for patch in patches]
        problem.check_step(2.0 / (equations.fastest + 2.0 * equations.reacting), "explicit", instead)
        return [_Euler(problem, patch) for patch in patches]


class _Euler:
    """The explicit method of Euler on one piece. A state is the fields (c, k)."""

    def __init__(self, problem: Problem, patch: Patch) -> None:
        self._problem, self._patch = problem, patch
        self._rows = [patch.rows(one, patch.own) for one in problem.equations.operators]
        self.work = sum(2.0 * one.nnz + 4.0 * len(patch.own) for one in self._rows)

    def start(self, fields: Values) -> Values:
        return fields

    def shows(self, state: Values, step: int) -> Values:
        return np.asarray(state[self._patch.rim])

    def step(self, state: Values, around: Values, step: int) -> Values:
        dt, seen = self._problem.dt, self._patch.joined(state, around)
        flow = np.stack([rows @ seen[:, field] for field, rows in enumerate(self._rows)], axis=1)
        return state + dt * (flow + self._problem.gain(state, self._patch.own, step * dt, (step + 1) * dt))

    def fields(self, state: Values) -> Values:
        return state


class _Leapfrog:
    """The leapfrog on one piece. A state is the fields now and a step before (2, c, k)."""

    def __init__(self, problem: Problem, patch: Patch) -> None:
        self._problem, self._patch = problem, patch
        self._rows = [patch.rows(one, patch.own) for one in problem.equations.operators]
        damping = problem.equations.damping
        self._damping = (
            np.zeros((len(patch.own), 1)) if damping is None else 0.5 * problem.dt * damping[patch.own, None]
        )
        self.work = sum(2.0 * one.nnz + 8.0 * len(patch.own) for one in self._rows)

    def start(self, fields: Values) -> Values:
        return np.stack([fields, fields])

    def shows(self, state: Values, step: int) -> Values:
        return np.asarray(state[0, self._patch.rim])

    def step(self, state: Values, around: Values, step: int) -> Values:
        dt, (now, before) = self._problem.dt, state
        seen = self._patch.joined(now, around)
        flow = np.stack([rows @ seen[:, field] for field, rows in enumerate(self._rows)], axis=1)
        force = dt**2 * (flow + self._problem.gain(now, self._patch.own, (step - 0.5) * dt, (step + 0.5) * dt))
        if step == 0:  # at rest, so that the step before would mirror the step after
            return np.stack([now + 0.5 * force, now])
        after = (2.0 * now - (1.0 - self._damping) * before + force) / (1.0 + self._damping)
        return np.stack([after, now])

    def fields(self, state: Values) -> Values:
        return np.asarray(state[0])
