"""python benchmarks/computing/rates.py [METHOD]: how fast a solve converges on six networks, beside theory.

20 robots map the basilica and solve one implicit step in time of diffusion with a clock: in each exchange a sweep, with
the newest halos there are. The error at the start is the slowest mode, and rho its factor a sweep, by Arnoldi's method.
A row tells after how many iterations the error was 1e-8 of that, and how many it takes in theory: (1 + age) ln 1e-8 /
ln rho by the mean age of all halos; and ln 1e-8 / ln f by the mean age of each one, where f is the spectral radius of
the sweep in which a value of this age counts f^-age.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta
from scipy import optimize, sparse
from scipy.sparse import linalg

from swarmsim.core.context import BuildContext
from swarmsim.core.jobs import Piece, Shared, Values
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.part import Part
from swarmsim.engine.build import build
from swarmsim.jobs.pieces import given
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.methods.seam import Scheme
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob

SCENARIO = Path("scenarios/basilica.toml")
MODEL, R, TOLERANCE = Diffusion(diffusivity=0.05, decay=0.01), 2.5, 1e-8  # R = D dt / h^2
LOSS, LATE = '{use = "bernoulli", loss = 0.3}', '{use = "latency", delay = 5}'
BOTH = f'{{use = "latency", delay = 2, law = "geometric", over = {LOSS}}}'
NETWORKS = {
    "everybody": ("full", '{use = "perfect"}'),
    "everybody, delay 5": ("full", LATE),
    "delaunay": ("delaunay", '{use = "perfect"}'),
    "delaunay, 30 % lost": ("delaunay", LOSS),
    "delaunay, 30 % lost, geometric delay 2": ("delaunay", BOTH),
    "delaunay, delay 5": ("delaunay", LATE),
}  # fmt: skip


class Slowest(Shared, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One implicit step in time, from an error that is the slowest mode of a method."""

    method: Part[Scheme]
    pieces: Annotated[int, Meta(ge=1, le=1000)] = 20

    def build(self, context: BuildContext) -> Mode:
        domain, method = given(context), self.method.build(context, "method")
        problem = Problem(
            MODEL.on(domain), lambda cells, begin, end: np.zeros(len(cells)), R * domain.lattice.cell**2 / 0.05
        )
        return Mode(ModelJob.of(problem, method, domain, self.pieces, method.exchanges), Faces.of(domain).number)


class Mode:
    """A job whose error at the start is its slowest mode, whatever robots sense; and the ages of what its steps read.

    Pieces show their step beside each value, so that who reads it knows its age.
    """

    def __init__(self, job: ModelJob, number: np.ndarray) -> None:
        self._job = job
        self.own = [number[tuple(piece.cells.T)] for piece in job.cut]
        self._halos = [number[tuple(piece.halo.T)] for piece in job.cut]
        self._ages, self._reads = [np.zeros(len(halo)) for halo in self._halos], 0
        self._columns = [self._read(piece) for piece in job.cut]
        self.rho, mode = self.slowest([np.ones(len(halo)) for halo in self._halos])
        self.mode = mode / np.abs(mode).max()
        change = -job.problem.dt * job.problem.equations.operators[0]
        self.exact = linalg.spsolve(change.tocsc(), self.mode)  # (1 + change) exact = exact + mode

    def _read(self, piece: Piece) -> Values:
        """What a sweep makes of a 1 in each cell of the halo: (c, h), by the job's own step with the right side 0."""
        nothing = self._job.start(piece, np.zeros(len(piece.cells)))
        nothing = self._job.step(piece, nothing, np.zeros((len(piece.halo), 1)), 0)
        its = [self._job.step(piece, nothing, one[:, None], 1) for one in np.eye(len(piece.halo))]
        return np.stack([self._job.answer(piece, state) for state in its], axis=1)

    def slowest(self, factors: list[Values]) -> tuple[float, Values]:
        """The spectral radius of a sweep in which each value of a halo counts so much (h,), and its mode (Arnoldi)."""
        count = sum(map(len, self.own))
        rows = np.concatenate([np.repeat(own, len(by)) for own, by in zip(self.own, factors, strict=True)])
        columns = np.concatenate([np.tile(halo, len(own)) for own, halo in zip(self.own, self._halos, strict=True)])
        values = np.concatenate([(its * by).ravel() for its, by in zip(self._columns, factors, strict=True)])
        entries = values, (rows, columns)
        sweep = sparse.coo_array(entries, (count, count)).tocsr()  # without negative entries, so its radius is real
        found, modes = linalg.eigs(sweep, 1, which="LR", v0=np.ones(count), tol=1e-9)
        return float(found[0].real), modes[:, 0].real

    def rate(self) -> float:
        """The factor f of the error in an exchange, if each value has always its mean age: it counts f^-age then."""
        ages = [age / (self._reads / len(self.own)) for age in self._ages]
        return float(
            optimize.brentq(lambda f: self.slowest([f**-one for one in ages])[0] - f, self.rho, 1.0, xtol=1e-6)
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self._job, name)

    def start(self, piece: Piece, sensed: Values) -> Values:
        return self._job.start(piece, (self.exact + self.mode)[self.own[piece.number]])

    def shows(self, piece: Piece, state: Values, step: int) -> Values:
        return np.column_stack([self._job.shows(piece, state, step), np.full(len(piece.rim), float(step))])

    def step(self, piece: Piece, state: Values, around: Values, step: int) -> Values:
        self._ages[piece.number] += np.maximum(step - around[:, 1], 0.0)
        self._reads += 1
        return self._job.step(piece, state, around[:, :1], step)

    def error(self, robots: Any) -> float:
        """The largest of all pieces."""
        return max(
            float(np.abs(self._job.answer(self._job.cut[piece], state) - self.exact[self.own[piece]]).max())
            for pieces in robots for piece, (_, state) in pieces.items()
        )  # fmt: skip


def row(name: str, method: str) -> str:
    """What happened on a network, and what theory gives."""
    topology, channel = NETWORKS[name]
    job = f'jobs=[{{use = "{Path(__file__).resolve()}:Slowest", fence = "clock", method = {method}}}]'
    network = (f'network.topology={{use = "{topology}"}}', f"network.channel={channel}")
    with registry.own_code(True):
        simulation = build(load(SCENARIO, (job, *network, "robots.count=20")), str(SCENARIO)).simulation
    errors = list[float]()
    while not errors or TOLERANCE < errors[-1] < 1e3:
        known = simulation.tick().jobs[0].knowledge
        errors.append(known.plan.job.error(known.states))
        if len(errors) == known.plan.steps:
            break
    job, done = known.plan.job, len(errors)
    age, sought = known.counts[:, 1].sum() / known.counts[:, 0].sum(), np.log(errors[-1])
    mean, each = (1.0 + age) * sought / np.log(job.rho), sought / np.log(job.rate())
    return (
        f"{name}: rho {job.rho:.4f}, error {errors[-1]:.1e} after {done}, mean age {age:.2f}, ln(rate) / ln(rho) "
        f"{sought / done / np.log(job.rho):.3f}; by the mean age {mean:.0f} ({done / mean - 1.0:+.0%}), by the ages of "
        f"each {each:.0f} ({done / each - 1.0:+.0%})"
    )


if __name__ == "__main__":
    method = sys.argv[1] if len(sys.argv) > 1 else '{use = "block-jacobi", sweeps = 800}'
    for name in NETWORKS:
        print(row(name, method), flush=True)
