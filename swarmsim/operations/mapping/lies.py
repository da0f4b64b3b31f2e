"""How messages with tiles can be false."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.capabilities import Lie
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.maps import TileItems

_SWAPPED: Final = np.array([UNKNOWN, OCCUPIED, FREE], np.uint8)  # what a tile's values turn into

Cells = NDArray[np.uint8]


def _retold(change: Callable[[Cells], Cells | int]) -> Lie[TileItems]:
    """False states of cells."""

    def told(items: TileItems, rows: NDArray[np.bool_], offset: tuple[int, int]) -> TileItems:
        values = items.values.copy()
        values[rows] = change(values[rows])
        return replace(items, values=values)

    return Lie(told)


def _displaced(items: TileItems, rows: NDArray[np.bool_], offset: tuple[int, int]) -> TileItems:
    """False places of tiles."""
    origins = items.origins.copy()
    origins[rows] += np.array(offset, np.int32)
    return replace(items, origins=origins)


#: `inverted`: free and occupied swapped. `free`, `occupied`: every cell is so, seen or not. `origin`: each tile is
#: shifted by rows (up) and columns (right) from where it was sensed.
LIES: Final[Mapping[str, Lie[TileItems]]] = {
    "inverted": _retold(lambda cells: _SWAPPED[cells]),
    "free": _retold(lambda cells: FREE),
    "occupied": _retold(lambda cells: OCCUPIED),
    "origin": Lie(_displaced, "[rows, columns]"),
}
