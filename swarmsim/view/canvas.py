"""Paints a moment of a run on a surface in memory; no display is needed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pygame
from numpy.typing import NDArray

from swarmsim.core.drawing import Mark
from swarmsim.view.background import FINEST, Background
from swarmsim.view.camera import Camera
from swarmsim.view.discs import Discs
from swarmsim.view.layers import LayerStack
from swarmsim.view.lettering import Lettering
from swarmsim.view.painter import Painter, opaque
from swarmsim.view.panel import Panel
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.style import Style

LENS = 0.12  # of the picture's height: the radius of the magnifier
WHOLE = 4000  # pixels: the longest side of the picture under the magnifier
MAGNIFIED = 13.0  # pixels at a height of 720: the radius of a robot under the magnifier


class Canvas:
    """The picture of a scene, of one size in pixels; wide ones have their panel on the right, others below."""

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int],
        look: Style | None = None,
        camera: Camera | None = None,
        finest: int = FINEST,
    ) -> None:
        """`camera` shows a part of the map, the default all of it; static shapes are drawn at most
        `finest` pixels wide before they are scaled down. Raises InputError for an invalid `look`.
        """
        self._scene, self._look = scene, look or Style()
        self._look.check(scene)
        theme = self._look.colours
        self._surface = opaque(size)
        wide = size[0] >= 1.25 * size[1]
        unit = min(size[0] / 1280, size[1] / 720) if wide else min(size[0] / 640, size[1] / 720)
        pad, head = round(18 * unit), max(20, round(46 * unit))
        self.area, panel = _arranged(size, wide, pad, head, unit, "panel" in self._look.layers)
        self._unit = unit
        self._small = max(12, round(18 * unit))
        self._letters = letters = Lettering()
        strip = pygame.Rect(self.area.left, self.area.bottom - 2 * self._small, self.area.width, 2 * self._small)
        room = pygame.Rect(self.area.left, self.area.top, self.area.width, self.area.height - strip.height)
        self._zoomed = camera is not None
        self.camera = camera or Camera.fitting(scene.bounds, (room.left, room.top, room.width, room.height))
        self._kept = 0  # the magnifier's corner
        self._layers, self._painter = LayerStack(scene), Painter(theme, self.camera, unit, letters)
        self.discs = Discs(scene, self.camera.scale, max(8.0 * unit, 5.0))
        self.radius = self.discs.radius
        self._ground = Background(self._painter, size, finest)
        self._overlay = self._headline(size[0] - 2 * pad if not wide else panel.left - 2 * pad)
        self._room, self._columns = panel, 1 if wide else 2
        self.renew()

    @property
    def outdated(self) -> bool:
        """Whether more has been recorded than the panel shows."""
        return self._shown < self._scene.iterations

    def renew(self) -> None:
        """Draw the panel for everything recorded so far."""
        self._shown = self._scene.iterations
        self._panel = (
            Panel(self._scene, self._look, self._room, self._unit, self._letters, self.discs.enlarged, self._columns)
            if self._room.width
            else None
        )

    def draw(self, iteration: float) -> pygame.Surface:
        """The picture after this many iterations; the next call overwrites the surface."""
        shot = self._scene.at(iteration, self._look.focus, self._look.chosen)
        marks = self._layers.draw(shot, self._look)
        rest = self._ground.show(marks)
        if self._zoomed:
            self._surface.fill(self._look.colours.background)
            self._surface.set_clip(self.area)
        self._surface.blit(self._ground.surface, (0, 0))
        radii = self.discs.radii(shot)
        for mark in rest:
            self._painter.paint(self._surface, mark, radii)
        self._surface.set_clip(None)
        if self._look.focus is not None:
            self._magnify(shot, marks, self._look.focus)
        for sheet, at in self._overlay:
            self._surface.blit(sheet, at)
        if "events" in self._look.layers:
            self._captions(shot)
        if self._panel is not None:
            self._panel.draw(self._surface, shot)
        return self._surface

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points (..., 2) in metres lie on the picture: x to the right, y downwards."""
        return self.camera.pixels(points)

    def _headline(self, width: int) -> list[tuple[pygame.Surface, tuple[int, int]]]:
        """The title, and a scale bar of a round length below the map, each with its place."""
        theme, unit, letters = self._look.colours, self._unit, self._letters
        of = "" if self._look.focus is None else f": what robot {self._look.focus} knows"
        told = self._scene.title + of
        size = letters.size(told, max(16, round(30 * unit)), max(14, round(20 * unit)), width)
        title = letters.fitted(told, size, theme.text, width)
        length = max(
            step * 10.0**power for power in range(-4, 5) for step in (1, 2, 5)
            if step * 10.0**power * self.camera.scale < 0.2 * self.area.width
        )  # fmt: skip
        bar = pygame.Surface((round(length * self.camera.scale), max(2, round(4 * unit))))
        bar.fill(theme.muted)
        text = letters.render(f"{length:g} m", self._small, theme.muted)
        bottom = self.area.bottom - round(0.5 * self._small)
        at = (
            self.area.left + bar.get_width() + round(8 * unit) + 2,
            bottom - text.get_height() // 2 - bar.get_height() // 2,
        )
        self._captions_from = at[0] + text.get_width() + self._small
        return [
            (title, (self.area.left, (self.area.top - title.get_height()) // 2 + 2)),
            (bar, (self.area.left, bottom - bar.get_height())),
            (text, at),
        ]

    def _captions(self, shot: Frame) -> None:
        """Write the latest events above the lower edge of the map, the newest at the bottom."""
        bottom, left = self.area.bottom, self._captions_from
        for text in shot.captions[::-1]:
            drawn = self._letters.fitted(text, self._small, self._look.colours.text, self.area.right - left - 16)
            ground = pygame.Surface((drawn.get_width() + 16, drawn.get_height() + 8), pygame.SRCALPHA, 32)
            ground.fill((*self._look.colours.background, 215))
            ground.fill(self._look.colours.mark, (0, 0, 4, ground.get_height()))
            ground.blit(drawn, (10, 4))
            self._surface.blit(ground, (left, bottom - ground.get_height()))
            bottom -= ground.get_height() + 2

    @cached_property
    def _lens(self) -> tuple[Background, int, pygame.Surface]:
        """A larger picture of the whole building; the magnifier shows a part of it."""
        left, right, low, high = self._scene.bounds
        wanted = MAGNIFIED * self._unit / self._scene.radius
        scale = max(min(wanted, WHOLE / max(right - left, high - low)), self.camera.scale)
        size = (round(scale * (right - left)), round(scale * (high - low)))
        camera = Camera(scale, -scale * left, scale * high)
        reach = round(LENS * self._surface.get_height())
        ground = Background(Painter(self._look.colours, camera, 2.0 * self._unit, self._letters), size)
        mask = pygame.Surface((2 * reach, 2 * reach), pygame.SRCALPHA, 32)
        pygame.draw.aacircle(mask, (255, 255, 255, 255), (reach, reach), reach)
        return ground, reach, mask

    def _magnify(self, shot: Frame, marks: Sequence[Mark], focus: int) -> None:
        """Show the surroundings of the focused robot in a circle in a corner."""
        ground, reach, mask = self._lens
        rest, camera = ground.show(marks), ground.camera
        x, y = camera.pixels(shot.pose[focus, :2]).tolist()
        around = pygame.Rect(round(x) - reach, round(y) - reach, 2 * reach, 2 * reach)
        sheet = pygame.Surface(around.size, pygame.SRCALPHA, 32)
        sheet.fill(self._look.colours.background)
        sheet.blit(ground.surface, (0, 0), around) if around.left >= 0 and around.top >= 0 else sheet.blit(
            ground.surface, (-around.left, -around.top)
        )
        moved = camera.moved(-around.left, -around.top)
        painter, radii = Painter(self._look.colours, moved, self._unit, self._letters), moved.scale * self._scene.radii
        for mark in rest:
            painter.paint(sheet, mark, radii)
        sheet.blit(mask, (0, 0), special_flags=pygame.BLEND_RGBA_MIN)
        place = self.pixels(shot.pose[focus, :2])
        corners = [
            (self.area.left + reach, self.area.top + reach), (self.area.right - reach, self.area.top + reach),
            (self.area.left + reach, self.area.bottom - reach - 3 * self._small),
            (self.area.right - reach, self.area.bottom - reach - 3 * self._small),
        ]  # fmt: skip
        centre = self._corner(corners, place)
        self._surface.blit(sheet, (centre[0] - reach, centre[1] - reach))
        theme = self._look.colours
        pygame.draw.aacircle(self._surface, theme.text, centre, reach, 2)
        pygame.draw.aacircle(self._surface, theme.text, place.tolist(), 1.6 * self.radius, 2)
        along = np.array(centre) - place
        unit = along / max(float(np.hypot(*along)), 1.0)
        ends = (place + 1.6 * self.radius * unit).tolist(), (np.array(centre) - reach * unit).tolist()
        pygame.draw.aaline(self._surface, theme.text, *ends, 1)

    def _corner(self, corners: list[tuple[int, int]], place: NDArray[np.float64]) -> tuple[int, int]:
        """The corner for the magnifier; it changes only when the robot is behind it."""
        reach = LENS * self._surface.get_height()
        kept = self._kept
        if np.hypot(*(np.array(corners[kept]) - place)) < 1.3 * reach:
            kept = int(np.argmax([np.hypot(*(np.array(corner) - place)) for corner in corners]))
        self._kept = kept
        return corners[kept]


def _arranged(
    size: tuple[int, int], wide: bool, pad: int, head: int, unit: float, panel: bool
) -> tuple[pygame.Rect, pygame.Rect]:
    """The areas of a picture for the map and the panel."""
    if not panel:
        return pygame.Rect(pad, head, size[0] - 2 * pad, size[1] - head - pad), pygame.Rect(size[0], 0, 0, 0)
    if wide:
        side = max(round(322 * unit), 190)
        area = pygame.Rect(pad, head, size[0] - side - 3 * pad, size[1] - head - pad)
        return area, pygame.Rect(size[0] - side - pad, pad, side, size[1] - 2 * pad)
    below = round(0.5 * size[1])
    area = pygame.Rect(pad, head, size[0] - 2 * pad, size[1] - below - head - pad)
    return area, pygame.Rect(pad, size[1] - below, size[0] - 2 * pad, below - pad)
