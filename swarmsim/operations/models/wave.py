"""Waves."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from swarmsim.core.jobs import Domain
from swarmsim.operations.models.diffusion import Rate, Walled, diffusive
from swarmsim.operations.models.equations import Equations
from swarmsim.operations.models.faces import Faces


class Wave(Walled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Waves with damping: d2u/dt2 + g du/dt = c^2 laplace(u) + q (d'Alembert 1747), at rest at the start.

    Walls without flux reflect a wave, fixed ones turn it over as well. Open ones let it leave, without any reflection
    if it meets them at a right angle: du/dt = -c du/dn (Engquist and Majda 1977, their first condition). Space as in
    `diffusion`, of second order; open walls are of first order.
    """

    speed: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0  # m/s
    damping: Rate = 0.0  # 1/s

    def on(self, domain: Domain) -> Equations:
        faces, cell = Faces.of(domain), domain.lattice.cell
        operator, inflow = diffusive(faces, self.speed**2, 0.0, self.fixed())
        damping = np.full(faces.count, self.damping)
        if self.walls == "open":
            leave = faces.walls[faces.outer]
            damping += faces.summed(leave, np.full(len(leave), self.speed / cell))
        return Equations(
            operators=(operator,), inflow=inflow[:, None], order=2, damping=damping,
            pace=("(c dt / h)^2", (self.speed / cell) ** 2),
        )  # fmt: skip
