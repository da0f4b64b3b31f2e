"""Registration of maps: turns and shifts that were made are found again, and doubtful ones are not believed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.sharing.registration import Match, Meetings, Transform, register


def rooms() -> np.ndarray:
    """A building without symmetry: 40 x 60 cells, five rooms of different sizes with doors."""
    cells = np.full((40, 60), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for column, door in ((14, 8), (33, 25), (48, 31)):
        cells[:, column] = OCCUPIED
        cells[door : door + 4, column] = FREE
    for row, columns, door in ((17, slice(0, 15), 5), (26, slice(14, 34), 24), (12, slice(33, 60), 40)):
        cells[row, columns] = OCCUPIED
        cells[row, door : door + 4] = FREE
    return cells


def turned(cells: np.ndarray, turn: float, aside: tuple[float, float] = (0.3, -0.4)):
    """The map at a turn, on a square that holds it, and where points (p, 2) of it lie then."""
    side = int(np.ceil(np.hypot(*cells.shape))) + 4
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle, centre = (np.array(cells.shape) - 1) / 2.0, np.full(2, (side - 1) / 2.0) + aside
    other = ndimage.affine_transform(cells, matrix, middle - matrix @ centre, (side, side), order=0, cval=UNKNOWN)
    return other, lambda points: (points - middle) @ matrix + centre


def met_at(*places) -> Meetings:
    """Meetings at places of the one map and the other, in turn."""
    fixed, moving = np.array(places[::2], float), np.array(places[1::2], float)
    return Meetings(fixed, moving, 7.0)


@pytest.mark.parametrize("turn", np.deg2rad([0.0, 17.3, 90.0, -121.9, 180.0]))
def test_two_parts_of_a_building_are_put_together(turn: float) -> None:
    whole = rooms()
    west, east = whole.copy(), whole.copy()
    west[:, 38:], east[:, :20] = UNKNOWN, UNKNOWN  # they share 18 columns of 60
    other, where = turned(east, turn)
    met = np.array([20.0, 28.0])
    match = register(west, other, met_at((22.0, 26.0), tuple(where(met))))
    assert match is not None
    assert match.accepted()
    places = np.argwhere((west != UNKNOWN) & (east != UNKNOWN)).astype(float)
    error = match.transform.apply(where(places) + 0.5) - 0.5 - places
    assert np.hypot(*error.T).max() < 1.0
    assert abs((match.transform.turn + turn + np.pi) % (2 * np.pi) - np.pi) < 0.02


def test_maps_that_fit_in_two_ways_are_not_believed() -> None:
    """A corridor is the same from both ends."""
    corridor = np.full((9, 60), OCCUPIED, np.uint8)
    corridor[1:-1] = FREE
    match = register(corridor, corridor, met_at((4.0, 30.0), (4.0, 29.5)))
    assert match is not None
    assert not match.accepted()


def test_meetings_at_both_ends_tell_which_of_two_ways_it_is() -> None:
    corridor = np.full((9, 60), OCCUPIED, np.uint8)
    corridor[1:-1] = FREE
    other, where = turned(corridor, 0.4)
    ends = np.array([[4.0, 4.0], [4.0, 54.0]])
    first, second = where(ends)
    match = register(corridor, other, met_at((4.0, 6.0), first, (5.0, 52.0), second))
    assert match is not None
    assert abs(match.transform.turn + 0.4) < 0.02
    assert np.hypot(*(match.transform.apply(where(ends) + 0.5) - 0.5 - ends).T).max() < 1.0


def test_meetings_that_contradict_each_other_give_no_answer() -> None:
    assert register(rooms(), rooms(), met_at((5.0, 5.0), (5.0, 5.0), (5.0, 6.0), (30.0, 50.0))) is None


def test_transforms_one_after_the_other_and_back() -> None:
    random = np.random.default_rng(4)
    points = random.uniform(-50.0, 50.0, (20, 2))
    for _ in range(20):
        one, other = (Transform(*random.uniform((-np.pi, -40.0, -40.0), (np.pi, 40.0, 40.0))) for _ in range(2))
        np.testing.assert_allclose(one.after(other).apply(points), one.apply(other.apply(points)), atol=1e-9)
        np.testing.assert_allclose(one.inverse().apply(one.apply(points)), points, atol=1e-9)
        assert abs(one.after(other).turn) <= np.pi + 1e-12


def test_maps_without_walls_give_no_answer() -> None:
    floor = np.full((20, 20), FREE, np.uint8)
    assert register(floor, rooms(), met_at((5.0, 5.0), (5.0, 5.0))) is None
    assert register(rooms(), floor, met_at((5.0, 5.0), (5.0, 5.0))) is None


def test_other_buildings_are_not_believed() -> None:
    other = np.rot90(rooms())[::-1].copy()  # a mirror image: no turn makes one of the other
    match = register(rooms(), other, met_at((8.0, 6.0), (6.0, 30.0)))
    assert match is not None
    assert match.agreement < 0.97 or match.walls < 25 or not match.accepted()


def test_a_transform_turns_counter_clockwise_and_shifts() -> None:
    quarter = Transform(np.pi / 2.0, 10.0, 3.0)
    np.testing.assert_allclose(
        quarter.apply(np.array([[0.0, 2.0], [1.0, 0.0]])), [[12.0, 3.0], [10.0, 2.0]], atol=1e-12
    )


def test_what_is_believed_needs_agreement_walls_and_a_margin() -> None:
    good = Match(Transform(0.0, 0.0, 0.0), 500, 0.99, 60, 0.3)
    assert good.accepted()
    for bad in (
        Match(good.transform, 500, 0.9, 60, 0.3),
        Match(good.transform, 500, 0.99, 10, 0.3),
        Match(good.transform, 500, 0.99, 60, 0.01),
    ):
        assert not bad.accepted()
