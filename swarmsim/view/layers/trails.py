"""An optional layer for scenarios: the robots' recent paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.drawing import Lines, Mark, Shown, ends_of

JUMP = 20.0  # radii of a robot: a farther step goes round a page without edges, or is a removal


class Trails(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each live robot's path over the latest iterations."""

    iterations: Annotated[int, Meta(ge=1, le=1000)] = 30  # how far back lines go

    @property
    def name(self) -> str:
        """What it is called."""
        return "trails"

    def draw(self, shown: Shown) -> Sequence[Mark]:
        """A thin line behind each robot."""
        back = [np.asarray(shown.recorded("pose", step), np.float64)[:, :2] for step in range(self.iterations, -1, -1)]
        places = np.stack([*back, shown.pose[:, :2]])
        jumps = np.hypot(*np.diff(places, axis=0).transpose(2, 0, 1)) > JUMP * shown.radii
        robots = np.flatnonzero(shown.alive)
        since = [int(np.flatnonzero(jumps[:, robot]).max(initial=-1)) + 1 for robot in robots.tolist()]
        points, ends = ends_of(places[first:, robot] for first, robot in zip(since, robots.tolist(), strict=True))
        inks = [f"robot {robot}" for robot in robots.tolist()]
        return [Lines(points, ends, inks, None, 1.0, 0.6, of=robots, name="trail", z=35.0)]
