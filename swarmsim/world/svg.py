"""The contents of an SVG drawing, element by element, in metres."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry
from svgelements import Matrix

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import budget
from swarmsim.core.scenario.file import World
from swarmsim.world.areas import OutOfReachError, covered, lines_of, polygons
from swarmsim.world.elements import Element, ElementError, parse, quoted
from swarmsim.world.layers import LayerNames, names_of
from swarmsim.world.outlines import SHAPES
from swarmsim.world.plan import FLOOR_LAYER, SPAWN_LAYER
from swarmsim.world.problems import Problems
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.styles import INITIAL, Paint, Style, StyleSheet, fraction, luminance, paint, reference
from swarmsim.world.viewport import LARGEST, Page, placed, transformed

_DEEPEST: Final = 400  # nested groups
_MOST_ELEMENTS: Final = 50_000  # references may multiply a small file endlessly
_HREF: Final = ("href", "{http://www.w3.org/1999/xlink}href", "xlink:href")
_LAYER: Final = "{http://www.inkscape.org/namespaces/inkscape}groupmode"
_GROUPS: Final = frozenset({"g", "a", "svg", "switch", "symbol"})
_PASSED_OVER: Final = frozenset({"text", "image", "foreignObject", "video", "canvas", "iframe", "audio"})
_PAINT: Final = ("fill", "stroke")
_BRIGHT: Final = 0.5  # of white: brighter parts of a mask show, others hide
_OPAQUE: Final = 0.9  # a fill that hides shapes below it
_FEW: Final = 0.02  # of all shapes; up to this share may lie off the page by mistake
_LARGE: Final = 200.0  # m; larger pages are mostly drawn in pixels
_LETTERS: Final = 8  # of path data for a segment
_MOST_TEXTS: Final = 2000
_STRAY: Final = 3.0  # times the extent of nearly all shapes; shapes beyond it and off the page are ignored


def read(source: str, name: str, world: World) -> Drawing:
    """The drawing in the SVG text `source`; `name`: of the file in messages.

    Layers are groups or shapes called walls, pillars, furniture, doors, spawn and unknown, or named by `world.layers`
    and `world.floor`. Elements that paint nothing, or are hidden or clipped, do not count. In the spawn layer, each
    element with an id is one area, the inside of its outline, however painted. The page is multiplied by `world.scale`,
    or made `world.width` metres wide.

    Raises InputError, with the file, the element and what would be right, for anything that cannot be read in full.
    """
    root = parse(source, name)
    with root.named(name):
        page = Page.of(root, world.scale or 1.0, world.width)
    sheet = StyleSheet.of(element for element in root.tree() if element.tag == "style")
    names = LayerNames(root, {**world.named, **({FLOOR_LAYER: world.floor} if world.floor else {})}, name)
    if misspelt := names.misspelt():
        raise InputError(f"{name}: {misspelt}")
    ids = {e.attributes["id"]: e for e in root.tree() if "id" in e.attributes}
    reader = _SvgReader(name, Problems(name), sheet, ids, names)
    around = _Placed(root, "", None, "", INITIAL, 1.0, page.matrix, page, None)
    shapes = reader.without_strays([*reader.shapes(root, around)], page)
    reader.problems.complain()
    empty = f": {reader.empty[0]} paints nothing that can be seen" if reader.empty else ""
    for layer, lacks in (("walls", f"wall in it{empty}; draw walls"), (SPAWN_LAYER, "area in it; draw one with an id")):
        if names.has(layer) and not any(shape.layer == layer for shape in shapes):
            rest = "" if layer == SPAWN_LAYER else " as filled shapes or as strokes, in a layer that is shown"
            raise InputError(f"{name}: the layer `{layer}` has no {lacks}{rest}")
    if not page.said and world.width is None and world.scale is None and max(page.metres) > _LARGE:
        reader.notices.append(
            f"its page is {page.metres[0]:g} m x {page.metres[1]:g} m, as one user unit counts as a metre; "
            "world.width = METRES says how wide it is"
        )
    box = (0.0, 0.0, *page.metres)
    return Drawing(name, tuple(shapes), box, page.said, tuple(reader.told()), names.says_solid, empty, _texts(root))


@dataclass(frozen=True, slots=True)
class _Placed:
    """An element with its inherited properties."""

    element: Element
    layer: str  # empty outside of the layers
    area: Element | None  # in the spawn layer: the element whose id names the area
    group: str  # the layer, or else the outermost group with a name
    style: Style
    alpha: float  # of the groups around it together
    matrix: Matrix  # from its user units to metres
    page: Page  # the viewport around it
    clip: BaseGeometry | None  # in metres, its visible region; None: all


_Waiting = tuple[Element, _Placed, int]  # an element, its surroundings, its depth


@dataclass(slots=True)
class _SvgReader:
    """Finds the shapes of a drawing, and its errors."""

    name: str
    problems: Problems
    sheet: StyleSheet
    ids: dict[str, Element]
    names: LayerNames
    areas: dict[str, Element] = field(default_factory=dict)  # spawn areas by id
    notices: list[str] = field(default_factory=list)
    empty: list[Element] = field(default_factory=list)  # shapes that paint nothing visible
    passed_over: Counter[str] = field(default_factory=Counter)
    hidden: int = 0  # hidden shapes
    strays: int = 0  # shapes far off the page
    broken: int = 0  # unreadable shapes outside of the layers
    count: int = 0  # elements met so far
    clips: int = 0  # nested regions being found

    @contextmanager
    def remembered(self, element: Element) -> Iterator[None]:
        """Keeps an element's error in this block, so that all problems are reported at once."""
        with self.problems.collected(), element.named(self.name):
            yield

    def told(self) -> list[str]:
        """On ignored contents, for the user, a sentence each."""
        told = []
        if self.passed_over:
            listed = ", ".join(f"{count} <{tag}>" for tag, count in sorted(self.passed_over.items()))
            told.append(f"{listed} are passed over: neither text nor pictures are walls")
        for count, what in (
            (self.hidden, "hidden"),
            (self.strays, "far off the page"),
            (self.broken, "outside of the layers and cannot be read"),
        ):
            if count:
                told.append(f"{count} shape{'s are' if count > 1 else ' is'} {what}, and passed over")
        return told + list(dict.fromkeys([*self.sheet.notices, *self.notices]))

    def shapes(self, root: Element, around: _Placed) -> Iterator[Shape]:
        """The shapes of visible elements at and below `root`, in their order."""
        waiting = list(self._placed(root, around))  # all of them first, to refuse too many before the work
        far: list[Element] = []
        for shape in budget.pieces(budget.drawing(sum(map(_segments, waiting)), self.name), waiting):
            try:
                found = self.shape(shape)
            except OutOfReachError as problem:
                if problem.off(shape.page.metres):
                    far.append(shape.element)
                else:
                    self._wrong(shape, problem)
            except ElementError as problem:
                self._wrong(shape, problem)
            else:
                if found is not None:
                    yield found
        if len(far) > _FEW * len(waiting):
            for element in far:
                with self.remembered(element):
                    raise ElementError(f"all of it lies farther than {LARGEST:g} m from the page; is the scale right?")
        self.strays += len(far)

    def _wrong(self, shape: _Placed, problem: ElementError) -> None:
        """Notes an unreadable shape; outside of a drawing's layers it is only counted."""
        if shape.layer or not self.names.says_solid:
            with self.remembered(shape.element):
                raise problem
        self.broken += 1

    def _placed(self, element: Element, around: _Placed, depth: int = 0) -> Iterator[_Placed]:
        """The visible shapes at and below an element held or repeated by that of `around`, in their order."""
        waiting: list[_Waiting] = [(element, around, depth)]
        while waiting:
            element, above, depth = waiting.pop()
            with self.remembered(element):
                shape, below = self._visited(element, above, depth)
                if shape is not None:
                    yield shape
                waiting.extend(reversed(below))
            if self.count > _MOST_ELEMENTS:
                return

    def _visited(self, element: Element, above: _Placed, depth: int) -> tuple[_Placed | None, list[_Waiting]]:
        """The shape of an element, or those in it or that it repeats."""
        tag = element.tag
        drawn = tag in SHAPES or tag == "use" or (tag in _GROUPS and (tag != "symbol" or above.element.tag == "use"))
        if tag in _PASSED_OVER and (above.layer or not self.names.says_solid):
            self.passed_over[tag] += 1
        if not drawn:
            return None, []
        style = self.sheet.styled(element, above.style)
        alpha = above.alpha * fraction(style["opacity"])
        if style["display"] == "none" or alpha <= 0.0:
            self.hidden += self._shapes_below(element)
            return None, []
        if depth > _DEEPEST:
            raise ElementError(f"nested deeper than {_DEEPEST} groups; ungroup it")
        layer = (self.names.layer_of(element) if self.clips == 0 and depth else "") or above.layer
        area = above.area if layer == SPAWN_LAYER else None
        self.count += 1
        if self.count > _MOST_ELEMENTS:
            raise ElementError(f"more than {_MOST_ELEMENTS} elements; simplify the drawing")
        if layer == SPAWN_LAYER and "id" in element.attributes and (above.layer == SPAWN_LAYER or tag in SHAPES):
            area = area or element
        group = above.group
        if tag == "g" and depth and (not group or element.attributes.get(_LAYER) == "layer"):
            group = next(iter(names_of(element)[::-1]), group)
        matrix = placed(above.matrix, style, above.page)
        shape = replace(
            above, element=element, layer=layer, area=area, group=group, style=style, alpha=alpha, matrix=matrix
        )
        shape = replace(shape, clip=self._clipped(shape))
        if tag not in SHAPES:
            return None, self._below(shape, above, depth)
        if style["visibility"] in {"hidden", "collapse"}:
            self.hidden += self.clips == 0
            return None, []
        if layer == SPAWN_LAYER and area is None:
            raise ElementError("a spawn area has no id; give it one, by which a scenario can name it")
        if area is not None and self.areas.setdefault(area.attributes["id"], area) is not area:
            raise ElementError("another spawn area has the same id; give each its own")
        return shape, []

    def _shapes_below(self, element: Element) -> int:
        return 0 if self.clips else sum(one.tag in SHAPES for one in element.tree())

    def _below(self, shape: _Placed, above: _Placed, depth: int) -> list[_Waiting]:
        """The contents of a group, or of the element that a <use> repeats."""
        element = shape.element
        if element.tag == "use":
            shift = (shape.page.length(element, axis) for axis in "xy")
            there = transformed(shape.matrix, "translate({!r} {!r})".format(*shift))
            target = self._target(element)
            return [] if target is None else [(target, replace(shape, matrix=there), depth + 1)]
        if element.tag == "symbol" or (element.tag == "svg" and depth):
            opened = self._opened(shape, above.element if above.element.tag == "use" else element)
            if opened is None:
                return []
            shape = opened
        children = element.children
        if element.tag == "switch":
            children = [child for child in children if _is_able(child)][:1]
        return [(child, shape, depth + 1) for child in children]

    def shape(self, placed: _Placed) -> Shape | None:
        """The shape of a visible element, or None if it covers nothing."""
        spawn = placed.layer == SPAWN_LAYER
        paints = [paint(placed.style, one, self.ids) for one in _PAINT]
        shown = (True, False) if spawn else (paints[0] is not None, paints[1] is not None)
        fill, stroke, outlines, pen = covered(placed.element, placed.style, placed.matrix, placed.page, shown)
        if placed.clip is not None:
            fill, stroke = (polygons(shapely.intersection(one, placed.clip)) for one in (fill, stroke))
        if fill.is_empty and stroke.is_empty:
            self.empty.append(placed.element)
            return None
        filled, drawn = (one or Paint(0.0, 1.0) for one in paints)
        return Shape(
            fill, stroke, filled.darkness * placed.alpha, drawn.darkness * placed.alpha,
            filled.alpha * placed.alpha > _OPAQUE, placed.layer, placed.group,
            placed.area.attributes["id"] if placed.area is not None else "",
            lines_of(outlines) if paints[1] is not None else (), pen, str(placed.element),
        )  # fmt: skip

    def without_strays(self, shapes: list[Shape], page: Page) -> list[Shape]:
        """The shapes without those off the page and far from nearly all others."""
        if len(shapes) < 3:
            return shapes
        bounds = shapely.bounds([shapely.union(shape.fill.envelope, shape.stroke.envelope) for shape in shapes])
        centres = 0.5 * (bounds[:, :2] + bounds[:, 2:])
        low, high = np.quantile(centres, [0.005, 0.995], axis=0, method="nearest")
        middle, reach = 0.5 * (low + high), 0.5 * _STRAY * np.maximum(high - low, page.metres)
        off = ((bounds[:, 2:] < 0.0) | (bounds[:, :2] > page.metres)).any(axis=1)
        far: NDArray[np.bool_] = ((bounds[:, 2:] < middle - reach) | (bounds[:, :2] > middle + reach)).any(axis=1)
        self.strays += int((off & far).sum())
        return [shape for shape, stray in zip(shapes, off & far, strict=True) if not stray]

    def _opened(self, shape: _Placed, sized: Element) -> _Placed | None:
        """The surroundings of the children of a nested <svg>, or of a <symbol> in a <use>; None without size."""
        element, page, matrix = shape.element, shape.page, shape.matrix
        if element.tag == "svg":
            shift = (page.length(element, axis) for axis in "xy")
            matrix = transformed(matrix, "translate({!r} {!r})".format(*shift))
        whole = {"width": "100%", "height": "100%"}
        texts = [sized.attributes.get(side, element.attributes.get(side, whole[side])) for side in whole]
        texts = ["100%" if text.strip() == "auto" else text for text in texts]
        size = page.units(texts[0], "width"), page.units(texts[1], "height")
        if min(size) < 0.0:
            raise ElementError("its width or height is negative; it should be larger than 0")
        if min(size) == 0.0:
            return None
        clip = shape.clip
        if shape.style["overflow"] in {"hidden", "scroll"}:
            corners = [(0.0, 0.0), (size[0], 0.0), size, (0.0, size[1])]
            window = shapely.Polygon([matrix.point_in_matrix_space(corner) for corner in corners])
            clip = window if clip is None else shapely.intersection(clip, window)
        inner, within = page.viewport(element, matrix, size)
        return replace(shape, page=inner, matrix=within, clip=clip)

    def _target(self, use: Element) -> Element | None:
        """The element that a <use> repeats; None for an ignored one."""
        link = next((use.attributes[key] for key in _HREF if key in use.attributes), "")
        target = self.ids.get(link.removeprefix("#")) if link.startswith("#") else None
        if target is not None and target.tag in _PASSED_OVER:
            self.passed_over[target.tag] += 1
            return None
        if target is None or target.tag not in {"use", *_GROUPS, *SHAPES}:
            raise ElementError(f"it repeats {quoted(link)}, which is not a shape or group here; unlink the clone")
        return target

    def _area(self, placed: _Placed, paints: tuple[bool, bool]) -> BaseGeometry:
        """The visible area of some of an element's paints, in metres."""
        fill, stroke, _, _ = covered(placed.element, placed.style, placed.matrix, placed.page, paints)
        whole = shapely.union(fill, stroke)
        return whole if placed.clip is None else polygons(shapely.intersection(whole, placed.clip))

    def _clipped(self, shape: _Placed) -> BaseGeometry | None:
        """The visible region of an element, by its own and the surrounding clip paths and masks; None: all."""
        seen = shape.clip
        for key, tag in (("clip-path", "clipPath"), ("mask", "mask")):
            value = shape.style[key]
            if value.lower() == "none":
                continue
            link = reference(value)
            if link is None or link[1]:
                raise ElementError(f"{key} is {quoted(value)}, which is not understood here; use a <{tag}>")
            target = self.ids.get(link[0])
            if target is None or target.tag != tag:
                continue  # a broken reference clips nothing
            region = self._region(target, shape)
            seen = region if seen is None else shapely.intersection(seen, region)
        return seen

    def _region(self, target: Element, shape: _Placed) -> BaseGeometry:
        """The region of an element that a <clipPath> or a <mask> shows, in metres."""
        if self.clips > 8:
            raise ElementError("its clip paths are clipped without end; remove one")
        mask = target.tag == "mask"
        units = target.attributes.get("maskContentUnits" if mask else "clipPathUnits", "userSpaceOnUse")
        matrix = shape.matrix
        if units == "objectBoundingBox":
            left, top, right, bottom = self._bounds(shape)
            matrix = transformed(matrix, f"matrix({right - left!r} 0 0 {bottom - top!r} {left!r} {top!r})")
        style = self.sheet.styled(target, INITIAL)
        around = replace(shape, style=style, matrix=placed(matrix, style, shape.page), layer="walls", clip=None)
        self.clips += 1
        try:
            around = replace(around, clip=self._clipped(around))
            region: BaseGeometry = MultiPolygon()
            for child in target.children:
                for part in self._placed(child, around, 1):
                    with self.remembered(part.element):
                        region = self._lit(region, part) if mask else self._united(region, part)
        finally:
            self.clips -= 1
        return region

    def _united(self, region: BaseGeometry, part: _Placed) -> BaseGeometry:
        """The region with the inside of a shape of a clip path."""
        style = {**part.style, "fill-rule": part.style["clip-rule"]}
        return shapely.union(region, self._area(replace(part, style=style), (True, False)))

    def _lit(self, region: BaseGeometry, part: _Placed) -> BaseGeometry:
        """The region with the part lit by a shape of a mask, without the part it darkens."""
        for number, kind in enumerate(_PAINT):
            bright = luminance(part.style, kind, self.ids)
            if bright is not None:
                area = self._area(part, (number == 0, number == 1))
                region = shapely.union(region, area) if bright > _BRIGHT else shapely.difference(region, area)
        return region

    def _bounds(self, shape: _Placed) -> tuple[float, float, float, float]:
        """The bounding box of a shape in its own user units."""
        if shape.element.tag not in SHAPES:
            raise ElementError("it is clipped by the size of a group (objectBoundingBox); release the clip")
        identity = Matrix(1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
        fill, *_ = covered(shape.element, INITIAL, identity, shape.page, (True, False))
        if fill.is_empty:
            raise ElementError("it is clipped by its own size, but has none; release the clip")
        left, top, right, bottom = fill.bounds
        return left, top, right, bottom


def _segments(shape: _Placed) -> int:
    """The approximate number of segments in a shape's outline."""
    attributes = shape.element.attributes
    return 4 + (len(attributes.get("d", "")) + len(attributes.get("points", ""))) // _LETTERS


def _texts(root: Element) -> tuple[str, ...]:
    """The texts in a drawing."""
    found = (" ".join(element.text.split()) for element in root.tree() if element.tag == "text")
    return tuple(text for text in found if text)[:_MOST_TEXTS]


def _is_able(element: Element) -> bool:
    """Whether a <switch> may show an element: it needs no unknown feature, and no other language."""
    languages = element.attributes.get("systemLanguage", "en").replace(",", " ").split()
    needs = {"requiredExtensions", "requiredFeatures"} & element.attributes.keys()
    return not needs and any(language.startswith("en") for language in languages)
