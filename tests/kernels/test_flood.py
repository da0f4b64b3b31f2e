"""Steps between cells against a queue of Python's own."""

from __future__ import annotations

from collections import deque

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.testing import assert_array_equal

from swarmsim.kernels.flood import steps

GRIDS = arrays.arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def slowly(free, seeds):
    found = np.full(free.shape, -1)
    waiting = deque(map(tuple, np.argwhere(free & seeds).tolist()))
    for cell in waiting:
        found[cell] = 0
    while waiting:
        row, column = waiting.popleft()
        for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if 0 <= r < free.shape[0] and 0 <= c < free.shape[1] and free[r, c] and found[r, c] < 0:
                found[r, c] = found[row, column] + 1
                waiting.append((r, c))
    return found


@given(GRIDS, st.data())
def test_steps_are_those_of_a_queue(free, data):
    seeds = data.draw(arrays.arrays(np.bool_, free.shape))
    assert_array_equal(steps(free, seeds), slowly(free, seeds))


def test_without_seeds_nothing_is_reached():
    assert_array_equal(steps(np.ones((3, 4), np.bool_), np.zeros((3, 4), np.bool_)), -np.ones((3, 4)))
