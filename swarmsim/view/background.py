"""What robots move on: the building, and what is known of it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pygame
import shapely
from numpy.typing import NDArray

from swarmsim.core.state import OCCUPIED, UNKNOWN
from swarmsim.view.camera import Camera
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.symbols import Pixel, opaque
from swarmsim.view.theme import Colour

FINEST = 5760  # pixels, the greatest width at which what stands still is drawn before it is reduced
#: What is known of a cell: how many robots know it, or one of these.
NOTHING, SEEN, OF_OTHERS = 0, -1, -2


class Background:
    """A picture of the building, kept up with the map of one moment after the other."""

    def __init__(
        self, scene: Scene, look: Style, camera: Camera, size: tuple[int, int], line: int, finest: int = FINEST
    ) -> None:
        """`size`, the width of a `line` and what still life is drawn at, `finest`, are in pixels."""
        self._scene, self._look, self._theme, self._camera = scene, look, look.colours, camera
        still, self._edges = self._building(size, line, min(3, max(1, finest // size[0])))
        lattice = scene.lattice
        lines = lattice.centres(np.arange(max(lattice.shape) + 1)[:, None].repeat(2, axis=1)) - 0.5 * lattice.cell
        # Whole pixels, so that neighbouring cells neither overlap nor leave a gap.
        self._columns, self._rows = np.rint(camera.pixels(lines)).astype(int).T.tolist()
        self._still, self._plain = still, still.copy()
        self.surface = still.copy()  # what is to be seen; overwritten by `show`
        self._levels = np.full(lattice.shape, NOTHING, np.int32)
        self._row = -1

    def show(self, row: int) -> None:
        """Bring the surface to what is known in a row of the recording, under the edges of what is solid."""
        if row == self._row:
            return
        if row < self._row:
            self._plain, self._levels = self._still.copy(), np.full(self._scene.lattice.shape, NOTHING, np.int32)
        changed = pygame.Rect(0, 0, 0, 0)
        if self._scene.has_maps:
            levels = self._known(row)
            places = np.argwhere(levels != self._levels)
            # Few cells change at a time, so filling them is faster than scaling the whole map.
            new = levels[tuple(places.T)]
            for (r, c), level, colour in zip(places.tolist(), new.tolist(), self._colours(new).tolist(), strict=True):
                area = self._area(r, c)
                if level == NOTHING:
                    self._plain.blit(self._still, area, area)
                else:
                    self._plain.fill(colour, area)
                changed = changed.union(area) if changed.width else area
            self._levels = levels
        if self._row < 0 or row < self._row or self._scene.has_field:
            changed = self.surface.get_rect()
        if changed.width:
            self.surface.blit(self._plain, changed, changed)
            shares = self._scene.estimate(row)
            if shares is not None:
                self._field(shares)
            self.surface.blit(self._edges, changed, changed)
        self._row = row

    def _area(self, r: int, c: int) -> pygame.Rect:
        x, y = self._columns[c], self._rows[r + 1]
        return pygame.Rect(x, y, self._columns[c + 1] - x, self._rows[r] - y)

    def _known(self, row: int) -> NDArray[np.int32]:
        """What is known of each cell (rows, columns), as NOTHING and the others say."""
        scene, focus = self._scene, self._look.focus
        cells, known = scene.cells(row), scene.known(row)
        if focus is None:
            return np.where(cells == OCCUPIED, np.int32(SEEN), known)
        own = scene.own_cells(focus, row)
        levels = np.where(own == OCCUPIED, np.int32(SEEN), np.int32(scene.robots))
        return np.where(own == UNKNOWN, np.where(cells == UNKNOWN, np.int32(NOTHING), np.int32(OF_OTHERS)), levels)

    def _colours(self, levels: NDArray[np.int32]) -> NDArray[np.uint8]:
        theme, most = self._theme, max(self._scene.robots - 1, 1)
        colours = theme.known(np.clip((levels - 1) / most, 0.0, 1.0))
        for level, colour in (
            (SEEN, theme.seen),
            (OF_OTHERS, _mixed(theme.unexplored, theme.few)),
        ):
            colours[levels == level] = colour
        return colours

    def _field(self, shares: NDArray[np.float64]) -> None:
        """Colour the floor by what robots make of the field."""
        colours = self._theme.heat(np.nan_to_num(shares))
        for r, c in np.argwhere(np.isfinite(shares)).tolist():
            self.surface.fill(colours[r, c].tolist(), self._area(r, c))

    def _building(self, size: tuple[int, int], line: int, finer: int) -> tuple[pygame.Surface, pygame.Surface]:
        """What stands still, under the map and over it: drawn `finer` times too large, then reduced."""
        theme, all_layers = self._theme, self._scene.layers
        large = (size[0] * finer, size[1] * finer)
        still = opaque(size)
        still.fill(theme.background)
        solids = [part for layer in all_layers.values() for part in layer.geoms]
        floor = theme.unexplored if self._scene.has_maps else theme.floor
        layers: list[tuple[Iterable[shapely.Polygon], Colour]] = [(self._scene.footprint, floor)]
        layers += [(all_layers[name].geoms, colour) for name, colour in theme.solids.items()]
        for polygons, colour in layers:
            sheet = _sheet(large, colour)
            for part in sorted(polygons, key=lambda part: -shapely.Polygon(part.exterior).area):
                # A hole is cut before what stands inside it is drawn, because that is smaller.
                pygame.draw.polygon(sheet, colour, self._corners(part.exterior, finer))
                for hole in part.interiors:
                    pygame.draw.polygon(sheet, (*colour, 0), self._corners(hole, finer))
            still.blit(pygame.transform.smoothscale(sheet, size), (0, 0))
        sheet = _sheet(large, theme.edge)
        for part in solids:
            for ring in (part.exterior, *part.interiors):
                pygame.draw.lines(sheet, theme.edge, True, self._corners(ring, finer), finer * line)
        return still, pygame.transform.smoothscale(sheet, size)

    def _corners(self, ring: shapely.LinearRing, finer: int) -> list[Pixel]:
        corners: list[Pixel] = (finer * self._camera.pixels(shapely.get_coordinates(ring))).tolist()
        return corners


def _mixed(one: Colour, other: Colour) -> Colour:
    """The colour half way between two."""
    red, green, blue = ((a + b) // 2 for a, b in zip(one, other, strict=True))
    return red, green, blue


def _sheet(size: tuple[int, int], colour: Colour) -> pygame.Surface:
    """A clear surface of the colour that will be drawn on it, so that reducing it leaves no dark fringe."""
    sheet = pygame.Surface(size, pygame.SRCALPHA, 32)
    sheet.fill((*colour, 0))
    return sheet
