"""Links between frames: frames follow from them, evidence counts once, and what does not fit together is withdrawn."""

from __future__ import annotations

import numpy as np
import pytest

from swarmsim.operations.mapping.sharing.links import Link, Links
from swarmsim.operations.mapping.sharing.places import Transform

TURNS = np.random.default_rng(5).uniform((-np.pi, -30.0, -30.0), (np.pi, 30.0, 30.0), (6, 3))
FRAMES = [Transform(*turn) for turn in TURNS]  # from each robot's frame to that of the building


def link(first: int, second: int, excess: int = 20, found: int = 0, aside: float = 0.0) -> Link:
    place = FRAMES[first].inverse().after(Transform(0.0, aside, 0.0)).after(FRAMES[second])
    return Link((first, second), found, excess, place)


def links(robot: int, *told: Link) -> Links:
    known = Links(robot)
    for one in told:
        known.learn(one)
    return known


@pytest.mark.parametrize("robot", range(4))
def test_frames_follow_from_a_chain_of_links(robot: int) -> None:
    known = links(robot, link(0, 1), link(2, 3), link(1, 2))
    assert sorted(known.frames) == [other for other in range(4) if other != robot]
    for other, frame in known.frames.items():
        assert frame.shift(FRAMES[robot].inverse().after(FRAMES[other])) < 1e-9


def test_links_that_lead_nowhere_give_no_frame() -> None:
    assert links(0, link(1, 2), link(2, 3)).frames == {}


def test_a_link_heard_again_is_the_same_evidence() -> None:
    known = links(0, link(0, 1, 20))
    for _ in range(5):
        known.learn(link(0, 1, 20))
        known.learn(link(0, 1, 30))  # of the same comparison: another number for it is no more evidence
    assert known.of((0, 1)) == link(0, 1, 20)


def test_of_two_ways_the_one_with_fewer_links_counts_and_then_the_stronger_one() -> None:
    known = links(0, link(0, 1, 20, aside=1.0), link(1, 3, 20), link(0, 2, 50), link(2, 3, 50))
    assert known.frames[3].shift(FRAMES[0].inverse().after(FRAMES[3])) < 1e-9
    known.learn(link(0, 3, 13, aside=2.0))
    assert known.frames[3].shift(FRAMES[0].inverse().after(FRAMES[3])) == pytest.approx(2.0)


def test_the_weakest_link_of_a_circle_that_does_not_close_is_withdrawn() -> None:
    """Links of three pairs are three pieces of evidence; one of them is wrong by a room."""
    known = links(0, link(0, 1, 40), link(1, 2, 30), link(0, 2, 14, aside=13.0))
    assert known.of((0, 2)) is None
    assert known.frames[2].shift(FRAMES[0].inverse().after(FRAMES[2])) < 1e-9
    known = links(0, link(0, 2, 14, aside=13.0), link(1, 2, 30), link(0, 1, 40))
    assert known.of((0, 2)) is None
    assert links(0, link(0, 1, 40), link(1, 2, 30), link(0, 2, 14, aside=2.0)).of((0, 2)) is not None


def test_what_is_withdrawn_stays_so_until_it_is_found_anew() -> None:
    known = links(0, link(0, 1, 20, found=3), link(1, 2, 20, found=3))
    known.learn(known.of((0, 1)).withdrawn(9))
    assert known.frames == {}
    known.learn(link(0, 1, 90, found=8))
    assert known.frames == {}
    known.learn(link(0, 1, 20, found=10))
    assert sorted(known.frames) == [1, 2]


def test_news_is_told_first_and_then_what_was_told_longest_ago() -> None:
    known = links(0, link(0, 1), link(1, 2))
    told = [known.next_to_tell(now).pair for now in range(3)]
    known.learn(link(2, 3))
    told += [known.next_to_tell(now).pair for now in range(3, 6)]
    assert told == [(0, 1), (1, 2), (0, 1), (2, 3), (1, 2), (0, 1)]
    assert Links(7).next_to_tell(0) is None


def test_the_weakest_link_on_the_way_is_the_one_to_doubt() -> None:
    known = links(0, link(0, 1, 40), link(1, 2, 15), link(2, 3, 60))
    assert known.weakest_towards(3) == link(1, 2, 15)
