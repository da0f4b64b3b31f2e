"""Converts between places in the building and pixels of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmsim.view.scene import Bounds


@dataclass(frozen=True)
class Camera:
    """A view from above."""

    scale: float  # pixels per metre
    left: float  # pixels: where x = 0 is ...
    low: float  # ... and y = 0

    @classmethod
    def fitting(cls, bounds: Bounds, area: tuple[int, int, int, int]) -> Camera:
        """A camera that shows all of `bounds`, centred in an area (left, top, width, height) of the picture."""
        left, right, low, high = bounds
        scale = min(area[2] / (right - left), area[3] / (high - low))
        middle = area[0] + 0.5 * area[2], area[1] + 0.5 * area[3]
        return cls(scale, middle[0] - 0.5 * scale * (left + right), middle[1] + 0.5 * scale * (low + high))

    def pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points (..., 2) in metres lie on the picture: x to the right, y downwards."""
        places: NDArray[np.float64] = points * (self.scale, -self.scale) + (self.left, self.low)
        return places

    def metres(self, x: float, y: float) -> tuple[float, float]:
        """The place in the building at a pixel."""
        return float((x - self.left) / self.scale), float((self.low - y) / self.scale)

    def moved(self, right: float, down: float) -> Camera:
        """The picture moved by this many pixels."""
        return Camera(self.scale, self.left + right, self.low + down)

    def zoomed(self, factor: float, x: float, y: float) -> Camera:
        """The picture enlarged around a pixel, which stays where it is."""
        return Camera(self.scale * factor, x + factor * (self.left - x), y + factor * (self.low - y))
