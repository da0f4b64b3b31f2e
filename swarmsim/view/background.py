"""The lowest shapes of a picture, cached between moments: static shapes, and the cells over them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

import numpy as np
import pygame
from numpy.typing import NDArray

from swarmsim.core.drawing import Mark, Raster
from swarmsim.view.painter import Painter, opaque

FINEST = 5760  # pixels: the greatest width at which static shapes are drawn before they are scaled down


class Background:
    """A picture of the building, updated with the map of each moment."""

    def __init__(self, painter: Painter, size: tuple[int, int], finest: int = FINEST) -> None:
        """`size` and `finest`, the width at which static shapes are drawn, are in pixels."""
        self.camera = painter.camera
        self._painter, self._finer = painter, min(3, max(1, finest // size[0]))
        self._still = opaque(size)
        self._still.fill(painter.theme.background)
        self._plain, self.surface = self._still.copy(), self._still.copy()  # with cells; with the shapes over them
        self._over = pygame.Surface(size, pygame.SRCALPHA, 32)
        self._of: list[tuple[object, ...]] = []  # what the surfaces show
        self._values: list[NDArray[np.uint8]] = []

    def show(self, marks: Sequence[Mark]) -> Sequence[Mark]:
        """Draw as many of the lowest shapes as can be cached; gives the others."""
        below = list(takewhile(lambda mark: mark.still and not isinstance(mark, Raster), marks))
        rest = marks[len(below) :]
        cells = [mark for mark in takewhile(lambda mark: isinstance(mark, Raster), rest) if isinstance(mark, Raster)]
        cells = [one for one in cells if _place(one) == _place(cells[0])]
        over = list(takewhile(lambda mark: mark.still and not isinstance(mark, Raster), rest[len(cells) :]))
        of: list[tuple[object, ...]] = [(type(mark), mark.name, mark.z) for mark in (*below, *over)]
        of += [(*_place(one), one.palette) for one in cells]
        if of != self._of:
            self._begin(below, cells, over)
            self._of = of
        if cells:
            self._fill(cells)
        return rest[len(cells) + len(over) :]

    def _begin(self, below: Sequence[Mark], cells: Sequence[Raster], over: Sequence[Mark]) -> None:
        """Draw the static shapes."""
        size = self._still.get_size()
        self._still.fill(self._painter.theme.background)
        self._over.fill((0, 0, 0, 0))
        for sheet, marks in ((self._still, below), (self._over, over)):
            for mark in marks:
                sheet.blit(self._painter.sheet(mark, size, self._finer), (0, 0))
        self._plain.blit(self._still, (0, 0))
        self.surface.blit(self._still, (0, 0))
        self.surface.blit(self._over, (0, 0))
        self._values = [np.zeros_like(one.values) for one in cells]
        self._colours = [self._painter.theme.shades(one.palette) for one in cells]
        if cells:
            self._x, self._y = self._painter.areas_of(cells[0])

    def _fill(self, cells: Sequence[Raster]) -> None:
        """Colour the cells that have changed, below the shapes over them."""
        differ: NDArray[np.bool_] = np.logical_or.reduce(
            [one.values != values for one, values in zip(cells, self._values, strict=True)]
        )
        places = np.argwhere(differ)
        if not len(places):
            return
        # Few cells change at a time, so filling them is faster than scaling the whole map.
        colours, clear = np.zeros((len(places), 3), np.uint8), np.ones(len(places), np.bool_)
        for one, shades in zip(cells, self._colours, strict=True):
            values = one.values[tuple(places.T)]
            colours[values > 0] = shades[values[values > 0]]
            clear &= values == 0
        x, y, changed = self._x, self._y, pygame.Rect(0, 0, 0, 0)
        for (r, c), colour, empty in zip(places.tolist(), colours.tolist(), clear.tolist(), strict=True):
            area = pygame.Rect(x[c], y[r + 1], x[c + 1] - x[c], y[r] - y[r + 1])
            self._plain.blit(self._still, area, area) if empty else self._plain.fill(colour, area)
            changed = changed.union(area) if changed.width else area
        self.surface.blit(self._plain, changed, changed)
        self.surface.blit(self._over, changed, changed)
        self._values = [one.values.copy() for one in cells]


def _place(raster: Raster) -> tuple[object, ...]:
    return raster.corner, raster.cell, raster.values.shape
