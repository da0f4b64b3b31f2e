"""A field that a model makes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.context import BuildContext, Field
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain, Values
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.part import NONE, Part
from swarmsim.jobs.pieces import given
from swarmsim.operations.fields.truth import FiniteField, Noise
from swarmsim.operations.methods.seam import Scheme
from swarmsim.operations.methods.sweeps import BlockJacobi
from swarmsim.operations.models.emitters import Emitter, Hidden
from swarmsim.operations.models.job import ModelJob, Seconds, at_key, problem_of
from swarmsim.operations.models.seam import Equation

MOST: Final = 1 << 25  # numbers kept of a field's past: 256 MB
_NOBODY: Final = np.empty((0, 0))
DIVERGED: Final = 1e100  # in the field's unit


class ModelField(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The field is what a model's equation gives, from sources that no robot is told of.

    The floor is that of the floor plan, from where robots enter; doors and furniture that come later do not change it.
    It is solved in one piece with steps of `dt` as they are needed; a point has the value of its cell, one in a wall
    that of the nearest free cell, and between two steps values change linearly. Without a `method`, each step is
    solved exactly by the implicit method of Euler; waves need `explicit`. With `refine`, its cells are smaller than the
    lattice's, so that robots that solve the same model on the lattice do not solve the very same equations.
    """

    model: Part[Equation]
    method: Part[Scheme] = NONE
    dt: Seconds | None = None  # s; default: the period
    refine: Annotated[int, Meta(ge=1, le=16)] = 1  # cells along the side of each of the lattice's
    start: Part[Field] = NONE  # the field at time 0; default: 0
    sources: tuple[Emitter, ...] = ()
    hidden: tuple[Hidden, ...] = ()  # besides, at random places
    noise: Noise = 0.0  # standard deviation of a sample, in the field's unit

    def build(self, context: BuildContext) -> EmittedField:
        """The field. Raises InputError, which starts with the key at fault."""
        coarse, dt = given(context), self.dt or context.period
        emitters, domain = (*self.sources, *self._drawn(coarse, context)), refined(coarse, self.refine)
        problem = problem_of(self.model, emitters, dt, domain, context)
        method: Scheme = self.method.build(context, "method") if self.method else BlockJacobi(sweeps=1)
        job = ModelJob.of(problem, method, domain, 1, method.level)
        first = np.zeros(np.count_nonzero(domain.free))
        if self.start:
            first = self.start.build(context, "start").value(0.0, domain.lattice.centres(np.argwhere(domain.free)))
        solved = SolvedField(job, domain, method.exchanges, first)
        return EmittedField(FiniteField(solved, "model: its solution", context), emitters)

    def _drawn(self, domain: Domain, context: BuildContext) -> Iterator[Emitter]:
        dice = context.streams.open("hidden sources")
        for number, one in enumerate(self.hidden):
            with at_key(f"hidden[{number}]"):
                yield one.drawn(domain, dice)


@dataclass(frozen=True, slots=True, eq=False)
class EmittedField:
    """A field with the sources that it comes from, for those who measure whether they are found."""

    field: Field
    emitters: Sequence[Emitter]

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at points (k, 2)."""
        return self.field.value(time, points)


class SolvedField:
    """A model's solution at any time, computed when it is asked for."""

    def __init__(self, job: ModelJob, domain: Domain, exchanges: int, first: NDArray[np.float64]) -> None:
        """`exchanges` are the job's steps in a step in time; `first` (n,) is the field at time 0."""
        self._lattice, self._cells, self._dt = domain.lattice, nearest_cells(domain), job.problem.dt
        self._past = Past(job, exchanges, first)

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at points (k, 2)."""
        cells = self._cells[tuple(_clipped(self._lattice, points).T)]
        last, part = divmod(time / self._dt, 1.0)
        if part > 1.0 - 1e-9:
            last, part = last + 1.0, 0.0
        found = self._past.at(int(last))[cells]
        if part < 1e-9:
            return np.asarray(found)
        return np.asarray((1.0 - part) * found + part * self._past.at(int(last) + 1)[cells])


class Past:
    """States of a job in one piece, at the steps in time that were asked for and at even intervals before."""

    def __init__(self, job: ModelJob, exchanges: int, first: NDArray[np.float64], most: int = MOST) -> None:
        """`most` numbers are kept, or a few states."""
        self._job, (self._piece,), self._exchanges = job, job.cut, exchanges
        self._states = {0: job.start(self._piece, first)}
        self._most, self._stride = max(8, most // self._states[0].size), 1

    def at(self, level: int) -> NDArray[np.float64]:
        """The field (n,) after so many steps in time. Raises InputError where it diverges."""
        known = max(one for one in self._states if one <= level)
        state = self._states[known]
        for step in range(known * self._exchanges, level * self._exchanges):
            with np.errstate(over="ignore", invalid="ignore"):  # told below
                state = self._job.step(self._piece, state, _NOBODY, step)
            if not (np.abs(state) < DIVERGED).all():
                raise InputError(
                    f"field.model: its solution passes {DIVERGED:g} after step {step + 1}, so it diverges; expected "
                    "shorter steps (field.dt) or weaker sources"
                )
            if (step + 1) % self._exchanges == 0:
                self._keep((step + 1) // self._exchanges, state)
        return self._job.answer(self._piece, state)

    def _keep(self, level: int, state: Values) -> None:
        self._states[level] = state
        while len(self._states) > self._most:
            self._stride *= 2
            near = self._most // 4
            self._states = {
                one: kept for one, kept in self._states.items() if one % self._stride == 0 or abs(one - level) < near
            }


def refined(domain: Domain, times: int) -> Domain:
    """The same floor in cells so many times smaller."""
    coarse = domain.lattice
    fine = replace(coarse, cell=coarse.cell / times, rows=coarse.rows * times, columns=coarse.columns * times)
    return Domain(fine, np.kron(domain.free, np.ones((times, times), np.bool_)))


def nearest_cells(domain: Domain) -> NDArray[np.int64]:
    """The number (rows, columns) of the free cell nearest to each cell."""
    number = np.cumsum(domain.free.ravel()).reshape(domain.free.shape) - 1
    rows, columns = ndimage.distance_transform_edt(~domain.free, return_distances=False, return_indices=True)
    return np.asarray(number[rows, columns])


def _clipped(lattice: Lattice, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """The cells (k, 2) at points (k, 2): row, column; of those outside the nearest ones."""
    found = np.floor((points - (lattice.x0, lattice.y0)) / lattice.cell)[:, ::-1]
    return np.asarray(np.clip(np.nan_to_num(found), 0, np.array(lattice.shape) - 1).astype(np.int64))
