"""Signs of a legend, with their meanings."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from swarmsim.core.drawing import Ink, Mark, Raster


class Sign(NamedTuple):
    """One sign. Its shapes lie around (0, 0), in pixels of a picture 720 pixels high, not in metres."""

    kind: str
    means: str
    marks: Sequence[Mark]
    radius: float = 3.5  # of a robot


def ramp(*inks: Ink) -> list[Mark]:
    """A strip from one ink over others to the last."""
    steps = len(inks) - 1
    values = np.arange(1, 7 * steps + 1, dtype=np.uint8)[None].repeat(4 * steps, axis=0)
    palette = tuple((7 * step + 1, 7 * step + 7, *pair) for step, pair in enumerate(pairwise(inks)))
    return [Raster(values, (-10.0, -5.0), 20.0 / (7 * steps), palette)]
