"""The signs, colours and letters of a picture, drawn alike on the map and in its legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pygame
from numpy.typing import NDArray

Colour = tuple[int, int, int]  # red, green, blue
Pixel = tuple[float, float]

BACKGROUND: Colour = (17, 20, 27)
UNEXPLORED: Colour = (43, 49, 61)
SOLIDS: dict[str, Colour] = {"walls": (88, 97, 114), "pillars": (104, 112, 128), "furniture": (112, 104, 92)}
FREE: Colour = (238, 234, 224)
HOT: Colour = (176, 62, 38)  # where a field is greatest; FREE is where it is least
SEEN: Colour = (148, 106, 66)  # a cell in which a beam ended
EDGE: Colour = (30, 33, 40)
TEXT: Colour = (232, 235, 240)
MUTED: Colour = (150, 158, 172)
RULE: Colour = (58, 65, 79)
LINK: Colour = (38, 128, 200)
BAND: Colour = (46, 84, 116)
CURVE: Colour = (240, 228, 66)
MARK: Colour = (230, 110, 40)
DEAD: Colour = (136, 140, 148)
#: Okabe and Ito's colours without black: told apart by colour-blind people too.
ROBOTS: Sequence[Colour] = (
    (230, 159, 0), (86, 180, 233), (0, 158, 115), (204, 121, 167), (213, 94, 0), (0, 114, 178), (240, 228, 66),
)  # fmt: skip


class Lettering:
    """Antialiased text in pygame's own font, at any size."""

    def __init__(self) -> None:
        pygame.font.init()
        self._fonts: dict[int, pygame.font.Font] = {}

    def render(self, text: str, size: int, colour: Colour) -> pygame.Surface:
        """The text on a transparent ground; `size` is about the height of a line in pixels."""
        if size not in self._fonts:
            self._fonts[size] = pygame.font.Font(None, size)
        return self._fonts[size].render(text, True, colour)

    def fitted(self, text: str, size: int, colour: Colour, width: int) -> pygame.Surface:
        """The text as `render` gives it, cut with an ellipsis to at most `width` pixels."""
        drawn = self.render(text, size, colour)
        while drawn.get_width() > width and text:
            text = text[:-1].rstrip()
            drawn = self.render(f"{text}…", size, colour)
        return drawn


def colour_of(robot: int) -> Colour:
    """The colour of a robot, which it may share with others."""
    return ROBOTS[robot % len(ROBOTS)]


def ink_on(colour: Colour) -> Colour:
    """Black or white, whichever is easier to read on a colour."""
    brightness = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return (0, 0, 0) if brightness > 120 else (255, 255, 255)


def polygon(surface: pygame.Surface, colour: Colour | pygame.Color, corners: Sequence[Pixel]) -> None:
    """A filled polygon with smooth edges."""
    pygame.draw.polygon(surface, colour, corners)
    pygame.draw.aalines(surface, colour, True, corners)


def robot(surface: pygame.Surface, at: Pixel, yaw: float, radius: float, colour: Colour, label: pygame.Surface) -> None:
    """A disc with its id, and a nose where it is heading; `yaw` in rad, counter-clockwise on the screen."""
    for grown, ink in ((1.3, EDGE), (0.0, colour)):
        nose = [
            (at[0] + (r + grown) * math.cos(yaw + turn), at[1] - (r + grown) * math.sin(yaw + turn))
            for r, turn in ((0.8 * radius, 0.75), (1.75 * radius, 0.0), (0.8 * radius, -0.75))
        ]
        polygon(surface, ink, nose)
        pygame.draw.aacircle(surface, ink, at, radius + grown)
    surface.blit(label, label.get_rect(center=(round(at[0]), round(at[1]) + 1)))


def heading(surface: pygame.Surface, at: Pixel, yaw: float, length: float, width: int) -> None:
    """A line from a robot's centre, under its disc, along the heading that it estimates."""
    end = (at[0] + length * math.cos(yaw), at[1] - length * math.sin(yaw))
    for ink, broad in ((EDGE, width + 2), (CURVE, width)):
        pygame.draw.aaline(surface, ink, at, end, broad)


def dead(surface: pygame.Surface, at: Pixel, radius: float) -> None:
    """A grey disc with a cross."""
    pygame.draw.aacircle(surface, EDGE, at, radius + 1.3)
    pygame.draw.aacircle(surface, DEAD, at, radius)
    arm, width = 0.6 * radius, max(2, round(0.3 * radius))
    for way in (1, -1):
        pygame.draw.aaline(surface, EDGE, (at[0] - arm, at[1] - way * arm), (at[0] + arm, at[1] + way * arm), width)


def removed(surface: pygame.Surface, at: Pixel, radius: float) -> None:
    """A grey ring, where a body was."""
    pygame.draw.aacircle(surface, DEAD, at, radius, max(2, round(0.45 * radius)))


def belief(surface: pygame.Surface, at: Pixel, there: Pixel, radius: float, colour: Colour, width: int) -> None:
    """A ring where a robot believes to be, and a line to it from where it is."""
    if math.hypot(there[0] - at[0], there[1] - at[1]) > 0.5 * radius:
        pygame.draw.aaline(surface, EDGE, at, there, width + 2)
        pygame.draw.aaline(surface, colour, at, there, width)
        pygame.draw.aacircle(surface, EDGE, there, 0.75 * radius + 1.3, width + 3)
        pygame.draw.aacircle(surface, colour, there, 0.75 * radius, width + 1)


def fault(surface: pygame.Surface, at: Pixel, radius: float) -> None:
    """A ring around a robot of this radius, which is drawn over it, with a dark edge on either side."""
    width = max(2, round(0.3 * radius))
    pygame.draw.aacircle(surface, EDGE, at, 2.1 * radius + 1.3, width + 3)
    pygame.draw.aacircle(surface, MARK, at, 2.1 * radius, width)


def box(surface: pygame.Surface, area: pygame.Rect, width: int) -> None:
    """A solid rectangle with a bright edge."""
    pygame.draw.rect(surface, SOLIDS["walls"], area)
    pygame.draw.rect(surface, MARK, area, width)


def caption(surface: pygame.Surface, text: pygame.Surface, left: int, bottom: int) -> int:
    """A line of text on a ground of its own; gives its upper edge."""
    ground = pygame.Surface((text.get_width() + 16, text.get_height() + 8), pygame.SRCALPHA, 32)
    ground.fill((*BACKGROUND, 215))
    ground.fill(MARK, (0, 0, 4, ground.get_height()))
    ground.blit(text, (10, 4))
    surface.blit(ground, (left, bottom - ground.get_height()))
    return bottom - ground.get_height()


def goal(surface: pygame.Surface, at: Pixel, radius: float, colour: Colour) -> None:
    """A diamond."""
    for reach, ink in ((radius + 1.5, EDGE), (radius, colour)):
        corners = ((reach, 0.0), (0.0, reach), (-reach, 0.0), (0.0, -reach))
        polygon(surface, ink, [(at[0] + x, at[1] + y) for x, y in corners])


def way(surface: pygame.Surface, points: Sequence[Pixel], colour: Colour, width: int) -> None:
    """A path: a line with a dark edge."""
    for ink, broad in ((EDGE, width + 2), (colour, width)):
        for start, end in pairwise(points):
            pygame.draw.aaline(surface, ink, start, end, broad)


def link(surface: pygame.Surface, start: Pixel, end: Pixel, width: int, gap: float | None = None) -> None:
    """A line between two robots; with a `gap` (pixels) it has an arrow head that far before its end."""
    pygame.draw.aaline(surface, LINK, start, end, width)
    length = math.dist(start, end)
    if gap is None or length < gap + 1.0:
        return
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    head = 3.5 + 1.5 * width
    tip = (end[0] - gap * ux, end[1] - gap * uy)
    back = (tip[0] - head * ux, tip[1] - head * uy)
    half = 0.5 * head
    sides = [(back[0] - side * uy, back[1] + side * ux) for side in (half, -half)]
    polygon(surface, LINK, [tip, *sides])


def tile(surface: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    """A tinted rectangle with a thin outline."""
    tint = pygame.Surface(area.size, pygame.SRCALPHA, 32)
    tint.fill((*colour, 34))
    pygame.draw.rect(tint, (*colour, 150), tint.get_rect(), 1)
    surface.blit(tint, area)


def heat(shares: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The colours (..., 3) of shares from 0 to 1 of a field: one hue, ever darker."""
    low, high = np.array(FREE, np.float64), np.array(HOT, np.float64)
    return np.rint(low + shares[..., None] * (high - low)).astype(np.uint8)
