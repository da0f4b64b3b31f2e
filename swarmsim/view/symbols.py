"""The signs of a picture, drawn alike on the map and in its legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import pygame

from swarmsim.view.theme import Colour, Theme

Pixel = tuple[float, float]


def opaque(size: tuple[int, int]) -> pygame.Surface:
    """A surface whose memory holds blue, green, red and a spare byte for each pixel: blits are fastest so."""
    return pygame.Surface(size, 0, 32, (0xFF0000, 0xFF00, 0xFF, 0))


def polygon(surface: pygame.Surface, colour: Colour | pygame.Color, corners: Sequence[Pixel]) -> None:
    """A filled polygon with smooth edges."""
    pygame.draw.polygon(surface, colour, corners)
    pygame.draw.aalines(surface, colour, True, corners)


class Pen:
    """Draws signs in the colours of a theme."""

    def __init__(self, theme: Theme) -> None:
        self.theme = theme

    def robot(
        self, surface: pygame.Surface, at: Pixel, yaw: float, radius: float, colour: Colour,
        label: pygame.Surface | None = None,
    ) -> None:  # fmt: skip
        """A disc with its id, and a nose where it is heading; `yaw` in rad, counter-clockwise on the screen."""
        cosine, sine = math.cos(yaw), math.sin(yaw)
        for grown, ink in ((1.3, self.theme.edge), (0.0, colour)):
            side, tip = 0.8 * radius + grown, 1.75 * radius + grown
            x, y = side * 0.7317, side * 0.6816  # cosine and sine of 0.75 rad
            nose = [
                (at[0] + ahead * cosine - aside * sine, at[1] - ahead * sine - aside * cosine)
                for ahead, aside in ((x, y), (tip, 0.0), (x, -y))
            ]
            polygon(surface, ink, nose)
            pygame.draw.aacircle(surface, ink, at, radius + grown)
        if label is not None:
            surface.blit(label, label.get_rect(center=(round(at[0]), round(at[1]))))

    def heading(self, surface: pygame.Surface, at: Pixel, yaw: float, length: float, width: int) -> None:
        """A line from a robot's centre, under its disc, along the heading that it estimates."""
        end = (at[0] + length * math.cos(yaw), at[1] - length * math.sin(yaw))
        for ink, broad in ((self.theme.edge, width + 2), (self.theme.curve, width)):
            pygame.draw.aaline(surface, ink, at, end, broad)

    def dead(self, surface: pygame.Surface, at: Pixel, radius: float) -> None:
        """A grey disc with a cross."""
        pygame.draw.aacircle(surface, self.theme.edge, at, radius + 1.3)
        pygame.draw.aacircle(surface, self.theme.dead, at, radius)
        arm, width = 0.6 * radius, max(2, round(0.3 * radius))
        for way in (1, -1):
            ends = (at[0] - arm, at[1] - way * arm), (at[0] + arm, at[1] + way * arm)
            pygame.draw.aaline(surface, self.theme.edge, *ends, width)

    def removed(self, surface: pygame.Surface, at: Pixel, radius: float) -> None:
        """A grey ring, where a body was."""
        width = max(2, round(0.45 * radius))
        pygame.draw.aacircle(surface, self.theme.edge, at, radius + 1.3, width + 3)
        pygame.draw.aacircle(surface, self.theme.dead, at, radius, width)

    def belief(
        self, surface: pygame.Surface, at: Pixel, there: Pixel, radius: float, colour: Colour, width: int
    ) -> None:
        """A ring where a robot believes to be, and a line to it from where it is."""
        if math.hypot(there[0] - at[0], there[1] - at[1]) > 0.5 * radius:
            edge = self.theme.edge
            pygame.draw.aaline(surface, edge, at, there, width + 2)
            pygame.draw.aaline(surface, colour, at, there, width)
            pygame.draw.aacircle(surface, edge, there, 0.75 * radius + 1.3, width + 3)
            pygame.draw.aacircle(surface, colour, there, 0.75 * radius, width + 1)

    def fault(self, surface: pygame.Surface, at: Pixel, radius: float) -> None:
        """A ring around a robot of this radius, which is drawn over it, with a dark edge on either side."""
        self._ring(surface, at, radius, self.theme.mark)

    def light(self, surface: pygame.Surface, at: Pixel, radius: float, colour: Colour) -> None:
        """A disc of the colour in which a robot shines, wider than that of the robot, which is drawn over it."""
        pygame.draw.aacircle(surface, self.theme.edge, at, 1.6 * radius + 1.3)
        pygame.draw.aacircle(surface, colour, at, 1.6 * radius)

    def joined(self, surface: pygame.Surface, at: Pixel, radius: float) -> None:
        """A ring around a robot that came later than the others."""
        self._ring(surface, at, radius, self.theme.joined)

    def _ring(self, surface: pygame.Surface, at: Pixel, radius: float, colour: Colour) -> None:
        width = max(2, round(0.3 * radius))
        pygame.draw.aacircle(surface, self.theme.edge, at, 2.1 * radius + 1.3, width + 3)
        pygame.draw.aacircle(surface, colour, at, 2.1 * radius, width)

    def person(self, surface: pygame.Surface, at: Pixel, radius: float) -> None:
        """A disc with a head."""
        pygame.draw.aacircle(surface, self.theme.edge, at, radius + 1.3)
        pygame.draw.aacircle(surface, self.theme.person, at, radius)
        pygame.draw.aacircle(surface, self.theme.edge, at, 0.45 * radius)

    def box(self, surface: pygame.Surface, area: pygame.Rect, width: int) -> None:
        """A solid rectangle with a bright edge."""
        pygame.draw.rect(surface, self.theme.solids["walls"], area)
        pygame.draw.rect(surface, self.theme.mark, area, width)

    def caption(self, surface: pygame.Surface, text: pygame.Surface, left: int, bottom: int) -> int:
        """A line of text on a ground of its own; gives its upper edge."""
        ground = pygame.Surface((text.get_width() + 16, text.get_height() + 8), pygame.SRCALPHA, 32)
        ground.fill((*self.theme.background, 215))
        ground.fill(self.theme.mark, (0, 0, 4, ground.get_height()))
        ground.blit(text, (10, 4))
        surface.blit(ground, (left, bottom - ground.get_height()))
        return bottom - ground.get_height()

    def goal(self, surface: pygame.Surface, at: Pixel, radius: float, colour: Colour) -> None:
        """A diamond."""
        for reach, ink in ((radius + 1.5, self.theme.edge), (radius, colour)):
            corners = ((reach, 0.0), (0.0, reach), (-reach, 0.0), (0.0, -reach))
            polygon(surface, ink, [(at[0] + x, at[1] + y) for x, y in corners])

    def way(self, surface: pygame.Surface, points: Sequence[Pixel], colour: Colour, width: int) -> None:
        """A path: a line with a dark edge."""
        for ink, broad in ((self.theme.edge, width + 2), (colour, width)):
            for start, end in pairwise(points):
                pygame.draw.aaline(surface, ink, start, end, broad)

    def link(
        self, surface: pygame.Surface, start: Pixel, end: Pixel, width: int, gap: float | None = None,
        fate: str = "heard",
    ) -> None:  # fmt: skip
        """A line between two robots; with a `gap` (pixels) it has an arrow head that far before its end.

        Messages that are heard are whole lines, those lost are dashed and those under way dotted.
        """
        colour = self.theme.lost if fate == "lost" else self.theme.link
        length = math.dist(start, end)
        dash = {"heard": length, "lost": 6.0 * width, "under way": 2.0 * width}[fate]
        if length < 1.0:
            return
        ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
        pieces = [(at, min(at + dash, length)) for at in _steps(length, 2.0 * dash)]
        casing = self.theme.edge if sum(colour) > 384 else self.theme.background
        for ink, broad in ((casing, width + 2), (colour, width)):
            for begin, stop in pieces:
                ends = (start[0] + begin * ux, start[1] + begin * uy), (start[0] + stop * ux, start[1] + stop * uy)
                pygame.draw.aaline(surface, ink, *ends, broad)
        if gap is None or length < gap + 1.0:
            return
        for grown, ink in ((1.5, casing), (0.0, colour)):
            head = 3.5 + 2.0 * width + grown
            tip = (end[0] - (gap - grown) * ux, end[1] - (gap - grown) * uy)
            back = (tip[0] - (head + grown) * ux, tip[1] - (head + grown) * uy)
            sides = [(back[0] - side * uy, back[1] + side * ux) for side in (0.5 * head, -0.5 * head)]
            polygon(surface, ink, [tip, *sides])

    def tile(self, surface: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
        """A tinted rectangle with a thin outline."""
        tint = pygame.Surface(area.size, pygame.SRCALPHA, 32)
        tint.fill((*colour, 34))
        pygame.draw.rect(tint, (*colour, 170), tint.get_rect(), 1)
        surface.blit(tint, area)

    def beams(self, surface: pygame.Surface, at: Pixel, ends: Sequence[Pixel], colour: Colour) -> None:
        """Thin lines from a robot to where its beams end."""
        for end in ends:
            pygame.draw.aaline(surface, colour, at, end)


def _steps(length: float, step: float) -> list[float]:
    return [step * k for k in range(max(1, math.ceil(length / step)))] if step > 0.0 else [0.0]
