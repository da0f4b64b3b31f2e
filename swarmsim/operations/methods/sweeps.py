"""Implicit methods: each step in time solves a system by sweeps over the pieces, with an exchange of halos for each."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Annotated, Final, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Values
from swarmsim.operations.methods.problem import Cells, Patch, Problem
from swarmsim.operations.methods.rates import bound
from swarmsim.operations.methods.seam import Solver

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Inner = Literal["exact", "diagonal"]

_SECOND: Final = "method: sweeps step equations of first order in time; expected explicit for waves"


class Sweeps(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Euler's implicit method, of first order in time, stable for steps of any length: (1 - dt L) u' = u + dt gain.

    The reaction is taken at the old time, so that the system is linear (Ascher, Ruuth and Wetton 1995). Sweeps start
    from the old fields, and there are as many as `sweeps` says: nobody has to know how good the answer is to go on.
    """

    sweeps: Annotated[int, Meta(ge=1, le=10**6)] = 20  # a step in time, each with an exchange

    @property
    def exchanges(self) -> int:
        return self.sweeps

    @property
    def level(self) -> int:
        return self.sweeps

    @property
    @abstractmethod
    def halo(self) -> int: ...

    def fits(self, problem: Problem) -> None:
        """Raise InputError for equations of second order, and for steps that the reaction does not bear."""
        if problem.equations.order != 1:
            raise InputError(_SECOND)
        if problem.equations.reacting:
            problem.check_step(1.0 / problem.equations.reacting, "explicit reactions in implicit", "")


class BlockJacobi(Sweeps, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Block Jacobi: each piece solves its own cells exactly, with the last values of its halo (Varga 1962).

    The error falls by rho a sweep, the spectral radius of 1 - P^-1 (1 - dt L), where P has the pieces' own blocks. One
    piece alone is solved in one sweep. With `inner = "diagonal"`, each cell is solved by itself (Jacobi 1845): slower,
    without a factorisation to keep, and the result does not depend on the pieces, to the bit.
    """

    inner: Inner = "exact"

    @property
    def halo(self) -> int:
        return 1

    def solvers(self, problem: Problem, patches: Sequence[Patch]) -> Sequence[Solver]:
        """Raises InputError for equations of second order in time."""
        self.fits(problem)
        return [_Sweeping(problem, patch, self.sweeps, inner=self.inner) for patch in patches]


class Chebyshev(Sweeps, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Chebyshev's acceleration of block Jacobi: two terms, and no sum over the network (Golub and Varga 1961).

    u_(k+1) = w (G u_k + f - u_(k-1)) + u_(k-1) with w = 1, 2 / (2 - rho^2), then 1 / (1 - rho^2 w / 4). The error falls
    by rho / (1 + sqrt(1 - rho^2)) a sweep in the end. Left out, `rho` is bounded from above by the quotients of
    Collatz and Wielandt (Varga 1962), from the floor plan alone. For symmetric models: not with a draught.
    """

    inner: Inner = "exact"
    rho: Annotated[float, Meta(ge=0.0, lt=1.0)] | None = None  # of block Jacobi; default: a bound

    @property
    def halo(self) -> int:
        return 1

    def solvers(self, problem: Problem, patches: Sequence[Patch]) -> Sequence[Solver]:
        """Raises InputError for equations of second order in time, and for a draught."""
        self.fits(problem)
        if any(abs(one - one.T).max() > 1e-9 * abs(one).max() for one in problem.equations.operators):
            raise InputError(
                "method: chebyshev needs a symmetric model, whose eigenvalues are real, and a draught makes it "
                "unsymmetric; expected block-jacobi or schwarz"
            )
        plain = [_Sweeping(problem, patch, self.sweeps, inner=self.inner) for patch in patches]
        rho = self.rho
        if rho is None:
            rho = bound(problem, patches, [one.swept for one in plain], self.inner == "diagonal")
        weights = relaxations(rho, self.sweeps)
        return [_Sweeping(problem, patch, self.sweeps, inner=self.inner, weights=weights) for patch in patches]


class Schwarz(Sweeps, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Restricted additive Schwarz: a piece solves more cells than its own, and keeps its own (Cai and Sarkis 1999).

    `overlap` is how many cells more, across faces. Each piece must hear one cell beyond, of whichever piece that cell
    is: a narrow piece is crossed, and what lies behind it heard as well.
    """

    overlap: Annotated[int, Meta(ge=0, le=100)] = 1  # cells

    @property
    def halo(self) -> int:
        return self.overlap + 1

    def solvers(self, problem: Problem, patches: Sequence[Patch]) -> Sequence[Solver]:
        """Raises InputError for equations of second order in time, and for halos narrower than the overlap needs."""
        self.fits(problem)
        return [_Sweeping(problem, patch, self.sweeps, overlap=self.overlap) for patch in patches]


class ConjugateGradients(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Refused: conjugate gradients need two sums over all pieces in each iteration, and pieces hear their halos alone.

    A sum by gossip is wrong where messages are lost, and one along a tree waits for every robot. `chebyshev` needs as
    many iterations, and no sum.
    """

    @property
    def halo(self) -> int:
        return 1

    @property
    def exchanges(self) -> int:
        return 1

    @property
    def level(self) -> int:
        return 1

    def solvers(self, problem: Problem, patches: Sequence[Patch]) -> Sequence[Solver]:
        """Raises InputError."""
        raise InputError(
            "method: conjugate-gradients needs 2 sums over all pieces in each iteration, and pieces hear their halos "
            "alone; expected chebyshev, which takes about as many iterations without any sum"
        )


def relaxations(rho: float, sweeps: int) -> NDArray[np.float64]:
    """Chebyshev's weights (sweeps,) of block Jacobi's iterates, for its spectral radius."""
    found = [1.0, 2.0 / (2.0 - rho**2)]
    while len(found) < sweeps:
        found.append(1.0 / (1.0 - 0.25 * rho**2 * found[-1]))
    return np.array(found[:sweeps])


class _Sweeping:
    """Sweeps on one piece. A state (2, e, k) has the right side and the iterate of the cells that it solves.

    These e cells are its own and the overlap. Chebyshev's (3, e, k) has the iterate before as well. Between steps in
    time, a state (1, c, k) has the fields of its own cells alone.
    """

    def __init__(
        self,
        problem: Problem,
        patch: Patch,
        sweeps: int,
        *,
        overlap: int = 0,
        inner: Inner = "exact",
        weights: NDArray[np.float64] | None = None,
    ) -> None:
        self._problem, self._patch, self._sweeps, self._weights = problem, patch, sweeps, weights
        operators = problem.equations.operators
        self._solved = _grown(patch, operators[0], overlap)
        self._among = np.searchsorted(patch.seen, self._solved)  # where the cells solved are among those seen
        self._mine = np.searchsorted(self._solved, patch.own)
        self._inverse, self._coupling = [], []
        self.work = 6.0 * len(self._solved) * len(operators)
        for operator in operators:
            rows = (problem.dt * patch.rows(operator, self._solved)).tocsr()
            solve, coupling, work = _split(rows, self._among, inner)
            self._inverse.append(solve)
            self._coupling.append(coupling)
            self.work += work

    def start(self, fields: Values) -> Values:
        return fields[None]

    def shows(self, state: Values, step: int) -> Values:
        return self.fields(state)[self._patch.rim]

    def fields(self, state: Values) -> Values:
        return np.asarray(state[0] if len(state) == 1 else state[1, self._mine])

    def swept(self, right: Values, seen: Values) -> Values:
        """The solution (e, k) for a right side (e, k) and the values (s, k) of all cells seen."""
        every = zip(self._inverse, self._coupling, strict=True)
        return np.stack([solve(right[:, f] + more @ seen[:, f]) for f, (solve, more) in enumerate(every)], axis=1)

    def step(self, state: Values, around: Values, step: int) -> Values:
        level, sweep = divmod(step, self._sweeps)
        seen, dt = self._patch.joined(self.fields(state), around), self._problem.dt
        if sweep == 0:
            now = before = seen[self._among]
            right = now + dt * self._problem.gain(now, self._solved, level * dt, (level + 1) * dt)
        else:
            right, now, before = state[0], state[1], state[-1]
        after = self.swept(right, seen)
        if self._weights is not None:
            after = self._weights[sweep] * (after - before) + before
        if sweep == self._sweeps - 1:
            return self.start(after[self._mine])
        return np.stack([right, after] if self._weights is None else [right, after, now])


def _grown(patch: Patch, operator: sparse.csr_array, overlap: int) -> Cells:
    """A piece's own cells, and those up to `overlap` faces away, in rising order."""
    found = patch.own
    for _ in range(overlap):
        found = np.union1d(found, operator[found].indices)
    return found.astype(np.int64)


def _split(rows: sparse.csr_array, among: Cells, inner: Inner) -> tuple[Solve, sparse.csr_array, float]:
    """How to solve (1 - rows) for the cells solved, what others add to the right side, and the work of both.

    `rows` (e, s) is dt L; `among` tells which of the columns are those of the cells solved.
    """
    count = len(among)
    if inner == "diagonal":
        diagonal = rows[np.arange(count), among]
        own = sparse.coo_array((diagonal, (np.arange(count), among)), rows.shape).tocsr()
        coupling = (rows - own).tocsr()
        coupling.eliminate_zeros()
        return _Divided(1.0 - diagonal), coupling, 2.0 * coupling.nnz + count
    factors = linalg.splu((sparse.eye_array(count) - rows[:, among]).tocsc())
    rest = np.ones(rows.shape[1])
    rest[among] = 0.0
    coupling = (rows @ sparse.diags_array(rest)).tocsr()
    coupling.eliminate_zeros()
    return factors.solve, coupling, 2.0 * (factors.L.nnz + factors.U.nnz + coupling.nnz)


class _Divided:
    """Solves a diagonal system."""

    def __init__(self, diagonal: NDArray[np.float64]) -> None:
        self._diagonal = diagonal

    def __call__(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(right / self._diagonal)
