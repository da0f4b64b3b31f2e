"""Frames from those who should not be heard: each is refused and counted, and none takes memory."""

from __future__ import annotations

import random
import socket
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from fleet.places import free, transport, until

from swarmsim.core.errors import InputError
from swarmsim.core.messages import HEADER
from swarmsim.fleet.keyring import read_keys, write_keys
from swarmsim.fleet.transport import WORLD, RobotLink
from swarmsim.fleet.transports.signed import TAG
from swarmsim.testing.transports import check_transport, collected

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


def test_a_hundred_thousand_hostile_frames_are_counted_and_forgotten(
    ends: tuple[RobotLink, RobotLink, RobotLink],
) -> None:
    robot, listener, stranger = ends
    good = []
    for iteration in range(1000):
        robot.say(frame(1, iteration))
        good += [one for one, _ in stranger.heard()]
    assert len(listener.heard()) == 1000
    dice, sent = random.Random(3), 0
    for i in range(100_000):
        if i == 80_000:  # it is slow
            tracemalloc.start()
        kind, old = i % 4, good[dice.randrange(len(good))]
        if kind == 0:
            hostile = dice.randbytes(dice.randrange(200))
        elif kind == 1:
            hostile = old
        elif kind == 2:
            at = dice.randrange(len(old))
            hostile = old[:at] + bytes([old[at] ^ (1 << dice.randrange(8))]) + old[at + 1 :]
        else:
            hostile = HEADER.pack(dice.randrange(4), dice.randrange(2**32)) + dice.randbytes(23)
        stranger.say(hostile)
        sent += 1
        if i % 1000 == 999:
            assert listener.heard() == []
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sum(listener.counts.values()) == sent == 100_000
    assert set(listener.counts) == {"forged", "replayed", "too short", "unknown"}
    assert peak < 500_000


def test_a_hundred_thousand_frames_that_nobody_takes_keep_a_bounded_memory() -> None:
    with closing(transport("memory").open("flood", 0)) as idle, closing(transport("memory").open("flood", 1)) as loud:
        for i in range(100_000):
            if i == 80_000:
                tracemalloc.start()
            loud.say(i.to_bytes(4) * 100)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 5_000_000
        heard = idle.heard()
        assert len(heard) + idle.counts["full"] == 100_000
        assert heard[-1][0][:4] == (99_999).to_bytes(4)


def test_sockets_of_strangers_move_nobody() -> None:
    """Datagrams on the air and for beacons, and connections to the channels, all with random bytes."""
    address, dice = free(), random.Random(4)
    host, port = address.split(":")
    with ExitStack() as opened:
        world, robot = (
            opened.enter_context(closing(transport("udp", mtu=60).open(address, one))) for one in (WORLD, 0)
        )
        orders, told = world.channel("to/0"), robot.channel("to/0")
        until(lambda: world.present() == {0})
        air = opened.enter_context(socket.socket(type=socket.SOCK_DGRAM))
        air.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        for i in range(100_000):
            if i == 80_000:
                tracemalloc.start()
            air.sendto(dice.randbytes(i % 120), ("127.255.255.255", int(port) + i % 2))
            if i % 1000 == 999:
                world.heard()
        for _ in range(300):
            with socket.create_connection((host, int(port))) as stranger:
                stranger.sendall(dice.randbytes(400))
        with socket.create_connection((host, int(port))) as stranger:
            stranger.sendall(b"\x02\x04" + (2**24 - 1).to_bytes(4) + b"to/0")  # and never what it announces
            until(lambda: world.counts["malformed"] > 200)
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            assert peak < 20_000_000
            assert world.counts["too long"] > 1000
            orders.say(b"go on")
            assert [one for one, _ in collected(told, 1)] == [b"go on"]
        world.heard()
        robot.say(b"here")
        until(lambda: (b"here", None) in world.heard())
        assert world.present() == {0}


def test_who_has_no_key_stays_out_and_nobody_speaks_for_another(keys: str, tmp_path: Path) -> None:
    other = write_keys(4, tmp_path / "other.keys")
    own = tmp_path / "robot1.keys"  # all that a robot needs
    own.write_text("".join(line for line in Path(keys).read_text().splitlines(True) if line.startswith("robot1:")))
    address = free()
    with ExitStack() as opened:
        world = opened.enter_context(closing(transport("zenoh", keys=keys).open(address, WORLD)))
        one = opened.enter_context(closing(transport("zenoh", keys=str(own)).open(address, 1)))
        two = opened.enter_context(closing(transport("zenoh", keys=keys).open(address, 2)))
        until(lambda: one.present() == {WORLD, 2} and two.present() == {WORLD, 1} and world.present() == {1, 2})
        for wrong in ("", str(other)):
            with pytest.raises(InputError, match=r"answers, but does not let robot 3 in; expected .* the same keys"):
                transport("zenoh", keys=wrong, patience=0.5).open(address, 3)
        with pytest.raises(InputError, match=r"robot1\.keys has none for robot3; expected a line robot3:KEY"):
            transport("zenoh", keys=str(own)).open(address, 3)
        mine, others = ([link.channel(f"do/{number}") for link in (world, one, two)] for number in (1, 2))
        time.sleep(0.2)
        one.say(b"by one")
        mine[1].say(b"done by one")
        others[1].say(b"done by two, says one")
        others[0].say(b"said by the world")
        until(lambda: [frame for frame, _ in two.heard()] == [b"by one"])
        assert [frame for frame, _ in collected(mine[0], 1)] == [b"done by one"]
        assert [frame for frame, _ in collected(others[2], 2)] == [b"said by the world"]
        assert others[0].heard() == []


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
