"""Frames from those who should not be heard: each is refused and counted, and none takes memory."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from fleet.places import free, transport

from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER
from swarmsim.fleet.keyring import read_keys, write_keys
from swarmsim.fleet.transport import WORLD, RobotLink
from swarmsim.fleet.transports.signed import TAG
from swarmsim.testing.transports import check_transport

BODY = bytes(range(15))  # after its header, 21 bytes as a tile's message


def frame(sender: int, iteration: int, body: bytes = BODY) -> bytes:
    return HEADER.pack(sender, iteration) + body


@pytest.fixture
def keys(tmp_path: Path) -> str:
    return str(write_keys(4, tmp_path / "swarm.keys"))


@pytest.fixture
def ends(keys: str, tmp_path: Path) -> Iterator[tuple[RobotLink, RobotLink, RobotLink]]:
    """A robot that signs, one that listens, and a stranger on the same air."""
    signed, address = transport("signed", over={"use": "memory"}, keys=keys), str(tmp_path)
    with ExitStack() as opened:
        made = (signed.open(address, 1), signed.open(address, 2), transport("memory").open(address, 9))
        yield tuple(opened.enter_context(closing(one)) for one in made)  # type: ignore[misc]


def test_a_tag_is_eight_bytes_and_the_rest_is_as_it_was(ends: tuple[RobotLink, RobotLink, RobotLink]) -> None:
    robot, listener, stranger = ends
    robot.say(frame(1, 5))
    assert listener.heard() == [(frame(1, 5), None)]
    ((on_air, _),) = stranger.heard()
    assert on_air[:-TAG] == frame(1, 5)
    assert len(on_air) == 29
    assert robot.mtu == stranger.mtu - TAG
    assert robot.airtime(21) == stranger.airtime(29)
    with pytest.raises(InputError, match=f"a frame of {robot.mtu + 1} bytes; it takes at most {robot.mtu}"):
        robot.say(frame(1, 6, bytes(robot.mtu + 1 - HEADER.size)))


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (lambda good, other: good[:-1] + bytes([good[-1] ^ 1]), "forged"),
        (lambda good, other: good[:8] + bytes([good[8] ^ 1]) + good[9:], "forged"),
        (lambda good, other: good, "replayed"),
        (lambda good, other: HEADER.pack(3, 5) + good[6:], "forged"),
        (lambda good, other: other, "wrong key"),
        (lambda good, other: HEADER.pack(77, 5) + good[6:], "unknown"),
        (lambda good, other: good[:5] + good[-TAG:], "too short"),
        (lambda good, other: b"", "too short"),
    ],
    ids=["tag", "body", "again", "sender", "key", "unknown", "short", "empty"],
)
def test_what_is_wrong_with_a_frame_is_counted_by_its_reason(
    made: Callable[[bytes, bytes], bytes],
    reason: str,
    ends: tuple[RobotLink, RobotLink, RobotLink],
    keys: str,
    tmp_path: Path,
) -> None:
    robot, listener, stranger = ends
    robot.say(frame(1, 5))
    (good, _), *_ = stranger.heard()
    signed, aside = transport("signed", over={"use": "memory"}, keys=keys), f"{tmp_path}/aside"
    with closing(signed.open(aside, 3)) as liar, closing(transport("memory").open(aside, 0)) as beside:
        liar.say(frame(1, 6))  # robot 3 says that it is robot 1
        ((other, _),) = beside.heard()
    assert listener.heard() == [(frame(1, 5), None)]
    stranger.say(made(good, other))
    assert listener.heard() == []
    assert listener.counts == {reason: 1}


def test_frames_may_be_late_by_the_window_and_come_in_any_order(
    ends: tuple[RobotLink, RobotLink, RobotLink],
) -> None:
    robot, listener, stranger = ends
    order = [*range(100, 164)]
    random.Random(2).shuffle(order)
    for iteration in (163, 99, 98, *order, 163):
        robot.say(frame(1, iteration, b"one"))
        robot.say(frame(1, iteration, b"two"))  # several in an iteration are all heard
    heard = [HEADER.unpack_from(one)[1] for one, _ in listener.heard()]
    assert Counter(heard) == dict.fromkeys([99, *range(100, 164)], 2)
    assert listener.counts == {"replayed": 2 + 4}  # 98 is 65 late; 163 comes three times
    listener.say(frame(2, 1000))
    robot.say(frame(1, 164))  # in time for a robot that knows of 164 alone, but this one is at 1000
    assert listener.heard() == []
    stranger.heard()


def test_transports_with_keys_keep_the_contract(keys: str) -> None:
    check_transport(transport("zenoh", keys=keys), free())


def test_keys_are_one_line_each_and_only_yours_to_read(keys: str, tmp_path: Path) -> None:
    known = read_keys(keys, "signed")
    assert set(known) == {WORLD, 0, 1, 2, 3}
    assert len(set(known.values())) == 5
    assert Path(keys).stat().st_mode & 0o777 == 0o600
    with pytest.raises(InputError, match=r"swarm\.keys: exists already"):
        write_keys(4, keys)
    for text in ("robot1", "robot1:12", "robot1:" + "g" * 32, "robot70000:" + "0" * 32, "robot1:" + "0" * 32 + "\n\n"):
        (tmp_path / "bad").write_text(text)
        with pytest.raises(InputError, match=r"transport signed: keys: .*bad: line \d is no key"):
            read_keys(tmp_path / "bad", "signed")
    (tmp_path / "twice").write_text(("robot1:" + "0" * 32 + "\n") * 2)
    with pytest.raises(InputError, match=r"twice: line 2 is no key, or a second one"):
        read_keys(tmp_path / "twice", "signed")
    for none in (tmp_path, tmp_path / "none", "/dev/zero"):
        with pytest.raises(InputError, match=r"transport signed: keys: "):
            read_keys(none, "signed")


def test_a_frame_without_a_sender_of_the_swarm_is_not_signed(ends: tuple[RobotLink, RobotLink, RobotLink]) -> None:
    robot, _, _ = ends
    with pytest.raises(InputError, match=r"a frame of 3 bytes names no sender"):
        robot.say(b"abc")
    with pytest.raises(InputError, match=r"a frame names 256 as its sender, who has no key; expected `header`"):
        robot.say(b"\x01" + frame(1, 5))  # as of robots that merge maps
