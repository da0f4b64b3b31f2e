"""Where robots can stand in a building that they know, how they get from place to place, and what they see there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.file import sensors_of
from swarmsim.engine.build import BuiltRun
from swarmsim.engine.survey import MANY, surveyor, tiles_from

ASIDE: Final = 0.25  # cells from the centre, see `Stands.points`
#: Rows and columns of a step, one of each pair of opposite ones.
MOVES: Final = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))


@dataclass(frozen=True, slots=True)
class SeenFrom:
    """How far tiles reach, and what they show from some points."""

    window: tuple[int, int]  # rows and columns of the largest tile
    seen: sparse.csr_array  # (points, cells of the lattice), boolean


@dataclass(frozen=True, eq=False)
class Stands:
    """The cells that robots can reach, as places to stand; place i is row i of `cells`."""

    lattice: Lattice
    cells: NDArray[np.int64]  # (p, 2): row and column
    #: (p, 2): x, y in m. An even side of a tile is centred on the nearest edge of a cell, so from a cell's centre the
    #: last bit of a pose decides which row (or column) is seen. Places are therefore a quarter of a cell beside it.
    points: NDArray[np.float64]
    domain: NDArray[np.int64]  # (m,): the lattice's cells to cover, row-major
    views: sparse.csr_array  # (p, m), boolean: what is seen from each place
    starts: NDArray[np.int64]  # (n,): the place of each robot at the start
    pace: float  # m in an iteration, at the fastest robots' top speed

    @cached_property
    def index(self) -> NDArray[np.int64]:
        """The place in each cell (rows, columns); -1 for none."""
        found = np.full(self.lattice.shape, -1)
        found[tuple(self.cells.T)] = np.arange(len(self.cells))
        return found

    @cached_property
    def steps(self) -> sparse.csr_array:
        """The ways in m (p, p) between places a step apart, 16 for each.

        Robots can stand in all cells of the rectangle that a step crosses, so no corner is cut.
        """
        ends, (rows, columns) = [], self.cells.T
        for down, across in MOVES:
            crossed = [
                (r, c) for r in range(down + 1) for c in range(0, across + np.sign(across) or 1, np.sign(across) or 1)
            ]
            # The lattice has a margin that nobody reaches.
            fine = np.logical_and.reduce([self.index[rows + r, columns + c] >= 0 for r, c in crossed])
            ends.append(np.stack([np.flatnonzero(fine), self.index[rows + down, columns + across][fine]]))
        first, second = np.hstack(ends)
        length = np.hypot(*(self.points[first] - self.points[second]).T)
        count = len(self.cells)
        one_way = sparse.csr_array((length, (first, second)), shape=(count, count))
        return sparse.csr_array(one_way + one_way.T)


def sight_of(built: BuiltRun, points: NDArray[np.float64]) -> SeenFrom:
    """What the robots' sensors show from points (k, 2) in m. Raises InputError for sensors without tiles."""
    context, shape = built.context, built.arena.lattice.shape
    sensors = [surveyor(place, part, context) for place, part in sensors_of(built.scenario)]
    tiled = [sensor for sensor in sensors if sensor is not None]
    if not tiled:
        raise InputError("sensor: gives no tiles; expected one whose tiles show which cells are covered")
    window, seen = np.zeros(2, np.int64), []
    for sensor in tiled:
        for piece in np.array_split(np.arange(len(points)), -(-len(points) // MANY)):
            tiles = tiles_from(sensor, context, points[piece])
            window = np.maximum(window, tiles.values.shape[1:])
            who, row, column = np.nonzero(tiles.values)
            cell = np.ravel_multi_index((tiles.origins[who] + np.stack([row, column], axis=1)).T, shape)
            ends = (piece[who], cell)
            seen.append(sparse.coo_array((np.ones(len(who), np.int8), ends), shape=(len(points), np.prod(shape))))
    total = sparse.csr_array(sum(seen[1:], seen[0]))
    return SeenFrom((int(window[0]), int(window[1])), sparse.csr_array(total > 0))


def ground_of(built: BuiltRun) -> Stands:
    """The ground of a run's robots. Raises InputError for sensors without tiles."""
    lattice, reachable = built.arena.lattice, built.reachable
    cells = np.argwhere(reachable)
    centres = lattice.centres(cells)
    window = sight_of(built, centres[:1]).window
    points = centres + lattice.cell * ASIDE * _aside(reachable, cells, window)
    domain = np.flatnonzero(built.explorable)
    index = np.full(lattice.shape, -1)
    index[tuple(cells.T)] = np.arange(len(cells))
    starts = index[tuple(lattice.cells(built.context.start[:, :2]).T)]
    pace = built.scenario.robots.speed * built.scenario.period
    views = sparse.csr_array(sight_of(built, points).seen[:, domain])
    return Stands(lattice, cells, points, domain, views, starts, pace)


def _aside(reachable: NDArray[np.bool_], cells: NDArray[np.int64], window: tuple[int, int]) -> NDArray[np.int64]:
    """To which side (p, 2), along x and y, robots leave the centres of `cells` (p, 2): where there is room."""
    sides = np.zeros_like(cells)
    for axis in (0, 1):
        if window[axis] % 2 == 0:
            step = np.eye(2, dtype=np.int64)[axis]
            above, below = (reachable[tuple((cells + way).T)] for way in (step, -step))
            sides[:, 1 - axis] = np.where(above, 1, np.where(below, -1, 0))
    return sides
