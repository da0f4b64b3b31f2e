"""The page of a drawing and the viewports in it: lengths, view boxes and transforms."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from svgelements import Matrix

from swarmsim.world.elements import NUMBER, Element, ElementError, numbers, quoted
from swarmsim.world.styles import Style

LARGEST = 1e4  #: m, no coordinate may be farther from the origin

_METRES = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6, "q": 0.25e-3}
_CSS_PIXEL = 0.0254 / 96  # m, one user unit of a drawing with a physical width and no viewBox
_LENGTH = re.compile(rf"\s*({NUMBER})\s*(|px|%|{'|'.join(_METRES)})\s*", re.IGNORECASE)
_ACROSS = frozenset({"x", "x1", "x2", "cx", "rx", "width"})  # lengths whose percentages are of the page's width
_UP = frozenset({"y", "y1", "y2", "cy", "ry", "height"})

_TRANSFORM = re.compile(r"\s*([a-zA-Z]+)\s*\(([^()]*)\)[\s,]*")
_TRANSFORM_NUMBERS = {
    "matrix": (6,), "translate": (1, 2), "translateX": (1,), "translateY": (1,), "scale": (1, 2), "scaleX": (1,),
    "scaleY": (1,), "rotate": (1, 3), "skewX": (1,), "skewY": (1,),
}  # fmt: skip
_NAMES = {name.lower(): name for name in _TRANSFORM_NUMBERS}
_DEGREES = {"deg": 1.0, "grad": 0.9, "rad": 180.0 / math.pi, "turn": 360.0}
_UNIT = re.compile(rf"({NUMBER})\s*(px|{'|'.join(_DEGREES)})(?![a-z])", re.IGNORECASE)
_SIDES = {"left": "0%", "top": "0%", "center": "50%", "right": "100%", "bottom": "100%"}
_ALIGNED = re.compile(r"\s*(?:defer\s+)?(none|x(Min|Mid|Max)Y(Min|Mid|Max))(?:\s+(meet|slice))?\s*")
_SHARES = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}


@dataclass(frozen=True, slots=True)
class Page:
    """A viewport: the view box that its lengths refer to, and the size of the whole drawing."""

    left: float  # user units
    top: float
    width: float
    height: float
    unit: float  # m, one user unit of the root
    metres: tuple[float, float]  # width and height of the drawing
    matrix: Matrix  # from the root's user units, y down, to metres, y up from the lower left corner
    pen: float  # m, unit of a stroke that does not scale
    said: str  # the source of the drawing's size, as in `mm`; empty for none

    @classmethod
    def of(cls, root: Element, scale: float, across: float | None = None) -> Page:
        """The page of an <svg> element, multiplied by `scale`, or `across` metres wide.

        A physical width or height (mm, cm, in, pt, pc, Q) gives the drawing's size, and `preserveAspectRatio` the place
        of a viewBox of another shape in it. Otherwise one user unit of the viewBox is one metre, whatever the width in
        pixels.
        """
        sizes = {side: root.attributes.get(side, "") for side in ("width", "height")}
        port = tuple(map(_metres, sizes.values()))
        if "viewBox" in root.attributes:
            view = tuple(numbers(root.attributes["viewBox"], "viewBox", (4,)))
            if not (view[2] > 0.0 and view[3] > 0.0):
                raise ElementError("the viewBox is {:g} x {:g}; it should be larger than nothing".format(*view[2:]))
            matrix, size = _shown(root, view, port, sizes)
        else:
            for side, text in sizes.items():
                if "%" in text or not _LENGTH.fullmatch(text):
                    raise ElementError(
                        f"{side} is {text!r} and there is no viewBox; add viewBox='0 0 WIDTH HEIGHT' in metres"
                    )
            unit = 1.0 if port == (None, None) else _CSS_PIXEL
            lengths = [
                metres / unit if metres is not None else float(_number(sizes[side]))
                for side, metres in zip(sizes, port, strict=True)
            ]
            view = (0.0, 0.0, *lengths)
            matrix, size = Matrix(unit, 0.0, 0.0, unit, 0.0, 0.0), (lengths[0] * unit, lengths[1] * unit)
        if across is not None:
            scale = across / size[0] if size[0] > 0.0 else math.nan
        size = (size[0] * scale, size[1] * scale)
        if not all(0.0 < side <= LARGEST for side in size):
            raise ElementError(
                "the page is {:g} m x {:g} m; width, height and viewBox should make it larger than nothing and at most "
                "{:g} m".format(*size, LARGEST)
            )
        physical = port != (None, None)
        matrix = matrix * Matrix(scale, 0.0, 0.0, -scale, 0.0, size[1])
        unit = math.sqrt(abs(matrix.a * matrix.d))
        pen = _CSS_PIXEL * scale if physical else unit
        units = [match[2] for text in sizes.values() if (match := _LENGTH.fullmatch(text))]
        said = next((unit for unit in units if unit.lower() in _METRES), "")
        return cls(view[0], view[1], view[2], view[3], unit, (size[0], size[1]), matrix, pen, said)

    def within(self, width: float, height: float) -> Page:
        """The same inside a viewport with its own coordinate system."""
        return replace(self, left=0.0, top=0.0, width=width, height=height)

    def units(self, text: str, what: str) -> float:
        """`text`, the value of the attribute `what`, in user units; it is finite, and `50cm` is half a metre."""
        match = _LENGTH.fullmatch(text)
        if match is None or not math.isfinite(float(match[1])):
            raise ElementError(f"{what} is {text!r}; it should be a number, alone or with px, %, {', '.join(_METRES)}")
        unit = match[2].lower()
        if unit != "%":
            return float(match[1]) * (_METRES[unit] / self.unit if unit in _METRES else 1.0)
        diagonal = math.hypot(self.width, self.height) / math.sqrt(2.0)
        return float(match[1]) / 100.0 * (self.width if what in _ACROSS else self.height if what in _UP else diagonal)

    def length(self, element: Element, key: str, missing: str = "0") -> float:
        """An attribute of `element` in user units; `missing` is the default."""
        return self.units(element.attributes.get(key, missing), key)

    def extent(self, element: Element, key: str) -> float:
        """A non-negative attribute of `element` in user units; at 0 nothing is visible."""
        text = element.attributes.get(key, "0")
        value = self.length(element, key) if text.strip().lower() != "auto" else 0.0
        if value < 0.0:
            raise ElementError(f"{key} is {text}; it should not be negative")
        return value

    def viewport(self, element: Element, matrix: Matrix, size: tuple[float, float]) -> tuple[Page, Matrix]:
        """The viewport of a nested <svg> or a <symbol>, and its matrix."""
        if "viewBox" not in element.attributes:
            return self.within(*size), matrix
        view = tuple(numbers(element.attributes["viewBox"], "viewBox", (4,)))
        if not (view[2] > 0.0 and view[3] > 0.0):
            raise ElementError("the viewBox is {:g} x {:g}; it should be larger than nothing".format(*view[2:]))
        return self.within(view[2], view[3]), _fitted(element, view, size) * matrix


def _number(text: str) -> str:
    match = _LENGTH.fullmatch(text)
    return match[1] if match else "nan"


def _metres(text: str) -> float | None:
    """`text` in metres; None if its unit is not physical."""
    match = _LENGTH.fullmatch(text)
    return float(match[1]) * _METRES[match[2].lower()] if match and match[2].lower() in _METRES else None


def _shown(
    root: Element, view: tuple[float, ...], port: tuple[float | None, ...], sizes: dict[str, str]
) -> tuple[Matrix, tuple[float, float]]:
    """The root's viewBox on its page, y down: a matrix from user units to metres, and the page's size."""
    across, up = port
    if across is None and up is None:
        unit, stretch = 1.0, 1.0
        pixels = [_LENGTH.fullmatch(text) for text in sizes.values()]
        if _aspect(root)[0] == "none" and all(size and size[2] != "%" and float(size[1]) > 0.0 for size in pixels):
            wide, high = (float(size[1]) for size in pixels if size)
            stretch = (high / view[3]) / (wide / view[2])
        matrix = Matrix(unit, 0.0, 0.0, unit * stretch, -view[0] * unit, -view[1] * unit * stretch)
        return matrix, (view[2] * unit, view[3] * unit * stretch)
    if across is not None and up is not None and up > 0.0 and across > 0.0:
        unit = across / view[2]
        if abs(unit * view[3] - up) > 0.005 * up:
            return _fitted(root, view, (across, up)), (across, up)
    else:
        unit = across / view[2] if across is not None else (up or 0.0) / view[3]
    return Matrix(unit, 0.0, 0.0, unit, -view[0] * unit, -view[1] * unit), (view[2] * unit, view[3] * unit)


def _aspect(element: Element) -> tuple[str, float, float, str]:
    """The value of `preserveAspectRatio`: none or not, the shares of the leftover space on both axes, meet or slice."""
    text = element.attributes.get("preserveAspectRatio", "xMidYMid meet")
    match = _ALIGNED.fullmatch(text)
    if match is None:
        raise ElementError(f"preserveAspectRatio is {quoted(text)}; it should be none or such as xMidYMid meet")
    return match[1], _SHARES.get(match[2] or "", 0.0), _SHARES.get(match[3] or "", 0.0), match[4] or "meet"


def _fitted(element: Element, view: tuple[float, ...], size: tuple[float, float]) -> Matrix:
    """From the units of a viewBox to those of a viewport of this size, by `preserveAspectRatio`."""
    kind, left, above, how = _aspect(element)
    across, up = size[0] / view[2], size[1] / view[3]
    if kind != "none":
        across = up = min(across, up) if how == "meet" else max(across, up)
    rest = size[0] - across * view[2], size[1] - up * view[3]
    return Matrix(across, 0.0, 0.0, up, left * rest[0] - across * view[0], above * rest[1] - up * view[1])


def placed(outer: Matrix, style: Style, page: Page) -> Matrix:
    """`outer` after the transforms of an element's own style, about their origin."""
    text = style["transform"]
    if not text or text.lower() == "none":
        return outer
    if style["transform-box"] not in {"view-box", "border-box"}:
        raise ElementError(
            f"transform-box is {quoted(style['transform-box'])}, which is not understood here; remove it"
        )
    origin = _origin(style["transform-origin"], page)
    if origin == (0.0, 0.0):
        return transformed(outer, text)
    there = "translate({!r} {!r})".format(*origin)
    back = "translate({!r} {!r})".format(*(-side for side in origin))
    return transformed(outer, f"{there} {text} {back}")


def _origin(text: str, page: Page) -> tuple[float, float]:
    """The point of `transform-origin`, in user units; by default the viewBox's own origin."""
    words = text.split()
    if not words:
        return 0.0, 0.0
    if len(words) == 1:
        words = ["center", *words] if words[0] in {"top", "bottom"} else [*words, "center"]
    if words[0] in {"top", "bottom"} or words[1] in {"left", "right"}:
        words[:2] = words[1], words[0]
    across, up = (_SIDES.get(word, word) for word in words[:2])
    try:
        return page.units(across, "x"), page.units(up, "y")
    except ElementError:
        raise ElementError(f"transform-origin is {quoted(text)}; it should be two lengths or sides") from None


def transformed(outer: Matrix, text: str) -> Matrix:
    """`outer` after the list of transforms in `text`, in the syntax of SVG or of CSS.

    svgelements silently drops what it cannot read, so check for that first.
    """
    position, steps = 0, []
    while position < len(text.rstrip()):
        match = _TRANSFORM.match(text, position)
        name = _NAMES.get(match[1].lower()) if match else None
        if match is None or name is None:
            raise ElementError(f"transform is {quoted(text)}; it should be a list such as translate(1 2) rotate(90)")
        values = numbers(_UNIT.sub(_plain, match[2]), f"transform {name}", _TRANSFORM_NUMBERS[name])
        steps.append(_step(name, values))
        position = match.end()
    try:
        matrix = Matrix(" ".join(steps)) * outer
        bounded = all(map(math.isfinite, (matrix.a, matrix.b, matrix.c, matrix.d, matrix.e, matrix.f)))
    except Exception:  # svgelements has no exception type of its own; a turn by infinity ends here
        bounded = False
    if not bounded:
        raise ElementError("its transforms lead out of all bounds; the numbers in them are too large")
    return matrix


def _plain(match: re.Match[str]) -> str:
    """A number with a CSS unit in SVG's form: angles in degrees, lengths in pixels."""
    factor = _DEGREES.get(match[2].lower(), 1.0)
    return match[1] if factor == 1.0 else repr(float(match[1]) * factor)


def _step(name: str, values: list[float]) -> str:
    """One transform in SVG's form."""
    rest = {"translate": 0.0, "scale": 1.0}
    if name[-1] in "XY" and name[:-1] in rest:
        pair = [values[0], rest[name[:-1]]] if name.endswith("X") else [rest[name[:-1]], values[0]]
        name, values = name[:-1], pair
    return f"{name}({' '.join(map(repr, values))})"
