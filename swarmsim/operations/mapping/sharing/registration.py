"""Aligns two maps of robots that do not know each other's places: a turn and a shift, or no answer.

One map is turned step by step; for each turn all shifts are judged at once, by correlating both maps' occupied and free
cells (as Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25 (2008), and Birk and
Carpin, "Merging Occupancy Grid Maps From Multiple Robots", Proceedings of the IEEE 94 (2006), judge overlaps by
agreement). There is an answer only if it is good and nothing else is nearly as good: a wrong merge spoils both maps, a
late one only costs time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, optimize

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN

Cells = NDArray[np.uint8]  # (rows, columns): UNKNOWN, FREE or OCCUPIED
Points = NDArray[np.float64]  # (p, 2): row and column

COARSE: Final = np.deg2rad(3.0)  # between the turns that are tried first ...
FINE: Final = np.deg2rad(0.5)  # ... and between those around the best of them
KEPT: Final = 12  # coarse turns that are refined
WALL: Final = 4.0  # score of a wall on a wall; beside it, half of that
FLOOR: Final = 0.3  # score of free floor on free floor, away from walls
CLASH: Final = 20.0  # cost of a wall on free floor, away from walls, since one place cannot be both ...
ROUNDED: Final = 1.5  # cells by which robots may seem to have been farther apart than they were
NEAR: Final = 2.0  # cells from a wall, within which another one may be the same ...
LEVER: Final = 20.0  # ... when a transform is refined; cells that weigh a turn against a shift
LENIENT: Final = 8.0  # ... but less while turns are coarse, and the ends of a map may lie beside their place


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


@dataclass(frozen=True, slots=True)
class Match:
    """The best transform, and how good it is."""

    transform: Transform
    overlap: int  # cells that both maps know
    agreement: float  # share of the overlap that agrees
    walls: int  # occupied cells of the one map that lie on walls of the other
    margin: float  # its lead, as a share of its score, over the best different one

    def accepted(self, agreement: float = 0.97, walls: int = 25, margin: float = 0.08) -> bool:
        """Whether to accept it: both maps agree, by enough walls, and nothing else is nearly as good."""
        return self.agreement >= agreement and self.walls >= walls and self.margin >= margin


@dataclass(frozen=True, slots=True, eq=False)
class Meetings:
    """The meetings of two robots: their places, each on its own map."""

    fixed: Points  # (m, 2): row and column, in cells, of the fixed map's robot each time
    moving: Points  # (m, 2): the same for the other, on the other map
    within: float  # cells, their largest distance


def register(fixed: Cells, moving: Cells, meetings: Meetings) -> Match | None:
    """How `moving` lies in `fixed`, by meetings of their robots; None without walls or an answer."""
    if not (fixed == OCCUPIED).any() or not (moving == OCCUPIED).any():
        return None
    judge = _Judge(fixed, moving, meetings)
    coarse = [judge.best(turn, lenient=True) for turn in np.arange(-np.pi, np.pi - 1e-9, COARSE)]
    coarse.sort(key=lambda peak: -peak.score)
    tried = {round((peak.turn + step) / FINE) for peak in coarse[:KEPT] for step in np.arange(-COARSE, COARSE, FINE)}
    peaks = [judge.best(FINE * turn) for turn in sorted(tried)]
    best = max(peaks, key=lambda peak: peak.score)
    if best.score <= 0.0:
        return None
    rival = max([judge.second(best), *(peak.score for peak in peaks if _apart(peak.turn, best.turn) > 2.0 * COARSE)])
    overlap, agreement, walls = judge.compared(best)
    return Match(
        _settled(judge.transform(best), fixed, moving), overlap, agreement, walls, 1.0 - max(rival, 0.0) / best.score
    )


def _settled(first: Transform, fixed: Cells, moving: Cells) -> Transform:
    """A transform refined so that walls lie on walls to less than a cell.

    Least squares over the distances of one map's walls to the nearest walls of the other, where these are near, as in
    iterative closest points (Besl and McKay 1992) with a loss that ignores far ones.
    """
    away: Points = ndimage.distance_transform_edt(fixed != OCCUPIED)
    walls: Points = np.argwhere(moving == OCCUPIED).astype(np.float64) + 0.5
    walls = walls[ndimage.map_coordinates(away, (first.apply(walls) - 0.5).T, order=1, mode="nearest") <= NEAR]
    if len(walls) < 3:
        return first
    pivot: Points = np.asarray(walls.mean(axis=0), np.float64)
    ((row, column),) = first.apply(pivot[None])

    def placed(change: NDArray[np.float64]) -> Transform:
        turn = Transform(first.turn + change[0] / LEVER, 0.0, 0.0)
        ((rows, columns),) = turn.apply(pivot[None])
        return Transform(turn.turn, float(row + change[1] - rows), float(column + change[2] - columns))

    def distances(change: NDArray[np.float64]) -> NDArray[np.float64]:
        at = (placed(change).apply(walls) - 0.5).T
        return np.asarray(ndimage.map_coordinates(away, at, order=1, mode="nearest"))

    found = optimize.least_squares(distances, np.zeros(3), loss="soft_l1", f_scale=0.5, diff_step=0.05, max_nfev=40)
    return placed(found.x) if np.abs(found.x).max() <= NEAR else first


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

    def __init__(self, fixed: Cells, moving: Cells, meetings: Meetings) -> None:
        self._fixed, self._moving, self._meetings = fixed, moving, meetings
        self._side = int(np.ceil(np.hypot(*moving.shape))) + 2  # of the square that holds the moving map at any turn
        self._shape: tuple[int, int] = tuple(fft.next_fast_len(side + self._side, real=True) for side in fixed.shape)
        near: NDArray[np.float32] = ndimage.maximum_filter((fixed == OCCUPIED).astype(np.float32), 3)
        self._walls = np.maximum(0.5 * near, fixed == OCCUPIED)
        clear: NDArray[np.bool_] = (fixed == FREE) & (near == 0.0)
        self._spectra: dict[bool, list[NDArray[np.complex64]]] = {
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
        walls: NDArray[np.float32] = (turned == OCCUPIED).astype(np.float32)
        clear: NDArray[np.float32] = ((turned == FREE) & (ndimage.maximum_filter(walls, 3) == 0.0)).astype(np.float32)
        sums = sum(
            spectrum * np.conj(fft.rfft2(one, self._shape, workers=1))
            for spectrum, one in zip(self._spectra[lenient], (walls, clear), strict=True)
        )
        return np.asarray(fft.irfft2(sums, self._shape, workers=1), np.float32)

    def _window(self, turn: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """The rows and columns of shifts, and which of them keep the robots within their meeting distance."""
        middle = (np.array(self._moving.shape) - 1) / 2.0
        away = Transform(turn, 0.0, 0.0).apply(self._meetings.moving - middle) + (self._side - 1) / 2.0
        wanted = self._meetings.fixed - away  # (m, 2): the shift that puts both on one place
        reach = self._meetings.within + ROUNDED
        low, high = np.ceil(wanted.max(axis=0) - reach), np.floor(wanted.min(axis=0) + reach)
        down, right = (np.arange(low[axis], high[axis] + 1.0) for axis in (0, 1))
        apart = np.hypot(down[:, None, None] - wanted[:, 0], right[None, :, None] - wanted[:, 1])
        near: NDArray[np.bool_] = np.asarray((apart <= reach).all(axis=2))
        return down.astype(np.int64) % self._shape[0], right.astype(np.int64) % self._shape[1], near

    def best(self, turn: float, lenient: bool = False) -> _Peak:
        """The best shift at a turn."""
        rows, columns, near = self._window(turn)
        if not near.any():
            return _Peak(float(turn), 0, 0, -np.inf)
        scores = np.where(near, self._scores(turn, lenient)[np.ix_(rows, columns)], -np.inf)
        row, column = np.unravel_index(int(scores.argmax()), scores.shape)
        return _Peak(float(turn), int(rows[row]), int(columns[column]), float(scores[row, column]))

    def second(self, best: _Peak) -> float:
        """The score of the best different shift at the same turn: more than three cells away."""
        rows, columns, near = self._window(best.turn)
        down, right = (
            np.minimum((at - peak) % side, (peak - at) % side)
            for at, peak, side in ((rows, best.row, self._shape[0]), (columns, best.column, self._shape[1]))
        )
        scores = self._scores(best.turn)[np.ix_(rows, columns)]
        return float(scores[near & ((down[:, None] > 3) | (right > 3))].max(initial=0.0))

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
        """The overlap in cells, the share that agrees, and how many walls lie on walls."""
        turned = self.turned(peak.turn)
        down, right = self.shift(peak)
        rows, columns = self._fixed.shape
        placed = np.zeros_like(self._fixed)
        low, left = max(down, 0), max(right, 0)
        high, end = min(down + self._side, rows), min(right + self._side, columns)
        if high > low and end > left:
            placed[low:high, left:end] = turned[low - down : high - down, left - right : end - right]
        both: NDArray[np.bool_] = (placed != UNKNOWN) & (self._fixed != UNKNOWN)
        near_wall = self._walls > 0.0
        walls: NDArray[np.bool_] = both & (placed == OCCUPIED) & near_wall
        around: NDArray[np.bool_] = ndimage.maximum_filter((placed == OCCUPIED).astype(np.uint8), 3) > 0
        free: NDArray[np.bool_] = both & (placed == FREE) & ((self._fixed == FREE) | around)
        overlap = int(both.sum())
        return overlap, float((walls | free).sum() / overlap) if overlap else 0.0, int(walls.sum())
