"""The contract of transports, for every part of ours: in one process, in two, with loss, pauses and deaths."""

from __future__ import annotations

import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing

import pytest
from fleet.places import free, transport, until

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.fleet.mailbox import CONTROL, Mailbox
from swarmsim.fleet.transport import WORLD, Heard, LinkError, RobotLink, Transport
from swarmsim.testing import BrokenError, check_transport
from swarmsim.testing.transports import collected

OURS = ("memory", "udp", "zenoh")
BETWEEN = ("udp", "zenoh")  # processes
PERIOD = 1.0  # s, the paper's


def test_there_are_no_others() -> None:
    assert set(registry.known("transport")) == {*OURS, "signed"}


@pytest.mark.parametrize("use", OURS)
def test_ours_keep_the_contract(use: str) -> None:
    check_transport(transport(use), free())


class Lossy:
    """A transport that loses, doubles and changes some of what links say, at random."""

    def __init__(self, over: Transport, lost: float = 0.0, doubled: float = 0.0, bent: float = 0.0) -> None:
        self.over, self.shares, self.dice = over, (lost, doubled, bent), random.Random(1)

    def open(self, address: str, robot: int) -> RobotLink:
        link = self.over.open(address, robot)
        say = link.say

        def lose(frame: bytes) -> None:
            lost, doubled, bent = (self.dice.random() < share for share in self.shares)
            for _ in range(0 if lost and len(frame) <= link.mtu else 1 + doubled):
                say(b"x" + frame[1:] if bent else frame)

        link.say = lose  # type: ignore[method-assign]
        return link


@pytest.mark.parametrize("use", OURS)
def test_a_medium_that_loses_frames_keeps_it_too(use: str) -> None:
    check_transport(Lossy(transport(use), lost=0.3), free())


@pytest.mark.parametrize(
    ("shares", "words"),
    [
        ({"lost": 1.0}, "none of 100 frames arrives"),
        ({"doubled": 0.1}, "arrive twice"),
        ({"bent": 0.1}, "a frame arrives that nobody said"),
    ],
)
def test_the_contract_finds_what_breaks_it(shares: Mapping[str, float], words: str) -> None:
    with pytest.raises(BrokenError, match=words):
        check_transport(Lossy(transport("memory"), **shares), "broken")


ECHO = """
import sys, time
from swarmsim.core.scenario.part import Part
link = Part("transport", {"use": sys.argv[1]}).build(None).open(sys.argv[2], int(sys.argv[3]))
orders, answers = link.channel("to/" + sys.argv[3]), link.channel("from/" + sys.argv[3])
print("there", flush=True)
while True:
    link.wait(0.05)
    for frame, _ in link.heard():
        link.say(frame[::-1])
    for order, _ in orders.heard():
        if order == b"leave":
            link.close()
            sys.exit()
        answers.say(order)
"""


@pytest.fixture
def echo() -> Iterator[Callable[[str, str, int], subprocess.Popen[str]]]:
    """Starts robots, each a process that says backwards what it hears and answers its orders by repeating them."""
    started: list[subprocess.Popen[str]] = []

    def start(use: str, address: str, robot: int) -> subprocess.Popen[str]:
        words = [sys.executable, "-c", ECHO, use, address, str(robot)]
        started.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        assert started[-1].stdout is not None
        assert started[-1].stdout.readline() == "there\n"
        return started[-1]

    yield start
    for one in started:
        if one.poll() is None:
            one.send_signal(signal.SIGCONT)
            one.kill()
        one.communicate()


@pytest.fixture(params=BETWEEN)
def world(request: pytest.FixtureRequest) -> Iterator[tuple[str, str, RobotLink]]:
    """The transport's name, an address, and the world's link there, which misses robots soon."""
    address, keys = free(), {"silence": 0.8} if request.param == "udp" else {}
    with closing(transport(request.param, **keys).open(address, WORLD)) as link:
        yield request.param, address, link


def test_processes_hear_one_another(world: tuple[str, str, RobotLink], echo: Callable) -> None:
    use, address, link = world
    orders, answers = ([link.channel(f"{one}/{robot}") for robot in (3, 4)] for one in ("to", "from"))
    robots = [echo(use, address, robot) for robot in (3, 4)]
    until(lambda: link.present() == {3, 4})
    link.say(b"\x00\x01abc")
    assert (b"cba\x01\x00", None) in collected(link, 1)
    told = [i.to_bytes(4) for i in range(1000)]
    for telegram in told:
        for one in orders:
            one.say(telegram)
    assert [[frame for frame, _ in collected(one, len(told), 3.0)] for one in answers] == [told, told]
    for one in orders:
        one.say(b"leave")
    assert [one.wait(5.0) for one in robots] == [0, 0]
    until(lambda: link.present() == set())


def test_a_killed_robot_is_gone_within_a_second_and_can_come_back(
    world: tuple[str, str, RobotLink], echo: Callable
) -> None:
    use, address, link = world
    robot = echo(use, address, 7)
    until(lambda: link.present() == {7})
    robot.kill()
    assert until(lambda: link.present() == set()) < 1.0
    echo(use, address, 7)
    until(lambda: link.present() == {7})
    link.say(b"ab")
    until(lambda: (b"ba", None) in link.heard())


def test_a_paused_robot_holds_nobody_up(world: tuple[str, str, RobotLink], echo: Callable) -> None:
    """Beyond what sockets take: its telegrams wait for it, frames do not, and others hear both."""
    use, address, link = world
    orders, answers = ([link.channel(f"{one}/{robot}") for robot in (1, 2)] for one in ("to", "from"))
    paused, awake = echo(use, address, 1), echo(use, address, 2)
    until(lambda: link.present() == {1, 2})
    paused.send_signal(signal.SIGSTOP)
    longest, told = 0.0, [i.to_bytes(4) + bytes(20_000) for i in range(1000)]
    begun = time.monotonic()
    for telegram in told:
        for end, frame in ((link, telegram[:1000]), *((one, telegram) for one in orders)):
            before = time.monotonic()
            end.say(frame)
            longest = max(longest, time.monotonic() - before)
    assert longest < 0.5 * PERIOD
    assert [frame for frame, _ in collected(answers[1], len(told), 2.0)] == told  # from the one that is awake
    assert time.monotonic() - begun < 5.0  # after which zenoh gives a robot up
    paused.send_signal(signal.SIGCONT)
    assert [frame for frame, _ in collected(answers[0], len(told), 3.0)] == told
    assert awake.poll() is None


@pytest.mark.parametrize("use", BETWEEN)
@pytest.mark.parametrize(
    ("address", "keys", "words"),
    [
        ("7447", {}, r"'7447' is no address; expected HOST:PORT"),
        ("127.0.0.1:0", {}, r"'127.0.0.1:0' is no address; expected HOST:PORT with a port from 1"),
        ("nowhere.invalid:7447", {}, r"no host is called 'nowhere\.invalid'"),
        ("127.0.0.1:7447", {"interface": "wlan9"}, r"interface: no 'wlan9' .*expected one of lo \(127\.0\.0\.1\)"),
        ("192.0.2.1:7447", {}, r"192\.0\.2\.1:7447 is beyond this machine, .*expected `interface`"),
    ],
)
def test_what_is_no_place_to_meet_is_refused(use: str, address: str, keys: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=rf"^transport {use}: {words}"):
        transport(use, **keys).open(address, 0)


@pytest.mark.parametrize("use", BETWEEN)
def test_a_taken_port_and_a_host_that_does_not_answer_are_told(use: str) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(InputError, match=rf"^transport {use}: cannot listen at {place}: the port is taken"):
            transport(use).open(place, WORLD)
        with pytest.raises(InputError, match=rf"^transport {use}: {place} answers, but "):
            order(use, place)
    with pytest.raises(InputError, match=rf"^transport {use}: nobody answers at .* within 0\.5 s; expected a world"):
        order(use, free())


def order(use: str, place: str) -> None:
    """Ask the world at a place for a channel, which over udp is when it is asked for anything."""
    with closing(transport(use, patience=0.5).open(place, 0)) as link:
        link.channel("orders")


@pytest.mark.parametrize("use", OURS)
def test_names_of_channels_are_plain(use: str) -> None:
    with closing(transport(use).open(free(), WORLD)) as link:
        for name in ("", "a b", "**", "x" * 201):
            with pytest.raises(InputError, match="no channel is called"):
                link.channel(name)


def test_a_full_box_forgets_the_oldest_and_a_full_channel_breaks() -> None:
    air, channel = Mailbox(1000), Mailbox(1000, "channel x")
    for i in range(20):
        air.put(bytes([i]))
        channel.put(bytes([i]))
    assert [frame[0] for frame, _ in air.drain()] == list(range(11, 20))
    assert air.counts == {"full": 11}
    assert [frame[0] for frame, _ in channel.drain()] == list(range(9))
    assert channel.wait(0.0)
    with pytest.raises(LinkError, match="channel x: 1000 bytes wait to be heard"):
        channel.drain()
    assert CONTROL > 10**7


def test_strengths_are_passed_on() -> None:
    box = Mailbox(1000)
    box.put(b"far", -92.5)
    heard: list[Heard] = box.drain()
    assert heard == [(b"far", -92.5)]
