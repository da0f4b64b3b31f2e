"""The style of all figures: colours, markers, letters and resolution, and how a figure is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np
from matplotlib import font_manager, style
from numpy.typing import NDArray

from swarmsim.core.errors import InputError, nearest

if TYPE_CHECKING:
    from matplotlib.typing import LineStyleType

Reals = NDArray[np.float64]
Line = Literal["", "-", "--", ":"]
Kind = Literal["png", "svg", "pdf"]
Look = Literal["paper", "slides", "dark"]

DPI: Final = 150  # of a saved PNG
FINEST: Final = 900  # points along a curve: more than a picture has pixels only make its file larger
TIME: Final = "iterations until done"
#: Okabe and Ito's colours, as on the map, without yellow, which is lost on white paper, and four of Tol's muted ones.
COLOURS: Final = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000",
    "#882255", "#999933", "#332288", "#44AA99",
)  # fmt: skip
BLUE, VERMILLION, GREEN, PURPLE, _, _, BLACK = COLOURS[:7]
GREY: Final = "#6B7280"
PALE: Final = "#DCEBF5"
#: With eleven colours and nine markers no two of the first 99 curves look alike.
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
DASHES: Final[Sequence[LineStyleType]] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (7, 2, 1.5, 2)))
STYLE: Final[dict[str, object]] = {
    "figure.titleweight": "bold", "text.parse_math": False, "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": GREY, "axes.axisbelow": True, "axes.grid": True, "grid.color": "#E3E6EB", "grid.linewidth": 0.8,
    "xtick.color": GREY, "ytick.color": GREY, "xtick.labelcolor": BLACK, "ytick.labelcolor": BLACK,
    "legend.frameon": False, "legend.handlelength": 2.4, "legend.columnspacing": 1.4,
    "svg.hashsalt": "swarmsim", "svg.fonttype": "none", "pdf.fonttype": 42,  # text stays text, its letters in the file
}  # fmt: skip
INCHES: Final = {"pt": 1 / 72, "mm": 1 / 25.4, "cm": 1 / 2.54, "in": 1.0}  # a typesetter's pt is 0.4 % shorter
COLUMN: Final = 5.0  # inches: narrower sheets have the letters of a journal's column
SLIDE: Final = 10.0  # inches


@dataclass(frozen=True, slots=True)
class Imprint:
    """How figures are asked for."""

    kinds: tuple[Kind, ...] = ()  # of files; none: by the file's suffix, or PNG and SVG
    width: float | None = None  # inches; None: what the figure needs
    font: str | None = None  # a family's name; None: matplotlib's own
    title: bool = True
    look: Look = "paper"

    @property
    def letters(self) -> float:
        """The size of letters, points."""
        return 16.0 if self.look == "slides" else 8.0 if self.width is not None and self.width < COLUMN else 10.0

    @property
    def settings(self) -> dict[str, object]:
        """Matplotlib's settings: every figure starts from matplotlib's own, not the user's, and these."""
        sizes = {
            "font.size": 1.0, "axes.labelsize": 1.0, "axes.titlesize": 1.0, "figure.titlesize": 1.2,
            "legend.fontsize": 0.9, "xtick.labelsize": 0.9, "ytick.labelsize": 0.9,
        }  # fmt: skip
        return {
            **STYLE,
            **{name: size * self.letters for name, size in sizes.items()},
            "font.family": [*([self.font] if self.font else []), "DejaVu Sans"],
        }


_IMPRINT: ContextVar[Imprint | None] = ContextVar("printed", default=None)


def asked_for() -> Imprint:
    """How figures are asked for in the present context."""
    return _IMPRINT.get() or Imprint()


@contextmanager
def printing(
    *,
    kinds: Sequence[Kind] = (),
    width: str | None = None,
    font: str | None = None,
    title: bool = True,
    style: Look = "paper",
) -> Iterator[None]:
    """Draw figures for print within this context: `swarmsim plot --width 252pt --pdf`.

    `kinds` of files are "png", "svg" and "pdf"; without any, the name's suffix says which, and otherwise they are PNG
    and SVG. Letters stay text in SVG and PDF. `width` is that of the figure, such as "252pt", "8.9cm" or "3.5in"; below
    5 inches letters are 8 points high. `font` is an installed family. Without `title` no title stands over the figure.
    `style` is "paper", "slides" (large letters) or "dark". Raises InputError for what is unknown.
    """
    for option, value, known in (("style", style, Look), *(("kinds", kind, Kind) for kind in kinds)):
        if value not in get_args(known):
            raise InputError(f"--{option} {value}: expected {' or '.join(get_args(known))}")
    inches = None if width is None else _inches(width)
    if style == "slides" and inches is None:
        inches = SLIDE
    if font is not None:
        families = {each.name: None for each in font_manager.fontManager.ttflist}
        if font not in families:
            raise InputError(f"--font {font}: no such font is installed; {nearest(font, families)}")
    token = _IMPRINT.set(Imprint(tuple(kinds), inches, font, title, style))
    try:
        yield
    finally:
        _IMPRINT.reset(token)


def _inches(width: str) -> float:
    """A width such as 252pt in inches. Raises InputError."""
    number, unit = width[:-2].strip(), width[-2:]
    try:
        inches = float(number) * INCHES[unit]
    except (KeyError, ValueError):
        inches = 0.0
    if not 1.5 <= inches <= 40.0:
        raise InputError(f"--width {width}: expected a width from 1.5in to 40in in pt, mm, cm or in, such as 252pt")
    return inches


@contextmanager
def _styled() -> Iterator[None]:
    with style.context(asked_for().settings, after_reset=True):
        yield


#: Decorates all that draws: in the style that is asked for, whatever the user's own settings are.
styled = _styled()
