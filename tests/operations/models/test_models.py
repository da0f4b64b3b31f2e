"""Models on floors: matrices put together in another way, balances, limits, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from floors import floor, laplacian, nothing, places, rooms, solved
from scipy.integrate import solve_ivp

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.operations.methods.explicit import Explicit
from swarmsim.operations.methods.problem import Problem
from swarmsim.operations.methods.sweeps import BlockJacobi, Chebyshev, ConjugateGradients, Schwarz
from swarmsim.operations.models.advection import AdvectionDiffusion, Vents
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.draught import between_vents, through
from swarmsim.operations.models.emitters import Emission, Emitter
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob, steps_of
from swarmsim.operations.models.reaction import GrayScott
from swarmsim.operations.models.wave import Wave

FLOOR = rooms()
FACES = Faces.of(FLOOR)
AREA = FLOOR.lattice.cell**2
START = np.random.default_rng(4).random(FACES.count)
VENTS = Vents(inlet=(0.4, 0.5), outlet=(3.6, 2.2), flow=0.03)
ISLAND = floor(14, 18, pillars=((5, 7, 9, 11),))  # open water around it


@pytest.mark.parametrize("fixed", [None, 0.7])
def test_the_operator_is_that_of_the_cells(fixed) -> None:
    matrix, right = laplacian(FLOOR, fixed)
    model = Diffusion(diffusivity=0.3, decay=0.2, walls="no-flux" if fixed is None else "fixed", value=fixed).on(FLOOR)
    assert abs(model.operators[0] - 0.3 * matrix + 0.2 * np.eye(FACES.count)).max() < 1e-12
    np.testing.assert_allclose(model.inflow[:, 0], 0.3 * right, atol=1e-12)


def test_a_solution_is_that_of_an_independent_solver() -> None:
    """Of eighth order and adaptive, over the matrix put together cell by cell; the method's own error is below 1 %."""
    matrix, right = laplacian(FLOOR, 0.4)
    exact = solve_ivp(lambda _, u: 0.05 * (matrix @ u + right) - 0.03 * u, (0.0, 2.0), START, "DOP853", rtol=1e-9)
    model = Diffusion(decay=0.03, walls="fixed", value=0.4)
    for method, dt in ((Explicit(), 0.01), (BlockJacobi(sweeps=9), 0.02), (Chebyshev(sweeps=7), 0.02)):
        found = solved(model, method, FLOOR, START, dt, round(2.0 / dt), 4)
        assert np.abs(found - exact.y[:, -1]).max() < 0.01 * np.ptp(exact.y[:, -1])


def test_a_draught_with_a_source_is_that_of_an_independent_solver() -> None:
    """The draught and what it carries from matrices of all cells by all, and a source in one of them."""
    matrix, _ = laplacian(FLOOR)
    beside, gains = matrix.toarray() * AREA, np.zeros(FACES.count)
    start, end, at = FACES.number[tuple(FLOOR.lattice.cells(np.array([VENTS.inlet, VENTS.outlet, (1.3, 1.3)])).T)]
    gains[[start, end]] = VENTS.flow, -VENTS.flow
    potential = np.linalg.lstsq(-beside, gains)[0]
    ahead = np.maximum(potential[:, None] - potential, 0.0) * (beside > 0.5)  # from row to column, m^2/s
    carried = (ahead.T - np.diag(ahead.sum(axis=1) - np.minimum(gains, 0.0))) / AREA
    source = np.eye(FACES.count)[at] * 0.4 / AREA
    exact = solve_ivp(
        lambda _, u: 0.05 * (matrix @ u) + carried @ u - 0.03 * u + source, (0.0, 1.0), START, "DOP853", rtol=1e-9
    )
    model = AdvectionDiffusion(decay=0.03, vents=VENTS)
    emission = Emission([Emitter(x=1.3, y=1.3, strength=0.4)], FACES)
    for method, dt in ((Explicit(), 0.01), (BlockJacobi(sweeps=9), 0.01), (Schwarz(sweeps=6, overlap=2), 0.01)):
        found = solved(model, method, FLOOR, START, dt, round(1.0 / dt), 4, emission)
        assert np.abs(found - exact.y[:, -1]).max() < 0.01 * np.ptp(exact.y[:, -1])


def test_a_pair_on_a_floor_is_that_of_an_independent_solver() -> None:
    matrix, _ = laplacian(FLOOR)

    def rates(_, state):
        v, u = np.split(state, 2)
        eaten = u * v * v
        return np.concatenate(
            [0.00225 * (matrix @ v) + eaten - 0.1 * v, 0.0045 * (matrix @ u) - eaten + 0.04 * (1.0 - u)]
        )

    exact = solve_ivp(rates, (0.0, 4.0), np.concatenate([START, 1.0 - START]), "DOP853", rtol=1e-9)
    v = exact.y[: len(START), -1]
    for method, dt in ((Explicit(), 0.02), (BlockJacobi(sweeps=6), 0.02)):
        assert np.abs(solved(GrayScott(), method, FLOOR, START, dt, round(4.0 / dt), 4) - v).max() < 0.01 * np.ptp(v)


def test_waves_are_those_of_an_independent_solver() -> None:
    matrix, _ = laplacian(FLOOR)
    bell = np.exp(-((places(FLOOR) - (0.9, 1.8)) ** 2).sum(axis=1) / 0.1)

    def rates(_, state):
        u, speed = np.split(state, 2)
        return np.concatenate([speed, 0.25 * (matrix @ u) - 0.1 * speed])

    exact = solve_ivp(rates, (0.0, 3.0), np.concatenate([bell, 0.0 * bell]), "DOP853", rtol=1e-9, atol=1e-9)
    found = solved(Wave(speed=0.5, damping=0.1), Explicit(), FLOOR, bell, 0.01, 300, 4)
    assert np.abs(found - exact.y[: len(bell), -1]).max() < 1e-3


def test_an_open_wall_lets_a_wave_leave() -> None:
    """A ring from the middle of a basin, beside the one in a basin so large that nothing has come back yet."""
    late = []
    for cells, walls in ((60, "no-flux"), (20, "open"), (20, "no-flux")):
        domain = floor(cells, cells)
        bell = np.exp(-((places(domain) - 0.075 * cells) ** 2).sum(axis=1) / 0.2)
        found = solved(Wave(walls=walls), Explicit(), domain, bell, 0.1, 35).reshape(cells, cells)
        late.append(found[cells // 2 - 10 : cells // 2 + 10, cells // 2 - 10 : cells // 2 + 10])
    wrong = [np.abs(one - late[0]).max() for one in late[1:]]
    assert wrong[0] < 0.2 * wrong[1], wrong


@pytest.mark.parametrize(
    ("method", "dt", "times"),
    [
        (Explicit(), 0.1, 200), (BlockJacobi(sweeps=40), 0.5, 20), (Chebyshev(sweeps=20), 0.5, 20),
        (Schwarz(sweeps=14, overlap=2), 0.5, 20),
    ],
)  # fmt: skip
def test_no_mass_is_lost_at_walls(method, dt, times) -> None:
    found = solved(Diffusion(), method, FLOOR, START, dt, times, 6)
    assert found.sum() == pytest.approx(START.sum(), rel=1e-12)
    assert np.ptp(found) < 0.5 * np.ptp(START)


def test_sources_give_off_what_they_say() -> None:
    """One that starts and stops between steps, one that moves through a door, and one that drives into a wall."""
    emitters = [
        Emitter(x=0.4, y=0.5, strength=2.0, begin=0.33, end=1.21),
        Emitter(x=1.5, y=1.3, strength=-0.5, velocity=(0.2, 0.0)),
        Emitter(x=3.7, y=1.3, strength=1.0, velocity=(0.3, 0.0)),
    ]
    found = solved(Diffusion(), Explicit(), FLOOR, START, 0.1, 20, 3, Emission(emitters, FACES))
    given = AREA * (found - START).sum()
    assert given == pytest.approx(2.0 * (1.21 - 0.33) - 0.5 * 2.0 + (3.9 - 3.7) / 0.3, abs=0.05)
    for some, expected in ((emitters[:2], 1.76 - 1.0),):
        found = solved(Diffusion(), Explicit(), FLOOR, START, 0.1, 20, 3, Emission(some, FACES))
        assert AREA * (found - START).sum() == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("scheme", ["upwind", "central"])
def test_a_draught_between_vents_is_free_of_divergence(scheme) -> None:
    """So that an even field stays as it is, where as much comes in; and all that leaves, leaves through the outlet."""
    model = AdvectionDiffusion(walls="no-flux", vents=VENTS, diffusivity=0.2, scheme=scheme).on(FLOOR)
    air = between_vents(FACES, VENTS.inlet, VENTS.outlet, VENTS.flow)
    even = model.operators[0] @ np.ones(FACES.count) + air.entering / AREA
    assert np.abs(even).max() < 1e-12 * abs(model.operators[0]).max()
    assert np.abs(air.fluxes).max() <= VENTS.flow
    gone = -AREA * (model.operators[0] @ START).sum()
    outlet = FACES.number[tuple(FLOOR.lattice.cells(np.array(VENTS.outlet)))]
    assert gone == pytest.approx(VENTS.flow * START[outlet], rel=1e-9)
    assert np.flatnonzero(air.leaving).tolist() == [outlet]


def test_a_draught_goes_around_islands() -> None:
    faces, velocity = Faces.of(ISLAND), np.array([0.2, 0.0])
    air = through(faces, velocity)
    out = np.zeros(faces.count)
    np.add.at(out, faces.pairs[:, 0], air.fluxes)
    np.add.at(out, faces.pairs[:, 1], -air.fluxes)
    assert np.abs(out + air.leaving - air.entering).max() < 1e-14
    assert air.entering.sum() == pytest.approx(14 * 0.15 * 0.2)
    columns = np.argwhere(ISLAND.free)[faces.pairs[:, 0], 1]
    for column in range(17):  # as much crosses each cut of the basin
        assert air.fluxes[(columns == column) & ~faces.rises].sum() == pytest.approx(14 * 0.15 * 0.2)
    empty = through(Faces.of(floor(9, 9)), np.array([0.1, -0.2]))
    assert np.ptp(empty.fluxes[~Faces.of(floor(9, 9)).rises]) < 1e-14


def test_diffusion_check_step_up_to_a_quarter_and_not_beyond() -> None:
    """A board of chess squares grows beyond, if it is let to."""
    domain = floor(40, 40)
    board = 1.0 - 2.0 * (np.indices((40, 40)).sum(axis=0) % 2).ravel()
    dt = 0.25 * 0.15**2 / 0.05
    assert np.abs(solved(Diffusion(), Explicit(), domain, board, dt, 500)).max() <= 1.0 + 1e-12
    with pytest.raises(InputError, match=re.escape("r = D dt / h^2 is 0.255, and the limit is 0.25 (dt = 0.1125 s)")):
        solved(Diffusion(), Explicit(), domain, board, 1.02 * dt, 1)
    assert np.abs(unguarded(Diffusion(), domain, board, 1.02 * dt, 500)).max() > 1e3


def test_waves_are_stable_up_to_their_limit_and_not_beyond() -> None:
    domain = floor(40, 40)
    board = 1.0 - 2.0 * (np.indices((40, 40)).sum(axis=0) % 2).ravel()
    dt = 0.15 / np.sqrt(2.0)
    assert np.abs(solved(Wave(), Explicit(), domain, board, dt, 500)).max() < 500.0  # a double root may grow evenly
    with pytest.raises(InputError, match=re.escape("(c dt / h)^2 is 0.5202, and the limit is 0.5 (dt = 0.106066 s)")):
        solved(Wave(), Explicit(), domain, board, 1.02 * dt, 1)
    assert np.abs(unguarded(Wave(), domain, board, 1.02 * dt, 500)).max() > 1e9


def unguarded(model, domain: Domain, start: np.ndarray, dt: float, times: int) -> np.ndarray:
    """The field that explicit steps give where nobody looks at their limit: equations that pretend to be slow."""
    equations = model.on(domain)
    slow = replace(equations, operators=tuple(1e-9 * one for one in equations.operators))
    job = ModelJob.of(Problem(slow, nothing, dt), Explicit(), domain, 1, times)
    for solver in job.solvers:
        solver._rows = [1e9 * one for one in solver._rows]
    state = job.start(job.cut[0], start)
    for step in range(times):
        state = job.step(job.cut[0], state, np.empty((0, 0)), step)
    return job.answer(job.cut[0], state)


REFUSED = [
    (Diffusion(walls="fixed"), Explicit(), 0.1, "value: required key is missing; fixed walls need the value"),
    (Diffusion(value=1.0), Explicit(), 0.1, 'value: 1 with walls that nothing passes; expected walls = "fixed"'),
    (Diffusion(walls="open"), Explicit(), 0.1, 'walls: "open" without a draught'),
    (GrayScott(walls="open"), Explicit(), 0.1, 'walls: "open" without a draught'),
    (AdvectionDiffusion(), Explicit(), 0.1, "velocity: a draught needs either a velocity or vents"),
    (AdvectionDiffusion(velocity=(0.1, 0.0)), Explicit(), 0.1, 'velocity: [0.1, 0.0] m/s cannot pass walls = "no-fl'),
    (
        AdvectionDiffusion(velocity=(0.1, 0.0), walls="open", diffusivity=0.001, scheme="central"), Explicit(), 0.01,
        "model.scheme: no explicit step is stable where values may grow, as with central differences and a cell ",
    ),
    (
        AdvectionDiffusion(velocity=(1.0, 0.0), walls="open", diffusivity=1e-6), Explicit(), 0.3,
        "dt: 0.3 s is more than explicit steps bear: what leaves a cell in a step, as a share of its content, is ",
    ),
    (AdvectionDiffusion(velocity=(1.0, 0.0), walls="open"), Chebyshev(), 0.3, "method: chebyshev needs a symmetric"),
    (
        AdvectionDiffusion(vents=Vents(inlet=(0.4, 0.5), outlet=(1.9, 0.3), flow=0.1)), Explicit(), 0.1,
        "vents.outlet: [1.9, 0.3] is not on the floor",
    ),
    (
        AdvectionDiffusion(vents=Vents(inlet=(0.4, 0.5), outlet=(0.4, 0.5), flow=0.1)), Explicit(), 0.1,
        "vents.outlet: [0.4, 0.5] is not connected to another cell, the inlet",
    ),
    (
        AdvectionDiffusion(vents=Vents(inlet=(0.4, 0.5), outlet=(3.6, 2.2), flow=-0.1)), Explicit(), 0.1,
        "vents.flow: -0.1 m^2/s; expected a number over 0",
    ),
    (Wave(), BlockJacobi(), 0.1, "method: sweeps step equations of first order in time; expected explicit for waves"),
    (GrayScott(rate=2.0), BlockJacobi(), 0.6, "dt: 0.6 s is more than explicit reactions in implicit steps bear"),
    (Diffusion(), ConjugateGradients(), 0.1, "method: conjugate-gradients needs 2 sums over all pieces in each"),
]  # fmt: skip


@pytest.mark.parametrize(("model", "method", "dt", "told"), REFUSED)
def test_what_does_not_go_together_is_refused(model, method, dt, told) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        solved(model, method, FLOOR, START, dt, 1)


def test_a_floor_without_cells_is_refused() -> None:
    with pytest.raises(InputError, match="no free cell to compute on"):
        Faces.of(Domain(FLOOR.lattice, np.zeros_like(FLOOR.free)))


@pytest.mark.parametrize(
    ("emitter", "told"),
    [
        (Emitter(x=1.9, y=0.3), r"sources\[0\].x: 1.9 m, 0.3 m is not on the floor"),
        (Emitter(x=0.4, y=0.4, begin=5.0, end=5.0), r"sources\[0\].end: 5 s; expected a time after it begins, 5 s"),
    ],
)
def test_sources_that_cannot_be_are_refused(emitter, told) -> None:
    with pytest.raises(InputError, match=told):
        Emission([emitter], FACES)


def test_a_duration_is_whole_steps_and_whole_levels() -> None:
    assert steps_of(Explicit(level=5), 0.1, 2.0) == 20
    assert steps_of(BlockJacobi(sweeps=7), 0.1, 2.0) == 140
    with pytest.raises(InputError, match=r"duration: 2.05 s are 20.5 steps of dt = 0.1 s; expected a whole number"):
        steps_of(Explicit(), 0.1, 2.05)
    with pytest.raises(InputError, match=r"method.level: 20 steps in 2 s are not a whole number of levels of 8"):
        steps_of(Explicit(level=8), 0.1, 2.0)


def test_inner_walls_stay_closed_where_outer_ones_are_open() -> None:
    faces = Faces.of(ISLAND)
    assert faces.outer.sum() == 2 * (14 + 18)
    assert (~faces.outer).sum() == 2 * (4 + 4)


def test_a_pair_eats_and_lives() -> None:
    """Gray and Scott's spots: from a seed, the activator spreads over the floor and keeps its shares in bounds."""
    domain = floor(40, 40)
    seed = 0.5 * (np.abs(places(domain) - 3.0).max(axis=1) < 0.6)
    found = solved(GrayScott(feed=0.037, kill=0.06), Explicit(), domain, seed, 0.5, 1500, 1)
    assert (found > 0.1).sum() > 3 * (seed > 0.1).sum()
    assert found.min() >= 0.0
    assert found.max() < 1.0
