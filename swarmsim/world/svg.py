"""A floor plan read from an SVG drawing: what is solid, where robots may start, and how large it is."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from shapely import MultiPolygon
from svgelements import Matrix

from swarmsim.core.errors import InputError
from swarmsim.world.areas import covered, united
from swarmsim.world.elements import Element, ElementError, parse, quoted
from swarmsim.world.outlines import SHAPES
from swarmsim.world.styles import INITIAL, Style, StyleSheet
from swarmsim.world.viewport import Page, transformed

SOLID_LAYERS = ("walls", "pillars", "furniture")  #: layers that stop robots and beams
SPAWN_LAYER = "spawn"  #: the layer whose elements are the areas in which robots may start

_DEEPEST = 200  # nested groups, well below Python's own limit
_MOST_ELEMENTS = 50_000  # in the layers; references may multiply a small file without end
_HREF = ("href", "http://www.w3.org/1999/xlink href")
_LABEL = "http://www.inkscape.org/namespaces/inkscape label"
_GROUPS = frozenset({"g", "a"})
_NEVER_DRAWN = frozenset(
    {"title", "desc", "metadata", "defs", "style", "script", "symbol", "clipPath", "mask", "marker", "pattern"}
    | {"linearGradient", "radialGradient", "filter"}
)


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

    Its layers are groups with these ids, or Inkscape labels; whatever lies outside of them is decoration, and what is
    hidden (`display`, `visibility`) does not count. In the spawn layer, each element with an id is one area, whose
    shape is the inside of its outline, however it is painted.

    Raises InputError, with the file, the element and what would be right, for whatever cannot be read in full.
    """
    root = parse(source, name)
    with root.named(name):
        page = Page.of(root, scale)
        sheet = StyleSheet.of("\n".join(element.text for element in root.tree() if element.tag == "style"))
    drawing = _Drawing(name, page, sheet, {e.attributes["id"]: e for e in root.tree() if "id" in e.attributes})
    outside = _Placed(root, "", None, INITIAL, page.matrix)
    found: defaultdict[tuple[str, Element | None], list[MultiPolygon]] = defaultdict(list)  # by layer and spawn area
    for shape in list(drawing.shapes(root, outside)):  # all of them first, to refuse too many before the work
        style = shape.style if shape.area is None else {**shape.style, "fill": "black", "stroke": "none"}
        with shape.element.named(name):
            found[shape.layer, shape.area].append(covered(shape.element, style, shape.matrix, page))
    layers = {layer: united(found[layer, None]) for layer in SOLID_LAYERS}
    spawns: dict[str, MultiPolygon] = {}
    for area in filter(None, (area for _, area in found)):
        if area.attributes["id"] in spawns:
            raise InputError(f"{name}: {area}: another spawn area has the same id; give each its own")
        spawns[area.attributes["id"]] = united(found[SPAWN_LAYER, area])
    drawing.require("walls", bool(found["walls", None]), "no wall in it; draw the walls as filled shapes or as strokes")
    drawing.require(SPAWN_LAYER, bool(spawns), "no area in it; draw one closed shape with an id")
    return FloorPlan(united(layers.values()), layers, spawns, *page.metres)


@dataclass(frozen=True, slots=True)
class _Placed:
    """An element with what it has from those around it."""

    element: Element
    layer: str  # empty outside of the layers
    area: Element | None  # in the spawn layer: the element whose id names the area
    style: Style
    matrix: Matrix  # from its user units to metres


@dataclass(slots=True)
class _Drawing:
    """Finds the shapes in the layers of a drawing."""

    name: str
    page: Page
    sheet: StyleSheet
    ids: dict[str, Element]
    seen: set[str] = field(default_factory=set)  # layers met so far
    count: int = 0  # elements met so far in layers

    def require(self, layer: str, filled: bool, what: str) -> None:
        """Raises InputError unless the layer was there and held something."""
        if layer not in self.seen:
            raise InputError(
                f"{self.name}: no layer `{layer}`; put its shapes into a visible group with that id"
                " (in Inkscape: a layer of that name)"
            )
        if not filled:
            raise InputError(f"{self.name}: the layer `{layer}` has {what}")

    def shapes(self, element: Element, above: _Placed, depth: int = 0) -> Iterator[_Placed]:
        """The visible shapes at and below `element`, which the one of `above` holds or repeats, in their order."""
        tag, layer, area = element.tag, above.layer, above.area
        if tag in _NEVER_DRAWN or " " in tag or (depth and not layer and tag not in _GROUPS):
            return
        with element.named(self.name):
            style = self.sheet.styled(element, above.style)
            if style["display"] == "none":
                return
            matrix = transformed(above.matrix, element.attributes.get("transform", ""))
            if depth > _DEEPEST:
                raise ElementError(f"nested deeper than {_DEEPEST} groups; ungroup it")
            if layer:
                self._admit(element, layer)
            elif tag == "g":
                layer = self._layer(element)
            if above.layer == SPAWN_LAYER and "id" in element.attributes:
                area = area or element
            if tag == "use":
                shift = (self.page.length(element, axis) for axis in "xy")
                matrix = transformed(matrix, "translate({!r} {!r})".format(*shift))
            placed = _Placed(element, layer, area, style, matrix)
            if tag not in SHAPES:
                for child in [self._target(element)] if tag == "use" else element.children:
                    yield from self.shapes(child, placed, depth + 1)
            elif style["visibility"] not in {"hidden", "collapse"}:
                if layer == SPAWN_LAYER and area is None:
                    raise ElementError("a spawn area has no id; give it one, by which a scenario can name it")
                yield placed

    def _admit(self, element: Element, layer: str) -> None:
        """Raises ElementError for what a layer cannot hold."""
        self.count += 1
        if self.count > _MOST_ELEMENTS:
            raise ElementError(f"more than {_MOST_ELEMENTS} elements in the layers; simplify the drawing")
        if element.tag not in {"use", *_GROUPS, *SHAPES}:
            raise ElementError(
                f"<{element.tag}> cannot be part of the layer `{layer}`; convert it to a path, or move it out of there"
            )

    def _layer(self, group: Element) -> str:
        """The layer that a group is, or an empty string."""
        names = (group.attributes.get("id", ""), group.attributes.get(_LABEL, ""))
        layer = next((name for name in names if name in {*SOLID_LAYERS, SPAWN_LAYER}), "")
        self.seen.add(layer)
        return layer

    def _target(self, use: Element) -> Element:
        """The element that a <use> repeats."""
        reference = next((use.attributes[key] for key in _HREF if key in use.attributes), "")
        target = self.ids.get(reference.removeprefix("#")) if reference.startswith("#") else None
        if target is None or target.tag not in {"use", *_GROUPS, *SHAPES}:
            raise ElementError(f"it repeats {quoted(reference)}, which is no shape or group here; unlink the clone")
        return target
