"""What jobs and probes declare to be drawn: fields, pieces and their holders, halos, numbers and estimated places."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.drawing import Circles, Ink, Lines, Mark, Polygons, Raster, Reals, Texts, Whole, ends_of
from swarmsim.core.probes import GONE, NOBODY, Declared, ProbeTable
from swarmsim.view.layers.robots import bodies, forms, inks_of_robots
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.signs import Sign, ramp
from swarmsim.view.style import Style

FIELD, PIECES, HALOS, NUMBERS, SPOTS, PLACES, RINGS = 10.5, 36.0, 72.0, 74.0, 87.0, 88.0, 101.5  # z
#: The colours of viridis (van der Walt and Smith 2015), which colour-blind people and printers keep in order.
SCALE: Final = (
    "#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725",
)  # fmt: skip
STEPS: Final = tuple((1 + 31 * step, 31 + 31 * step, *pair) for step, pair in enumerate(pairwise(SCALE)))
MOST: Final = STEPS[-1][1]
FLASH: Final = 15  # iterations for which a piece that was taken over stands out
INSET: Final = 0.3  # cells by which outlines lie within their pieces
DISC: Final = 0.016  # of the picture's longer side: the radius of the disc under a holder's number
PLUS: Final = 0.55 * np.array(
    [(0.3, 0.3), (0.3, 1), (-0.3, 1), (-0.3, 0.3), (-1, 0.3), (-1, -0.3), (-0.3, -0.3), (-0.3, -1), (0.3, -1),
     (0.3, -0.3), (1, -0.3), (1, 0.3)]
)  # fmt: skip
ONE: Final = np.zeros(1, np.int64)


class DrawnTable(ABC):
    """A table that is drawn; each kind has a class of its own."""

    name = "jobs"

    def __init__(self, scene: Scene, declared: Declared, table: ProbeTable) -> None:
        self._scene, self._table, self._of = scene, table, declared.called(table)
        self._said = f"{declared.name.replace('_', ' ')}: {table.meaning or table.name}"
        self._row = -1

    @abstractmethod
    def draw(self, shot: Frame) -> Sequence[Mark]:
        """The shapes of a moment."""

    @abstractmethod
    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The signs of the legend."""

    @property
    def scale(self) -> str:
        """What the colours of the scale mean; nothing for shapes that have none."""
        return ""

    def _values(self, shot: Frame, back: int = 0) -> NDArray[np.generic]:
        return shot.recorded(self._of, back)

    def _limits(self) -> tuple[float, float]:
        """The least and the greatest finite number of the whole run; from 0 unless all are far from it."""
        table = np.asarray(self._scene.recording[self._of], np.float64)
        finite = table[np.isfinite(table)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
        return (0.0 if 0.0 <= low < 0.5 * high else low), high

    def _shares(self, values: NDArray[np.generic]) -> Reals:
        """Numbers from 0 to 1 on the scale of the run; NaN stays."""
        low, high = self._ends
        found = np.asarray(values, np.float64)
        return np.clip((np.where(np.isfinite(found), found, np.nan) - low) / ((high - low) or 1.0), 0.0, 1.0)

    @property
    def _ends(self) -> tuple[float, float]:
        """The ends of the scale, for everything recorded so far."""
        if self._row != self._scene.iterations:
            self._row, self._scale = self._scene.iterations, self._limits()
        return self._scale


class ScaledTable(DrawnTable, ABC):
    """A table of numbers in the colours of the scale."""

    @property
    def scale(self) -> str:
        """What is drawn, with the ends of the scale and its unit."""
        low, high = self._ends
        return f"{self._said}, {low:.3g} to {high:.3g} {self._table.unit}".rstrip()

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The scale."""
        return [Sign(self._of, self.scale, ramp(*SCALE))]


class FieldTable(ScaledTable):
    """A field over cells."""

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Cells in the colours of the scale."""
        shares, lattice = self._shares(self._values(shot)), self._scene.lattice
        values = np.nan_to_num(1.0 + np.rint((MOST - 1) * shares), nan=0.0).astype(np.uint8)
        return [Raster(values, (lattice.x0, lattice.y0), lattice.cell, STEPS, name=self._of, z=FIELD)]


class HolderTable(DrawnTable):
    """The outlines of pieces in the colours of the robots that compute them."""

    def __init__(self, scene: Scene, declared: Declared, table: ProbeTable, pieces: ProbeTable) -> None:
        super().__init__(scene, declared, table)
        self._count = int(table.shape[0])
        of = np.asarray(scene.recording[declared.called(pieces)][0])
        left, right, low, high = scene.bounds
        self._disc = DISC * max(right - left, high - low)  # m
        self._rings = [list(_outline(scene, of == piece)) for piece in range(self._count)]
        self._middles = np.array([_middle(scene, of == piece) for piece in range(self._count)]).reshape(-1, 2)

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Outlines, the robots' numbers, bright lines around what was just taken over, and rings around holders."""
        holder = np.asarray(self._values(shot), np.int64)
        inks = [f"robot {one}" if one >= 0 else "lost" if one == GONE else "dead" for one in holder.tolist()]
        found: list[Mark] = [*self._outlines(range(self._count), inks, 2.5)]
        taken = self._taken(shot)
        found += self._outlines(taken, ["mark"] * len(taken), 5.0) if taken else []
        words = [str(one) if one >= 0 else "x" if one == GONE else "?" for one in holder.tolist()]
        found.append(Circles(self._middles, self._disc, "#101420", None, 0.7, name="holder", z=NUMBERS))
        found.append(Texts(self._middles, words, 16.0, "#ffffff", name="holder", z=NUMBERS + 0.1))
        robots = np.unique(holder[holder >= 0])
        robots = robots[shot.alive[robots]]
        return [*found, Circles(shot.pose[robots, :2], 1.5, "curve", stroke=0.22, unit="body", of=robots, rides=True,
                                name="holds a piece", z=RINGS)]  # fmt: skip

    def _taken(self, shot: Frame) -> list[int]:
        """The pieces that went to another robot a short time ago."""
        if self._row != self._scene.iterations:  # more has been recorded
            self._row, self._changed = self._scene.iterations, _taken_over(self._scene.recording[self._of])
        return np.flatnonzero(self._changed[max(shot.row + 1 - FLASH, 0) : shot.row + 1].any(axis=0)).tolist()

    def _outlines(self, pieces: Sequence[int], inks: Sequence[Ink], width: float) -> Iterator[Mark]:
        rings = [(ring, ink) for piece, ink in zip(pieces, inks, strict=True) for ring in self._rings[piece]]
        points, ends = ends_of(ring for ring, _ in rings)
        for edge, broad in (("edge", width + 1.5), ([ink for _, ink in rings], width)):
            yield Polygons(points, ends, None, edge, broad, name="piece", z=PIECES + 0.1 * (width > 3.0))

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A piece with its holder, and what becomes of it."""
        square = np.array([(-7.0, -5.0), (7.0, -5.0), (7.0, 5.0), (-7.0, 5.0)])
        recorded = np.asarray(scene.recording[self._of])
        pose = np.array([(0.0, 0.0, 0.5)])
        ring = Circles(pose[:, :2], 1.5, "curve", stroke=0.22, unit="body", of=ONE)
        found = [Sign("holder", self._said, [_square(square, "robot 0"), ring, *bodies(pose, ONE)])]
        for there, ink, text in (
            (_taken_over(recorded).any(), "mark", "piece just taken over"),
            ((recorded == NOBODY).any(), "dead", "nobody computes it"),
            ((recorded == GONE).any(), "lost", "lost: no living robot has it"),
        ):  # fmt: skip
            found += [Sign(text, text, [_square(square, ink)])] * bool(there)
        return found


class LinkTable(DrawnTable):
    """Who has got something from whom."""

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Short arrows half way from the giver to the taker."""
        given = np.asarray(self._values(shot), np.int64)
        taker, place = np.nonzero(given >= 0)
        both = shot.alive[taker] & shot.alive[given[taker, place]]
        taker, giver = taker[both], given[taker, place][both]
        return [arrows(shot.pose[giver, :2], shot.pose[taker, :2], self._of)] if len(taker) else []

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """An arrow."""
        return [Sign(self._of, self._said, [arrows(np.array([(-20.0, 0.0)]), np.array([(20.0, 0.0)]), "")])]


class NumberTable(ScaledTable):
    """A number of each robot, as the colour of a ring around it."""

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Rings in the colours of the scale."""
        shares = self._shares(self._values(shot))
        robots = np.flatnonzero(shot.alive & np.isfinite(shares))
        inks = [_blend(share) for share in shares[robots].tolist()]
        return [_ring(shot.pose[robots], robots, inks, self._of)]


class PlaceTable(DrawnTable):
    """Where robots take something to be, and how sure they are."""

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """A plus at each place, and a ring as large as the standard deviation."""
        told = np.asarray(self._values(shot), np.float64)
        robots = np.flatnonzero(shot.alive & np.isfinite(told).all(axis=1) & (told[:, 2] >= 0.0))
        return _places(told[robots], robots, self._of) if len(robots) else []

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """One of each."""
        return [Sign(self._of, f"{self._said} and spread", _places(np.array([(0.0, 0.0, 8.0)]), ONE, ""))]


class SpotTable(DrawnTable):
    """Where something is."""

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """A white disc within a dark and a white ring at each place."""
        places = np.asarray(self._values(shot), np.float64)
        there = places[np.isfinite(places).all(axis=1)]
        left, right, low, high = self._scene.bounds
        return _spots(there, DISC * max(right - left, high - low), self._of) if len(there) else []

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """One of them."""
        return [Sign(self._of, self._said, _spots(np.zeros((1, 2)), 8.0, ""))]


def job_layers(scene: Scene) -> list[DrawnTable]:
    """A layer for each table that a recording's jobs and probes declare to be drawn."""
    found: list[DrawnTable] = []
    kinds: dict[str, type[DrawnTable]] = {
        "field": FieldTable,
        "links": LinkTable,
        "robots": NumberTable,
        "places": PlaceTable,
        "spots": SpotTable,
    }
    for declared in scene.recording.probes:
        pieces = next((one for one in declared.tables if one.drawn == "pieces"), None)
        for table in declared.tables:
            if table.drawn in kinds:
                found.append(kinds[table.drawn](scene, declared, table))
            elif table.drawn == "holders" and pieces is not None:
                found.append(HolderTable(scene, declared, table, pieces))
    return found


def _taken_over(holders: NDArray[np.generic]) -> NDArray[np.bool_]:
    """Where (t, p) a piece has come to another robot than the last one that held it."""
    held = np.asarray(holders) >= 0
    since = np.maximum.accumulate(np.where(held, np.arange(len(held))[:, None], 0), axis=0)  # the last row with one
    last = np.take_along_axis(np.asarray(holders), since, axis=0)
    return np.concatenate([np.zeros_like(held[:1]), held[1:] & (last[:-1] >= 0) & (last[1:] != last[:-1])])


def _outline(scene: Scene, cells: NDArray[np.bool_]) -> Iterator[Reals]:
    """The rings, a little within, around cells (rows, columns), in m."""
    row, column = np.argwhere(cells).T.astype(np.float64)  # whole numbers, so that edges meet
    whole = shapely.union_all(shapely.box(column, row, column + 1.0, row + 1.0))
    for part in shapely.get_parts(shapely.buffer(whole, -INSET, join_style="mitre")):
        for ring in (part.exterior, *part.interiors) if not part.is_empty else ():
            corner = np.array([scene.lattice.x0, scene.lattice.y0])
            yield corner + scene.lattice.cell * shapely.get_coordinates(ring)[:-1]


def _middle(scene: Scene, cells: NDArray[np.bool_]) -> Reals:
    """The centre (2,) of the cell in m that lies nearest to the middle of all."""
    at = scene.lattice.centres(np.argwhere(cells)).reshape(-1, 2)
    if not len(at):
        return np.array([scene.lattice.x0, scene.lattice.y0])
    return np.asarray(at[np.hypot(*(at - at.mean(axis=0)).T).argmin()])


def _square(corners: Reals, ink: Ink) -> Polygons:
    return Polygons(corners, np.array([4]), None, ink, 2.5)


def arrows(start: Reals, end: Reals, name: str) -> Lines:
    """Short dashed arrows (k,) in the middle of the ways from `start` (k, 2) to `end` (k, 2)."""
    parts = np.stack([start + 0.36 * (end - start), start + 0.64 * (end - start)], axis=1)
    points, ends = parts.reshape(-1, 2), 2 * np.arange(1, len(start) + 1)
    return Lines(points, ends, "curve", "edge", 2.0, dash="dashed", arrow=True, name=name, z=HALOS)


def _ring(pose: Reals, of: Whole, inks: Sequence[Ink], name: str) -> Circles:
    return Circles(pose[:, :2], 1.9, inks, stroke=0.6, unit="body", of=of, rides=True, name=name, z=RINGS)


def _places(told: Reals, of: Whole, name: str) -> list[Mark]:
    inks = inks_of_robots(of)
    rings = Circles(told[:, :2], told[:, 2], inks, None, stroke=1e-6, of=of, name=f"{name} spread", z=PLACES)
    return [rings, forms(told[:, :2], PLUS, of, inks, PLACES, name)]


def _spots(places: Reals, radius: float, name: str) -> list[Mark]:
    rings = [(1.0, "#ffffff"), (0.8, "#101420"), (0.35, "#ffffff")]
    return [Circles(places, share * radius, ink, None, name=name, z=SPOTS) for share, ink in rings]


def _blend(share: float) -> Ink:
    """The colour of a share, 0 to 1, on the scale."""
    step = min(int(share * (len(SCALE) - 1)), len(SCALE) - 2)
    part = share * (len(SCALE) - 1) - step
    low, high = (np.array([int(ink[at : at + 2], 16) for at in (1, 3, 5)]) for ink in SCALE[step : step + 2])
    return "#" + bytes(np.rint(low + part * (high - low)).astype(np.uint8).tolist()).hex()
