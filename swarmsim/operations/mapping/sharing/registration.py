"""Aligns two maps of robots that do not know each other's places, and tells where else one may lie on the other.

One map is turned step by step; for each turn all shifts are judged at once, by correlating both maps' occupied and free
cells (as Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25 (2008), and Birk and
Carpin, "Merging Occupancy Grid Maps From Multiple Robots", Proceedings of the IEEE 94 (2006), judge overlaps by
agreement). The best place may still be a wrong one, where rooms are equal: it is proved only once both maps contradict
each other in every other place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.sharing.places import (
    ASIDE,
    ASKEW,
    Cells,
    Match,
    Place,
    Points,
    Transform,
    between,
    judged,
)  # fmt: skip
from swarmsim.operations.mapping.sharing.refining import refined

COARSE: Final = np.deg2rad(3.0)  # between the turns that are tried first ...
FINE: Final = np.deg2rad(0.5)  # ... and between those around the best of them
KEPT: Final = 8  # coarse turns that are refined
WALL: Final = 4.0  # score of a wall on a wall; beside it, half of that
FLOOR: Final = 0.3  # score of free floor on free floor, away from walls
CLASH: Final = 20.0  # cost of a wall on free floor, away from walls, since one place cannot be both ...
ROUNDED: Final = 1.5  # cells by which robots may seem to have been farther apart than they were
LENIENT: Final = 8.0  # ... but less while turns are coarse, and the ends of a map may lie beside their place
SKEWED: Final = 4  # turns oblique to the best one at which other places are looked for ...
AROUND: Final = np.deg2rad(np.arange(-1.5, 1.6, 0.5))  # ... each with these around it


@dataclass(frozen=True, slots=True, eq=False)
class Meetings:
    """The meetings of two robots, or of one and those linked to the other: their places, each on its own map."""

    fixed: Points  # (m, 2): row and column, in cells, of the fixed map's robot each time
    moving: Points  # (m, 2): the same for the other, on the other map
    within: float | NDArray[np.float64]  # cells, their largest distance, or that of each meeting (m,)

    @property
    def spread(self) -> float:
        """How far apart the meetings were, on the map where that is less, in cells."""
        return float(min(np.hypot(*np.ptp(places, axis=0)) for places in (self.fixed, self.moving)))


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
    peaks.sort(key=lambda peak: -peak.score)
    place = judge.place(best)
    others = judge.others(best, [peak.turn for peak in peaks if peak.score > 0.0])
    transform, unsure = refined(place.transform, fixed, moving)
    least = int(others[:, 6].min()) if len(others) else place.overlap  # the meetings may allow no other place
    rivals = judge.distinct(others[others[:, 6] < place.contradictions + place.needed])
    return Match(replace(place, transform=transform), rivals, least - place.contradictions, unsure)


@dataclass(frozen=True, slots=True)
class _Peak:
    turn: float
    row: int  # of the shift, among those of the correlation
    column: int
    score: float


def _is_other(table: NDArray[np.float64], turn: float, spot: Points) -> NDArray[np.bool_]:
    """Which places (s, 8) are others than one with this turn and meeting spot (1, 2)."""
    turned: NDArray[np.float64] = np.abs((table[:, 0] - turn + np.pi) % (2.0 * np.pi) - np.pi)
    return np.asarray((np.hypot(*(table[:, 3:5] - spot).T) > ASIDE) | (turned > ASKEW))


class _Judge:
    """The scores of all shifts of one map over the other, turn by turn."""

    def __init__(self, fixed: Cells, moving: Cells, meetings: Meetings) -> None:
        self._fixed, self._moving, self._meetings = fixed, moving, meetings
        self._side = int(np.ceil(np.hypot(*moving.shape))) + 2  # of the square that holds the moving map at any turn
        self._shape: tuple[int, int] = tuple(fft.next_fast_len(side + self._side, real=True) for side in fixed.shape)
        near: NDArray[np.float32] = ndimage.maximum_filter((fixed == OCCUPIED).astype(np.float32), 3)
        self._walls = np.maximum(0.5 * near, fixed == OCCUPIED)
        clear: NDArray[np.bool_] = (fixed == FREE) & (near == 0.0)
        parts = fixed != UNKNOWN, (near > 0.0) & (fixed != UNKNOWN), clear, fixed == OCCUPIED
        self._plain = [fft.rfft2(one.astype(np.float32), self._shape, workers=1) for one in parts]
        self._spectra: dict[bool, list[NDArray[np.complex64]]] = {
            lenient: [
                fft.rfft2(one.astype(np.float32), self._shape, workers=1)
                for one in (WALL * self._walls - clash * clear, FLOOR * clear - clash * (fixed == OCCUPIED))
            ]
            for lenient, clash in ((True, LENIENT), (False, CLASH))
        }

    def turned(self, turn: float) -> Cells:
        """The moving map at a turn about the middle of a square that holds it."""
        rows, columns = self._moving.shape
        cos, sin = np.cos(turn), np.sin(turn)
        away = np.arange(self._side) - (self._side - 1) / 2.0
        row = np.floor(cos * away[:, None] - sin * away + rows / 2.0).astype(np.intp)  # from the square to the map
        column = np.floor(sin * away[:, None] + cos * away + columns / 2.0).astype(np.intp)
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        np.clip(row, 0, rows - 1, out=row)
        np.clip(column, 0, columns - 1, out=column)
        return np.asarray(self._moving[row, column] * inside, np.uint8)  # UNKNOWN, 0, beyond it

    def _scores(self, turn: float, lenient: bool = False) -> NDArray[np.float32]:
        turned = self.turned(turn)
        walls: NDArray[np.float32] = (turned == OCCUPIED).astype(np.float32)
        clear: NDArray[np.float32] = ((turned == FREE) & (ndimage.maximum_filter(walls, 3) == 0.0)).astype(np.float32)
        sums = sum(
            spectrum * np.conj(fft.rfft2(one, self._shape, workers=1))
            for spectrum, one in zip(self._spectra[lenient], (walls, clear), strict=True)
        )
        return np.asarray(fft.irfft2(sums, self._shape, workers=1), np.float32)

    def _wanted(self, turn: float) -> Points:
        """The shifts (m, 2) that put both robots on one place, meeting by meeting."""
        middle = (np.array(self._moving.shape) - 1) / 2.0
        away = Transform(turn, 0.0, 0.0).apply(self._meetings.moving - middle) + (self._side - 1) / 2.0
        return self._meetings.fixed - away

    def _window(self, turn: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """The rows and columns of shifts, and which of them keep the robots within their meeting distance."""
        wanted = self._wanted(turn)
        reach = np.broadcast_to(self._meetings.within, len(wanted)) + ROUNDED
        low = np.ceil((wanted - reach[:, None]).max(axis=0))
        high = np.floor((wanted + reach[:, None]).min(axis=0))
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

    def others(self, best: _Peak, turns: list[float]) -> NDArray[np.float64]:
        """All other places that the meetings allow, as `_judged` gives them.

        They are looked for at the best turn and those square to it, since buildings are, and at the first of the other
        `turns`.
        """
        tried = [best.turn + quarter for quarter in np.arange(4) * np.pi / 2.0]
        for turn in turns:
            if len(tried) < 4 + SKEWED and min(between(turn, one) for one in tried) > ASKEW:
                tried.append(turn)
        table = np.concatenate([self._judged(turn + step) for turn in tried for step in AROUND])
        spot = self._spot(best.turn, np.array([[best.row, best.column]]))
        return table[_is_other(table, best.turn, spot)]

    def distinct(self, table: NDArray[np.float64]) -> tuple[Place, ...]:
        """One place for each spot and turn: the least contradicted one, by most walls."""
        found: list[Place] = []
        table = table[np.lexsort((-table[:, 7], table[:, 6]))]
        while len(table):
            turn, row, column, *_, overlap, contradictions, walls = table[0].tolist()
            transform = self.transform(_Peak(turn, int(row), int(column), 0.0))
            found.append(Place(transform, int(overlap), int(contradictions), int(walls)))
            table = table[_is_other(table, turn, table[:1, 3:5])]
        return tuple(found)

    def _judged(self, turn: float) -> NDArray[np.float64]:
        """Every shift that the meetings allow at a turn (s, 8).

        Turn, row and column of the shift, row and column of its meeting spot, overlap, contradictions and walls.
        """
        rows, columns, near = self._window(turn)
        if not near.any():
            return np.zeros((0, 8))
        turned = self.turned(turn)
        walls = turned == OCCUPIED
        clear = (turned == FREE) & ~ndimage.maximum_filter(walls, 3)
        known, full, empty = (
            np.conj(fft.rfft2(one.astype(np.float32), self._shape, workers=1))
            for one in (turned != UNKNOWN, walls, clear)
        )
        held, near_walls, far, solid = self._plain
        counts = [
            np.round(fft.irfft2(sums, self._shape, workers=1)[np.ix_(rows, columns)][near])
            for sums in (held * known, far * full + solid * empty, near_walls * full)
        ]
        shifts = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)[near]
        return np.column_stack([np.full(len(shifts), turn), shifts, self._spot(turn, shifts), *counts])

    def _spot(self, turn: float, shifts: NDArray[np.int64]) -> Points:
        """Where shifts (s, 2) put the moving map's robot, from where the fixed map's was, mean over the meetings."""
        rows, columns = self._shape
        down = np.where(shifts[:, 0] > self._fixed.shape[0], shifts[:, 0] - rows, shifts[:, 0])
        right = np.where(shifts[:, 1] > self._fixed.shape[1], shifts[:, 1] - columns, shifts[:, 1])
        return np.asarray(np.stack([down, right], axis=1) - self._wanted(turn).mean(axis=0))

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

    def place(self, peak: _Peak) -> Place:
        """The peak as a place."""
        turned = self.turned(peak.turn)
        down, right = self.shift(peak)
        rows, columns = self._fixed.shape
        placed = np.zeros_like(self._fixed)
        low, left = max(down, 0), max(right, 0)
        high, end = min(down + self._side, rows), min(right + self._side, columns)
        if high > low and end > left:
            placed[low:high, left:end] = turned[low - down : high - down, left - right : end - right]
        return judged(self._fixed, placed, self.transform(peak))
