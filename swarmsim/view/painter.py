"""Paints shapes in metres on a surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import pygame
from numpy.typing import NDArray

from swarmsim.core.drawing import Circles, Ink, Inks, Lines, Mark, Polygons, Raster, Rays, Texts, Whole, placed
from swarmsim.view.camera import Camera
from swarmsim.view.lettering import Lettering
from swarmsim.view.theme import Colour, Theme

Pixel = tuple[float, float]
Reals = NDArray[np.float64]
READABLE: Final = 6.0  # pixels: the smallest radius of a disc with a text
ROUND: Final = 1.3  # pixels of the edge around a disc
BORDER: Final = 0.85  # of its width: how far the edge of a solid area reaches, since it is drawn with smooth edges
SMALLEST: Final = 2.0  # lines: the least radius of a disc in metres
DASHES: Final = {"dashed": 6.0, "dotted": 2.0}  # length of a dash in line widths


def opaque(size: tuple[int, int]) -> pygame.Surface:
    """A surface with blue, green, red and a spare byte for each pixel, for the fastest blits."""
    return pygame.Surface(size, 0, 32, (0xFF0000, 0xFF00, 0xFF, 0))


def clear(size: tuple[int, int], colour: Colour) -> pygame.Surface:
    """A transparent surface in the colour to be drawn on it, so that scaling it down leaves no dark fringe."""
    sheet = pygame.Surface(size, pygame.SRCALPHA, 32)
    sheet.fill((*colour, 0))
    return sheet


def polygon(surface: pygame.Surface, colour: Colour | pygame.Color, corners: Sequence[Pixel]) -> None:
    """A filled polygon with smooth edges."""
    pygame.draw.polygon(surface, colour, corners)
    pygame.draw.aalines(surface, colour, True, corners)


class Painter:
    """Paints a camera's view in the colours of a theme."""

    def __init__(self, theme: Theme, camera: Camera, unit: float, letters: Lettering) -> None:
        """`unit` scales lines and letters; it is 1 in a picture 720 pixels high."""
        self.theme, self.camera, self.unit, self._letters = theme, camera, unit, letters
        self._line = self._thick(1.5)
        self._inks: dict[Ink, Colour] = {}
        self._texts: dict[tuple[str, int, Colour], pygame.Surface] = {}

    def paint(self, surface: pygame.Surface, mark: Mark, radii: Reals) -> None:
        """Paint shapes over the picture; `radii` (n,) are those of robots as drawn, in pixels."""
        match mark:
            case Circles():
                self._circles(surface, mark, radii)
            case Polygons():
                self._polygons(surface, mark, radii)
            case Lines():
                self._lines(surface, mark, radii)
            case Rays():
                self._rays(surface, mark)
            case Texts():
                self._write(surface, mark, radii)
            case Raster():
                self._cells(surface, mark)

    def sheet(self, mark: Mark, size: tuple[int, int], finer: int) -> pygame.Surface:
        """Static shapes on a transparent ground: painted `finer` times too large, then scaled down."""
        camera = Camera(finer * self.camera.scale, finer * self.camera.left, finer * self.camera.low)
        large = Painter(self.theme, camera, finer * self.unit, self._letters)
        sheet = clear((size[0] * finer, size[1] * finer), self._first(mark))
        if isinstance(mark, Polygons) and mark.at is None:
            large.areas(sheet, mark)
        elif isinstance(mark, Lines):
            large.strokes(sheet, mark)
        else:
            large.paint(sheet, mark, np.empty(0))
        return pygame.transform.smoothscale(sheet, size)

    def areas(self, sheet: pygame.Surface, mark: Polygons) -> None:
        """Areas with holes on a transparent surface, without smooth edges; a hole is cut out of all areas below it."""
        corners = _split(self.camera.pixels(mark.points), mark.ends)
        holes = np.zeros(len(corners), np.bool_) if mark.holes is None else mark.holes
        inks = self._all(mark.ink if mark.ink is not None else mark.edge or "edge", len(corners))
        for ring, hole, ink in zip(corners, holes.tolist(), inks, strict=True):
            pygame.draw.polygon(sheet, (*ink, 0 if hole else round(255 * mark.opacity[0])), ring)

    def strokes(self, sheet: pygame.Surface, mark: Lines) -> None:
        """Lines on a transparent surface, without smooth edges."""
        width = self._thick(mark.width)
        for points, ink in zip(
            _split(self.camera.pixels(mark.points), mark.ends), self._all(mark.ink, len(mark.ends)), strict=True
        ):
            pygame.draw.lines(sheet, ink, False, points, width)

    def areas_of(self, raster: Raster) -> tuple[list[int], list[int]]:
        """Where columns and rows of cells begin and end, in whole pixels.

        Neighbouring cells then neither overlap nor leave a gap.
        """
        steps = raster.cell * np.arange(max(raster.values.shape) + 1)[:, None]
        x, y = np.rint(self.camera.pixels(np.array(raster.corner) + steps)).astype(int).T.tolist()
        return x, y

    def _thick(self, width: float) -> int:
        return max(1, round(width * self.unit))

    def _ink(self, name: Ink) -> Colour:
        if name not in self._inks:
            self._inks[name] = self.theme.ink(name)
        return self._inks[name]

    def _first(self, mark: Mark) -> Colour:
        inks = None if isinstance(mark, Raster) else mark.ink
        return self._ink(inks if isinstance(inks, str) else inks[0] if inks else "edge")

    def _all(self, inks: Inks, count: int) -> list[Colour]:
        return [self._ink(inks)] * count if isinstance(inks, str) else list(map(self._ink, inks))

    def _scale(self, unit: str, of: Whole | None, radii: Reals, count: int) -> Reals:
        """The pixels (count,) per unit of each shape."""
        return radii[of] if unit == "body" and of is not None else np.full(count, self.camera.scale)

    def _circles(self, surface: pygame.Surface, mark: Circles, radii: Reals) -> None:
        if mark.opacity < 1.0:
            veil = clear(surface.get_size(), self._first(mark))
            self._discs(veil, mark, radii)
            veil.set_alpha(round(255 * mark.opacity))
            surface.blit(veil, (0, 0))
        else:
            self._discs(surface, mark, radii)

    def _discs(self, surface: pygame.Surface, mark: Circles, radii: Reals) -> None:
        scale = self._scale(mark.unit, mark.of, radii, len(mark.centre))
        sizes = scale * mark.radius
        if mark.unit == "m" and mark.edge is not None:
            sizes = np.maximum(sizes, SMALLEST * self._line)
        edge = None if mark.edge is None else self._ink(mark.edge)
        places, inks = self.camera.pixels(mark.centre).tolist(), self._all(mark.ink, len(sizes))
        broad = np.maximum(np.rint(mark.stroke * scale), 2.0).astype(int).tolist() if mark.stroke else [0] * len(sizes)
        for at, radius, ink, width in zip(places, sizes.tolist(), inks, broad, strict=True):
            if edge is not None:
                pygame.draw.aacircle(surface, edge, at, radius + ROUND, width + 3 if width else 0)
            pygame.draw.aacircle(surface, ink, at, radius, width)

    def _corners(self, mark: Polygons, radii: Reals, grown: float = 0.0) -> list[list[Pixel]]:
        """The corners of each area in pixels, with its sides moved outwards by some more."""
        scale = self.camera.scale
        return _split(self.camera.pixels(placed(mark, radii / scale, grown / scale)), mark.ends)

    def _polygons(self, surface: pygame.Surface, mark: Polygons, radii: Reals) -> None:
        corners = self._corners(mark, radii)
        if mark.holes is not None and mark.holes.any():
            sheet = clear(surface.get_size(), self._first(mark))
            self.areas(sheet, mark)
            surface.blit(sheet, (0, 0))
            return
        count = len(corners)
        inks: Sequence[Colour | None] = [None] * count if mark.ink is None else self._all(mark.ink, count)
        edges: Sequence[Colour | None] = [None] * count if mark.edge is None else self._all(mark.edge, count)
        through = mark.opacity != (1.0, 1.0) or mark.ink is None
        outer = corners if through else self._corners(mark, radii, BORDER * mark.width * self.unit)
        if mark.at is not None and not through:
            for ring, edge in zip(outer, edges, strict=True):
                if edge is not None:
                    polygon(surface, edge, ring)
            edges = [None] * count
        width = self._thick(mark.width)
        for ring, around, ink, edge in zip(corners, outer, inks, edges, strict=True):
            if mark.opacity != (1.0, 1.0):
                self._veil(surface, ring, ink, edge, mark.opacity, width)
                continue
            if edge is not None and ink is None:
                for start, end in pairwise([*ring, ring[0]]):
                    pygame.draw.aaline(surface, edge, start, end, width)
            elif edge is not None:
                polygon(surface, edge, around)
            if ink is not None:
                polygon(surface, ink, ring)

    def _veil(
        self, surface: pygame.Surface, ring: list[Pixel], ink: Colour | None, edge: Colour | None,
        opacity: tuple[float, float], width: int,
    ) -> None:  # fmt: skip
        """A translucent area with a translucent outline."""
        x, y = zip(*ring, strict=True)
        area = pygame.Rect(math.floor(min(x)), math.floor(min(y)), 0, 0)
        area.size = math.ceil(max(x)) - area.left + 1, math.ceil(max(y)) - area.top + 1
        if not area.colliderect(surface.get_rect()) or max(area.size) > 4 * max(surface.get_size()):
            return
        sheet, corners = (
            pygame.Surface(area.size, pygame.SRCALPHA, 32),
            [(a - area.left, b - area.top) for a, b in ring],
        )
        for colour, share, broad in ((ink, opacity[0], 0), (edge, opacity[1], width)):
            if colour is not None:
                pygame.draw.polygon(sheet, (*colour, round(255 * share)), corners, broad)
        surface.blit(sheet, area)

    def _lines(self, surface: pygame.Surface, mark: Lines, radii: Reals) -> None:
        if mark.opacity < 1.0:
            veil = clear(surface.get_size(), self._first(mark))
            self._drawn(veil, mark, radii)
            veil.set_alpha(round(255 * mark.opacity))
            surface.blit(veil, (0, 0))
        else:
            self._drawn(surface, mark, radii)

    def _drawn(self, surface: pygame.Surface, mark: Lines, radii: Reals) -> None:
        width, count = self._thick(mark.width), len(mark.ends)
        casing = None if mark.casing is None else self._ink(mark.casing)
        last = np.full(count, -1) if mark.on is None else mark.on[mark.ends - 1]
        gaps = np.where(last >= 0, radii[last], 0.0).tolist() if mark.arrow and len(radii) else [0.0] * count
        lines = _split(self.camera.pixels(mark.points), mark.ends)
        for points, ink, gap in zip(lines, self._all(mark.ink, count), gaps, strict=True):
            pieces = list(pairwise(points))
            if mark.dash != "whole":
                pieces = [dash for piece in pieces for dash in _dashes(*piece, DASHES[mark.dash] * width)]
            for colour, broad in ((casing, width + 2), (ink, width)):
                for start, end in pieces if colour is not None else ():
                    if mark.dash == "whole":
                        pygame.draw.aaline(surface, colour or ink, start, end, broad)
                    else:  # a short line has to end at right angles
                        polygon(surface, colour or ink, _bar(start, end, 0.5 * broad - 0.75))
            if mark.arrow and len(points) > 1:
                _head(surface, points[-2], points[-1], gap, width, ((1.5, casing), (0.0, ink)))

    def _rays(self, surface: pygame.Surface, mark: Rays) -> None:
        width = self._thick(mark.width)
        starts, tips = self.camera.pixels(mark.at).tolist(), self.camera.pixels(mark.tips).tolist()
        for start, ends, ink in zip(starts, tips, self._all(mark.ink, len(starts)), strict=True):
            for end in ends:
                pygame.draw.aaline(surface, ink, start, end, width)

    def _write(self, surface: pygame.Surface, mark: Texts, radii: Reals) -> None:
        widest = max(mark.texts, key=len, default="")
        discs = radii[mark.of].tolist() if mark.unit == "body" and mark.of is not None else [0.0] * len(mark.texts)
        places, inks = self.camera.pixels(mark.at).tolist(), self._all(mark.ink, len(discs))
        for at, text, ink, disc in zip(places, mark.texts, inks, discs, strict=True):
            if mark.unit == "pixel":
                drawn = self._text(text, text, max(10, round(mark.size * self.unit)), ink, 0)
            elif disc >= READABLE:
                drawn = self._text(text, "0" * len(widest), max(10, round(mark.size * disc)), ink, int(1.7 * disc))
            else:
                continue
            surface.blit(drawn, drawn.get_rect(center=(round(at[0]), round(at[1]))))

    def _text(self, text: str, widest: str, size: int, ink: Colour, room: int) -> pygame.Surface:
        """A text, small enough that the widest one fits into `room` pixels, if given."""
        key = (f"{widest} {text}", size, ink)
        if key not in self._texts:
            fit = self._letters.size(widest, size, 10, room) if room else size
            self._texts[key] = self._letters.render(text, fit, ink)
        return self._texts[key]

    def _cells(self, surface: pygame.Surface, raster: Raster) -> None:
        colours, (x, y) = self.theme.shades(raster.palette), self.areas_of(raster)
        for r, c in np.argwhere(raster.values).tolist():
            surface.fill(colours[raster.values[r, c]].tolist(), (x[c], y[r + 1], x[c + 1] - x[c], y[r] - y[r + 1]))


def _split(points: Reals, ends: Whole) -> list[list[Pixel]]:
    """The points of each line or area."""
    listed, stops = points.tolist(), ends.tolist()
    return [listed[start:stop] for start, stop in pairwise([0, *stops])]


def _dashes(start: Pixel, end: Pixel, dash: float) -> list[tuple[Pixel, Pixel]]:
    """Dashes along a line, as long as the gaps between them."""
    length = math.dist(start, end)
    if length < 1.0:
        return []
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    cuts = [(2.0 * dash * k, min(2.0 * dash * k + dash, length)) for k in range(math.ceil(length / (2.0 * dash)))]
    return [((start[0] + a * ux, start[1] + a * uy), (start[0] + b * ux, start[1] + b * uy)) for a, b in cuts]


def _bar(start: Pixel, end: Pixel, aside: float) -> list[Pixel]:
    """The corners of a line that reaches so far aside."""
    share = aside / max(math.dist(start, end), 1e-9)
    (ax, ay), (bx, by) = start, end
    x, y = share * (ay - by), share * (bx - ax)
    return [(ax + x, ay + y), (bx + x, by + y), (bx - x, by - y), (ax - x, ay - y)]


def _head(
    surface: pygame.Surface, start: Pixel, end: Pixel, gap: float, width: int,
    inks: Sequence[tuple[float, Colour | None]],
) -> None:  # fmt: skip
    """An arrow's head, `gap` pixels before its end; each ink comes with how much larger it is drawn."""
    length = math.dist(start, end)
    if length < gap + 1.0:
        return
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    for grown, ink in inks:
        if ink is None:
            continue
        head = 3.5 + 2.0 * width + grown
        tip = (end[0] - (gap - grown) * ux, end[1] - (gap - grown) * uy)
        back = (tip[0] - (head + grown) * ux, tip[1] - (head + grown) * uy)
        sides = [(back[0] - side * uy, back[1] + side * ux) for side in (0.5 * head, -0.5 * head)]
        polygon(surface, ink, [tip, *sides])
