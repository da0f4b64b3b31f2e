"""Where robots may be in a building, and from where they may see a cell: generous, for bounds that nothing beats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.lattice import Lattice
from swarmsim.engine.build import BuiltRun
from swarmsim.studies.benchmark.views import sight_of
from swarmsim.world.boundary import boundary, shares

FINE: Final = 4  # parts of a cell's side on which walls are told from free space
CLEAR: Final = 0.9  # of the radius: contacts let bodies overlap walls a little
WHOLE: Final = 1.0 - 1e-6  # share of a part from which it counts as solid
AROUND: Final = np.ones((3, 3), np.int64)  # neighbours across edges and corners


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where robots may be, and from where cells may be seen; a place is a square of half a cell.

    Both err on the generous side, so that no bound is too high.
    """

    lattice: Lattice
    window: tuple[int, int]  # rows and columns of a tile
    domain: NDArray[np.int64]  # (m,): the cells to cover, row-major
    possible: NDArray[np.bool_]  # (2 rows, 2 columns): the places that a robot's centre may come to
    #: (m, 2 rows of the tile + 4, 2 columns of it + 4): the places around each cell of the domain that are connected
    #: to it within the rectangle that they fill; no others see it.
    sides: NDArray[np.bool_]
    starts: NDArray[np.float64]  # (n, 2): row and column of each robot at the start, in half cells from the corner

    @property
    def corners(self) -> NDArray[np.int64]:
        """The first place (m, 2) of the rectangle around each cell of the domain."""
        cells = np.stack(np.divmod(self.domain, self.lattice.columns), axis=1)
        return np.asarray(2 * cells - (np.array(self.window) + 1))


def places_of(built: BuiltRun) -> Places:
    """The places of a run's robots. Raises InputError for sensors without tiles."""
    arena, start = built.arena, built.context.start[:, :2]
    lattice, domain = arena.lattice, np.flatnonzero(built.explorable)
    fine = Lattice(lattice.x0, lattice.y0, lattice.cell / FINE, FINE * lattice.rows, FINE * lattice.columns)
    free = shares(arena.segments, fine) < WHOLE
    # A buffer's outline lies inside of the true one, so more places remain possible.
    grown = arena.solid.buffer(CLEAR * float(built.context.robots.each("radius").min()))
    rooms, _ = ndimage.label(free & (shares(boundary(grown), fine) < WHOLE), AROUND)
    room: NDArray[np.bool_] = np.isin(rooms, np.unique(rooms[tuple(fine.cells(start).T)]))
    window = sight_of(built, start[:1]).window
    size = FINE * (np.array(window) + 2)
    first = FINE // 2 * (2 * np.stack(np.divmod(domain, lattice.columns), axis=1) - (np.array(window) + 1))
    own = tuple(slice(FINE // 2 * (side + 1) - 1, FINE // 2 * (side + 1) + FINE + 1) for side in window)
    sides = np.empty((len(domain), *(2 * (np.array(window) + 2))), np.bool_)
    for number, (row, column) in enumerate(first.tolist()):
        around = slice(row, row + size[0]), slice(column, column + size[1])
        pieces, _ = ndimage.label(free[around], AROUND)
        seeing = np.zeros(int(pieces.max()) + 1, np.bool_)
        seeing[pieces[own]] = True  # the cell's piece; of a wall, the pieces that it touches
        seeing[0] = False
        sides[number] = _halved(seeing[pieces] & room[around])
    starts = (start - (lattice.x0, lattice.y0))[:, ::-1] * (2.0 / lattice.cell)
    return Places(lattice, window, domain, _halved(room), sides, starts)


def _halved(parts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The squares of half a cell that hold any of these parts."""
    rows, columns = (2 * side // FINE for side in parts.shape)
    return np.asarray(parts.reshape(rows, FINE // 2, columns, FINE // 2).any(axis=(1, 3)))
