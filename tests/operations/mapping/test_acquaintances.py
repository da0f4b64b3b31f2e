"""Meetings with linked robots count together, in one frame; maps are compared again when there is more to compare."""

from __future__ import annotations

import numpy as np

from swarmsim.core.state import FREE, OCCUPIED
from swarmsim.operations.mapping.sharing.acquaintances import Acquaintance, meetings
from swarmsim.operations.mapping.sharing.links import Link, Links
from swarmsim.operations.mapping.sharing.places import ASIDE, Place, Transform
from swarmsim.operations.mapping.sharing.registration import register

HERE = Transform(0.0, 0.0, 0.0)
FRAMES = [Transform(*one) for one in ((0.2, 3.0, -4.0), (-1.0, 12.0, 8.0), (2.4, -6.0, 9.0))]  # from cells, by number


def memory(*places: tuple[float, float]) -> Acquaintance:
    """Meetings at the same true places for both."""
    known = Acquaintance(0)
    for place in places:
        assert known.meet(np.array([place, place]))
    return known


def between(first: int, second: int) -> Link:
    return Link((first, second), 0, 30, FRAMES[first].after(FRAMES[second].inverse()))


def test_meetings_with_those_linked_to_a_stranger_count_in_its_frame() -> None:
    known = {(0, 1): memory((5.0, 6.0)), (0, 2): memory((9.0, 2.0), (30.0, 40.0))}
    links = Links(0)
    alone = meetings(0, 1, known, links, FRAMES, 7.0)
    np.testing.assert_allclose(alone.fixed, [[5.0, 6.0]])
    links.learn(between(1, 2))
    met = meetings(0, 1, known, links, FRAMES, 7.0)
    np.testing.assert_allclose(met.fixed, [[5.0, 6.0], [9.0, 2.0], [30.0, 40.0]])
    np.testing.assert_allclose(met.moving, FRAMES[1].apply(met.fixed), atol=1e-9)
    np.testing.assert_allclose(met.within, [7.0, 7.0 + ASIDE, 7.0 + ASIDE])


def test_a_link_is_not_tested_by_itself() -> None:
    known = {(0, 1): memory((5.0, 6.0)), (0, 2): memory((9.0, 2.0))}
    links = Links(0)
    links.learn(between(1, 2))
    links.learn(between(0, 1))
    np.testing.assert_allclose(meetings(0, 1, known, links, FRAMES, 7.0).fixed, [[5.0, 6.0]])


def test_a_meeting_with_a_third_robot_tells_which_of_two_ways_it_is() -> None:
    """A corridor is the same from both ends; a robot met the other here, and one that is linked to it over there."""
    corridor = np.full((9, 60), FREE, np.uint8)
    corridor[[0, -1]] = corridor[:, [0, -1]] = OCCUPIED
    known, links, starts = {(0, 1): memory((4.0, 30.0))}, Links(0), [HERE, HERE, FRAMES[2]]

    def backwards() -> list[Place]:
        match = register(corridor, corridor, meetings(0, 1, known, links, starts, 7.0))
        assert match is not None
        return [one for one in (match.best, *match.rivals) if abs(one.transform.turn) > 1.0]

    assert backwards()
    known[0, 2] = memory((4.0, 50.0))
    links.learn(Link((1, 2), 0, 30, FRAMES[2].inverse()))
    assert not backwards()


def test_a_meeting_on_the_same_spot_is_no_new_one() -> None:
    known = memory((5.0, 6.0))
    assert not known.meet(np.array([[5.5, 6.0], [5.0, 6.5]]))
    assert known.meet(np.array([[5.0, 6.0], [5.0, 7.5]]))


def test_maps_are_compared_again_once_there_is_enough_more() -> None:
    known = Acquaintance(0)
    assert known.has_grown(100, 0.0, 1.2)
    assert not known.has_grown(120, 0.0, 1.2)
    assert known.has_grown(121, 0.0, 1.2)
    assert known.has_grown(121, 4.0, 1.2)
    assert not known.has_grown(121, 4.0, 1.0)
    assert known.has_grown(122, 4.0, 1.0)
