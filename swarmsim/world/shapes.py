"""The contents of a file, in metres, before deciding on walls."""

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
    """One thing in a file.

    `layer` is its layer in a floor plan, if the file or the user gives it. If neither does, it is empty and its ink
    decides. Shapes in `doors` cut solids; shapes in `floor` are rooms, with walls along their borders if they have no
    stroke of their own.
    """

    fill: MultiPolygon = NOTHING  # area of its fill
    stroke: MultiPolygon = NOTHING  # area of its pen
    fill_ink: float = 1.0  # contrast of the fill to the paper, from 0 to 1 for black on white
    stroke_ink: float = 1.0  # the same for the stroke
    opaque: bool = True  # whether its fill hides shapes below
    layer: str = ""  # one of `plan.LAYERS`, or empty
    group: str = ""  # its layer or group, by the file's own name
    spawn: str = ""  # the name of the area, in the layer `spawn`
    lines: tuple[Line, ...] = ()  # the lines that its pen follows, for door symbols
    pen: float = 0.0  # m, the width of the pen
    where: str = ""  # its name in messages, as in `<rect id="a"> (line 7)`


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """All shapes of a file, lowest first: later shapes cover earlier ones."""

    name: str  # of the file in messages
    shapes: tuple[Shape, ...]
    page: Box  # left, lower, right, upper in m
    unit: str = ""  # the source of its size, as in `mm`; empty for none
    notices: tuple[str, ...] = ()  # on ignored contents, in sentences without the file's name
    says_solid: bool = False  # whether it has layers that say what is solid
    nothing: str = ""  # the rest of a message that nothing is solid, as in `: <rect id="a"> paints nothing ...`
    texts: tuple[str, ...] = ()  # that it contains; they may state its scale
