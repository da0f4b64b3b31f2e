"""The letters of pictures, each placed to an eighth of a pixel so that small numbers are legible."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import matplotlib as mpl
import pygame
from PIL import Image, ImageDraw, ImageFont

from swarmsim.view.theme import Colour

#: DejaVu Sans, which comes with matplotlib, so that plots and pictures share a font.
FONT: Final = Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
PARTS: Final = 8  # of a pixel, in which letters are drawn and placed
LOW: Final = 1120 / 2048  # of the size of letters: the height of an x ...
ABOVE: Final = 1901 / 2048  # ... the room above the line they stand on ...
BELOW: Final = 483 / 2048  # ... and below it
LETTERS: Final = 0.7  # of the height of a line: the size of its letters


class Lettering:
    """Smooth text at any size."""

    def __init__(self) -> None:
        self._faces: dict[int, Face] = {}

    def render(self, text: str, size: int, colour: Colour) -> pygame.Surface:
        """The text on a transparent ground; `size` is about the height of a line in pixels."""
        return self._face(size).render(text, colour)

    def width(self, text: str, size: int) -> int:
        """The width of the text in pixels."""
        return self._face(size).width(text)

    def size(self, text: str, most: int, least: int, width: int) -> int:
        """The largest size from `least` to `most` at which the text is at most `width` pixels wide; `least` if none."""
        return next((size for size in range(most, least, -1) if self.width(text, size) <= width), least)

    def fitted(self, text: str, size: int, colour: Colour, width: int) -> pygame.Surface:
        """The text as `render` gives it, cut with an ellipsis to at most `width` pixels."""
        drawn = text
        while text and self.width(drawn, size) > width:
            text = text[:-1].rstrip()
            drawn = f"{text}…"
        return self.render(drawn, size, colour)

    def _face(self, size: int) -> Face:
        if size not in self._faces:
            self._faces[size] = Face(size)
        return self._faces[size]


class Face:
    """The letters of one size. They are drawn larger and scaled down, without hinting, which would move them to whole
    pixels. Low letters are whole pixels high, so that lines keep sharp edges.
    """

    def __init__(self, size: int) -> None:
        high = round(LOW * LETTERS * size) / LOW
        self._font = ImageFont.truetype(FONT, PARTS * high, layout_engine=ImageFont.Layout.BASIC)
        self._above = math.ceil(ABOVE * high)
        self._tall = self._above + math.ceil(BELOW * high)
        self._aside = math.ceil(0.25 * high)  # pixels by which a letter may overhang
        self._advances: dict[str, int] = {}  # eighths of a pixel
        self._glyphs: dict[tuple[str, int, Colour], pygame.Surface] = {}

    def width(self, text: str) -> int:
        """The width of a text in pixels."""
        return math.ceil(sum(map(self._advance, text)) / PARTS)

    def render(self, text: str, colour: Colour) -> pygame.Surface:
        """A text on a transparent ground."""
        sheet = pygame.Surface((max(1, self.width(text)), self._tall), pygame.SRCALPHA, 32)
        sheet.fill((*colour, 0))
        at, letters = 0, []
        for letter in text:
            whole, part = divmod(at, PARTS)
            letters.append((self._glyph(letter, part, colour), (whole - self._aside, 0)))
            at += self._advance(letter)
        sheet.fblits(letters)
        return sheet

    def _advance(self, letter: str) -> int:
        if letter not in self._advances:
            self._advances[letter] = round(self._font.getlength(_drawable(letter)))
        return self._advances[letter]

    def _glyph(self, letter: str, part: int, colour: Colour) -> pygame.Surface:
        """A letter that begins this many eighths of a pixel after a whole one."""
        if (letter, part, colour) not in self._glyphs:
            wide = math.ceil(self._advance(letter) / PARTS) + 2 * self._aside + 1
            large = Image.new("L", (PARTS * wide, PARTS * self._tall))
            at = (PARTS * self._aside + part, PARTS * self._above)
            ImageDraw.Draw(large).text(at, _drawable(letter), 255, self._font, "ls")
            glyph = Image.new("RGB", (wide, self._tall), colour)
            glyph.putalpha(large.reduce(PARTS))
            self._glyphs[letter, part, colour] = pygame.image.frombytes(glyph.tobytes(), glyph.size, "RGBA")
        return self._glyphs[letter, part, colour]


def _drawable(letter: str) -> str:
    """The letter, or a space for a control character."""
    return letter if letter.isprintable() else " "
