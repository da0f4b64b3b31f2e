"""python benchmarks/sweeps.py [SCENARIO]: how many sweeps each implicit method needs, on a floor in 20 pieces.

One implicit step in time of diffusion from random fields, until the largest error is 1e-8, for three ratios
r = D dt / h^2; and the spectral radius of a sweep, by which the error of the slowest mode falls.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.sparse import linalg

from swarmsim.core.jobs import Values
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build
from swarmsim.jobs.pieces import given, joined, joints
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.methods.sweeps import BlockJacobi, Chebyshev, Schwarz
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob

MOST = 3000
METHODS = {
    "block-jacobi": lambda: BlockJacobi(sweeps=MOST),
    "chebyshev": lambda: Chebyshev(sweeps=MOST),
    "chebyshev, inner diagonal": lambda: Chebyshev(sweeps=MOST, inner="diagonal"),
    "schwarz, overlap 1": lambda: Schwarz(sweeps=MOST, overlap=1),
    "schwarz, overlap 2": lambda: Schwarz(sweeps=MOST, overlap=2),
}


def swept(job: ModelJob) -> Callable[[list[Values], int], list[Values]]:
    """The states of all pieces after one more step."""
    its = joints(job.cut)

    def step(states: list[Values], at: int) -> list[Values]:
        shown = [job.shows(piece, state, at) for piece, state in zip(job.cut, states, strict=True)]
        return [
            job.step(piece, state, joined(piece, mine, [shown[one.piece] for one in mine]), at)
            for piece, state, mine in zip(job.cut, states, its, strict=True)
        ]

    return step


def radius(job: ModelJob, own: list[np.ndarray], count: int) -> float:
    """The spectral radius of a sweep, by Arnoldi's method."""
    step = swept(job)

    def sweep(values: np.ndarray) -> np.ndarray:
        found = np.empty(count)
        states = [solver.start(values.ravel()[cells][:, None]) for solver, cells in zip(job.solvers, own, strict=True)]
        for cells, piece, state in zip(own, job.cut, step(states, 1), strict=True):
            found[cells] = job.answer(piece, state)
        return found

    operator = linalg.LinearOperator((count, count), sweep, dtype=float)
    return float(abs(linalg.eigs(operator, 1, v0=np.ones(count), tol=1e-6, return_eigenvectors=False)[0]))


def needed(job: ModelJob, own: list[np.ndarray], start: Values, exact: Values) -> int | None:
    """How many sweeps it takes; None for more than MOST."""
    step = swept(job)
    states = [job.start(piece, start[cells]) for piece, cells in zip(job.cut, own, strict=True)]
    for at in range(MOST - 1):
        states = step(states, at)
        if all(
            np.abs(job.answer(piece, state) - exact[cells]).max() < 1e-8
            for piece, state, cells in zip(job.cut, states, own, strict=True)
        ):
            return at + 1
    return None


def main() -> None:
    path = Path(sys.argv[1] if len(sys.argv) > 1 else "scenarios/basilica.toml")
    domain = given(build(load(path), str(path)).context)
    number, cell = Faces.of(domain).number, domain.lattice.cell
    count = int(domain.free.sum())
    start = np.random.default_rng(0).random(count)
    print(f"{count} free cells in 20 pieces")
    for r in (2.5, 25.0, 250.0):
        problem = Problem(Diffusion().on(domain), lambda cells, begin, end: np.zeros(len(cells)), r * cell**2 / 0.05)
        system = problem.dt * -problem.equations.operators[0].tocsc()
        system.setdiag(system.diagonal() + 1.0)
        exact = linalg.spsolve(system.tocsc(), start)
        for name, method in METHODS.items():
            job = ModelJob.of(problem, method(), domain, 20, MOST)
            own = [number[tuple(piece.cells.T)] for piece in job.cut]
            rho = radius(job, own, count) if "chebyshev" not in name else float("nan")
            sweeps = needed(job, own, start, exact)
            told = "" if "chebyshev" in name else f", rho {rho:.4f}"
            print(f"r = {r:g}, {name}: {sweeps} sweeps{told}", flush=True)


if __name__ == "__main__":
    main()
