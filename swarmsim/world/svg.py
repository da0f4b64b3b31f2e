"""A floor plan read from an SVG drawing: what is solid, where robots may start, and how large it is.

The drawing has up to four layers, which are groups with the id (or the Inkscape label) `walls`, `pillars`,
`furniture` and `spawn`; whatever lies outside them is decoration. The first three are solid, and differ only in
how a picture paints them. A fill is solid over its area, a stroke over its width; opacity does not matter, and
what is hidden (`display`, `visibility`) does not count. In `spawn`, each element with an id is one area, whose
shape is the inside of its outline, however it is painted.

**Scale.** If the root has a physical width (mm, cm, in, pt, pc), the drawing is that wide. Otherwise one user
unit of the viewBox is one metre, whatever the width in pixels. A length with a physical unit inside the drawing is
physical as well: `50cm` is half a metre. `scale` multiplies everything.

Numbers are checked here, because svgelements reads what it can and drops the rest without a word; it does the
path grammar, the arcs and the transforms. A mitre beyond its limit is cut at the limit, not bevelled.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np
import shapely
import svgelements
from numpy.typing import NDArray
from shapely import MultiPolygon

from swarmsim.core.errors import InputError

SOLID_LAYERS = ("walls", "pillars", "furniture")  #: layers that stop robots and beams
SPAWN_LAYER = "spawn"  #: the layer whose elements are the areas in which robots may start

FLATNESS = 1e-3  # m, the largest distance between a curve and the chords that replace it
_GRID = 1e-9  # m, coordinates are rounded to it, which welds walls that abut
_LARGEST = 1e4  # m, no coordinate may be farther from the origin
_DEEPEST = 200  # nested groups, well below Python's own limit
_MOST_ELEMENTS = 50_000  # in the layers; references may multiply a small file without end

_METRES = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "pt": 0.0254 / 72, "pc": 0.0254 / 6}
_CSS_PIXEL = 0.0254 / 96  # m, one user unit of a drawing with a physical width and no viewBox

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_LENGTH_PATTERN = re.compile(rf"\s*({_NUMBER})\s*([a-zA-Z]*|%)\s*")
_PATH_TOKENS = re.compile(rf"{_NUMBER}|[MmZzLlHhVvCcSsQqTtAa]|[\s,]+")
_TRANSFORM_PATTERN = re.compile(r"\s*(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^()]*)\)[\s,]*")
_TRANSFORM_NUMBERS = {
    "matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,),
}  # fmt: skip
_RULE_PATTERN = re.compile(r"([^{}]*)\{([^{}]*)\}")
_SELECTOR_PATTERN = re.compile(r"\*|[\w-]+|[\w-]*\.[\w-]+|#[\w-]+")

_SVG_NAMESPACE = "http://www.w3.org/2000/svg "
_HREF = ("href", "http://www.w3.org/1999/xlink href")
_LABEL = "http://www.inkscape.org/namespaces/inkscape label"
_SHAPES = frozenset({"path", "rect", "circle", "ellipse", "polygon", "polyline", "line"})
_NEVER_DRAWN = frozenset(
    {"title", "desc", "metadata", "defs", "style", "script", "symbol", "clipPath", "mask", "marker", "pattern"}
    | {"linearGradient", "radialGradient", "filter"}
)
#: Paint that applies when nothing is said; all of it is inherited here, also where a mask or clip is only once.
_DEFAULTS = {
    "fill": "black", "fill-rule": "nonzero", "stroke": "none", "stroke-width": "1", "stroke-linecap": "butt",
    "stroke-linejoin": "miter", "stroke-miterlimit": "4", "display": "inline", "visibility": "visible",
    "clip-path": "none", "mask": "none", "stroke-dasharray": "none", "vector-effect": "none",
}  # fmt: skip
_REFUSED = ("clip-path", "mask", "stroke-dasharray", "vector-effect")  # they change what is solid
_CAPS = {"butt": "flat", "round": "round", "square": "square"}
_JOINS = {"miter": "mitre", "round": "round", "bevel": "bevel"}

Points = NDArray[np.float64]  # (n, 2): x, y
Style = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """What a drawing says, in metres, x right and y up from the lower left corner of its page."""

    walls: MultiPolygon  # everything solid, as one
    layers: Mapping[str, MultiPolygon]  # the same, one by one: walls, pillars, furniture
    spawns: dict[str, MultiPolygon]  # areas in which robots may start, by id
    width: float  # m, of the page
    height: float  # m, of the page


def read_floor_plan(source: str, name: str, scale: float = 1.0) -> FloorPlan:
    """The floor plan in the SVG text `source`; `name` is what messages call the file.

    Raises InputError, with the file, the element and what would be right, for whatever cannot be read in full.
    """
    root = _parse_xml(source, name)
    if root.tag != "svg":
        raise InputError(f"{name}: the root is <{root.tag}>, not <svg>; a world is drawn as SVG")
    try:
        page = _Page.of(root, scale)
        sheet = [rule for element in root.tree() if element.tag == "style" for rule in _style_rules(element.text)]
    except _ElementError as wrong:
        raise InputError(f"{name}: {root}: {wrong}") from None
    reader = _Reader(name, page, sheet, {e.attributes["id"]: e for e in root.tree() if "id" in e.attributes})
    solid: dict[str, list[MultiPolygon]] = {layer: [] for layer in SOLID_LAYERS}
    areas: dict[str, list[MultiPolygon]] = {}
    owners: dict[str, _Element] = {}
    for shape in list(reader.shapes(root)):  # all of them first, so that too many are found before work starts
        polygons = reader.polygons(shape)
        if shape.area is None:
            solid[shape.layer].append(polygons)
            continue
        area = shape.area.attributes["id"]
        if owners.setdefault(area, shape.area) is not shape.area:
            raise InputError(f"{name}: {shape.area}: another spawn area has the same id; give each its own")
        areas.setdefault(area, []).append(polygons)
    reader.require("walls", bool(solid["walls"]), "no wall in it; draw the walls as filled shapes or as strokes")
    reader.require(SPAWN_LAYER, bool(areas), "no area in it; draw one closed shape with an id")
    layers = {layer: _union(polygons) for layer, polygons in solid.items()}
    spawns = {area: _union(polygons) for area, polygons in areas.items()}
    return FloorPlan(_union(list(layers.values())), layers, spawns, page.metres_wide, page.metres_high)


class _ElementError(Exception):
    """What is wrong with one element; whoever knows the file and the element adds them."""


@dataclass(eq=False, slots=True)
class _Element:
    """One XML element, with its place in the file."""

    tag: str
    attributes: dict[str, str]
    line: int
    number: int  # among the elements of its tag, from 1
    children: list[_Element] = field(default_factory=list)
    text: str = ""

    def __str__(self) -> str:
        mark = f' id="{self.attributes["id"]}">' if "id" in self.attributes else f"> number {self.number}"
        return f"<{self.tag}{mark} (line {self.line})"

    def tree(self) -> Iterator[_Element]:
        """The element itself and all below it, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(reversed(element.children))


def _parse_xml(source: str, name: str) -> _Element:
    """The tree of `source`; expat itself, because ElementTree forgets the line of an element."""
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    above: list[_Element] = [_Element("", {}, 0, 0)]
    numbers: dict[str, int] = {}

    def start(tag: str, attributes: dict[str, str]) -> None:
        tag = tag.removeprefix(_SVG_NAMESPACE)
        numbers[tag] = numbers.get(tag, 0) + 1
        element = _Element(tag, attributes, parser.CurrentLineNumber, numbers[tag])
        above[-1].children.append(element)
        above.append(element)

    def end(_tag: str) -> None:
        above.pop()

    def text(characters: str) -> None:
        above[-1].text += characters

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    try:
        parser.Parse(source, True)
    except expat.ExpatError as error:
        why = expat.ErrorString(error.code)
        raise InputError(
            f"{name}: line {error.lineno}, column {error.offset + 1}: not XML ({why}); save it as plain SVG"
        ) from None
    except UnicodeEncodeError as error:
        line = source.count("\n", 0, error.start) + 1
        column = error.start - source.rfind("\n", 0, error.start)
        raise InputError(f"{name}: line {line}, column {column}: not XML (not text); save it as UTF-8") from None
    return above[0].children[0]


@dataclass(frozen=True, slots=True)
class _Page:
    """The viewBox and its scale."""

    left: float  # user units
    top: float
    width: float
    height: float
    unit: float  # m, one user unit of the root

    @classmethod
    def of(cls, root: _Element, scale: float) -> _Page:
        """The page of an <svg> element."""
        metres = {side: _physical(root.attributes.get(side, "")) for side in ("width", "height")}
        across, up = metres["width"], metres["height"]
        if "viewBox" in root.attributes:
            left, top, width, height = _numbers(root.attributes["viewBox"], "viewBox", (4,))
            unit = 1.0 if across is None else across / width if width else math.nan
            if across is not None and up is not None and abs(unit * height - up) > 0.005 * up:
                raise _ElementError(
                    "width and height stretch the viewBox; give them its aspect ratio, or leave height out"
                )
        else:
            unit = 1.0 if across is None else _CSS_PIXEL
            left = top = 0.0
            width, height = (
                _pixels(root, side) if metres[side] is None else (metres[side] or 0.0) / _CSS_PIXEL
                for side in ("width", "height")
            )
        page = cls(left, top, width, height, unit * scale)
        if not (0.0 < page.metres_wide <= _LARGEST and 0.0 < page.metres_high <= _LARGEST):
            raise _ElementError(
                f"the page is {page.metres_wide:g} m x {page.metres_high:g} m; "
                f"width, height and viewBox should make it larger than nothing and at most {_LARGEST:g} m"
            )
        return page

    @property
    def metres_wide(self) -> float:
        """Width of the page, in m."""
        return self.width * self.unit

    @property
    def metres_high(self) -> float:
        """Height of the page, in m."""
        return self.height * self.unit

    @property
    def diagonal(self) -> float:
        """What a percentage is one of where neither width nor height is meant, in user units."""
        return math.hypot(self.width, self.height) / math.sqrt(2.0)

    @property
    def transform(self) -> str:
        """From user units, y down, to metres, y up, as SVG writes it."""
        unit = self.unit
        return f"matrix({unit!r} 0 0 {-unit!r} {-self.left * unit!r} {(self.top + self.height) * unit!r})"

    def length(self, text: str, what: str, whole: float) -> float:
        """`text` in user units, finite; a percentage is one of `whole`."""
        match = _LENGTH_PATTERN.fullmatch(text)
        unit = match[2] if match else ""
        if match is None or not math.isfinite(float(match[1])) or unit not in {"", "px", "%", *_METRES}:
            raise _ElementError(f"{what} is {text!r}; it should be a number, alone or with px, %, {', '.join(_METRES)}")
        number = float(match[1])
        if unit == "%":
            return number / 100.0 * whole
        return number * _METRES[unit] / self.unit if unit in _METRES else number


def _physical(text: str) -> float | None:
    """The metres that `text` says; None where its unit is not a physical one."""
    match = _LENGTH_PATTERN.fullmatch(text)
    return float(match[1]) * _METRES[match[2]] if match and match[2] in _METRES else None


def _pixels(root: _Element, side: str) -> float:
    """The root's width or height in user units, for a drawing without a viewBox."""
    text = root.attributes.get(side, "")
    match = _LENGTH_PATTERN.fullmatch(text)
    if match is None or match[2] not in {"", "px"}:
        raise _ElementError(f"{side} is {text!r} and there is no viewBox; add viewBox='0 0 WIDTH HEIGHT' in metres")
    return float(match[1])


def _numbers(text: str, what: str, counts: tuple[int, ...]) -> list[float]:
    """The finite numbers in `text`, separated by blanks or commas, as many as one of `counts` says."""
    parts = text.replace(",", " ").split()
    try:
        if not all(re.fullmatch(_NUMBER, part) for part in parts):
            raise ValueError
        values = [float(part) for part in parts]
    except ValueError:
        raise _ElementError(f"{what} is {_short(text)}; it should hold numbers alone") from None
    if counts and len(values) not in counts:
        raise _ElementError(f"{what} has {len(values)} numbers; it should have {' or '.join(map(str, counts))}")
    if not all(map(math.isfinite, values)):
        raise _ElementError(f"{what} is {_short(text)}; a number in it is too large")
    return values


def _short(text: str) -> str:
    """`text` in quotes, cut to what a message bears."""
    return repr(text if len(text) <= 40 else f"{text[:37]}...")


def _checked_transform(text: str) -> str:
    """`text`, if it is a list of SVG transforms."""
    position = 0
    while position < len(text.rstrip()):
        match = _TRANSFORM_PATTERN.match(text, position)
        if match is None:
            raise _ElementError(f"transform is {_short(text)}; it should be a list such as translate(1 2) rotate(90)")
        _numbers(match[2], f"transform {match[1]}", _TRANSFORM_NUMBERS[match[1]])
        position = match.end()
    return text


def _matrix(transform: str) -> svgelements.Matrix:
    """The matrix of a list of transforms, all of it finite."""
    try:
        matrix = svgelements.Matrix(transform)
    except Exception:  # svgelements has no exception type of its own; a turn by infinity ends here
        matrix = None
    if matrix is None or not all(map(math.isfinite, (matrix.a, matrix.b, matrix.c, matrix.d, matrix.e, matrix.f))):
        raise _ElementError("its transforms lead out of all bounds; the numbers in them are too large")
    return matrix


def _declarations(text: str) -> dict[str, str]:
    """The properties of a `style` attribute or of the inside of a style rule."""
    pairs = (part.partition(":") for part in text.split(";"))
    return {key.strip(): value.replace("!important", "").strip() for key, _, value in pairs if value.strip()}


def _style_rules(text: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Selector and properties of each rule of a style sheet that says anything about what is solid."""
    for selectors, body in _RULE_PATTERN.findall(re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)):
        declarations = _declarations(body)
        if not declarations.keys() & {*_DEFAULTS, "transform"}:
            continue
        for selector in map(str.strip, selectors.split(",")):
            if not _SELECTOR_PATTERN.fullmatch(selector):
                raise _ElementError(f"the style sheet selects {_short(selector)}; use a plain tag, .class or #id")
            yield selector, declarations


@dataclass(frozen=True, slots=True)
class _Shape:
    """One shape in one of the layers."""

    element: _Element
    layer: str
    area: _Element | None  # in the spawn layer: the element whose id names the area
    style: Style
    transform: str  # to metres


@dataclass(slots=True)
class _Reader:
    """Walks the drawing and turns its shapes into polygons."""

    name: str
    page: _Page
    sheet: list[tuple[str, dict[str, str]]]
    ids: dict[str, _Element]
    seen: set[str] = field(default_factory=set)  # layers met so far
    count: int = 0  # elements met so far in layers

    def error(self, element: _Element, what: object) -> InputError:
        """An error in one element."""
        return InputError(f"{self.name}: {element}: {what}")

    def require(self, layer: str, filled: bool, what: str) -> None:
        """Raises InputError unless the layer was there and held something."""
        if layer not in self.seen:
            raise InputError(
                f"{self.name}: no layer `{layer}`; put its shapes into a visible group with that id"
                " (in Inkscape: a layer of that name)"
            )
        if not filled:
            raise InputError(f"{self.name}: the layer `{layer}` has {what}")

    def shapes(self, root: _Element) -> Iterator[_Shape]:
        """Every visible shape in a layer, in the order of the file."""
        yield from self._below(root, "", None, _DEFAULTS, self.page.transform, 0)

    def _below(
        self, element: _Element, layer: str, area: _Element | None, style: Style, transform: str, depth: int
    ) -> Iterator[_Shape]:
        """The shapes in `element`, given what it inherits."""
        tag = element.tag
        if tag in _NEVER_DRAWN or " " in tag or (depth and not layer and tag not in {"g", "a"}):
            return
        try:
            style = self._styled(element, style)
            if style["display"] == "none":
                return
            transform = f"{transform} {_checked_transform(element.attributes.get('transform', ''))}"
            self.count += bool(layer)
            if self.count > _MOST_ELEMENTS:
                raise _ElementError(f"more than {_MOST_ELEMENTS} elements in the layers; simplify the drawing")
            if depth > _DEEPEST:
                raise _ElementError(f"nested deeper than {_DEEPEST} groups; ungroup it")
            if layer and tag not in {"g", "a", "use", *_SHAPES}:
                raise _ElementError(
                    f"<{tag}> cannot be part of the layer `{layer}`; convert it to a path, or move it out of the layer"
                )
            if tag == "use":
                transform += self._shift(element)
                children = [self._target(element)]
            else:
                children = element.children
        except _ElementError as wrong:
            raise self.error(element, wrong) from None
        if not layer and tag == "g":
            layer = self._layer(element)
            if layer:
                self.seen.add(layer)
        elif layer == SPAWN_LAYER and area is None and "id" in element.attributes:
            area = element
        if tag in _SHAPES:
            yield from self._shape(element, layer, area, style, transform)
            return
        for child in children:
            yield from self._below(child, layer, area, style, transform, depth + 1)

    def _shape(
        self, element: _Element, layer: str, area: _Element | None, style: Style, transform: str
    ) -> Iterator[_Shape]:
        """The shape itself, if it is to be seen."""
        if style["visibility"] in {"hidden", "collapse"}:
            return
        if layer == SPAWN_LAYER and area is None:
            raise self.error(element, "a spawn area has no id; give it one, by which a scenario can name it")
        yield _Shape(element, layer, area, style, transform)

    def _layer(self, group: _Element) -> str:
        """The layer that a group is, or an empty string."""
        names = (group.attributes.get("id", ""), group.attributes.get(_LABEL, ""))
        return next((name for name in names if name in {*SOLID_LAYERS, SPAWN_LAYER}), "")

    def _target(self, use: _Element) -> _Element:
        """The element that a <use> repeats."""
        reference = next((use.attributes[key] for key in _HREF if key in use.attributes), "")
        target = self.ids.get(reference.removeprefix("#")) if reference.startswith("#") else None
        if target is None or target.tag not in {"g", "a", "use", *_SHAPES}:
            raise _ElementError(f"it repeats {_short(reference)}, which is no shape or group here; unlink the clone")
        return target

    def _shift(self, use: _Element) -> str:
        """By how much a <use> moves what it repeats, as a transform."""
        x, y = (_length(use, axis, self.page) for axis in "xy")
        return f" translate({x!r} {y!r})"

    def _styled(self, element: _Element, inherited: Style) -> Style:
        """What `element` inherits, overridden by its attributes, the style sheet and its style, in this order."""
        own = {key: value.strip() for key, value in element.attributes.items() if key in _DEFAULTS}
        marks = [{"*"}, {element.tag}, set(), {f"#{element.attributes.get('id', '')}"}]
        for name in element.attributes.get("class", "").split():
            marks[2] |= {f".{name}", f"{element.tag}.{name}"}
        for mark in marks if self.sheet else ():
            for selector, declarations in self.sheet:
                own |= declarations if selector in mark else {}
        own |= _declarations(element.attributes.get("style", ""))
        if "transform" in own:
            raise _ElementError("its style has a transform; write it as the attribute `transform`")
        return {**inherited, **{key: own[key] for key in own.keys() & _DEFAULTS if own[key] != "inherit"}}

    def polygons(self, shape: _Shape) -> MultiPolygon:
        """What `shape` covers, in metres."""
        try:
            with np.errstate(all="ignore"):  # overflows are found by looking at the coordinates
                return self._covered(shape)
        except shapely.errors.GEOSException as error:
            raise self.error(shape.element, f"its geometry cannot be built ({error}); redraw it") from None
        except _ElementError as wrong:
            raise self.error(shape.element, wrong) from None

    def _covered(self, shape: _Shape) -> MultiPolygon:
        """What `shape` covers, in metres."""
        style = shape.style
        for key in _REFUSED:
            if style[key] != "none":
                raise _ElementError(f"{key} is {_short(style[key])}, which is not understood here; remove it")
        matrix = _matrix(shape.transform)
        linear = np.array([[matrix.a, matrix.c], [matrix.b, matrix.d]])
        shift = np.array([matrix.e, matrix.f])
        stretch, squeeze = np.linalg.svd(linear, compute_uv=False)
        if squeeze <= 1e-9 * max(stretch, 1e-9):
            raise _ElementError("its transforms flatten it to a line; no scale in them should be 0")
        outlines = _outlines(shape.element, self.page, FLATNESS / stretch)
        for points, _ in outlines:
            metres = points @ linear.T + shift
            if not (np.isfinite(metres).all() and np.abs(metres).max() <= _LARGEST and np.abs(points).max() < 1e12):
                raise _ElementError(f"a point lies farther than {_LARGEST:g} m from the page; is the scale right?")
        parts = []
        if shape.area is not None or style["fill"] != "none":
            parts.append(_filled(outlines, style["fill-rule"] == "evenodd", 1e-6 / stretch, shape.element))
        if shape.area is None and style["stroke"] != "none":
            parts.append(_stroked(outlines, style, self.page, FLATNESS / stretch))
        if not parts:
            raise _ElementError("neither fill nor stroke; a solid thing needs one of them, or move it out of the layer")
        local = shapely.union_all(parts)
        coefficients = [matrix.a, matrix.c, matrix.b, matrix.d, matrix.e, matrix.f]
        covered = _union([shapely.affinity.affine_transform(local, coefficients)])
        if covered.is_empty:
            raise _ElementError("it covers no area; give it an extent, or remove it")
        return covered


def _union(geometries: list[MultiPolygon]) -> MultiPolygon:
    """The union as a MultiPolygon, rounded to the grid."""
    parts = shapely.get_parts(shapely.union_all(geometries, grid_size=_GRID))
    return MultiPolygon([part for part in parts if part.geom_type == "Polygon" and part.area > 0.0])


Outlines = list[tuple[Points, bool]]  # each with whether it closes itself


def _outlines(element: _Element, page: _Page, flatness: float) -> Outlines:
    """The outlines of a shape in its own user units, flattened."""
    tag = element.tag
    if tag == "path":
        return _flattened(_path_segments(element.attributes.get("d", "")), flatness)
    if tag in {"polygon", "polyline"}:
        values = _numbers(element.attributes.get("points", ""), "points", ())
        if len(values) % 2 or len(values) < 4:
            raise _ElementError(f"points has {len(values)} numbers; it should have two for each of two or more points")
        return [(np.array(values).reshape(-1, 2), tag == "polygon")]

    match tag:
        case "line":
            x1, y1, x2, y2 = (_length(element, key, page) for key in ("x1", "y1", "x2", "y2"))
            return [(np.array([[x1, y1], [x2, y2]]), False)]
        case "circle":
            centre = _length(element, "cx", page), _length(element, "cy", page)
            curve = svgelements.Circle(*centre, _extent(element, "r", page))
        case "ellipse":
            centre = _length(element, "cx", page), _length(element, "cy", page)
            curve = svgelements.Ellipse(*centre, _extent(element, "rx", page), _extent(element, "ry", page))
        case _:
            corner = _length(element, "x", page), _length(element, "y", page)
            size = _extent(element, "width", page), _extent(element, "height", page)
            given = [key for key in ("rx", "ry") if element.attributes.get(key, "auto") != "auto"]
            radii = [_length(element, key, page) for key in given] * (3 - len(given)) if given else [0.0, 0.0]
            if min(radii) < 0.0:
                raise _ElementError("rx or ry is negative; a radius should be 0 or larger")
            curve = svgelements.Rect(*corner, *size, *radii)
    return _flattened(curve.segments(), flatness)


def _length(element: _Element, key: str, page: _Page) -> float:
    """A length attribute in user units, 0 where it is missing."""
    across = key in {"x", "x1", "x2", "cx", "rx", "width"}
    whole = page.diagonal if key == "r" else page.width if across else page.height
    return page.length(element.attributes.get(key, "0"), key, whole)


def _extent(element: _Element, key: str, page: _Page) -> float:
    """A length attribute without which there is nothing to see."""
    value = _length(element, key, page)
    if value <= 0.0:
        raise _ElementError(f"{key} is {element.attributes.get(key, 'missing')}; it should be larger than 0")
    return value


def _path_segments(data: str) -> list[object]:
    """The segments of path data, which must be readable to its end."""
    left = _PATH_TOKENS.sub("", data)
    if left:
        raise _ElementError(f"d has {_short(left[0])}, which is no path command; only MLHVCSQTAZ and numbers are")
    try:
        segments = list(svgelements.Path(data))
    except Exception as error:  # svgelements has no exception type of its own
        raise _ElementError(f"d is {_short(data)}, in which a command has too few or too many numbers") from error
    if not segments:
        raise _ElementError("d is empty; it should say where the path goes")
    if not isinstance(segments[0], svgelements.Move):
        raise _ElementError(f"d is {_short(data)}; it should start with M and a point")
    return segments


def _flattened(segments: list[object], flatness: float) -> Outlines:
    """Outlines whose curves are replaced by chords at most `flatness` away."""
    outlines: Outlines = []
    points: list[Points] = []
    for segment in segments:
        if isinstance(segment, svgelements.Move):
            _keep(outlines, points, closed=False)
            points = [_corner(segment.end)]
        elif isinstance(segment, svgelements.Close):
            _keep(outlines, points, closed=True)
            points = points[:1]
        else:
            points.extend(_chords(segment, flatness))
    _keep(outlines, points, closed=False)
    if not outlines:
        raise _ElementError("it has no line in it; it should have two points or more")
    return outlines


def _keep(outlines: Outlines, points: list[Points], closed: bool) -> None:
    """Adds an outline, unless it is a single point."""
    if len(points) > 1:
        outlines.append((np.array(points), closed))


def _corner(point: object) -> Points:
    """A point of svgelements as an array of two finite numbers."""
    try:
        corner = np.array([float(point.x), float(point.y)])  # type: ignore[attr-defined]
    except (AttributeError, TypeError):
        raise _ElementError("d has a command with too few numbers") from None
    if not np.isfinite(corner).all():
        raise _ElementError("d has a number that is too large")
    return corner


def _chords(segment: object, flatness: float) -> list[Points]:
    """The ends of the chords of one segment; a start is the end of the segment before."""
    if isinstance(segment, svgelements.Arc) and segment.sweep and segment.rx and segment.ry:
        # An ellipse is a stretched circle, and its chords stray at most as far as those of the larger circle.
        return _sampled(segment, abs(float(segment.sweep)) / _chord_angle(max(segment.rx, segment.ry), flatness))
    if isinstance(segment, (svgelements.QuadraticBezier, svgelements.CubicBezier)):
        corners = np.array([_corner(corner) for corner in segment])
        degree = len(corners) - 1
        bend = degree * (degree - 1) * np.linalg.norm(np.diff(corners, 2, axis=0), axis=1).max()
        return _sampled(segment, math.sqrt(bend / (8.0 * flatness)))  # a chord strays by at most bend dt^2 / 8
    return [_corner(segment.end)]  # type: ignore[attr-defined]


def _chord_angle(radius: float, flatness: float) -> float:
    """The angle of an arc of `radius`, a quarter at most, that strays `flatness` from its chord."""
    return max(4.0 * math.asin(math.sqrt(min(0.5 * flatness / radius, 0.5 - math.sqrt(0.125)))), 1e-9)


def _sampled(curve: object, pieces: float) -> list[Points]:
    """The ends of at least `pieces` chords along a curve."""
    if not math.isfinite(pieces):
        raise _ElementError("d has a number that is too large")
    count = max(1, min(math.ceil(pieces), 10_000))  # more are needed only beyond the largest coordinate
    return list(curve.npoint(np.linspace(0.0, 1.0, count + 1))[1:])  # type: ignore[attr-defined]


def _filled(outlines: Outlines, even_odd: bool, gap: float, element: _Element) -> shapely.Geometry:
    """What the outlines enclose by the fill rule; `gap` is how far apart the ends of a closed one may lie."""
    rings = []
    for points, closed in outlines:
        if not closed and np.linalg.norm(points[0] - points[-1]) > gap:
            raise _ElementError(
                "its outline is open; close it (Z), or set fill='none' if only its stroke is solid"
                if element.tag != "line"
                else "a line encloses no area; set fill='none' and a stroke, or draw an area"
            )
        ring = points[np.append(True, np.any(np.diff(points, axis=0), axis=1))]
        if len(ring) >= 3:
            rings.append(np.vstack([ring, ring[:1]]))
    if len(rings) == 1:
        polygon = shapely.Polygon(rings[0])
        if polygon.is_valid:
            return polygon
    # Cut the plane along all rings at once, and ask each piece how often the rings wind around it.
    cuts = shapely.union_all([shapely.LineString(ring) for ring in rings])
    pieces = shapely.get_parts(shapely.polygonize(shapely.get_parts(cuts)))
    inside = shapely.get_coordinates(shapely.point_on_surface(pieces))
    windings = sum((_windings(ring, inside) for ring in rings), np.zeros(len(inside), dtype=np.int64))
    return shapely.union_all(pieces[windings % 2 == 1 if even_odd else windings != 0])


def _windings(ring: Points, points: Points) -> NDArray[np.int64]:
    """How often a closed ring (m + 1, 2) winds around each of the points (n, 2)."""
    start, step = ring[:-1], np.diff(ring, axis=0)
    above = ring[:, 1] > points[:, 1, None]  # (n, m + 1)
    crossing = above[:, 1:].astype(np.int64) - above[:, :-1]
    offset = points[:, None] - start
    side = step[:, 0] * offset[..., 1] - step[:, 1] * offset[..., 0]
    windings: NDArray[np.int64] = np.where(side * crossing > 0.0, crossing, 0).sum(axis=1)
    return windings


def _stroked(outlines: Outlines, style: Style, page: _Page, flatness: float) -> shapely.Geometry:
    """What a pen of the stroke's width covers along the outlines."""
    width = page.length(style["stroke-width"], "stroke-width", page.diagonal)
    if not 0.0 < width < 1e12:
        raise _ElementError(f"stroke-width is {style['stroke-width']!r}; it should be larger than 0")
    limit = page.length(style["stroke-miterlimit"], "stroke-miterlimit", 1.0)
    try:
        cap, join = _CAPS[style["stroke-linecap"]], _JOINS[style["stroke-linejoin"]]
    except KeyError as key:
        raise _ElementError(f"{key} is no stroke-linecap or -linejoin; use {', '.join({**_CAPS, **_JOINS})}") from None
    quarter = math.ceil(math.pi / 2.0 / _chord_angle(width / 2.0, flatness))
    lines = []
    for points, closed in outlines:
        ring = closed and len(np.unique(points, axis=0)) >= 3
        lines.append(shapely.LinearRing(points) if ring else shapely.LineString(points))
    pen = {"cap_style": cap, "join_style": join, "mitre_limit": max(limit, 1.0), "quad_segs": min(quarter, 10_000)}
    return shapely.union_all(shapely.buffer(lines, width / 2.0, **pen))
