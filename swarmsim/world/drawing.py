"""A floor plan as an SVG drawing, in metres, with layers that Inkscape shows."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np
import shapely
from shapely import MultiPolygon

from swarmsim.world.plan import SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, FloorPlan

_COLOURS = {"walls": "#3d3835", "pillars": "#6b5d52", "furniture": "#a8824f", UNKNOWN_LAYER: "#b8b8b8"}
_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"


def drawn(plan: FloorPlan, title: str) -> str:
    """The SVG text of a plan, which reads back as the same plan; one user unit is one metre."""
    solid = {layer: plan.layers[layer] for layer in SOLID_LAYERS if not plan.layers[layer].is_empty}
    layers: list[tuple[str, list[tuple[str | None, MultiPolygon]]]] = [
        (layer, [(None, shape)]) for layer, shape in solid.items()
    ]
    if not plan.unknown.is_empty:
        layers.insert(0, (UNKNOWN_LAYER, [(None, plan.unknown)]))
    if plan.spawns:
        layers.append((SPAWN_LAYER, [(name, area) for name, area in plan.spawns.items()]))
    groups = "".join(_group(layer, shapes, plan) for layer, shapes in layers)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="{_INKSCAPE}"'
        f' width="{40 * plan.width:.0f}" height="{40 * plan.height:.0f}"'
        f' viewBox="0 0 {plan.width!r} {plan.height!r}">\n<title>{_escaped(title)}</title>\n{groups}</svg>\n'
    )


def _group(layer: str, shapes: list[tuple[str | None, MultiPolygon]], plan: FloorPlan) -> str:
    colour = _COLOURS.get(layer, "#2f7fd6")
    faint = ' fill-opacity="0.15"' if layer == SPAWN_LAYER else ""
    paths = "".join(
        f'  <path{f" id={quoteattr(name)}" if name is not None else ""} d="{_data(shape, plan)}"/>\n'
        for name, shape in shapes
    )
    return (
        f'<g id="{layer}" inkscape:groupmode="layer" inkscape:label="{layer}" fill="{colour}"{faint}'
        f' fill-rule="evenodd" stroke="none">\n{paths}</g>\n'
    )


def _data(shape: MultiPolygon, plan: FloorPlan) -> str:
    """Path data of all rings, y down from the page's upper left corner."""
    pieces = []
    for ring in shapely.get_rings(shapely.get_parts(shape)):
        corners = np.asarray(ring.coords)[:-1]
        points = np.column_stack([corners[:, 0] - plan.page[0], plan.page[3] - corners[:, 1]])
        pieces.append("M" + "L".join(f"{_plain(x)} {_plain(y)}" for x, y in points.tolist()) + "Z")
    return "".join(pieces)


def _plain(value: float) -> str:
    """A number of metres to the nanometre, as short as possible."""
    return f"{value:.9f}".rstrip("0").rstrip(".")


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
