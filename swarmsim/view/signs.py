"""Signs of a legend, with their meanings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarmsim.core.drawing import Ink, Mark, Raster


class Sign(NamedTuple):
    """One sign. Its shapes lie around (0, 0), in pixels of a picture 720 pixels high, not in metres."""

    kind: str
    means: str
    marks: Sequence[Mark]
    radius: float = 3.5  # of a robot


def ramp(low: Ink, high: Ink) -> list[Mark]:
    """A strip from one ink to another."""
    values = np.arange(1, 8, dtype=np.uint8)[None].repeat(4, axis=0)
    return [Raster(values, (-10.0, -5.0), 20.0 / 7.0, ((1, 7, low, high),))]
