"""How two maps lie to each other whose robots know nothing of each other's places: a turn and a shift, or no answer.

One map is turned step by step; for each turn all shifts are judged at once, by correlations of what both maps call
occupied and free (as Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25 (2008), and
Birk and Carpin, "Merging Occupancy Grid Maps From Multiple Robots", Proceedings of the IEEE 94 (2006), judge overlaps
by agreement). The answer is given only if it is good and nothing else is nearly as good: a merge that is wrong spoils
both maps, one that comes later costs time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN

Cells = NDArray[np.uint8]  # (rows, columns): UNKNOWN, FREE or OCCUPIED

COARSE: Final = np.deg2rad(3.0)  # between the turns that are tried first ...
FINE: Final = np.deg2rad(0.5)  # ... and between those around the best of them
KEPT: Final = 12  # turns around which is tried again
WALL: Final = 4.0  # what a wall on a wall counts; beside it, half of that
FLOOR: Final = 0.3  # what free floor on free floor counts, away from walls
CLASH: Final = 20.0  # what a wall on free floor costs, away from walls, since the same place cannot be both ...
LENIENT: Final = 8.0  # ... but less while turns are coarse, and the ends of a map may lie beside their place


@dataclass(frozen=True, slots=True)
class Transform:
    """A turn about the corner of cell (0, 0), then a shift: where the cells of one map lie in the other."""

    turn: float  # rad, counter-clockwise with rows upwards
    rows: float  # cells
    columns: float  # cells

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (p, 2) of the one map, row and column in cells, in the other."""
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        row, column = points.T
        return np.stack([row * cos + column * sin + self.rows, column * cos - row * sin + self.columns], axis=1)


@dataclass(frozen=True, slots=True)
class Match:
    """The best transform, and how good it is."""

    transform: Transform
    overlap: int  # cells that both maps know
    agreement: float  # share of the overlap in which both say the same
    walls: int  # occupied cells of the one map that lie on walls of the other
    margin: float  # by what share of its score it is better than the best that is another one

    def accepted(self, agreement: float = 0.97, walls: int = 25, margin: float = 0.08) -> bool:
        """Whether it is worth believing: both maps agree, by enough walls, and nothing else is nearly as good."""
        return self.agreement >= agreement and self.walls >= walls and self.margin >= margin


@dataclass(frozen=True, slots=True)
class Meeting:
    """What two robots that meet know of each other: they are near, each somewhere on its own map."""

    fixed: tuple[float, float]  # row and column, in cells, of the robot of the one map
    moving: tuple[float, float]  # the same of the other, on the other map
    within: float  # cells that they are apart at most


def register(fixed: Cells, moving: Cells, meeting: Meeting) -> Match | None:
    """How `moving` lies in `fixed`, by a meeting of their robots; None if either has no walls to go by."""
    if not (fixed == OCCUPIED).any() or not (moving == OCCUPIED).any():
        return None
    judge = _Judge(fixed, moving, meeting)
    coarse = [judge.best(turn, lenient=True) for turn in np.arange(-np.pi, np.pi - 1e-9, COARSE)]
    coarse.sort(key=lambda peak: -peak.score)
    tried = {round((peak.turn + step) / FINE) for peak in coarse[:KEPT] for step in np.arange(-COARSE, COARSE, FINE)}
    peaks = [judge.best(FINE * turn) for turn in sorted(tried)]
    best = max(peaks, key=lambda peak: peak.score)
    rival = max([judge.second(best), *(peak.score for peak in peaks if _apart(peak.turn, best.turn) > 2.0 * COARSE)])
    overlap, agreement, walls = judge.compared(best)
    margin = 1.0 - max(rival, 0.0) / best.score if best.score > 0.0 else 0.0
    return Match(judge.transform(best), overlap, agreement, walls, margin)


@dataclass(frozen=True, slots=True)
class _Peak:
    turn: float
    row: int  # of the shift, among those of the correlation
    column: int
    score: float


def _apart(one: float, other: float) -> float:
    """The angle between two turns, rad."""
    return float(abs((one - other + np.pi) % (2.0 * np.pi) - np.pi))


class _Judge:
    """The scores of all shifts of one map over the other, turn by turn."""

    def __init__(self, fixed: Cells, moving: Cells, meeting: Meeting) -> None:
        self._fixed, self._moving, self._meeting = fixed, moving, meeting
        self._side = int(np.ceil(np.hypot(*moving.shape))) + 2  # of the square that holds the moving map at any turn
        self._shape = tuple(fft.next_fast_len(side + self._side, real=True) for side in fixed.shape)
        near = ndimage.maximum_filter((fixed == OCCUPIED).astype(np.float32), 3)
        self._walls = np.maximum(0.5 * near, fixed == OCCUPIED)
        clear = (fixed == FREE) & (near == 0.0)
        self._spectra = {
            lenient: [
                fft.rfft2(one.astype(np.float32), self._shape, workers=1)
                for one in (WALL * self._walls - clash * clear, FLOOR * clear - clash * (fixed == OCCUPIED))
            ]
            for lenient, clash in ((True, LENIENT), (False, CLASH))
        }

    def turned(self, turn: float) -> Cells:
        """The moving map at a turn about the middle of a square that holds it."""
        middle = (np.array(self._moving.shape) - 1) / 2.0
        cos, sin = np.cos(turn), np.sin(turn)
        matrix = np.array([[cos, -sin], [sin, cos]])  # from the turned square to the map
        offset = middle - matrix @ np.full(2, (self._side - 1) / 2.0)
        return np.asarray(
            ndimage.affine_transform(
                self._moving, matrix, offset, (self._side, self._side), order=0, mode="constant", cval=UNKNOWN
            ),
            np.uint8,
        )

    def _scores(self, turn: float, lenient: bool = False) -> NDArray[np.float32]:
        turned = self.turned(turn)
        walls = (turned == OCCUPIED).astype(np.float32)
        clear = ((turned == FREE) & (ndimage.maximum_filter(walls, 3) == 0.0)).astype(np.float32)
        sums = sum(
            spectrum * np.conj(fft.rfft2(one, self._shape, workers=1))
            for spectrum, one in zip(self._spectra[lenient], (walls, clear), strict=True)
        )
        return np.asarray(fft.irfft2(sums, self._shape, workers=1), np.float32)

    def _window(self, turn: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The rows and columns of shifts that leave the robots as near to each other as they are."""
        middle = (np.array(self._moving.shape) - 1) / 2.0
        cos, sin = np.cos(turn), np.sin(turn)
        row, column = np.array(self._meeting.moving) - middle
        centre = (self._side - 1) / 2.0
        place = np.array([row * cos + column * sin + centre, column * cos - row * sin + centre])
        shift = np.round(np.array(self._meeting.fixed) - place).astype(np.int64)
        reach = np.arange(-int(self._meeting.within), int(self._meeting.within) + 1)
        return (shift[0] + reach) % self._shape[0], (shift[1] + reach) % self._shape[1]

    def best(self, turn: float, lenient: bool = False) -> _Peak:
        """The best shift at a turn."""
        rows, columns = self._window(turn)
        scores = self._scores(turn, lenient)[np.ix_(rows, columns)]
        row, column = np.unravel_index(int(scores.argmax()), scores.shape)
        return _Peak(float(turn), int(rows[row]), int(columns[column]), float(scores[row, column]))

    def second(self, best: _Peak) -> float:
        """The score of the best shift at the same turn that is another one: more than three cells away."""
        rows, columns = self._window(best.turn)
        down, right = (
            np.minimum((at - peak) % side, (peak - at) % side)
            for at, peak, side in ((rows, best.row, self._shape[0]), (columns, best.column, self._shape[1]))
        )
        scores = self._scores(best.turn)[np.ix_(rows, columns)]
        others = (down[:, None] > 3) | (right > 3)
        return float(scores[others].max(initial=0.0))

    def shift(self, peak: _Peak) -> tuple[int, int]:
        """Where the lower left cell of the turned square lies in the fixed map."""
        rows, columns = self._shape
        return (
            peak.row - rows if peak.row > self._fixed.shape[0] else peak.row,
            peak.column - columns if peak.column > self._fixed.shape[1] else peak.column,
        )

    def transform(self, peak: _Peak) -> Transform:
        """The peak as a transform of cells' centres, row and column counted from the corner of cell (0, 0)."""
        cos, sin = np.cos(peak.turn), np.sin(peak.turn)
        down, right = self.shift(peak)
        middle = np.array(self._moving.shape) / 2.0
        centre = np.array([down, right]) + self._side / 2.0
        matrix = np.array([[cos, sin], [-sin, cos]])
        rows, columns = centre - matrix @ middle
        return Transform(peak.turn, float(rows), float(columns))

    def compared(self, peak: _Peak) -> tuple[int, float, int]:
        """The overlap in cells, the share of it that agrees, and how many walls lie on walls."""
        turned = self.turned(peak.turn)
        down, right = self.shift(peak)
        rows, columns = self._fixed.shape
        placed = np.zeros_like(self._fixed)
        low, left = max(down, 0), max(right, 0)
        high, end = min(down + self._side, rows), min(right + self._side, columns)
        if high > low and end > left:
            placed[low:high, left:end] = turned[low - down : high - down, left - right : end - right]
        both = (placed != UNKNOWN) & (self._fixed != UNKNOWN)
        near_wall = self._walls > 0.0
        walls = both & (placed == OCCUPIED) & near_wall
        around = ndimage.maximum_filter((placed == OCCUPIED).astype(np.uint8), 3) > 0
        free = both & (placed == FREE) & ((self._fixed == FREE) | around)
        overlap = int(both.sum())
        return overlap, float((walls | free).sum() / overlap) if overlap else 0.0, int(walls.sum())
