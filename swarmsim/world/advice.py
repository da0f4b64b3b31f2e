"""What an unknown file says about itself, before deciding how to read it."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from swarmsim.world.doors import cut_by_symbols
from swarmsim.world.plan import SOLID_LAYERS
from swarmsim.world.shapes import Drawing

LEAVES: Final = (0.7, 0.85, 1.0)  # m, widths of door leaves: least, usual, most
MUCH: Final = 0.1  # share of the drawing; more than this outside of the layers deserves a question
_SCALE: Final = re.compile(r"\b1\s*:\s*([1-9][0-9]{1,3})\b")
_WIDTHS: Final = (2.0, 5.0, 12.0, 30.0, 75.0, 190.0)  # m of a page, at which door symbols are looked for
_FEWEST: Final = 2  # door symbols that give a drawing's size


@dataclass(frozen=True, slots=True)
class LayerAdvice:
    """The contents of one layer, or group, of a drawing."""

    name: str  # empty for shapes in none
    layer: str  # the floor plan's layer that it counts as; empty for none
    shapes: int
    share: float  # of all that is drawn


def groups(drawing: Drawing) -> list[LayerAdvice]:
    """The groups of a drawing, largest first."""
    count: Counter[tuple[str, str]] = Counter()
    ink: defaultdict[tuple[str, str], float] = defaultdict(float)
    for shape in drawing.shapes:
        count[shape.group, shape.layer] += 1
        ink[shape.group, shape.layer] += shape.fill.area + shape.stroke.area
    whole = sum(ink.values()) or 1.0
    found = [LayerAdvice(name, layer, count[name, layer], ink[name, layer] / whole) for name, layer in count]
    return sorted(found, key=lambda group: -group.share)


def decoration(drawing: Drawing) -> list[LayerAdvice]:
    """The large groups outside of a drawing's layers, which may hold walls."""
    if not drawing.says_solid:
        return []
    return [group for group in groups(drawing) if not group.layer and group.name and group.share >= MUCH]


def figures(drawing: Drawing) -> list[str]:
    """A drawing's contents, in sentences."""
    filled = sum(not shape.fill.is_empty for shape in drawing.shapes)
    lines = sum(shape.fill.is_empty and not shape.stroke.is_empty for shape in drawing.shapes)
    areas = f"{filled} filled area{'' if filled == 1 else 's'}"
    seen = f"{len(drawing.shapes)} shape{'' if len(drawing.shapes) == 1 else 's'} that can be seen"
    told = [f"{seen}: {areas}, {lines} line{'' if lines == 1 else 's'}"]
    named = [group for group in groups(drawing) if group.name]
    if named:
        listed = ", ".join(
            f"`{one.name}` {one.shapes} ({100.0 * one.share:.0f} % of what is drawn"
            f"{f', {one.layer}' if one.layer in SOLID_LAYERS and one.layer != one.name.lower() else ''})"
            for one in named[:8]
        )
        told.append(f"layers: {listed}{f' and {len(named) - 8} more' if len(named) > 8 else ''}")
    return told


def stated_scale(drawing: Drawing) -> int | None:
    """The scale that the texts of a drawing state, as 100 for 1:100; None if they state none, or several."""
    found = {int(match[1]) for text in drawing.texts for match in _SCALE.finditer(text)}
    return found.pop() if len(found) == 1 else None


def width_by_doors(drawing: Drawing) -> tuple[float, float, float, int] | None:
    """How wide (m) the page would be if its door symbols were real doors: at least, likely, at most, and their number.

    None for too few symbols.
    """
    left, _, right, _ = drawing.page
    lined = [shape for shape in drawing.shapes if shape.lines]
    best: list[float] = []
    for width in _WIDTHS:
        factor = width / (right - left)
        grown = [
            replace(shape, lines=tuple(factor * line for line in shape.lines), pen=max(factor * shape.pen, 1e-3))
            for shape in lined
        ]
        _, openings = cut_by_symbols(grown)
        leaves = [min(np.hypot(*np.diff(np.asarray(door.exterior.coords), axis=0).T)[[0, 2]]) for door in openings]
        if len(leaves) > len(best):
            best = [float(leaf) / factor for leaf in leaves]
    if len(best) < _FEWEST:
        return None
    page = (right - left) / float(np.median(best))
    return page * LEAVES[0], page * LEAVES[1], page * LEAVES[2], len(best)
