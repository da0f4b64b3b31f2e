"""A building's place in the coordinates of its file, and strays far away from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol, Self, TypeVar

import numpy as np

from swarmsim.core.errors import InputError
from swarmsim.world.viewport import LARGEST

_MIDDLE: Final = (0.05, 0.95)  # of the things' places
_AROUND: Final = 3.0  # times the size of the middle, on all sides; things wholly beyond are strays
_FEW: Final = 10  # things; among fewer, none is a stray


class Placed(Protocol):
    """Something with a place."""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, lower, right, upper."""
        ...

    def shifted(self, x: float, y: float) -> Self:
        """The same, moved by (dx, dy)."""
        ...


P = TypeVar("P", bound=Placed)


def kept(things: Sequence[P]) -> tuple[list[P], list[str]]:
    """The things without strays, which lie wholly beyond three times the size of the rest, and a notice of those."""
    if len(things) < _FEW:
        return list(things), []
    boxes = np.array([thing.bounds for thing in things])
    middles = (boxes[:, :2] + boxes[:, 2:]) / 2.0
    low, high = np.quantile(middles, _MIDDLE, axis=0)
    reach = _AROUND * max(float((high - low).max()), float(np.quantile(boxes[:, 2:] - boxes[:, :2], _MIDDLE[1])))
    stray = ((boxes[:, :2] > high + reach) | (boxes[:, 2:] < low - reach)).any(axis=1)
    told = [f"what lies far outside of all else is passed over (shapes: {stray.sum()})"] if stray.any() else []
    return [thing for thing, far in zip(things, stray, strict=True) if not far], told


def moved(things: Sequence[P], name: str) -> tuple[list[P], list[str]]:
    """The things, moved to the origin if they are too far from it, and a notice of that.

    Raises InputError, with the file's `name`, for a building that is too large.
    """
    boxes = np.array([thing.bounds for thing in things])
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    if float((high - low).max()) > LARGEST:
        raise InputError(
            f"{name}: what it shows is {float((high - low).max()):.4g} m wide, more than {LARGEST:g} m; is its unit "
            "right? If not, say world.scale, or world.width in metres"
        )
    if max(float(np.abs(low).max()), float(np.abs(high).max())) <= LARGEST / 2.0:
        return list(things), []
    x, y = (float(np.floor(side)) for side in low)
    told = f"it lies at ({x:.0f}, {y:.0f}) m, and was moved so that this point is the origin"
    return [thing.shifted(-x, -y) for thing in things], [told]
