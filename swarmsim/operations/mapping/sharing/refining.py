"""Puts walls on walls to less than a cell, and tells how well they pin the turn between two maps."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.state import OCCUPIED
from swarmsim.operations.mapping.sharing.places import Cells, Points, Transform

NEAR: Final = 2.0  # cells from a wall, within which another one may be the same
SMOOTH: Final = 1.5  # cells: standard deviation of the window in which a wall is a line
FAR: Final = 0.7  # cells between a wall and its line, at which it weighs half
STEPS: Final = 15  # at most
#: Turn (rad), rows and columns (cells): how far the first transform may be from the refined one, standard deviations.
PRIOR: Final = np.array([0.02, 1.0, 1.0])

Floats = NDArray[np.float64]


def refined(first: Transform, fixed: Cells, moving: Cells) -> tuple[Transform, float]:
    """A transform by which walls lie on walls, and the standard error of its turn, rad; infinite without walls.

    Least squares over the distances of one map's walls from lines through those of the other, as in iterative closest
    points with planes (Chen and Medioni, "Object modelling by registration of multiple range images", Image and Vision
    Computing 10 (1992)), with Cauchy's weights, so that far ones count for little. The standard error is that of least
    squares if each wall errs by a cell, with the shift left open. A few walls close together leave the turn open.
    """
    lines = _Lines(fixed)
    walls: Points = np.argwhere(moving == OCCUPIED) + np.float64(0.5)
    found, error = first, np.inf
    for _ in range(STEPS):
        points = found.apply(walls)
        near = lines.away(points) <= NEAR
        if np.count_nonzero(near) < 3:
            return first, np.inf
        points, began = points[near], first.apply(walls[near])
        information, gradient = lines.sums(points)
        error = _error(information)
        turned = found.after(first.inverse()).turn
        changed = np.array([turned, *(points - began).mean(axis=0)])
        step = -np.linalg.solve(information + np.diag(PRIOR**-2), gradient + changed / PRIOR**2)
        found = _about(points.mean(axis=0), step).after(found)
        if np.abs(step / PRIOR).max() < 0.01:
            break
    return found, error


def _about(middle: Floats, step: Floats) -> Transform:
    """A turn about a point, and a shift."""
    turn = Transform(float(step[0]), 0.0, 0.0)
    rows, columns = (middle + step[1:] - turn.apply(middle[None])[0]).tolist()
    return Transform(turn.turn, rows, columns)


def _error(information: Floats) -> float:
    """The standard error of the turn, by the information of turn and shift (3, 3) (its Schur complement)."""
    aside = information[0, 1:]
    left = information[0, 0] - aside @ np.linalg.pinv(information[1:, 1:], rcond=1e-6) @ aside
    return float(max(left, 1e-12) ** -0.5)


class _Lines:
    """The walls of a map as lines, each through the walls around a place."""

    def __init__(self, cells: Cells) -> None:
        solid = (cells == OCCUPIED).astype(np.float64)
        self._away: Floats = ndimage.distance_transform_edt(solid == 0.0)
        weight = _smooth(solid)
        slopes = [ndimage.gaussian_filter(solid, 1.0, order=order) for order in ((1, 0), (0, 1))]
        self._middle = [_smooth(solid * place) / np.maximum(weight, 1e-9) for place in np.indices(cells.shape) + 0.5]
        self._across = [_smooth(slopes[one] * slopes[other]) for one, other in ((0, 0), (0, 1), (1, 1))]

    def away(self, points: Points) -> Floats:
        """How far points (p, 2) are from the nearest wall, cells."""
        return _at(self._away, points)

    def sums(self, points: Points) -> tuple[Floats, Floats]:
        """What points' distances from their lines say of a turn and a shift: information (3, 3), and gradient (3,).

        A line's direction is given by the structure tensor of the walls around it; at a corner both directions count.
        """
        one, mixed, other = (_at(field, points) for field in self._across)
        across = np.array([[one, mixed], [mixed, other]]).transpose(2, 0, 1) / (one + other + 1e-12)[:, None, None]
        apart = points - np.stack([_at(field, points) for field in self._middle], axis=1)
        from_middle = points - points.mean(axis=0)
        by = np.zeros((len(points), 2, 3))
        by[:, 0, 0], by[:, 1, 0], by[:, :, 1:] = from_middle[:, 1], -from_middle[:, 0], np.eye(2)
        pulled = across @ by
        weight = 1.0 / (1.0 + np.einsum("pi,pij,pj->p", apart, across, apart) / FAR**2)
        information = np.einsum("p,pij,pik->jk", weight, by, pulled)
        return information, np.einsum("p,pi,pij->j", weight, apart, pulled)


def _smooth(cells: Floats) -> Floats:
    return np.asarray(ndimage.gaussian_filter(cells, SMOOTH, mode="constant"))


def _at(field: Floats, points: Points) -> Floats:
    """A field at points (p, 2) between the middles of cells."""
    return np.asarray(ndimage.map_coordinates(field, (points - 0.5).T, order=1, mode="nearest"))
