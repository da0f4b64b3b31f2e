"""Advection and diffusion: what a draught carries."""

from __future__ import annotations

from typing import Literal

import numpy as np
from msgspec import Struct
from scipy import sparse

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.operations.models.diffusion import Diffusivity, Rate, Walled, diffusive
from swarmsim.operations.models.draught import Air, Point, between_vents, through
from swarmsim.operations.models.equations import Equations
from swarmsim.operations.models.faces import Faces


class Vents(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where air comes in, where it leaves, and how much."""

    inlet: Point  # x, y in m
    outlet: Point
    flow: float  # m^2/s: the volume in a second by the height of the room


class AdvectionDiffusion(Walled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A draught v carries what diffuses: du/dt = D laplace(u) - div(v u) - k u + q (LeVeque 2002).

    The draught is a potential flow, so it is free of divergence up to rounding and passes no wall: either from an
    inlet to an outlet (`vents`), or of a `velocity` far from pillars and islands, through open outer walls. What comes
    in there has `value`, and through an inlet 0. `scheme` tells whose value crosses a face: the cell's upstream
    ("upwind": of first order, never oscillates) or the mean of both ("central": of second order, oscillates where the
    cell Peclet number v h / D is over 2). Diffusion does not cross open walls.
    """

    diffusivity: Diffusivity = 0.05  # m^2/s
    decay: Rate = 0.0  # 1/s
    velocity: tuple[float, float] | None = None  # m/s: x, y
    vents: Vents | None = None
    scheme: Literal["upwind", "central"] = "upwind"

    def on(self, domain: Domain) -> Equations:
        faces, cell = Faces.of(domain), domain.lattice.cell
        air = self._air(faces)
        operator, inflow = diffusive(faces, self.diffusivity, self.decay, self.fixed())
        operator = (operator + carried(faces, air, self.scheme)).tocsr()
        inflow += air.entering / cell**2 * ((self.value or 0.0) if self.walls == "open" else 0.0)
        return Equations(
            operators=(operator,), inflow=inflow[:, None],
            pace=("what leaves a cell in a step, as a share of its content,", float(-operator.diagonal().min())),
        )  # fmt: skip

    def _air(self, faces: Faces) -> Air:
        if (self.velocity is None) == (self.vents is None):
            raise InputError("velocity: a draught needs either a velocity or vents; expected one of them")
        if self.vents is not None:
            return between_vents(faces, self.vents.inlet, self.vents.outlet, self.vents.flow)
        if self.walls != "open":
            raise InputError(
                f'velocity: {list(self.velocity or ())} m/s cannot pass walls = "{self.walls}"; expected "open", or '
                "vents = {inlet = [x, y], outlet = [x, y], flow = m^2/s}"
            )
        return through(faces, np.array(self.velocity))


def carried(faces: Faces, air: Air, scheme: str) -> sparse.csr_array:
    """The matrix (n, n) of advection, 1/s: what leaves a cell arrives in the next one."""
    area = faces.domain.lattice.cell**2
    ahead, back = np.maximum(air.fluxes, 0.0), np.maximum(-air.fluxes, 0.0)
    if scheme == "central":
        ahead, back = 0.5 * air.fluxes, -0.5 * air.fluxes
    out = faces.summed(faces.pairs[:, 0], ahead) + faces.summed(faces.pairs[:, 1], back) + air.leaving
    return faces.matrix(back / area, ahead / area, -out / area)
