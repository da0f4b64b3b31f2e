"""Random numbers hashed from their purpose, so that one more draw shifts no other."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_GAMMA: Final = np.uint64(0x9E3779B97F4A7C15)
_FIRST: Final = np.uint64(0xBF58476D1CE4E5B9)
_SECOND: Final = np.uint64(0x94D049BB133111EB)


def uniform(salt: int, *keys: ArrayLike) -> NDArray[np.float64]:
    """Numbers in [0, 1), one for each element of the broadcast `keys` (whole numbers), hashed with the 64-bit `salt`.

    Each key is mixed in by one step of SplitMix64 (Steele, Lea and Flood 2014); the upper 53 bits make the number.
    """
    state = np.array([salt], np.uint64)  # an array, because numpy warns of overflow in scalars
    for key in keys:
        state = _mixed(state ^ np.asarray(key).astype(np.uint64))
    return np.asarray((state >> np.uint64(11)) * 2.0**-53)


def normal(salt: int, *keys: ArrayLike) -> NDArray[np.float64]:
    """Standard normal numbers for `keys`, as in `uniform`, by the method of Box and Muller (1958)."""
    radius = np.sqrt(-2.0 * np.log1p(-uniform(salt, *keys, 0)))
    return np.asarray(radius * np.cos(2.0 * np.pi * uniform(salt, *keys, 1)))


def _mixed(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = state + _GAMMA
    state = (state ^ (state >> np.uint64(30))) * _FIRST
    state = (state ^ (state >> np.uint64(27))) * _SECOND
    return np.asarray(state ^ (state >> np.uint64(31)))
