"""What a part is built for: the run, or the site of a building that is made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.building import Building
from swarmsim.core.lattice import Lattice
from swarmsim.core.robots import Robots
from swarmsim.core.streams import Streams


class Field(Protocol):
    """A scalar quantity that has a value everywhere in the building, at every time."""

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (k,) at a time (s) and at points (k, 2): x, y in m."""
        ...


@dataclass(frozen=True, slots=True)
class Setting:
    """What every part may know of the run it is built for.

    Minds are built from it as well, but of the building they may use its size alone: all else they have to sense.
    """

    robots: Robots
    lattice: Lattice
    period: float  # s, one iteration
    streams: Streams
    building: Building
    start: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))  # (n, 3): poses at the start
    scalar_field: Field | None = None  # what there is to measure besides walls
    number: int = 0  # a fault's place among the scenario's, or a sensor's among its robot's


@dataclass(frozen=True, slots=True)
class Site:
    """What a building is made from."""

    streams: Streams  # of the world's own seed
    cell: float  # m, side of the lattice's cells
