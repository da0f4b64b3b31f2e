"""A model that a swarm solves, in pieces of the floor."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from msgspec import Meta

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain, Piece, Shared, Values
from swarmsim.core.scenario.part import Part
from swarmsim.jobs.pieces import bisected, given
from swarmsim.operations.methods.problem import Patch, Problem
from swarmsim.operations.methods.seam import Scheme, Solver
from swarmsim.operations.models.emitters import Emission, Emitter
from swarmsim.operations.models.faces import Faces, Whole
from swarmsim.operations.models.seam import Equation

if TYPE_CHECKING:
    from collections.abc import Iterator

Seconds = Annotated[float, Meta(gt=0.0, le=1e9)]


@contextmanager
def at_key(key: str) -> Iterator[None]:
    """Puts a key in front of what InputErrors say."""
    try:
        yield
    except InputError as problem:
        raise problem.inside(key) from problem


class Solve(Shared, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots solve a model's equation on the floor, each some pieces of it, for `duration` in steps of `dt`.

    The domain is the floor plan's free cells, connected to the entrance, which is handed out before the run. It is cut
    into as many `pieces` as there are robots, or as said. A piece's field at the start is what its first holder
    senses; `sources` are those that robots are told of.
    """

    model: Part[Equation]
    method: Part[Scheme]
    dt: Seconds  # s, of a step in time
    duration: Seconds  # s, a whole number of steps
    sources: tuple[Emitter, ...] = ()
    pieces: Annotated[int, Meta(ge=1, le=1_000_000_000)] | None = None  # none: as many as robots

    def build(self, context: BuildContext) -> ModelJob:
        """The job. Raises InputError for a step that is not stable, and for keys that do not go together."""
        problem = problem_of(self.model, self.sources, self.dt, given(context), context)
        method = self.method.build(context, "method")
        if self.fence == "clock" and method.exchanges > 1 and method.halo > 1:
            raise InputError(
                f"method.overlap: {method.halo - 1} with a clock: cells in an overlap keep the right side of the first "
                'sweep, for good, though what was heard by then is late; expected 0, or fence = "data"'
            )
        steps = steps_of(method, self.dt, self.duration)
        return ModelJob.of(problem, method, given(context), self.pieces or context.swarm, steps)


def problem_of(
    model: Part[Equation], sources: Sequence[Emitter], dt: float, domain: Domain, context: BuildContext
) -> Problem:
    """A model with sources on a domain. Raises InputError, which starts with the key at fault."""
    equation, faces = model.build(context, "model"), Faces.of(domain)
    with at_key("model"):
        equations = equation.on(domain)
    return Problem(equations, Emission(sources, faces), dt)


def steps_of(method: Scheme, dt: float, duration: float) -> int:
    """The steps of a piece in a duration (s). Raises InputError unless they make whole steps in time and levels."""
    times = round(duration / dt)
    if times < 1 or abs(times * dt - duration) > 1e-9 * duration:
        raise InputError(
            f"duration: {duration:g} s are {duration / dt:.6g} steps of dt = {dt:g} s; expected a whole number"
        )
    steps = times * method.exchanges
    if steps % method.level:
        raise InputError(
            f"method.level: {steps} steps in {duration:g} s are not a whole number of levels of {method.level}; "
            "expected a divisor"
        )
    return steps


@dataclass(frozen=True, slots=True, eq=False)
class ModelJob:
    """A problem and a method on a domain, as a job in pieces."""

    problem: Problem
    method: Scheme
    number: Whole  # (rows, columns): of each free cell
    steps: int
    cut: Sequence[Piece]
    solvers: Sequence[Solver]  # one for each piece

    @classmethod
    def of(cls, problem: Problem, method: Scheme, domain: Domain, count: int, steps: int) -> Self:
        """The job on a domain in `count` pieces. Raises InputError, which starts with the key at fault."""
        return cls.on(problem, method, domain, bisected(domain, count, method.halo), steps)

    @classmethod
    def on(cls, problem: Problem, method: Scheme, domain: Domain, cut: Sequence[Piece], steps: int) -> Self:
        """The job on these pieces of a domain. Raises InputError, which starts with the key at fault."""
        number = Faces.of(domain).number
        solvers = method.solvers(problem, [Patch.of(piece, number) for piece in cut])
        return cls(problem, method, number, steps, cut, solvers)

    @property
    def halo(self) -> int:
        return self.method.halo

    @property
    def level(self) -> int:
        return self.method.level

    def pieces(self, domain: Domain) -> Sequence[Piece]:
        return self.cut

    def start(self, piece: Piece, sensed: Values) -> Values:
        return self._solver(piece).start(self.problem.equations.start(sensed))

    def shows(self, piece: Piece, state: Values, step: int) -> Values:
        return self._solver(piece).shows(state, step)

    def step(self, piece: Piece, state: Values, around: Values, step: int) -> Values:
        with np.errstate(all="ignore"):  # who runs a job looks whether it is finite
            return self._solver(piece).step(state, around, step)

    def work(self, piece: Piece) -> float:
        return self._solver(piece).work

    def time(self, step: int) -> float:
        """The time (s) that the field has reached after so many steps of a piece."""
        return step // self.method.exchanges * self.problem.dt

    def answer(self, piece: Piece, state: Values) -> Values:
        return np.asarray(self._solver(piece).fields(state)[:, 0])

    def _solver(self, piece: Piece) -> Solver:
        """The solver of a piece; one that the domain is not cut into gets its own."""
        if piece is self.cut[piece.number]:
            return self.solvers[piece.number]
        return self.method.solvers(self.problem, [Patch.of(piece, self.number)])[0]
