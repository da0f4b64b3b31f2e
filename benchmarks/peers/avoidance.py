"""The avoidance of W(N) in numpy, for simulators without their own: that of `wander`, without bends."""

import numpy as np


def twists(bearings: np.ndarray, ranges: np.ndarray, clearance: float, speed: float, period: float) -> np.ndarray:
    """Velocities (n, 2), m/s ahead and rad/s, for beams (b,) in rad that end at `ranges` (n, b) in m."""
    push = np.where(ranges < clearance, clearance / np.maximum(ranges, 1e-3) - 1.0, 0.0) * 4.0 / len(bearings)
    turn = np.arctan2(-push @ np.sin(bearings), 1.0 - push @ np.cos(bearings))
    return np.stack([speed * np.maximum(np.cos(turn), 0.0), turn / period], axis=1)
