"""Floor plans as cells: occupied, free or unknown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from swarmsim.core.lattice import Lattice
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.world.arena import Arena
from swarmsim.world.boundary import boundary, shares
from swarmsim.world.plan import FloorPlan

_SLIVER = 1e-6  # of a cell; a smaller piece of wall is rounding


def rasterised(plan: FloorPlan, cell: float, name: str) -> tuple[NDArray[np.uint8], Lattice]:
    """The cells (rows, columns) of side `cell` (m) of a plan's page and all solids, and their lattice.

    A cell is occupied if walls cover any of it, and unknown if more than half of it is. Raises InputError for
    too many cells.
    """
    arena = Arena.open(plan, cell, 1, name)
    states = np.full(arena.lattice.shape, FREE, np.uint8)
    states[shares(boundary(plan.unknown), arena.lattice) > 0.5] = UNKNOWN
    for layer in plan.layers.values():
        if not layer.is_empty:
            states[shares(boundary(layer), arena.lattice) > _SLIVER] = OCCUPIED
    return cropped(states, arena.lattice, [shapely.box(*plan.page), *plan.layers.values()])


def cropped(
    states: NDArray[np.uint8], lattice: Lattice, areas: Sequence[BaseGeometry]
) -> tuple[NDArray[np.uint8], Lattice]:
    """The cells of a lattice that hold any of these areas, and the cells between them."""
    left, low, right, high = shapely.total_bounds([area for area in areas if not area.is_empty])
    cell = lattice.cell
    inside = _SLIVER * cell
    first = lattice.cells(np.array([left + inside, low + inside]))
    last = lattice.cells(np.array([right - inside, high - inside]))
    states = states[first[0] : last[0] + 1, first[1] : last[1] + 1]
    x0, y0 = lattice.x0 + first[1] * cell, lattice.y0 + first[0] * cell
    return states, Lattice(float(x0), float(y0), cell, *states.shape)
