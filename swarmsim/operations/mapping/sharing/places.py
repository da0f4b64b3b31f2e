"""Where one map may lie on another, what contradicts that, and when one place is proved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN

Cells = NDArray[np.uint8]  # (rows, columns): UNKNOWN, FREE or OCCUPIED
Points = NDArray[np.float64]  # (p, 2): row and column

AGREEMENT: Final = 0.97  # share of the cells that both maps know, the least where one may lie on the other ...
WALLS: Final = 25  # ... and the least number of walls on walls
EXCESS: Final = 12  # cells: by how many more than the best place any other one has to be contradicted ...
NOISE: Final = 0.005  # ... at this share of contradictions in the right place, which is that of perfect sensors
ASIDE: Final = 3.0  # cells at the meeting spot, beyond which a place is another one ...
ASKEW: Final = 0.2  # ... and rad of its turn
PINNED: Final = np.deg2rad(1.0)  # the greatest standard error of a turn that is known well enough
#: Places by which two transforms are compared, in cells.
BREADTH: Final = np.array([[40.0, 0.0], [-40.0, 0.0], [0.0, 40.0], [0.0, -40.0]])


@dataclass(frozen=True, slots=True)
class Transform:
    """A turn about the corner of cell (0, 0), then a shift: where the cells of one map lie in the other."""

    turn: float  # rad, counter-clockwise with rows upwards
    rows: float  # cells
    columns: float  # cells

    def apply(self, points: Points) -> Points:
        """Points (p, 2) of one map, row and column in cells, in the other."""
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        row, column = points[:, 0], points[:, 1]
        return np.stack([row * cos + column * sin + self.rows, column * cos - row * sin + self.columns], axis=1)

    def after(self, first: Transform) -> Transform:
        """Another transform followed by this one."""
        turn = (self.turn + first.turn + np.pi) % (2.0 * np.pi) - np.pi
        return Transform(float(turn), *self._of(first.rows, first.columns))

    def _of(self, row: float, column: float) -> tuple[float, float]:
        """One point of the one map in the other."""
        row, column = self.apply(np.array([[row, column]])).ravel().tolist()
        return row, column

    def inverse(self) -> Transform:
        """The inverse transform."""
        return Transform(-self.turn, *Transform(-self.turn, 0.0, 0.0)._of(-self.rows, -self.columns))

    def shift(self, other: Transform) -> float:
        """How far apart both put the worst of the places a map's breadth away from its frame's beginning, in cells."""
        return float(np.hypot(*(self.apply(BREADTH) - other.apply(BREADTH)).T).max())


def between(one: float, other: float) -> float:
    """The angle between two turns, rad."""
    return float(abs((one - other + np.pi) % (2.0 * np.pi) - np.pi))


def elsewhere(one: Transform, other: Transform, spots: Points) -> bool:
    """Whether two transforms are different places, as seen from where robots met (m, 2)."""
    aside = np.hypot(*(one.apply(spots) - other.apply(spots)).mean(axis=0))
    return bool(aside > ASIDE or between(one.turn, other.turn) > ASKEW)


@dataclass(frozen=True, slots=True)
class Place:
    """One way in which a map may lie on another, and what both maps say of it."""

    transform: Transform
    overlap: int  # cells that both maps know
    contradictions: int  # cells of these that are wall on the one map and free on the other, away from its walls
    walls: int  # occupied cells of the one map that lie on walls of the other

    @property
    def agreement(self) -> float:
        """The share of the overlap that does not contradict."""
        return 1.0 - self.contradictions / self.overlap if self.overlap else 0.0

    @property
    def needed(self) -> int:
        """By how many more contradicting cells than here another place is refuted, if this is the right one.

        Each cell weighs the logarithm of how much rarer a contradiction is in the right place than elsewhere, about
        -log(noise), so noisy maps need more of them. Their number scatters by its root, in both places.
        """
        noise = max(NOISE, self.contradictions / max(self.overlap, 1))
        scatter = np.sqrt(2.0 * max(0.0, self.contradictions - NOISE * self.overlap))
        return int(np.ceil(EXCESS * np.log(NOISE) / np.log(noise) + 3.0 * scatter))


@dataclass(frozen=True, slots=True)
class Match:
    """The best place, and what speaks against all others."""

    best: Place
    rivals: tuple[Place, ...]  # places not refuted, one for each spot and turn, the least contradicted first
    excess: int  # cells that contradict the least contradicted other place beyond those of the best
    error: float  # rad, the standard error of the best place's turn if each wall errs by a cell

    def placed(self) -> bool:
        """Whether every other place is refuted, and both maps agree in the best one by enough walls."""
        return self.best.agreement >= AGREEMENT and self.best.walls >= WALLS and not self.rivals

    def accepted(self) -> bool:
        """Whether the best place is proved, and walls pin its turn."""
        return self.placed() and self.error <= PINNED


def judged(fixed: Cells, placed: Cells, transform: Transform) -> Place:
    """What a map says of another one that is `placed` on its cells; a wall beside its place contradicts nothing."""
    both: NDArray[np.bool_] = (placed != UNKNOWN) & (fixed != UNKNOWN)
    near, around = (ndimage.maximum_filter(one == OCCUPIED, 3) for one in (fixed, placed))
    walls: NDArray[np.bool_] = both & (placed == OCCUPIED) & near
    free: NDArray[np.bool_] = both & (placed == FREE) & ((fixed == FREE) | around)
    return Place(transform, int(both.sum()), int((both & ~walls & ~free).sum()), int(walls.sum()))


def at(fixed: Cells, moving: Cells, transform: Transform) -> Place:
    """What both maps say of one place."""
    rows, columns = fixed.shape
    centres: Points = np.indices(fixed.shape).reshape(2, -1).T + np.float64(0.5)
    cells = np.floor(transform.inverse().apply(centres)).astype(np.int64)
    inside = np.asarray(((cells >= 0) & (cells < moving.shape)).all(axis=1))
    row, column = np.where(inside, cells.T, 0)
    placed = np.where(inside, moving[row, column], np.uint8(UNKNOWN)).reshape(rows, columns)
    return judged(fixed, placed, transform)
