"""How large robots are drawn: at true size or, where that is too small to see, larger."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.view.scene import Frame, Scene

LEAST: Final = 3.0  # pixels: the smallest radius of a robot's disc, even if discs then overlap


class Discs:
    """The discs of robots under a camera."""

    def __init__(self, scene: Scene, scale: float, legible: float) -> None:
        """Radii are at least `legible` pixels unless discs would overlap; `scale` is in pixels per metre."""
        self._scale, self._true = scale, np.asarray(scale * scene.radii, np.float64)
        self._wanted = np.maximum(self._true, legible)
        self.radius = float(self._wanted.max())  # pixels, of the largest robot with no other near
        #: The enlargement of robots, 1 at true size.
        self.enlarged = float((self._wanted / self._true).max())

    def radii(self, shot: Frame) -> NDArray[np.float64]:
        """The radii (n,) of discs in pixels: as large as legible or true, but smaller where they would overlap."""
        if self.enlarged <= 1.0:
            return self._true
        there = np.array([mark not in ("removed", "late") for mark in shot.marks]) | shot.alive
        places = self._scale * np.where(there[:, None], shot.pose[:, :2], np.inf)
        with np.errstate(invalid="ignore"):
            apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        np.fill_diagonal(apart, np.inf)
        nearest = np.nan_to_num(apart, nan=np.inf, posinf=np.inf).min(axis=1)
        fitting: NDArray[np.float64] = np.minimum(self._wanted, 0.5 * nearest)
        return np.maximum(fitting, np.maximum(self._true, LEAST))
