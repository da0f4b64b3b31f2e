"""What is written in pictures can be read: letters are told apart by their gaps, and each by its shape alone, against
drawings of two fonts by another program.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pygame
import pytest
from conftest import made
from matplotlib.ft2font import FT2Font, LoadFlags
from numpy.typing import NDArray

from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.lettering import Lettering
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.theme import THEMES, Colour

FONTS = (Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), Path(pygame.__file__).parent / "freesansbold.ttf")
ALPHABET = "0123456789.,%abcdefghijklmnopqrstuvwxyz"
FINE = 8
LETTERS = 0.7  # of the size of a line: about the size of its letters
GAP = 0.5  # of the ink of a line's darkest pixels: where no pixel of a column has more, two letters are apart
SPACE = 0.3  # of the size of letters: how much ground is between two words
SIZES = [(640, 360), (1280, 720), (1920, 1080)]

Ink = NDArray[np.float64]  # (height, width): 0 to 1


@cache
def drawings(font: Path, size: float) -> dict[str, list[tuple[Ink, int]]]:
    """Every letter at every part of a pixel, with the row of the line that it stands on."""
    face = FT2Font(str(font))
    face.set_size(FINE * size, 72)
    found: dict[str, list[tuple[Ink, int]]] = {}
    for letter in ALPHABET:
        face.set_text(letter, 0.0, flags=LoadFlags.NO_HINTING)
        face.draw_glyphs_to_bitmap(antialiased=True)
        large = np.asarray(face.get_image()) / 255.0
        below = -(-face.get_descent() // (64 * FINE))
        above = -(-large.shape[0] // FINE) + 1
        for part in range(0, FINE, 2):
            wide = -(-(large.shape[1] + part) // FINE)
            sheet = np.zeros((FINE * (above + below), FINE * wide))
            bottom = FINE * above + round(face.get_descent() / 64)
            sheet[bottom - large.shape[0] : bottom, part : part + large.shape[1]] = large
            small = sheet.reshape(above + below, FINE, wide, FINE).mean(axis=(1, 3))
            found.setdefault(letter, []).append((small, above))
    return found


def pieces(ink: Ink) -> Iterator[tuple[int, int]]:
    """The columns (first, last) between the gaps of a line."""
    inked = np.flatnonzero(ink.max(axis=0) > GAP * ink.max())
    for run in np.split(inked, np.flatnonzero(np.diff(inked) > 1) + 1):
        yield int(run[0]), int(run[-1])


def unlikeness(piece: Ink, base: int, drawing: Ink, line: int) -> float:
    """How little a piece of a picture and a drawing have in common, 0 to 1, at the best place in a column or two."""
    top, wide = max(base, line), max(piece.shape[1], drawing.shape[1]) + 2
    tall = top + max(piece.shape[0] - base, drawing.shape[0] - line)
    one = np.zeros((tall, wide))
    one[top - base : top - base + piece.shape[0], 1 : 1 + piece.shape[1]] = piece
    best, whole = np.inf, (piece**2).sum() + (drawing**2).sum()
    for shift in range(wide - drawing.shape[1] + 1):
        other = one[top - line : top - line + drawing.shape[0], shift : shift + drawing.shape[1]]
        best = min(best, float(whole - 2.0 * (other * drawing).sum()))
    return best / float(whole)


def read(ink: Ink, size: float) -> str:
    """The text of a line whose letters are about of this size; "?" where none is like a piece of it."""
    readings = []
    column = ink.max(axis=0) / ink.max()
    base = int(np.argmin(np.diff(ink.sum(axis=1)))) + 1  # the row below the one that most letters end in
    for font, close in product(FONTS, (0.95 * size, size, 1.05 * size)):
        text, apart, before = "", [], None
        for first, last in pieces(ink):
            if before is not None and (1.0 - column[before + 1 : first]).sum() > SPACE * close:
                text += " "
            before, piece = last, ink[:, first : last + 1]
            scores = {
                letter: min(unlikeness(piece, base, *one) for one in drawn)
                for letter, drawn in drawings(font, close).items()
                if abs(drawn[0][0].shape[1] - piece.shape[1]) <= 2
            }
            best = min(scores, key=scores.__getitem__, default="?")
            text += best
            apart.append(scores.get(best, 1.0))
        readings.append((float(np.mean(apart)), text))
    return min(readings)[1]


def inked(picture: NDArray[np.uint8], ground: Colour, colour: Colour) -> Ink:
    """How far each pixel is on the way from the ground's colour to the letters'; what lies aside is of other things."""
    away, way = picture.astype(float) - ground, np.array(colour, float) - ground
    shares = away @ way / (way @ way)
    aside = np.linalg.norm(away - shares[..., None] * way, axis=-1) > 0.15 * np.linalg.norm(way)
    return np.where(aside, 0.0, np.clip(shares, 0.0, 1.0))


def pixels(surface: pygame.Surface) -> NDArray[np.uint8]:
    return np.asarray(pygame.surfarray.array3d(surface).transpose(1, 0, 2))


@pytest.fixture(scope="module")
def recording(room: Path) -> Recording:
    return Recording(room)


def shown(recording: Recording, monkeypatch: pytest.MonkeyPatch, value: float, messages: int) -> None:
    """From now on every moment of a scene is that of so much coverage and so many messages."""
    at = Scene.at
    monkeypatch.setattr(
        Scene, "at", lambda self, when, *how: replace(at(self, when, *how), value=value, messages=messages, groups=2)
    )


@pytest.mark.parametrize(("theme", "size"), [*(("dark", size) for size in SIZES), ("light", SIZES[0])], ids=str)
@pytest.mark.parametrize(
    ("value", "messages", "texts"),
    [
        (0.991, 6127, ("99.1 %", "2 groups, 6,127 messages")),
        (0.117, 11835, ("11.7 %", "2 groups, 11,835 messages")),
        (1.0, 907, ("100.0 %", "2 groups, 907 messages")),
    ],
)
def test_numbers_are_read_from_frames(recording, monkeypatch, theme, size, value, messages, texts) -> None:
    shown(recording, monkeypatch, value, messages)
    canvas, colours = Canvas(Scene(recording), size, Style(theme=theme)), THEMES[theme]
    picture = pixels(canvas.draw(40.0))
    left, top = canvas._room.topleft
    panel = canvas._panel
    (x, y), (_, first) = panel._rows[3], panel._rows[0]
    large = picture[top : top + first - 2, left : left + panel._first.width]
    small = picture[top + y - 2 : top + y + panel._line - 2, left + x - 2 : left + panel._first.width]
    assert read(inked(large, colours.background, colours.curve), LETTERS * panel._large) == texts[0]
    assert read(inked(small, colours.background, colours.text), LETTERS * panel._small) == texts[1]


class Listening(Lettering):
    """Keeps what is written."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def render(self, text: str, size: int, colour: Colour) -> pygame.Surface:
        self.texts.append(text)
        return super().render(text, size, colour)


@pytest.mark.parametrize("size", [(320, 360), (480, 270), (640, 360)], ids=str)
def test_what_does_not_fit_into_a_small_picture_is_left_out_and_not_cut(recording, monkeypatch, size) -> None:
    shown(recording, monkeypatch, 0.5, 12345)
    canvas = Canvas(Scene(recording), size)
    canvas._letters = letters = Listening()
    canvas.renew()
    canvas.draw(40.0)
    assert any(text.endswith("12,345 messages") for text in letters.texts)
    assert any(text.startswith("robot, up to") for text in letters.texts)  # the legend
    panel, quarters = canvas._panel, [text for text in letters.texts if text in ("25", "50", "75")]
    assert len(quarters) * panel._line <= panel._plot_area.height


def test_what_the_number_means_is_written_smaller_before_it_is_cut(recording: Recording) -> None:
    scene = Scene(recording)
    canvas = Canvas(scene, (1280, 720))
    for label, kept in (("smallest distance of two robots, m", True), ("m" * 60, False)):
        scene.curve = replace(scene.curve, label=label)
        canvas._letters = letters = Listening()
        canvas.renew()
        assert (label.partition(",")[0] in letters.texts) == kept
        assert any("…" in text for text in letters.texts) != kept


@pytest.mark.parametrize(("topology", "named"), [("none", True), ("full", False)])
def test_a_curve_beneath_that_of_all_together_is_not_named(tmp_path: Path, topology: str, named: bool) -> None:
    run = made("stop.iterations=6", f'network.topology={{use="{topology}"}}')
    with run.recorder(tmp_path / "recording.h5") as recorder:
        run.simulation.run([recorder])
    canvas = Canvas(Scene(Recording(tmp_path / "recording.h5")), (1280, 720))
    canvas._letters = letters = Listening()
    canvas.renew()
    assert ("mean" in letters.texts) == named
    assert ("worst robot" in letters.texts) == named


@pytest.mark.parametrize("size", [(640, 360), (1280, 784)], ids=str)
def test_words_are_read_from_the_window(room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size) -> None:
    from swarmsim.live.session import Replay
    from swarmsim.view.window import BAR, Window

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window(Replay(Recording(room)), tmp_path, size)
    window.playing, window.words = False, "1,835 messages, 0.71 of it together"
    window.frame(0.0)
    assert window._canvas.area.bottom <= size[1] - BAR
    line = pixels(window._screen)[size[1] - BAR + 26 : size[1] - 8]
    pygame.display.quit()
    colours = THEMES["dark"]
    text = read(inked(line, colours.background, colours.text), LETTERS * 20)
    assert text == f"paused, 20 iterations a second {window.words}"
