"""Reaction and diffusion of a pair."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from swarmsim.core.jobs import Domain, Values
from swarmsim.operations.models.diffusion import Diffusivity, Walled, diffusive, mesh_ratio
from swarmsim.operations.models.equations import Equations
from swarmsim.operations.models.faces import Faces

Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class GrayScott(Walled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An activator v that lives on a substrate u (Gray and Scott 1983; Pearson, Science 261, 1993).

    dv/dt = D_v laplace(v) + rate (u v^2 - (feed + kill) v), du/dt = D_u laplace(u) + rate (feed (1 - u) - u v^2).
    Both are shares of 1 without a unit. The field is v; where it starts at s, u starts at 1 - s. The diffusivities are
    Pearson's in cells of 0.15 m. Fixed walls keep v at `value` and u at 1 - `value`.
    """

    activator: Diffusivity = 0.00225  # m^2/s, D_v
    substrate: Diffusivity = 0.0045  # m^2/s, D_u
    feed: Share = 0.04  # of u, in a unit of 1 / rate
    kill: Share = 0.06  # of v, in a unit of 1 / rate
    rate: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0  # 1/s

    def on(self, domain: Domain) -> Equations:
        self.closed()
        faces, v = Faces.of(domain), self.fixed()
        first, of_activator = diffusive(faces, self.activator, 0.0, v)
        second, of_substrate = diffusive(faces, self.substrate, 0.0, None if v is None else 1.0 - v)
        inflow = np.stack([of_activator, of_substrate], axis=1)
        return Equations(
            operators=(first, second), inflow=inflow, reaction=self._reaction,
            reacting=self.rate * (1.0 + self.feed + self.kill), start=lambda s: np.stack([s, 1.0 - s], axis=1),
            pace=mesh_ratio(max(self.activator, self.substrate), domain),
        )  # fmt: skip

    def _reaction(self, fields: Values) -> Values:
        v, u = fields.T
        eaten = u * v * v
        return self.rate * np.stack([eaten - (self.feed + self.kill) * v, self.feed * (1.0 - u) - eaten], axis=1)
