"""Steps from cell to cell."""

from __future__ import annotations

import numpy as np

from swarmsim.kernels.compiling import njit


@njit(cache=True)
def steps(free, seeds):
    """Steps (rows, columns) between 4-neighbours in `free` from the nearest of `seeds` among them; -1 without a way."""
    rows, columns = free.shape
    found = np.full((rows, columns), -1, np.int32)
    queue = np.empty((rows * columns, 2), np.int32)
    size = 0
    for r in range(rows):
        for c in range(columns):
            if seeds[r, c] and free[r, c]:
                found[r, c] = 0
                queue[size] = r, c
                size += 1
    done = 0
    while done < size:
        row, column = queue[done]
        done += 1
        for down, right in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            r, c = row + down, column + right
            if 0 <= r < rows and 0 <= c < columns and free[r, c] and found[r, c] < 0:
                found[r, c] = found[row, column] + 1
                queue[size] = r, c
                size += 1
    return found
