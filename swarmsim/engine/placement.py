"""Where robots start."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.streams import Streams

LARGE: Final = 10_000  # cells of a spawn area from which single ones are drawn ...
TRIES: Final = 100  # ... and how often


def start_poses(
    robots: Robots, lattice: Lattice, streams: Streams, centres: NDArray[np.float64], world: str
) -> NDArray[np.float64]:
    """Start poses (n, 3): each robot at one of the `centres` (c, 2) of free spawn cells, with a random heading.

    Every robot draws from its own stream, after those with lower ids are placed, so that one more robot
    moves no other. Raises InputError if the area holds fewer robots.
    """
    open_ = np.ones(len(centres), np.bool_)
    left, apart = len(centres), 2.0 * robots.radius
    cells, width = lattice.cells(centres), math.ceil(apart / lattice.cell)
    places = np.full(np.array(lattice.shape) + 2 * width, -1)  # index of the centre in each cell, if any
    places[tuple(cells.T + width)] = np.arange(len(centres))
    pose = np.empty((robots.count, 3))
    for robot in range(robots.count):
        if left == 0:
            raise InputError(
                f"robots.count: spawn area {robots.spawn!r} of {world} holds {robot} robots of radius "
                f"{robots.radius:g} m, not {robots.count}; expected fewer robots or a larger area"
            )
        stream = streams.open("spawn", robot)
        choice = _drawn(stream, open_)
        pose[robot] = *centres[choice], stream.uniform(-np.pi, np.pi)
        row, column = cells[choice]
        beside = places[row : row + 2 * width + 1, column : column + 2 * width + 1]
        beside = beside[beside >= 0]
        beside = beside[np.hypot(*(centres[beside] - centres[choice]).T) < apart]
        left -= int(np.count_nonzero(open_[beside]))
        open_[beside] = False
    return pose


def _drawn(stream: np.random.Generator, open_: NDArray[np.bool_]) -> int:
    """One of the open cells, drawn from all cells, so that the draw does not depend on how many are open.

    A small area is shuffled, and its first open cell is taken. In a large one, cells are drawn until one is open; only
    if that takes long it is shuffled as well.
    """
    for _ in range(TRIES if len(open_) > LARGE else 0):
        choice = int(stream.integers(len(open_)))
        if open_[choice]:
            return choice
    order = stream.permutation(len(open_))
    return int(order[open_[order]][0])
