"""The working memory of searches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

ENDLESS = 2**62  # cells: more than any search settles


class Scratch(NamedTuple):
    """Working memory of the searches, valid where `mark` belongs to the present one."""

    straight: NDArray[np.int32]  # (cells,): edge steps from the start
    diagonal: NDArray[np.int32]  # (cells,): diagonal steps from the start
    parent: NDArray[np.int32]  # (cells,)
    mark: NDArray[np.int64]  # (cells,): twice the search's number, plus 1 once settled
    heap: NDArray[np.int32]  # (8 cells,): a binary heap of cells ...
    keys: NDArray[np.float64]  # (8 cells,): ... ordered by their cost ...
    ranks: NDArray[np.uint64]  # (8 cells,): ... and, for equal cost, by their rank
    number: NDArray[np.int64]  # (1,): of the present search
    left: NDArray[np.int64]  # (1,): how many more cells may be settled in this iteration
    paused: NDArray[np.int64]  # (2,): of a search that goes on: the cells in its heap, 0 for none, and its start


def working_memory(cells: int) -> Scratch:
    """Working memory for a search of a grid."""
    counts = np.zeros((3, cells), np.int32)
    return Scratch(
        counts[0], counts[1], counts[2], np.zeros(cells, np.int64),
        np.zeros(8 * cells, np.int32), np.zeros(8 * cells), np.zeros(8 * cells, np.uint64), np.ones(1, np.int64),
        np.full(1, ENDLESS), np.zeros(2, np.int64),
    )  # fmt: skip
