"""What a file shows, in metres, before anything of it is taken for a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon

from swarmsim.core.events import Box

NOTHING = MultiPolygon()

Line = NDArray[np.float64]  # (n, 2): x, y in m; closed if its ends are the same


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One thing that a file shows.

    `layer` is the layer of a floor plan that it belongs to, where the file or the user says so. It is empty where
    neither does: then its ink decides. Shapes in `doors` cut what is solid; shapes in `floor` are rooms, with walls
    along their borders where they have no stroke of their own.
    """

    fill: MultiPolygon = NOTHING  # what its fill covers
    stroke: MultiPolygon = NOTHING  # what its pen covers
    fill_ink: float = 1.0  # how far the fill stands out from the paper, from 0 to 1 for black on white
    stroke_ink: float = 1.0  # likewise for the stroke
    opaque: bool = True  # whether its fill hides what lies below
    layer: str = ""  # one of `plan.LAYERS`, or empty
    group: str = ""  # the layer or group that holds it, by the file's own name
    spawn: str = ""  # the name of the area, in the layer `spawn`
    lines: tuple[Line, ...] = ()  # the lines that its pen follows, for door symbols
    pen: float = 0.0  # m, the width of the pen
    where: str = ""  # what messages call it, as in `<rect id="a"> (line 7)`


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """All that a file shows, the lowest first: later shapes cover earlier ones."""

    name: str  # what messages call the file
    shapes: tuple[Shape, ...]
    page: Box  # left, lower, right, upper in m
    unit: str = ""  # what says how large it is, as in `mm`; empty if nothing does
    notices: tuple[str, ...] = ()  # what was passed over, in sentences without the file's name
    says_solid: bool = False  # whether it has layers that say what is solid
    nothing: str = ""  # the rest of a message that nothing is solid, as in `: <rect id="a"> paints nothing ...`
    texts: tuple[str, ...] = ()  # what is written in it, which may state its scale
