"""python benchmarks/computing/beside_fipy.py ours|fipy FILE.npz: four models on a floor with walls, and FiPy's answers.

FiPy (Guyer, Wheeler and Warren, Comput. Sci. Eng. 11, 2009) has its own mesh, matrices and solver. It
is none of the project's packages: with `ours`, the project's Python writes its answers to FILE.npz; then with `fipy`, a
Python of another environment that has FiPy computes the same, and prints how far they are apart.

The floor has two rooms with a door between, a pillar and a bay, in cells of 0.15 m. Both take the same steps in time.
"""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np

CELL, DT, TIMES = 0.15, 0.5, 40
D, K, V, G, FLOW = 0.05, 0.02, 0.5, 0.1, 0.03  # m^2/s, 1/s, m/s, 1/s, m^2/s
ACTIVATOR, SUBSTRATE, FEED, KILL = 0.00225, 0.0045, 0.04, 0.06
INLET, OUTLET, SOURCE, STRENGTH = (0.375, 0.525), (3.675, 2.175), (1.275, 1.275), 0.4
FREE = np.ones((18, 26), bool)
for _low, _left, _high, _right in ((0, 12, 7, 13), (10, 12, 18, 13), (5, 4, 8, 7), (0, 20, 3, 26)):
    FREE[_low:_high, _left:_right] = False
PLACES = CELL * (np.argwhere(FREE)[:, ::-1] + 0.5)  # (n, 2): x, y
BELL = np.exp(-((PLACES - (0.9, 1.8)) ** 2).sum(axis=1) / 0.1)


def ours() -> dict[str, np.ndarray]:
    """The fields (n,) after TIMES steps, in six pieces."""
    from swarmsim.core.jobs import Domain
    from swarmsim.core.lattice import Lattice
    from swarmsim.jobs.alone import alone
    from swarmsim.operations.methods.explicit import Explicit
    from swarmsim.operations.methods.problem import Problem
    from swarmsim.operations.methods.sweeps import BlockJacobi, Chebyshev, Schwarz
    from swarmsim.operations.models.advection import AdvectionDiffusion, Vents
    from swarmsim.operations.models.diffusion import Diffusion
    from swarmsim.operations.models.emitters import Emission, Emitter
    from swarmsim.operations.models.faces import Faces
    from swarmsim.operations.models.job import ModelJob
    from swarmsim.operations.models.reaction import GrayScott
    from swarmsim.operations.models.wave import Wave

    domain = Domain(Lattice(0.0, 0.0, CELL, *FREE.shape), FREE)
    faces, vents = Faces.of(domain), Vents(inlet=INLET, outlet=OUTLET, flow=FLOW)
    source = Emitter(x=SOURCE[0], y=SOURCE[1], strength=STRENGTH)
    cases: dict[str, tuple[Any, Any, float, list[Any]]] = {
        "diffusion": (Diffusion(diffusivity=D, decay=K, walls="fixed", value=0.4), Chebyshev(sweeps=60), DT, []),
        "advection-diffusion": (
            AdvectionDiffusion(diffusivity=D, decay=K, vents=vents), Schwarz(sweeps=60, overlap=2), DT, [source]
        ),
        "wave": (Wave(speed=V, damping=G), Explicit(level=1), 0.1, []),
        "gray-scott": (
            GrayScott(activator=ACTIVATOR, substrate=SUBSTRATE, feed=FEED, kill=KILL), BlockJacobi(sweeps=60), DT, []
        ),
    }  # fmt: skip
    found = {}
    for name, (model, method, dt, sources) in cases.items():
        problem = Problem(model.on(domain), Emission(sources, faces), dt)
        job = ModelJob.of(problem, method, domain, 6, TIMES * method.exchanges)
        own = [faces.number[tuple(piece.cells.T)] for piece in job.cut]
        found[name] = np.empty(len(BELL))
        states = alone(job, job.cut, [BELL[cells] for cells in own])
        for piece, cells, state in zip(job.cut, own, states, strict=True):
            found[name][cells] = job.answer(piece, state)
    return found


def mesh() -> Any:
    """FiPy's mesh of the free cells: the faces without a cell beyond are its outer ones."""
    from fipy.meshes.mesh2D import Mesh2D

    cells = np.argwhere(FREE)
    corners = {tuple(one) for row, column in cells for one in _corners(row, column)}
    numbers = {one: place for place, one in enumerate(sorted(corners))}
    edges: dict[tuple[int, int], int] = {}
    of_cells = []
    for row, column in cells:
        around = [numbers[one] for one in _corners(row, column)]
        ends = zip(around, [*around[1:], around[0]], strict=True)
        of_cells.append([edges.setdefault((min(pair), max(pair)), len(edges)) for pair in ends])
    places = CELL * np.array(sorted(corners), float)[:, ::-1].T
    return Mesh2D(places, np.array(list(edges)).T, np.array(of_cells).T)


def _corners(row: int, column: int) -> list[tuple[int, int]]:
    return [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]


def fipys() -> dict[str, np.ndarray]:
    """The same by FiPy."""
    os.environ["FIPY_SOLVERS"] = "scipy"
    import fipy

    floor, solver = mesh(), fipy.LinearLUSolver(tolerance=1e-14)
    place = {"inlet": INLET, "outlet": OUTLET, "source": SOURCE}
    at = {
        name: (np.abs(floor.cellCenters.value.T - one).max(axis=1) < 0.5 * CELL) / CELL**2
        for name, one in place.items()
    }

    def variable(values: np.ndarray) -> Any:
        return fipy.CellVariable(mesh=floor, value=values, hasOld=True)

    def stepped(equation: Any, var: Any, before: Any = lambda: None) -> np.ndarray:
        for _ in range(TIMES):
            before()
            var.updateOld()
            equation.solve(var=var, dt=DT, solver=solver)
        return np.array(var.value)

    found, smell, carried = {}, variable(BELL), variable(BELL)
    smell.constrain(0.4, floor.exteriorFaces)
    spreads = fipy.TransientTerm() == fipy.DiffusionTerm(D) - fipy.ImplicitSourceTerm(K)
    found["diffusion"] = stepped(spreads, smell)

    potential = variable(np.zeros(len(BELL)))  # of the draught; that of one cell is at will
    pin = fipy.CellVariable(mesh=floor, value=np.arange(len(BELL)) == 0)
    gains = fipy.CellVariable(mesh=floor, value=FLOW * (at["inlet"] - at["outlet"]))
    (fipy.DiffusionTerm(1.0) + gains - fipy.ImplicitSourceTerm(pin * 1.0) == 0.0).solve(var=potential, solver=solver)
    air = -potential.faceGrad
    out = fipy.CellVariable(mesh=floor, value=FLOW * at["outlet"])
    given = fipy.CellVariable(mesh=floor, value=STRENGTH * at["source"])
    drifts = fipy.TransientTerm() == (
        fipy.DiffusionTerm(D) - fipy.UpwindConvectionTerm(air) - fipy.ImplicitSourceTerm(out + K) + given
    )
    found["advection-diffusion"] = stepped(drifts, carried)

    dt, now = 0.1, variable(BELL)
    before = BELL
    for step in range(TIMES):
        force = dt**2 * V**2 * np.array(now.faceGrad.divergence.value)
        after = (2.0 * now.value - (1.0 - 0.5 * G * dt) * before + force) / (1.0 + 0.5 * G * dt)
        before, after = np.array(now.value), after if step else now.value + 0.5 * force
        now.setValue(after)
    found["wave"] = np.array(now.value)

    v, u = variable(BELL), variable(1.0 - BELL)
    for _ in range(TIMES):
        eaten = fipy.CellVariable(mesh=floor, value=u.value * v.value**2)
        old_v, old_u = (fipy.CellVariable(mesh=floor, value=one.value.copy()) for one in (v, u))
        for var, diffusivity, reaction in (
            (v, ACTIVATOR, eaten - (FEED + KILL) * old_v), (u, SUBSTRATE, FEED * (1.0 - old_u) - eaten)
        ):  # fmt: skip
            var.updateOld()
            (fipy.TransientTerm() == fipy.DiffusionTerm(diffusivity) + reaction).solve(var=var, dt=DT, solver=solver)
    found["gray-scott"] = np.array(v.value)
    return found


if __name__ == "__main__":
    side, path = sys.argv[1:]
    if side == "ours":
        np.savez(path, **ours())
    else:
        told = np.load(path)
        for name, values in fipys().items():
            apart = np.abs(values - told[name]).max()
            print(f"{name}: apart by {apart:.1e} of {np.ptp(values):.3g}")
