"""Paints a moment of a run on a surface in memory; no display is needed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pygame
import shapely
from numpy.typing import NDArray

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.view import symbols
from swarmsim.view.panel import Panel
from swarmsim.view.scene import Scene, Shot
from swarmsim.view.symbols import Colour, Lettering, Pixel

FINEST = 5760  # pixels, the greatest width at which what stands still is drawn before it is reduced


class Canvas:
    """The picture of a scene, of one size in pixels."""

    def __init__(self, scene: Scene, size: tuple[int, int]) -> None:
        self._scene = scene
        self._surface = pygame.Surface(size, 0, 32)
        unit = min(size[0] / 1280, size[1] / 720)
        pad, side = round(18 * unit), max(round(322 * unit), 150)
        head = max(20, round(46 * unit))
        self._area = pygame.Rect(pad, head, size[0] - side - 3 * pad, size[1] - head - pad)
        left, right, low, high = scene.bounds
        self._scale = min(self._area.width / (right - left), self._area.height / (high - low))  # pixels per metre
        self._left = self._area.centerx - 0.5 * self._scale * (left + right)
        self._low = self._area.centery + 0.5 * self._scale * (low + high)
        self._line = max(1, round(2 * unit))
        legible = max(8.0 * unit, 5.0)
        self.radius = max(self._scale * scene.radius, legible)
        self._radii = np.maximum(self._scale * scene.radii, legible).tolist()
        self._letters = letters = Lettering()
        self._small = max(12, round(19 * unit))
        self._ids = _ids(scene.robots, self.radius, letters)
        panel = pygame.Rect(size[0] - side - pad, pad, side, size[1] - 2 * pad)
        self._panel = Panel(scene, panel, unit, letters, self._scale * scene.radius < legible)
        self._still, self._edges = self._building(min(3, max(1, FINEST // size[0])))
        self._headline(letters, unit, size[0] - side - 4 * pad)
        lattice = scene.lattice
        lines = lattice.centres(np.arange(max(lattice.shape) + 1)[:, None].repeat(2, axis=1)) - 0.5 * lattice.cell
        # Whole pixels, so that neighbouring cells neither overlap nor leave a gap.
        self._columns, self._rows = np.rint(self.pixels(lines)).astype(int).T.tolist()
        self._plain, self._ground = self._still.copy(), self._still.copy()
        self._cells = np.full(lattice.shape, UNKNOWN, np.uint8)
        self._row = -1

    def draw(self, iteration: float) -> pygame.Surface:
        """The picture after so many iterations; the surface is overwritten by the next call."""
        shot = self._scene.at(iteration)
        if shot.row != self._row:
            self._map(shot.row)
        self._surface.blit(self._ground, (0, 0))
        self._changes(shot)
        self._tiles(shot)
        self._swarm(shot)
        self._captions(shot)
        self._panel.draw(self._surface, shot)
        return self._surface

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points (..., 2) in metres lie on the picture: x to the right, y downwards."""
        places: NDArray[np.float64] = points * (self._scale, -self._scale) + (self._left, self._low)
        return places

    def _building(self, finer: int) -> tuple[pygame.Surface, pygame.Surface]:
        """What stands still, under the map and over it: drawn `finer` times too large, then reduced."""
        size = self._surface.get_size()
        large = (size[0] * finer, size[1] * finer)
        still = pygame.Surface(size, 0, 32)
        still.fill(symbols.BACKGROUND)
        solids = [part for layer in self._scene.layers.values() for part in layer.geoms]
        footprint = [shapely.Polygon(part.exterior) for part in self._scene.layers["walls"].geoms]
        ground = symbols.UNEXPLORED if self._scene.has_maps else symbols.FREE
        layers: list[tuple[Iterable[shapely.Polygon], Colour]] = [(footprint, ground)]
        layers += [(self._scene.layers[name].geoms, colour) for name, colour in symbols.SOLIDS.items()]
        for polygons, colour in layers:
            sheet = _sheet(large, colour)
            for part in sorted(polygons, key=lambda part: -shapely.Polygon(part.exterior).area):
                # A hole is cut before what stands inside it is drawn, because that is smaller.
                pygame.draw.polygon(sheet, colour, self._corners(part.exterior, finer))
                for hole in part.interiors:
                    pygame.draw.polygon(sheet, (*colour, 0), self._corners(hole, finer))
            still.blit(pygame.transform.smoothscale(sheet, size), (0, 0))
        sheet = _sheet(large, symbols.EDGE)
        for part in solids:
            for ring in (part.exterior, *part.interiors):
                pygame.draw.lines(sheet, symbols.EDGE, True, self._corners(ring, finer), finer * self._line)
        return still, pygame.transform.smoothscale(sheet, size)

    def _corners(self, ring: shapely.LinearRing, finer: int) -> list[Pixel]:
        corners: list[Pixel] = (finer * self.pixels(shapely.get_coordinates(ring))).tolist()
        return corners

    def _headline(self, letters: Lettering, unit: float, width: int) -> None:
        """Write the title, and draw a scale bar of a round length below the map."""
        title = letters.fitted(self._scene.title, max(16, round(30 * unit)), symbols.TEXT, width)
        self._still.blit(title, (self._area.left, (self._area.top - title.get_height()) // 2 + 2))
        length = max(
            step * 10.0**power for power in range(-4, 5) for step in (1, 2, 5)
            if step * 10.0**power * self._scale < 0.2 * self._area.width
        )  # fmt: skip
        bar = pygame.Rect(0, 0, round(length * self._scale), max(2, round(4 * unit)))
        bar.bottomleft = (self._area.left, self._area.bottom)
        pygame.draw.rect(self._still, symbols.MUTED, bar)
        text = letters.render(f"{length:g} m", self._small, symbols.MUTED)
        place = text.get_rect(midleft=(bar.right + round(8 * unit) + 2, bar.centery))
        self._still.blit(text, place)
        self._captions_from = place.right + self._small

    def _map(self, row: int) -> None:
        """Bring the ground to the collective map of a row of the recording, under the edges of what is solid."""
        if row < self._row:
            self._plain, self._cells = self._still.copy(), np.full(self._scene.lattice.shape, UNKNOWN, np.uint8)
        colours = {FREE: symbols.FREE, OCCUPIED: symbols.SEEN}
        cells = self._scene.cells(row)
        for r, c in np.argwhere(cells != self._cells).tolist():
            # Few cells change at a time, so filling them is faster than scaling the whole map.
            x, y = self._columns[c], self._rows[r + 1]
            self._plain.fill(colours[cells[r, c]], (x, y, self._columns[c + 1] - x, self._rows[r] - y))
        self._ground.blit(self._plain, (0, 0))
        if self._scene.has_field:
            self._field(row)
        self._ground.blit(self._edges, (0, 0))
        self._cells, self._row = cells, row

    def _field(self, row: int) -> None:
        """Colour the floor by what robots make of the field."""
        shares = self._scene.estimate(row)
        colours = symbols.heat(np.nan_to_num(shares))
        for r, c in np.argwhere(np.isfinite(shares)).tolist():
            x, y = self._columns[c], self._rows[r + 1]
            self._ground.fill(colours[r, c].tolist(), (x, y, self._columns[c + 1] - x, self._rows[r] - y))

    def _changes(self, shot: Shot) -> None:
        """Draw the boxes that stand in the building besides its plan."""
        for left, low, right, high in shot.boxes:
            (x1, y1), (x2, y2) = np.rint(self.pixels(np.array([(left, high), (right, low)]))).astype(int).tolist()
            symbols.box(self._surface, pygame.Rect(x1, y1, max(x2 - x1, 3), max(y2 - y1, 3)), self._line)

    def _captions(self, shot: Shot) -> None:
        """Write what has just happened above the lower edge of the map, the newest at the bottom."""
        bottom, left = self._area.bottom + self._small // 2, self._captions_from
        for text in shot.captions[::-1]:
            drawn = self._letters.fitted(text, self._small, symbols.TEXT, self._area.right - left - 16)
            bottom = symbols.caption(self._surface, drawn, left, bottom) - 2

    def _tiles(self, shot: Shot) -> None:
        rows, columns = (side * self._scene.lattice.cell * self._scale for side in self._scene.tile)
        for robot in np.flatnonzero(shot.alive).tolist() if len(shot.origins) else ():
            x, y = self.pixels(shot.origins[robot])
            area = pygame.Rect(round(x), round(y - rows), round(columns), round(rows))
            symbols.tile(self._surface, area, symbols.colour_of(robot))

    def _swarm(self, shot: Shot) -> None:
        """Draw ways, links, goals and robots, in this order."""
        surface, places = self._surface, self.pixels(shot.pose[:, :2]).tolist()
        for robot, points in enumerate(shot.ways):
            if len(points) > 1:
                symbols.way(surface, self.pixels(points).tolist(), symbols.colour_of(robot), self._line)
        for one, other in shot.mutual:
            symbols.link(surface, places[one], places[other], self._line)
        for receiver, sender in shot.one_way:
            symbols.link(surface, places[sender], places[receiver], self._line, self.radius)
        for robot in np.flatnonzero(~np.isnan(shot.goals[:, 0])).tolist():
            at = self.pixels(shot.goals[robot])
            symbols.goal(surface, (at[0], at[1]), 0.6 * self._radii[robot], symbols.colour_of(robot))
        for robot in np.flatnonzero(~shot.alive).tolist():
            if shot.marks[robot] == "removed":
                symbols.removed(surface, places[robot], self._radii[robot])
            elif shot.marks[robot] != "late":
                symbols.dead(surface, places[robot], self._radii[robot])
        believed = [] if shot.believed is None else self.pixels(shot.believed).tolist()
        for robot in np.flatnonzero(shot.alive).tolist() if believed else ():
            ring = (self._radii[robot], symbols.colour_of(robot), self._line)
            symbols.belief(surface, places[robot], believed[robot], *ring)
        for robot in np.flatnonzero(shot.alive).tolist():
            if shot.marks[robot] == "fault":
                symbols.fault(surface, places[robot], self._radii[robot])
            colour, yaw = symbols.colour_of(robot), float(shot.pose[robot, 2])
            if shot.headings is not None and np.isfinite(shot.headings[robot]):
                symbols.heading(
                    surface, places[robot], float(shot.headings[robot]), 4.0 * self._radii[robot], self._line
                )
            symbols.robot(surface, places[robot], yaw, self._radii[robot], colour, self._ids[robot])


def _sheet(size: tuple[int, int], colour: Colour) -> pygame.Surface:
    """A clear surface of the colour that will be drawn on it, so that reducing it leaves no dark fringe."""
    sheet = pygame.Surface(size, pygame.SRCALPHA, 32)
    sheet.fill((*colour, 0))
    return sheet


def _ids(robots: int, radius: float, letters: Lettering) -> list[pygame.Surface]:
    """Each robot's id, as large as fits on its disc."""
    size = max(10, round(1.9 * radius))
    while size > 10 and letters.render(str(robots - 1), size, symbols.TEXT).get_width() > 1.7 * radius:
        size -= 1
    return [letters.render(str(robot), size, symbols.ink_on(symbols.colour_of(robot))) for robot in range(robots)]
