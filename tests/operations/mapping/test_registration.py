"""Registration of maps: turns and shifts that were made are found again, and doubtful ones are not believed."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from conftest import ROOT
from scipy import ndimage

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.sharing.merging import refuted
from swarmsim.operations.mapping.sharing.places import Match, Place, Transform, at
from swarmsim.operations.mapping.sharing.registration import Meetings, register


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
    error = match.best.transform.apply(where(places) + 0.5) - 0.5 - places
    assert np.hypot(*error.T).max() < 1.0
    assert abs((match.best.transform.turn + turn + np.pi) % (2 * np.pi) - np.pi) < 0.02


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
    assert abs(match.best.transform.turn + 0.4) < 0.02
    assert np.hypot(*(match.best.transform.apply(where(ends) + 0.5) - 0.5 - ends).T).max() < 1.0


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
    assert not match.accepted()


def test_a_transform_turns_counter_clockwise_and_shifts() -> None:
    quarter = Transform(np.pi / 2.0, 10.0, 3.0)
    np.testing.assert_allclose(
        quarter.apply(np.array([[0.0, 2.0], [1.0, 0.0]])), [[12.0, 3.0], [10.0, 2.0]], atol=1e-12
    )


def test_what_is_believed_needs_agreement_walls_a_turn_and_no_rival() -> None:
    here = Transform(0.0, 0.0, 0.0)
    rival = Place(here, 400, 9, 40)
    assert Match(Place(here, 500, 5, 60), (), 40, 0.01).accepted()
    for bad in (
        Match(Place(here, 500, 50, 60), (), 40, 0.01),
        Match(Place(here, 500, 5, 10), (), 40, 0.01),
        Match(Place(here, 500, 5, 60), (rival,), 4, 0.01),
        Match(Place(here, 500, 5, 60), (), 40, 0.02),
    ):
        assert not bad.accepted()


def test_noisy_maps_need_more_contradictions() -> None:
    """Perfect ones 12; with 2 % of wrong cells, more than chance and a factor of log 0.005 / log 0.02 explain."""
    here = Transform(0.0, 0.0, 0.0)
    assert Place(here, 1000, 0, 100).needed == Place(here, 1000, 5, 100).needed == 12
    assert Place(here, 1000, 20, 100).needed == int(np.ceil(12 * np.log(0.005) / np.log(0.02) + 3 * np.sqrt(30.0)))


def test_a_place_is_judged_where_it_is_asked_for() -> None:
    whole = rooms()
    here = at(whole, whole, Transform(0.0, 0.0, 0.0))
    assert (here.overlap, here.contradictions) == (2400, 0)
    aside = at(whole, whole, Transform(0.0, 0.0, 5.0))
    assert aside.overlap == 40 * 55
    assert aside.contradictions > 100


def ward(columns: slice) -> np.ndarray:
    """A part of a corridor with equal rooms on one side, 10 cells each, the last one with a cupboard."""
    cells = np.full((20, 81), FREE, np.uint8)
    cells[[0, 11, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[11:, ::10] = OCCUPIED
    for door in range(3, 80, 10):
        cells[11, door : door + 4] = FREE
    cells[14:17, 75:80] = OCCUPIED
    part = np.full_like(cells, UNKNOWN)
    part[:, columns] = cells[:, columns]
    return part


def test_equal_rooms_are_undecided_after_one_meeting_and_the_second_tells() -> None:
    """The shift by a room is as good until they meet near the cupboard, which only then is on both maps."""
    right = np.array([0.0, 0.0])
    first = register(ward(slice(12, 49)), ward(slice(12, 49)), met_at((5.0, 30.0), (5.0, 25.0)))
    assert first is not None
    assert not first.accepted()
    assert len(first.rivals) >= 1
    both = met_at((5.0, 30.0), (5.0, 25.0), (5.0, 68.0), (5.0, 72.0))
    second = register(ward(slice(12, 81)), ward(slice(12, 81)), both)
    assert second is not None
    assert second.accepted()
    assert np.abs(second.best.transform.apply(right[None]) - right).max() < 1.0


def test_what_only_the_second_meeting_offers_is_found() -> None:
    """At the first the right place is refuted: a table was moved to the next room between both robots' visits."""
    before, after = ward(slice(12, 59)), ward(slice(12, 59))
    before[14:17, 24:29] = after[14:17, 34:39] = OCCUPIED
    met = met_at((5.0, 30.0), (5.0, 35.0))
    first = register(before, after, met)
    assert first is not None
    places = [first.best, *first.rivals]
    assert not any(np.abs(one.transform.apply(np.zeros((1, 2)))).max() < 1.0 for one in places)
    whole = ward(slice(12, 81))
    whole[14:17, 34:39] = OCCUPIED
    second = register(whole, whole, met)
    assert second is not None
    assert second.accepted()
    assert np.abs(second.best.transform.apply(np.zeros((1, 2)))).max() < 1.0


def test_one_meeting_where_rooms_are_equal_gives_no_wrong_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two pairs of each kind of building of the benchmark, none of those on which the threshold was chosen."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "merging")
    pairs = importlib.import_module("pairs")
    assert not set(pairs.CHOOSE) & set(pairs.JUDGE)
    right = 0
    for kind in (*pairs.EQUAL, *pairs.ORDINARY):
        for seed in pairs.JUDGE[:2]:
            pair = pairs.pair(kind, seed)
            match = register(pair.first, pair.other, pair.met)
            if match is not None and match.accepted():
                assert pair.error(match.best.transform) <= pairs.WRONG, (kind, seed)
                right += 1
    assert right >= 3


def bent(cells: np.ndarray, most: float) -> np.ndarray:
    """A map as odometry that drifts draws it: its columns are moved by up to this many cells at both ends."""
    middle = cells.shape[1] / 2.0
    away = np.round(most * ((np.arange(cells.shape[1]) - middle) / middle) ** 2).astype(int)
    return np.stack([np.roll(column, shift) for column, shift in zip(cells.T, away, strict=True)], axis=1)


@pytest.mark.parametrize(("noise", "most"), [(0.01, 0.0), (0.0, 4.0), (0.01, 3.0)])
def test_noise_and_drift_are_borne_where_a_building_tells_and_prove_nothing_where_not(
    noise: float, most: float
) -> None:
    """Noise: the share of wrong cells on each of two maps, 2 % of what they compare. Drift bends one of them."""
    random = np.random.default_rng(3)

    def spoilt(cells: np.ndarray) -> np.ndarray:
        wrong = (random.random(cells.shape) < noise) & (cells != UNKNOWN)
        return np.where(wrong, np.where(cells == FREE, OCCUPIED, FREE), cells).astype(np.uint8)

    wide = np.pad(rooms(), 4, constant_values=UNKNOWN)
    other, where = turned(spoilt(bent(wide, most)), 0.7)
    met = np.array([24.0, 32.0])
    match = register(spoilt(wide), other, met_at((26.0, 30.0), tuple(where(met))))
    assert match is not None
    assert match.accepted()
    assert np.hypot(*(match.best.transform.apply(where(met[None]) + 0.5) - 0.5 - met).T).max() < 1.5
    assert (match.best.needed > 12) == (noise > 0.0)
    part = np.pad(ward(slice(12, 49)), 4, constant_values=UNKNOWN)
    equal = register(spoilt(part), spoilt(bent(part, most)), met_at((9.0, 34.0), (9.0, 29.0)))
    assert equal is None or not equal.accepted()


def test_a_place_held_is_refuted_by_meetings_elsewhere_even_where_maps_do_not_contradict_it() -> None:
    """The turn may still be open: that is no reason to keep another place."""
    here, spots = Transform(0.0, 0.0, 0.0), np.array([[5.0, 5.0], [9.0, 5.0]])
    proved = Match(Place(here, 500, 5, 60), (), 40, 0.05)
    assert not proved.accepted()
    assert refuted(proved, Place(Transform(0.0, 15.0, 0.0), 20, 0, 5), spots)
    assert refuted(proved, Place(Transform(0.4, 0.0, 0.0), 20, 0, 5), spots)
    assert not refuted(proved, Place(Transform(0.02, 1.0, 0.0), 500, 30, 60), spots)
    open_still = Match(Place(here, 500, 5, 60), (Place(here, 90, 3, 20),), 4, 0.01)
    assert not refuted(open_still, Place(Transform(0.0, 15.0, 0.0), 20, 0, 5), spots)
    assert refuted(open_still, Place(Transform(0.0, 15.0, 0.0), 400, 40, 30), spots)
