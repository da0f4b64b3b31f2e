"""Robots that are taken for walls are spared, and maps are counted, as a slow loop does it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmsim.kernels import occupancy


def middle(origin: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    return origin + np.array(shape) / 2


def spared_slowly(tiles, origins, receivers, heard, heard_origins, fresh, reach):
    """What is occupied near a robot that the owner of the tile knows: itself, or one whose tile of now it hears."""
    shape, own, told = tiles.shape[1:], tiles.copy(), heard.copy()

    def clear(tile, origin, place):
        for cell in np.ndindex(*shape):
            if tile[cell] == 2 and np.hypot(*(origin + np.array(cell) + 0.5 - place)) <= reach:
                tile[cell] = 0

    for m, i in enumerate(receivers):
        clear(told[m], heard_origins[m], middle(origins[i], shape))
        if fresh[m]:
            clear(own[i], origins[i], middle(heard_origins[m], shape))
            for other in np.flatnonzero(receivers == i):
                if other != m:
                    clear(told[other], heard_origins[other], middle(heard_origins[m], shape))
    return own, told


@settings(deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([(3, 4), (5, 5), (6, 7)]), st.floats(0.5, 4.0))
def test_robots_are_spared_as_by_a_slow_loop(seed, shape, reach):
    rng = np.random.default_rng(seed)
    robots, letters = 4, int(rng.integers(0, 9))
    tiles = rng.integers(0, 3, (robots, *shape)).astype(np.uint8)
    origins = rng.integers(-3, 4, (robots, 2)).astype(np.int32)
    receivers = np.sort(rng.integers(0, robots, letters)).astype(np.int32)
    heard = rng.integers(0, 3, (letters, *shape)).astype(np.uint8)
    heard_origins = rng.integers(-3, 4, (letters, 2)).astype(np.int32)
    fresh = rng.random(letters) < 0.7
    reach = reach + 1e-6 * np.sqrt(2.0)  # off the distances that cells can have
    expected = spared_slowly(tiles, origins, receivers, heard, heard_origins, fresh, reach)
    occupancy.spare(tiles, origins, receivers, heard, heard_origins, fresh, reach)
    assert np.array_equal(tiles, expected[0])
    assert np.array_equal(heard, expected[1])


@settings(deadline=None)
@given(st.integers(0, 2**32))
def test_cells_are_counted_as_by_a_slow_loop(seed):
    rng = np.random.default_rng(seed)
    robots, cells = 3, 12
    held, holders, each = np.zeros((robots, cells), bool), np.zeros(cells, np.int32), np.zeros(robots, np.int64)
    domain = rng.random(cells) < 0.6
    known, union = np.zeros((robots, cells), np.int64), 0
    for _ in range(5):
        changes = np.column_stack(
            [rng.integers(0, robots, 8), rng.integers(0, cells, 8), rng.integers(0, 3, 8)]
        ).astype(np.int32)
        for robot, cell, state in changes:
            known[robot, cell] = state
        union += occupancy.recount(changes, held, holders, domain, each)
        assert each.tolist() == ((known != 0) & domain).sum(axis=1).tolist()
        assert union == ((known != 0).any(axis=0) & domain).sum()
        assert holders.tolist() == (known != 0).sum(axis=0).tolist()


def test_evidence_changes_no_cell_that_the_tile_does_not_show():
    log_odds, observed = np.zeros((1, 4, 4), np.float32), np.zeros((1, 4, 4), bool)
    tiles = np.array([[[0, 1], [2, 0]]], np.uint8)
    said = np.array([[[3.0, -1.5], [np.nan, np.nan]]], np.float32)
    none = np.empty((0, 2, 2), np.uint8)
    fresh = np.empty(1, np.int32)
    numbers = map(np.float32, (2.0, -0.5, -2.0, 3.5))
    occupancy.fuse(
        log_odds, observed, np.ones(1, bool), tiles, said, np.array([[1, 1]], np.int32), np.empty(0, np.int32), none,
        np.empty((0, 2), np.int32), *numbers, fresh,
    )  # fmt: skip
    assert np.argwhere(observed[0]).tolist() == [[1, 2], [2, 1]]
    assert log_odds[0, 1, 2] == -1.5  # as the sensor says
    assert log_odds[0, 2, 1] == 2.0  # as the map's own model has it
    assert fresh.tolist() == [2]
