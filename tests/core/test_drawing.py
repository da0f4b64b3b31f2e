"""Shapes as arrays: where the corners of areas come to lie."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmsim.core.drawing import SHARPEST, Polygons, Reals, placed

SQUARE = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
NOBODY = np.empty(0)


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1]])
@pytest.mark.parametrize("at", [None, np.array([(5.0, -3.0)])])
def test_all_sides_of_an_area_move_outwards_alike_wherever_its_place_is(corners: Reals, at: Reals | None) -> None:
    middle = np.array([1.0, 1.0]) + (0.0 if at is None else at)
    grown = placed(Polygons(corners, np.array([4]), at=at), NOBODY, 0.1)
    assert_allclose(grown - middle, 1.1 * (corners - 1.0), atol=1e-12)


def test_a_thin_form_on_a_robot_gets_an_edge_along_its_sides_too() -> None:
    line, robot = np.array([(0.0, -0.1), (4.0, -0.1), (4.0, 0.1), (0.0, 0.1)]), np.array([1])
    mark = Polygons(
        line, np.array([4]), at=np.array([(7.0, 7.0)]), yaw=np.array([0.5 * np.pi]), unit="body", of=robot, rides=True
    )
    grown = placed(mark, np.array([9.0, 0.5]), 0.2)
    assert_allclose(grown, [(7.25, 6.8), (7.25, 9.2), (6.75, 9.2), (6.75, 6.8)], atol=1e-12)


def test_a_sharp_corner_reaches_no_farther_than_it_may_and_empty_areas_are_left_out() -> None:
    needle = np.array([(0.0, -0.01), (1.0, 0.0), (0.0, 0.01)])
    mark = Polygons(np.concatenate([needle, SQUARE]), np.array([0, 3, 3, 7, 7]))
    grown = placed(mark, NOBODY, 0.1)
    assert_allclose(grown[1], (1.0 + SHARPEST * 0.1, 0.0), atol=1e-12)
    assert_allclose(grown[3:], 1.1 * (SQUARE - 1.0) + 1.0, atol=1e-12)
