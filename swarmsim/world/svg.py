"""A floor plan read from an SVG drawing: what it shows is solid, where it has no layers that say so."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import shapely
from shapely import MultiPolygon
from svgelements import Matrix

from swarmsim.core.errors import InputError
from swarmsim.world.areas import covered, joined, polygons, united
from swarmsim.world.elements import Element, ElementError, parse, quoted
from swarmsim.world.layers import LayerNames
from swarmsim.world.outlines import SHAPES
from swarmsim.world.plan import SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, FloorPlan
from swarmsim.world.problems import Problems
from swarmsim.world.styles import INITIAL, Style, StyleSheet, fraction, luminance, reference
from swarmsim.world.viewport import Page, placed, transformed

_DEEPEST = 200  # nested groups, well below Python's own limit
_MOST_ELEMENTS = 50_000  # in the layers; references may multiply a small file without end
_HREF = ("href", "{http://www.w3.org/1999/xlink}href")
_GROUPS = frozenset({"g", "a", "svg", "switch", "symbol"})
_PASSED_OVER = frozenset({"text", "image", "foreignObject", "video", "canvas", "iframe", "audio"})
_PAINT = ("fill", "stroke")
_BRIGHT = 0.5  # of white: what is brighter in a mask shows, what is not hides


def read_floor_plan(
    source: str,
    name: str,
    scale: float = 1.0,
    across: float | None = None,
    layers: Mapping[str, Sequence[str]] | None = None,
) -> FloorPlan:
    """The floor plan in the SVG text `source`; `name` is what messages call the file.

    Its layers are groups or shapes called walls, pillars, furniture, spawn and unknown, or as `layers` say; whatever
    lies outside of them is decoration. Where none of the solid ones is there, all that the drawing shows is a wall, but
    for a shape that fills the page. What paints nothing, or is hidden or clipped, does not count. In the spawn layer,
    each element with an id is one area, whose shape is the inside of its outline, however it is painted. The page is
    multiplied by `scale`, or made so many metres `across`.

    Raises InputError, with the file, the element and what would be right, for all that cannot be read in full.
    """
    root = parse(source, name)
    with root.named(name):
        page = Page.of(root, scale, across)
    sheet = StyleSheet.of(element for element in root.tree() if element.tag == "style")
    drawing = _Drawing(
        name, Problems(name), sheet, {e.attributes["id"]: e for e in root.tree() if "id" in e.attributes}
    )
    names = LayerNames(root, layers or {}, name)
    if misspelt := names.misspelt():
        raise InputError(f"{name}: {misspelt}")
    drawing.names = names
    outside = _Placed(root, "" if names.says_solid else "walls", None, INITIAL, page.matrix, page, None)
    found, shown = _found(drawing, drawing.shapes(root, outside), page, names.says_solid)
    drawing.problems.complain()
    empty = f": {drawing.empty[0]} paints nothing that can be seen" if drawing.empty else ""
    for layer, lacks in (("walls", f"wall in it{empty}; draw walls"), (SPAWN_LAYER, "area in it; draw one with an id")):
        if names.has(layer) and not any(key[0] == layer for key in found):
            rest = "" if layer == SPAWN_LAYER else " as filled shapes or as strokes, in a layer that is shown"
            raise InputError(f"{name}: the layer `{layer}` has no {lacks}{rest}")
    united_layers = {layer: united(found[layer, None]) for layer in SOLID_LAYERS}
    if all(layer.is_empty for layer in united_layers.values()):
        raise InputError(f"{name}: nothing in it is solid{empty}; draw the walls as filled shapes or as strokes")
    spawns: dict[str, MultiPolygon] = {}
    for area in filter(None, (area for _, area in found)):
        if area.attributes["id"] in spawns:
            raise InputError(f"{name}: {area}: another spawn area has the same id; give each its own")
        spawns[area.attributes["id"]] = united(found[SPAWN_LAYER, area])
    return FloorPlan(
        united(united_layers.values()),
        united_layers,
        spawns,
        (0.0, 0.0, *page.metres),
        united(found[UNKNOWN_LAYER, None]),
        tuple(f"{name}: {notice}" for notice in drawing.told(shown, names.says_solid)),
    )


@dataclass(frozen=True, slots=True)
class _Placed:
    """An element with what it has from those around it."""

    element: Element
    layer: str  # empty outside of the layers
    area: Element | None  # in the spawn layer: the element whose id names the area
    style: Style
    matrix: Matrix  # from its user units to metres
    page: Page  # the viewport around it
    clip: shapely.Geometry | None  # in metres, what of it can be seen; None: all


_Found = defaultdict[tuple[str, Element | None], list[shapely.Geometry]]  # by layer and spawn area


def _found(drawing: _Drawing, shapes: Iterator[_Placed], page: Page, says_solid: bool) -> tuple[_Found, int]:
    """What the shapes cover, and how many of them cover anything; paper is left out of a drawing without layers."""
    found: _Found = defaultdict(list)
    paper = shapely.box(0.0, 0.0, *page.metres)
    shown = 0
    for shape in list(shapes):  # all of them first, to refuse too many before the work
        with drawing.remembered(shape.element):
            area = drawing.area(shape)
            if area.is_empty:
                drawing.empty.append(shape.element)
                continue
            if (
                not says_solid
                and shape.layer == "walls"
                and area.area >= 0.999 * paper.area
                and area.covers(shapely.buffer(paper, -1e-3 * max(page.metres)))
            ):
                drawing.notices.append(f"{shape.element} fills the page and is taken for its paper, not for a wall")
                continue
            shown += 1
            found[shape.layer, shape.area].append(area)
    return found, shown


@dataclass(slots=True)
class _Drawing:
    """Finds the shapes in the layers of a drawing, and what is wrong with it."""

    name: str
    problems: Problems
    sheet: StyleSheet
    ids: dict[str, Element]
    names: LayerNames = field(init=False)
    notices: list[str] = field(default_factory=list)
    empty: list[Element] = field(default_factory=list)  # shapes that paint nothing, or nothing that is seen
    passed_over: Counter[str] = field(default_factory=Counter)
    count: int = 0  # elements met so far in layers
    clips: int = 0  # regions that are being found, one within the other

    @contextmanager
    def remembered(self, element: Element) -> Iterator[None]:
        """Keeps what is wrong with an element in this block, so that all problems are told at once."""
        with self.problems.collected(), element.named(self.name):
            yield

    def told(self, shown: int, says_solid: bool) -> list[str]:
        """What a user should know of how the drawing was taken, each in a sentence."""
        told = []
        if not says_solid:
            told.append(f"it has no layer of {', '.join(SOLID_LAYERS)}, so that all {shown} visible shapes are walls")
        if self.passed_over:
            listed = ", ".join(f"{count} <{tag}>" for tag, count in sorted(self.passed_over.items()))
            told.append(f"{listed} are passed over: neither text nor pictures are walls")
        return told + list(dict.fromkeys([*self.sheet.notices, *self.notices]))

    def shapes(self, element: Element, above: _Placed, depth: int = 0) -> Iterator[_Placed]:
        """The visible shapes at and below `element`, which the one of `above` holds or repeats, in their order."""
        if self.count > _MOST_ELEMENTS:
            return
        with self.remembered(element):
            yield from self._shapes(element, above, depth)

    def _shapes(self, element: Element, above: _Placed, depth: int) -> Iterator[_Placed]:
        tag, layer = element.tag, above.layer
        drawn = tag in SHAPES or tag == "use" or (tag in _GROUPS and (tag != "symbol" or above.element.tag == "use"))
        if tag in _PASSED_OVER and layer:
            self.passed_over[tag] += 1
        if not drawn:
            return
        style = self.sheet.styled(element, above.style)
        if style["display"] == "none" or fraction(style["opacity"]) <= 0.0:
            return
        if depth > _DEEPEST:
            raise ElementError(f"nested deeper than {_DEEPEST} groups; ungroup it")
        layer = (self.names.layer_of(element) if self.clips == 0 and depth else "") or layer
        area = above.area if layer == SPAWN_LAYER else None
        if layer:
            self.count += 1
            if self.count > _MOST_ELEMENTS:
                raise ElementError(f"more than {_MOST_ELEMENTS} elements in the layers; simplify the drawing")
        elif tag == "use" or tag in SHAPES:
            return
        if layer == SPAWN_LAYER and "id" in element.attributes and (above.layer == SPAWN_LAYER or tag in SHAPES):
            area = area or element
        matrix = placed(above.matrix, style, above.page)
        clip = self._clipped(replace(above, element=element, style=style, matrix=matrix))
        shape = _Placed(element, layer, area, style, matrix, above.page, clip)
        if tag in SHAPES:
            if style["visibility"] not in {"hidden", "collapse"}:
                if layer == SPAWN_LAYER and area is None:
                    raise ElementError("a spawn area has no id; give it one, by which a scenario can name it")
                yield shape
            return
        yield from self._below(shape, above, depth)

    def _below(self, shape: _Placed, above: _Placed, depth: int) -> Iterator[_Placed]:
        """The shapes in a group, or those that a <use> repeats."""
        element = shape.element
        if element.tag == "use":
            shift = (shape.page.length(element, axis) for axis in "xy")
            there = transformed(shape.matrix, "translate({!r} {!r})".format(*shift))
            target = self._target(element)
            if target is not None:
                yield from self.shapes(target, replace(shape, matrix=there), depth + 1)
            return
        if element.tag == "symbol" or (element.tag == "svg" and depth):
            opened = self._opened(shape, above.element if above.element.tag == "use" else element)
            if opened is None:
                return
            shape = opened
        children = element.children
        if element.tag == "switch":
            children = [child for child in children if _is_able(child)][:1]
        for child in children:
            yield from self.shapes(child, shape, depth + 1)

    def _opened(self, shape: _Placed, sized: Element) -> _Placed | None:
        """What a nested <svg>, or a <symbol> that a <use> repeats, is around its children; None if it has no size."""
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
        """The element that a <use> repeats; None for one that is passed over."""
        link = next((use.attributes[key] for key in _HREF if key in use.attributes), "")
        target = self.ids.get(link.removeprefix("#")) if link.startswith("#") else None
        if target is not None and target.tag in _PASSED_OVER:
            self.passed_over[target.tag] += 1
            return None
        if target is None or target.tag not in {"use", *_GROUPS, *SHAPES}:
            raise ElementError(f"it repeats {quoted(link)}, which is no shape or group here; unlink the clone")
        return target

    def area(self, shape: _Placed) -> shapely.Geometry:
        """What a shape covers, in metres, of what can be seen of it."""
        paints = [luminance(shape.style, paint, self.ids) is not None for paint in _PAINT]
        if shape.layer == SPAWN_LAYER:
            paints = [True, False]
        areas = covered(shape.element, shape.style, shape.matrix, shape.page, (paints[0], paints[1]))
        whole = joined(areas)
        return whole if shape.clip is None else polygons(shapely.intersection(whole, shape.clip))

    def _clipped(self, shape: _Placed) -> shapely.Geometry | None:
        """What of an element can be seen, by its own clip path and mask and by those around it; None: all of it."""
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

    def _region(self, target: Element, shape: _Placed) -> shapely.Geometry:
        """What a <clipPath> or a <mask> lets show of an element, in metres."""
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
            region: shapely.Geometry = MultiPolygon()
            for child in target.children:
                for part in self.shapes(child, around, 1):
                    region = self._lit(region, part) if mask else self._united(region, part)
        finally:
            self.clips -= 1
        return region

    def _united(self, region: shapely.Geometry, part: _Placed) -> shapely.Geometry:
        """The region with the inside of a shape of a clip path."""
        whole = {**part.style, "fill": "black", "fill-opacity": "1", "stroke": "none"}
        style = {**whole, "fill-rule": part.style["clip-rule"]}
        return shapely.union(region, self.area(replace(part, style=style)))

    def _lit(self, region: shapely.Geometry, part: _Placed) -> shapely.Geometry:
        """The region with what a shape of a mask lights, without what it darkens."""
        for paint in _PAINT:
            bright = luminance(part.style, paint, self.ids)
            if bright is not None:
                alone = {**part.style, **{other: "none" for other in _PAINT if other != paint}}
                area = self.area(replace(part, style=alone))
                region = shapely.union(region, area) if bright > _BRIGHT else shapely.difference(region, area)
        return region

    def _bounds(self, shape: _Placed) -> tuple[float, float, float, float]:
        """The bounding box of a shape in its own user units."""
        if shape.element.tag not in SHAPES:
            raise ElementError("it is clipped by the size of a group (objectBoundingBox); release the clip")
        identity = Matrix(1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
        fill, _ = covered(shape.element, INITIAL, identity, shape.page, (True, False))
        if fill.is_empty:
            raise ElementError("it is clipped by its own size, but has none; release the clip")
        left, top, right, bottom = fill.bounds
        return left, top, right, bottom


def _is_able(element: Element) -> bool:
    """Whether a <switch> may show an element: it needs nothing that is not understood here, and no other language."""
    languages = element.attributes.get("systemLanguage", "en").replace(",", " ").split()
    needs = {"requiredExtensions", "requiredFeatures"} & element.attributes.keys()
    return not needs and any(language.startswith("en") for language in languages)
