"""Orders of accuracy in space and time, against solutions in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from floors import floor, laplacian, orders, places, solved
from scipy.integrate import solve_ivp

from swarmsim.operations.methods.explicit import Explicit
from swarmsim.operations.methods.sweeps import BlockJacobi, Chebyshev, Schwarz
from swarmsim.operations.models.advection import AdvectionDiffusion
from swarmsim.operations.models.diffusion import Diffusion
from swarmsim.operations.models.reaction import GrayScott
from swarmsim.operations.models.wave import Wave

SIDE, D, K, C = 1.8, 0.05, 0.02, 0.6  # m, m^2/s, 1/s, m/s
EXACTLY = [BlockJacobi(sweeps=30), Chebyshev(sweeps=15), Schwarz(sweeps=12, overlap=2)]  # as good as exact here
NAMES = ["block-jacobi", "chebyshev", "schwarz"]


def mode(domain, walls):
    """A product of cosines, or of sines, that keeps to no-flux walls, or to walls at 0; and its -laplace(u) / u."""
    wave = np.cos if walls == "no-flux" else np.sin
    x, y = np.pi * places(domain).T / SIDE
    return wave(x) * wave(2.0 * y), 5.0 * (np.pi / SIDE) ** 2


def square(cells):
    return floor(cells, cells, SIDE / cells)


@pytest.mark.parametrize("walls", ["no-flux", "fixed"])
@pytest.mark.parametrize("method", [Explicit(), *EXACTLY], ids=["explicit", *NAMES])
def test_diffusion_is_of_second_order_in_space(method, walls) -> None:
    """A manufactured solution, (1 + t) times a mode, with the source that makes it; its errors in time vanish."""
    errors = []
    for cells in (12, 24):
        domain = square(cells)
        shape, eigenvalue = mode(domain, walls)
        dt = 0.2 * (SIDE / 24) ** 2 / D

        def forcing(of, begin, end, shape=shape, eigenvalue=eigenvalue):
            late = begin if isinstance(method, Explicit) else end  # where Euler's methods take the right side
            return shape[of] * (1.0 + (1.0 + late) * (D * eigenvalue + K))

        model = Diffusion(diffusivity=D, decay=K, walls=walls, value=0.0 if walls == "fixed" else None)
        found = solved(model, method, domain, shape, dt, 12, 4, forcing)
        errors.append(np.abs(found - (1.0 + 12 * dt) * shape).max())
    assert orders(errors, [2.0, 1.0]) == pytest.approx([2.0], abs=0.1)


@pytest.mark.parametrize("method", [Explicit(level=1), *EXACTLY], ids=["explicit", *NAMES])
def test_euler_s_methods_are_of_first_order_in_time(method) -> None:
    """A mode of the cells themselves decays exactly, so that errors in space vanish."""
    domain = square(12)
    shape, _ = mode(domain, "no-flux")
    matrix, _ = laplacian(domain)
    rate = D * -((matrix @ shape) / shape)[0] + K
    errors = []
    for times in (20, 40):
        found = solved(Diffusion(diffusivity=D, decay=K), method, domain, shape, 1.6 / times, times, 3)
        errors.append(np.abs(found - np.exp(-rate * 1.6) * shape).max())
    assert orders(errors, [2.0, 1.0]) == pytest.approx([1.0], abs=0.1)


@pytest.mark.parametrize("walls", ["no-flux", "fixed"])
def test_waves_are_of_second_order_in_space_and_time(walls) -> None:
    errors, model = [], Wave(speed=C, walls=walls, value=0.0 if walls == "fixed" else None)
    for cells in (16, 32):
        domain = square(cells)
        shape, eigenvalue = mode(domain, walls)
        dt, times = 0.5 * SIDE / cells / C, 2 * cells
        found = solved(model, Explicit(), domain, shape, dt, times, 4)
        errors.append(np.abs(found - np.cos(C * eigenvalue**0.5 * dt * times) * shape).max())
    assert orders(errors, [2.0, 1.0]) == pytest.approx([2.0], abs=0.1)


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_the_leapfrog_is_of_second_order_in_time(damping) -> None:
    domain = square(12)
    shape, _ = mode(domain, "no-flux")
    matrix, _ = laplacian(domain)
    square_of = C**2 * -((matrix @ shape) / shape)[0] - damping**2 / 4.0
    w, late = square_of**0.5, 2.0
    exact = np.exp(-damping * late / 2) * (np.cos(w * late) + damping / 2 / w * np.sin(w * late)) * shape
    errors = [
        np.abs(solved(Wave(speed=C, damping=damping), Explicit(), domain, shape, late / times, times, 3) - exact).max()
        for times in (20, 40)
    ]
    assert orders(errors, [2.0, 1.0]) == pytest.approx([2.0], abs=0.1)


@pytest.mark.parametrize(("scheme", "order", "coarse"), [("upwind", 1.0, 64), ("central", 2.0, 32)])
def test_a_draught_carries_at_the_order_of_its_scheme(scheme, order, coarse) -> None:
    """A bell that drifts and spreads over open water."""
    velocity, width, late, errors = np.array([0.12, 0.05]), 0.5, 4.0, []
    for cells in (coarse, 2 * coarse):
        domain = floor(cells, cells, 6.4 / cells)

        def bell(time, domain=domain):
            square = width**2 + 2.0 * D * time
            gap = ((places(domain) - (2.9, 3.0) - time * velocity) ** 2).sum(axis=1)
            return width**2 / square * np.exp(-0.5 * gap / square)

        times = 32 * (cells // 32) ** 2
        model = AdvectionDiffusion(diffusivity=D, velocity=tuple(velocity), walls="open", scheme=scheme)
        found = solved(model, Explicit(), domain, bell(0.0), late / times, times)
        errors.append(np.abs(found - bell(late)).max())
    assert orders(errors, [2.0, 1.0]) == pytest.approx([order], abs=0.1)


@pytest.mark.parametrize("method", [Explicit(level=1), *EXACTLY], ids=["explicit", *NAMES])
def test_a_reaction_is_of_first_order_in_time(method) -> None:
    """Against an adaptive solver of eighth order, of a matrix put together in another way."""
    domain, model = floor(8, 8), GrayScott(feed=0.03, kill=0.055)
    matrix, _ = laplacian(domain)
    start = 0.5 * np.exp(-((places(domain) - 0.5) ** 2).sum(axis=1) / 0.1)

    def rates(_, fields):
        v, u = fields.reshape(2, -1)
        dv = 0.00225 * (matrix @ v) + u * v * v - 0.085 * v
        du = 0.0045 * (matrix @ u) + 0.03 * (1.0 - u) - u * v * v
        return np.concatenate([dv, du])

    exact = solve_ivp(rates, (0.0, 10.0), np.concatenate([start, 1.0 - start]), "DOP853", rtol=1e-10, atol=1e-12)
    errors = [
        np.abs(solved(model, method, domain, start, 10.0 / times, times, 3) - exact.y[: len(start), -1]).max()
        for times in (20, 40)
    ]
    assert orders(errors, [2.0, 1.0]) == pytest.approx([1.0], abs=0.1)
