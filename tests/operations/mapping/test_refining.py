"""Walls are put on walls to less than a cell, and walls that leave a turn open are told from those that pin it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.sharing.places import PINNED, Transform, between
from swarmsim.operations.mapping.sharing.refining import refined

HERE = Transform(0.0, 0.0, 0.0)


def hall() -> np.ndarray:
    """40 x 60 cells with a wall across and a pillar."""
    cells = np.full((40, 60), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[:26, 22] = cells[30:33, 40:44] = OCCUPIED
    return cells


def turned(cells: np.ndarray, turn: float) -> tuple[np.ndarray, Transform]:
    """The map at a turn, and how it lies in the map as it was."""
    side = int(np.hypot(*cells.shape)) + 4
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle, centre = (np.array(cells.shape) - 1) / 2.0, np.full(2, (side - 1) / 2.0)
    other = ndimage.affine_transform(cells, matrix, middle - matrix @ centre, (side, side), order=0, cval=UNKNOWN)
    back = Transform(-turn, 0.0, 0.0)
    rows, columns = (middle + 0.5 - back.apply((centre + 0.5)[None])[0]).tolist()
    return other, Transform(back.turn, rows, columns)


@pytest.mark.parametrize("turn", [0.0, 0.3, -2.0])
@pytest.mark.parametrize("aside", [(0.0, 0.8, -0.7), (0.017, -0.5, 0.4), (-0.01, 0.0, 1.0)])
def test_walls_are_put_on_walls_to_less_than_a_cell(turn: float, aside: tuple[float, float, float]) -> None:
    other, right = turned(hall(), turn)
    found, error = refined(Transform(*aside).after(right), hall(), other)
    assert np.degrees(between(found.turn, right.turn)) < 0.4
    assert found.shift(right) < 0.6
    assert error < PINNED


@pytest.mark.parametrize("length", [24, 48, 80])
def test_the_error_of_a_turn_is_that_of_a_straight_line(length: int) -> None:
    """Of n points a cell apart, each off by a cell: the root of 12 / (n^3 - n)."""
    line = np.full((21, 120), FREE, np.uint8)
    line[10, 20 : 20 + length] = OCCUPIED
    assert refined(HERE, line, line)[1] == pytest.approx((12.0 / (length**3 - length)) ** 0.5, rel=0.1)


def test_walls_close_together_do_not_pin_a_turn() -> None:
    """An alcove, and a long wall of as many cells."""
    alcove = np.full((40, 60), UNKNOWN, np.uint8)
    alcove[20, 20:34] = alcove[21:34, 20] = alcove[21:34, 33] = OCCUPIED
    wall = np.full((40, 60), UNKNOWN, np.uint8)
    wall[20, 10:50] = OCCUPIED
    assert np.count_nonzero(alcove) == np.count_nonzero(wall) == 40
    assert refined(HERE, alcove, alcove)[1] > 1.2 * PINNED
    assert refined(HERE, wall, wall)[1] < PINNED


def test_a_bad_start_never_runs_away() -> None:
    """A turn that walls leave open stays near the one that was found first."""
    post = np.full((30, 30), FREE, np.uint8)
    post[14:16, 14:16] = OCCUPIED
    found, error = refined(Transform(0.05, 0.0, 0.0), post, post)
    assert between(found.turn, 0.05) < 0.03
    assert error > PINNED
    lone = np.full((30, 30), FREE, np.uint8)
    lone[3, 3] = OCCUPIED
    assert refined(HERE, post, lone) == (HERE, np.inf)
