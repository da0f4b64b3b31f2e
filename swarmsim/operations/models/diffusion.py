"""Diffusion with decay, and the walls of all models."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy import sparse

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain
from swarmsim.operations.models.equations import Equations
from swarmsim.operations.models.faces import Faces

Diffusivity = Annotated[float, Meta(gt=0.0, le=1e6)]  # m^2/s
Rate = Annotated[float, Meta(ge=0.0, le=1e6)]  # 1/s


class Walled(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What happens at walls: nothing passes, the value there is fixed, or the outer ones are open.

    Open are only the walls that belong to the solid around the floor; those of pillars and islands let nothing pass.
    """

    walls: Literal["no-flux", "fixed", "open"] = "no-flux"
    value: float | None = None  # at fixed walls; with a draught through open ones, what comes in (default: 0)

    def fixed(self) -> float | None:
        """The value that walls keep; None if they keep none. Raises InputError for a value missing or one too many."""
        if self.walls == "fixed" and self.value is None:
            raise InputError("value: required key is missing; fixed walls need the value that they keep")
        if self.walls == "no-flux" and self.value is not None:
            raise InputError(f'value: {self.value:g} with walls that nothing passes; expected walls = "fixed"')
        return self.value if self.walls == "fixed" else None

    def closed(self) -> None:
        """Raise InputError for open walls, which take a draught or a wave to mean something."""
        if self.walls == "open":
            raise InputError(
                'walls: "open" without a draught: nothing is carried out, so it is the same as no flux; expected '
                '"no-flux", or "fixed" with a value'
            )


class Diffusion(Walled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Diffusion with decay: du/dt = D laplace(u) - k u + q (Fick 1855; Crank, The Mathematics of Diffusion, 1975).

    Finite volumes with four neighbours, of second order in the cell (LeVeque, Finite Difference Methods, 2007, ch. 3):
    between two cells flows D (u_j - u_i) / h, and to a fixed wall, half a cell away, 2 D (value - u_i) / h.
    """

    diffusivity: Diffusivity = 0.05  # m^2/s
    decay: Rate = 0.0  # 1/s

    def on(self, domain: Domain) -> Equations:
        self.closed()
        operator, inflow = diffusive(Faces.of(domain), self.diffusivity, self.decay, self.fixed())
        return Equations(operators=(operator,), inflow=inflow[:, None], pace=mesh_ratio(self.diffusivity, domain))


def diffusive(
    faces: Faces, diffusivity: float, decay: float, fixed: float | None
) -> tuple[sparse.csr_array, NDArray[np.float64]]:
    """The matrix (n, n) of diffusion with decay, 1/s, and what walls of a fixed value add (n,), unit/s."""
    flow = diffusivity / faces.domain.lattice.cell**2
    every = np.full(len(faces.pairs), flow)
    out = faces.summed(faces.pairs.ravel(), np.repeat(every, 2)) + decay
    if fixed is None:
        return faces.matrix(every, every, -out), np.zeros(faces.count)
    walls = faces.summed(faces.walls, np.full(len(faces.walls), 2.0 * flow))
    return faces.matrix(every, every, -out - walls), walls * fixed


def mesh_ratio(diffusivity: float, domain: Domain) -> tuple[str, float]:
    """The number r = D dt / h^2, and its value in a step of 1 s."""
    return "r = D dt / h^2", diffusivity / domain.lattice.cell**2
