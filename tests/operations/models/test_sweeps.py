"""Sweeps over pieces: their rates against eigenvalues of their very iteration matrices, and what they converge to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from floors import floor, laplacian, nothing, places, rooms, solved
from scipy import sparse
from scipy.sparse import linalg

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.jobs.alone import alone
from swarmsim.jobs.pieces import joined, joints, pieces_of
from swarmsim.operations.methods.explicit import Explicit
from swarmsim.operations.methods.problem import Patch, Problem
from swarmsim.operations.methods.sweeps import BlockJacobi, Chebyshev, Schwarz, relaxations
from swarmsim.operations.models.advection import AdvectionDiffusion
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import ModelJob
from swarmsim.operations.models.reaction import GrayScott
from swarmsim.operations.models.wave import Wave
from swarmsim.testing.jobs import ROOM, check_job

FLOOR = rooms()
START = np.random.default_rng(3).random(Faces.of(FLOOR).count)
DECAY, DT = 0.01, 1.2


def job_of(method, count=6, dt=DT, domain=FLOOR, decay=DECAY) -> ModelJob:
    problem = Problem(Diffusion(decay=decay).on(domain), nothing, dt)
    return ModelJob.of(problem, method, domain, count, method.exchanges)


def sweep_of(job: ModelJob, domain) -> Callable[[np.ndarray], np.ndarray]:
    """One sweep of a job over any values (n,), with the right side 0: its own steps and its own halos."""
    number, its = Faces.of(domain).number, joints(job.cut)
    own = [number[tuple(piece.cells.T)] for piece in job.cut]

    def sweep(values: np.ndarray) -> np.ndarray:
        states, found = [], np.empty(len(values))
        for solver, cells in zip(job.solvers, own, strict=True):
            states.append(np.zeros((2, len(solver._solved), 1)))
            states[-1][1, solver._mine, 0] = values.ravel()[cells]
        shown = [job.shows(piece, state, 1) for piece, state in zip(job.cut, states, strict=True)]
        for piece, state, mine, cells in zip(job.cut, states, its, own, strict=True):
            around = joined(piece, mine, [shown[one.piece] for one in mine])
            found[cells] = job.answer(piece, job.step(piece, state, around, 1))
        return found

    return sweep


def slowest(job: ModelJob, domain) -> tuple[float, np.ndarray]:
    """The spectral radius of a job's sweep by Arnoldi's method, and the mode that falls at this rate."""
    count = np.count_nonzero(domain.free)
    sweep = linalg.LinearOperator((count, count), sweep_of(job, domain), dtype=float)
    values, modes = linalg.eigs(sweep, 1, v0=np.ones(count), tol=1e-10)
    assert abs(values[0].imag) < 1e-9
    return float(values[0].real), modes[:, 0].real


@pytest.mark.parametrize("dt", [0.3, 3.0])
@pytest.mark.parametrize("method", [BlockJacobi(), Schwarz(overlap=1), Schwarz(overlap=2)], ids=["0", "1", "2"])
def test_sweeps_converge_at_the_spectral_radius(method, dt) -> None:
    """One step in time, from fields whose error is the slowest mode; ln(rate) / ln(rho), for rho near 1 hides all."""
    job = job_of(method, dt=dt)
    rho, mode = slowest(job, FLOOR)
    exact, start = from_an_error_of(mode, dt)
    errors = [np.abs(fields_after(job, start, sweeps) - exact).max() for sweeps in (2, 5)]
    assert np.log((errors[1] / errors[0]) ** (1 / 3)) / np.log(rho) == pytest.approx(1.0, abs=0.1)
    assert 0.01 < rho < 0.9


@pytest.mark.parametrize("dt", [0.3, 3.0])
@pytest.mark.parametrize("inner", ["exact", "diagonal"])
def test_chebyshev_converges_at_its_rate(inner, dt) -> None:
    """Of the slowest mode 1 / T_k(1 / rho) is left after k sweeps, T_k of Chebyshev; in the end the rate is known."""
    rho, mode = slowest(job_of(BlockJacobi(inner=inner), dt=dt), FLOOR)
    job = job_of(Chebyshev(rho=rho, inner=inner), dt=dt)
    exact, start = from_an_error_of(mode, dt)
    errors = np.array([np.abs(fields_after(job, start, sweeps) - exact).max() for sweeps in (4, 10)])
    left = 1.0 / np.cosh(np.array([4.0, 10.0]) * np.arccosh(1.0 / rho))
    assert errors / np.abs(mode).max() == pytest.approx(left, rel=1e-3)
    in_the_end = rho / (1.0 + np.sqrt(1.0 - rho**2))
    assert np.log((errors[1] / errors[0]) ** (1 / 6)) / np.log(in_the_end) == pytest.approx(1.0, abs=0.1)


def from_an_error_of(mode: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """The fields a step in time later, solved as a whole, and those before, which differ by a mode."""
    matrix, _ = laplacian(FLOOR)
    change = dt * (DECAY * sparse.eye_array(len(mode)) - 0.05 * matrix)  # (1 + change) after = before
    after = linalg.spsolve(change.tocsc(), mode)
    return after, after + mode


def fields_after(job: ModelJob, start: np.ndarray, sweeps: int) -> np.ndarray:
    """The iterate after some sweeps of the first step in time."""
    number, found = Faces.of(FLOOR).number, np.empty(len(start))
    its = [number[tuple(piece.cells.T)] for piece in job.cut]
    for piece, cells, state in zip(
        job.cut, its, alone(job, job.cut, [start[cells] for cells in its], sweeps), strict=True
    ):
        found[cells] = job.answer(piece, state)
    return found


@pytest.mark.parametrize(("dt", "inner"), [(0.3, "exact"), (3.0, "exact"), (3.0, "diagonal")])
def test_the_bound_of_the_spectral_radius_holds_and_is_close(dt, inner) -> None:
    rho, _ = slowest(job_of(BlockJacobi(inner=inner), dt=dt, decay=0.0), FLOOR)
    weight = job_of(Chebyshev(inner=inner), dt=dt, decay=0.0).solvers[0]._weights[1]
    found = np.sqrt(2.0 - 2.0 / weight)
    assert rho <= found < rho + 0.05 * (1.0 - rho)


def test_chebyshev_s_weights_are_those_of_its_polynomials() -> None:
    rho, weights = 0.9, relaxations(0.9, 8)
    polynomials = [1.0, 1.0 / rho]
    for _ in range(8):
        polynomials.append(2.0 / rho * polynomials[-1] - polynomials[-2])
    assert weights[1:] == pytest.approx([2.0 / rho * polynomials[k] / polynomials[k + 1] for k in range(1, 8)])
    assert weights[0] == 1.0


@pytest.mark.parametrize(
    "method",
    [
        BlockJacobi(sweeps=110), Chebyshev(sweeps=40), Schwarz(sweeps=30, overlap=2), Schwarz(sweeps=110, overlap=0),
        Chebyshev(sweeps=90, inner="diagonal"),
    ],
)  # fmt: skip
def test_sweeps_converge_to_the_whole_system_s_solution(method) -> None:
    matrix, _ = laplacian(FLOOR)
    system = ((1.0 + DECAY * DT) * sparse.eye_array(len(START)) - 0.05 * DT * matrix).tocsc()
    expected = linalg.spsolve(system, linalg.spsolve(system, START))
    found = solved(Diffusion(decay=DECAY), method, FLOOR, START, DT, 2, 6)
    np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize("overlap", [0, 1, 2, 3])
def test_thin_pieces_converge_to_the_same(overlap) -> None:
    """Pieces two cells wide: an overlap of two lies in the next piece, and its halo in the one behind that."""
    domain, start = FLOOR, START
    of = np.where(domain.free, np.indices(domain.free.shape)[1] // 2, -1).astype(np.int32)
    cut = pieces_of(domain, of, overlap + 1)
    beside = abs(cut[5].owners - 5).max()
    assert beside == 1 + overlap // 2
    expected = solved(Diffusion(), BlockJacobi(sweeps=1), domain, start, DT, 1)
    found = solved(Diffusion(), Schwarz(sweeps=90, overlap=overlap), domain, start, DT, 1, cut=cut)
    assert np.abs(found - expected).max() < 1e-8


def test_an_overlap_as_wide_as_the_halo_is_refused() -> None:
    of = np.where(FLOOR.free, np.indices(FLOOR.free.shape)[1] // 2, -1).astype(np.int32)
    with pytest.raises(InputError, match=r"method: piece 0 reads \d+ values beyond its halo; expected halos one cell"):
        solved(Diffusion(), Schwarz(overlap=2), FLOOR, START, DT, 1, cut=pieces_of(FLOOR, of, 2))


@pytest.mark.parametrize(
    ("model", "method", "dt"),
    [
        (Diffusion(decay=DECAY), Explicit(), 0.1),
        (Wave(walls="open"), Explicit(), 0.1),
        (GrayScott(), Explicit(), 0.5),
        (AdvectionDiffusion(velocity=(0.1, -0.05), walls="open"), Explicit(), 0.04),
        (Diffusion(), BlockJacobi(inner="diagonal", sweeps=8), 1.0),
        (Diffusion(), Chebyshev(inner="diagonal", rho=0.9, sweeps=8), 1.0),
        (GrayScott(), Chebyshev(inner="diagonal", sweeps=8), 0.8),
    ],
)
def test_what_knows_no_blocks_does_not_depend_on_the_pieces(model, method, dt) -> None:
    found = [solved(model, method, FLOOR, START, dt, 4, count) for count in (1, 2, 7, 50)]
    assert all(np.array_equal(found[0], one) for one in found[1:])


@pytest.mark.parametrize(
    ("method", "whole"),
    [
        (Explicit(level=5), 0.0), (BlockJacobi(inner="diagonal", sweeps=6), 0.0),
        (Chebyshev(inner="diagonal", sweeps=6, rho=0.9), 0.0), (BlockJacobi(sweeps=4), None),
        (Chebyshev(sweeps=60), 1e-11), (Schwarz(sweeps=50, overlap=2), 1e-11),
    ],
)  # fmt: skip
def test_jobs_depend_on_nothing_but_what_they_may(method, whole) -> None:
    domain = Domain(FLOOR.lattice, ROOM)
    problem = Problem(Diffusion().on(domain), nothing, 0.1)
    check_job(ModelJob.of(problem, method, domain, 5, 2 * method.level), whole=whole)


def test_a_second_visit_of_a_step_gives_equal_bits() -> None:
    job = job_of(Chebyshev())
    piece, around = job.cut[2], np.random.default_rng(1).random((len(job.cut[2].halo), 1))
    state = job.start(piece, START[: len(piece.cells)])
    once = [job.step(piece, state.copy(), around.copy(), step) for step in (0, 0, 20)]
    assert np.array_equal(once[0], once[1])
    assert np.array_equal(once[0], once[2])  # the first sweep of the next step in time


def test_a_level_starts_with_the_fields_alone() -> None:
    """So that equal fields are equal copies."""
    for method in (BlockJacobi(sweeps=3), Chebyshev(sweeps=3), Schwarz(sweeps=3)):
        job = job_of(method)
        within, after = (
            alone(job, job.cut, [1.0 + 0.0 * one.cells[:, 0] for one in job.cut], steps) for steps in (2, 3)
        )
        assert all(np.count_nonzero(one) > len(piece.cells) for one, piece in zip(within, job.cut, strict=True))
        assert [np.count_nonzero(one) for one in after] == [len(piece.cells) for piece in job.cut]


def test_pieces_say_their_work() -> None:
    job = job_of(Schwarz(overlap=2), 5)
    patch = Patch.of(job.cut[0], Faces.of(FLOOR).number)
    assert 100.0 * len(patch.own) > job.work(job.cut[0]) > 10.0 * len(patch.own)
    assert len(places(FLOOR)) == len(START)


@pytest.mark.slow
@pytest.mark.parametrize("dt", [1.125, 11.25, 112.5])
def test_rates_on_a_floor_of_a_thousand_cells(dt) -> None:
    """r of 2.5, 25 and 250, 20 pieces."""
    domain = floor(24, 40, pillars=((0, 12, 16, 13), (8, 27, 24, 28)))
    for method in (BlockJacobi(), Schwarz(overlap=1), Schwarz(overlap=2)):
        job = job_of(method, 20, dt, domain)
        rho, mode = slowest(job, domain)
        values, sweep = [mode], sweep_of(job, domain)
        for _ in range(9):
            values.append(sweep(values[-1]))
        rate = (np.abs(values[9]).max() / np.abs(values[3]).max()) ** (1 / 6)
        assert np.log(rate) / np.log(rho) == pytest.approx(1.0, abs=0.1)
