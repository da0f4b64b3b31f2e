"""The page of a drawing: how large it is, and what its lengths and transforms mean."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from svgelements import Matrix

from swarmsim.world.elements import NUMBER, Element, ElementError, numbers, quoted

LARGEST = 1e4  #: m, no coordinate may be farther from the origin

_METRES = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6}
_CSS_PIXEL = 0.0254 / 96  # m, one user unit of a drawing with a physical width and no viewBox
_LENGTH = re.compile(rf"\s*({NUMBER})\s*(|px|%|{'|'.join(_METRES)})\s*")
_ACROSS = frozenset({"x", "x1", "x2", "cx", "rx", "width"})  # lengths whose percentages are of the page's width
_UP = frozenset({"y", "y1", "y2", "cy", "ry", "height"})

_TRANSFORM = re.compile(r"\s*(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^()]*)\)[\s,]*")
_TRANSFORM_NUMBERS = {
    "matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Page:
    """The viewBox and its scale."""

    left: float  # user units
    top: float
    width: float
    height: float
    unit: float  # m, one user unit of the root

    @classmethod
    def of(cls, root: Element, scale: float) -> Page:
        """The page of an <svg> element, whose `scale` multiplies everything.

        With a physical width (mm, cm, in, pt, pc) the drawing is that wide. Otherwise one user unit of the viewBox is
        one metre, whatever the width in pixels.
        """
        sizes = {side: root.attributes.get(side, "") for side in ("width", "height")}
        across, up = map(_metres, sizes.values())
        if "viewBox" in root.attributes:
            left, top, width, height = numbers(root.attributes["viewBox"], "viewBox", (4,))
            unit = 1.0 if across is None else across / width if width else math.nan
            if across is not None and up is not None and abs(unit * height - up) > 0.005 * up:
                raise ElementError("width and height stretch the viewBox; give them its aspect ratio, or drop height")
        else:
            for side, text in sizes.items():
                if "%" in text or not _LENGTH.fullmatch(text):
                    raise ElementError(
                        f"{side} is {text!r} and there is no viewBox; add viewBox='0 0 WIDTH HEIGHT' in metres"
                    )
            left, top, unit = 0.0, 0.0, 1.0 if across is None else _CSS_PIXEL
            width, height = (cls(left, top, 0.0, 0.0, unit).units(text, side) for side, text in sizes.items())
        page = cls(left, top, width, height, unit * scale)
        if not all(0.0 < side <= LARGEST for side in page.metres):
            raise ElementError(
                "the page is {:g} m x {:g} m; width, height and viewBox should make it larger than nothing and at most "
                "{:g} m".format(*page.metres, LARGEST)
            )
        return page

    @property
    def metres(self) -> tuple[float, float]:
        """Width and height, in m."""
        return self.width * self.unit, self.height * self.unit

    @property
    def matrix(self) -> Matrix:
        """From user units, y down, to metres, y up from the lower left corner."""
        unit = self.unit
        return Matrix(unit, 0.0, 0.0, -unit, -self.left * unit, (self.top + self.height) * unit)

    def units(self, text: str, what: str) -> float:
        """`text`, the value of the attribute `what`, in user units; it is finite, and `50cm` is half a metre."""
        match = _LENGTH.fullmatch(text)
        if match is None or not math.isfinite(float(match[1])):
            raise ElementError(f"{what} is {text!r}; it should be a number, alone or with px, %, {', '.join(_METRES)}")
        if match[2] != "%":
            return float(match[1]) * (_METRES[match[2]] / self.unit if match[2] in _METRES else 1.0)
        diagonal = math.hypot(self.width, self.height) / math.sqrt(2.0)
        return float(match[1]) / 100.0 * (self.width if what in _ACROSS else self.height if what in _UP else diagonal)

    def length(self, element: Element, key: str) -> float:
        """An attribute of `element` in user units, 0 where it is missing."""
        return self.units(element.attributes.get(key, "0"), key)

    def extent(self, element: Element, key: str) -> float:
        """An attribute of `element` in user units, without which there is nothing to see."""
        value = self.length(element, key)
        if value <= 0.0:
            raise ElementError(f"{key} is {element.attributes.get(key, 'missing')}; it should be larger than 0")
        return value


def _metres(text: str) -> float | None:
    """The metres that `text` says; None where its unit is not a physical one."""
    match = _LENGTH.fullmatch(text)
    return float(match[1]) * _METRES[match[2]] if match and match[2] in _METRES else None


def transformed(outer: Matrix, text: str) -> Matrix:
    """`outer` after the list of transforms that `text` says; svgelements drops without a word what it cannot read."""
    position = 0
    while position < len(text.rstrip()):
        match = _TRANSFORM.match(text, position)
        if match is None:
            raise ElementError(f"transform is {quoted(text)}; it should be a list such as translate(1 2) rotate(90)")
        numbers(match[2], f"transform {match[1]}", _TRANSFORM_NUMBERS[match[1]])
        position = match.end()
    try:
        matrix = Matrix(text) * outer
        bounded = all(map(math.isfinite, (matrix.a, matrix.b, matrix.c, matrix.d, matrix.e, matrix.f)))
    except Exception:  # svgelements has no exception type of its own; a turn by infinity ends here
        bounded = False
    if not bounded:
        raise ElementError("its transforms lead out of all bounds; the numbers in them are too large")
    return matrix
