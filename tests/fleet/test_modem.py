"""The radio modem that docs/fleet-transports.md lists, over a pair of pseudo-terminals."""

from __future__ import annotations

import os
import pty
import random
import re
import select
import threading
import time
from collections.abc import Iterator
from contextlib import closing, suppress

import pytest
from conftest import ROOT

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.transport import LinkError, RobotLink, Transport
from swarmsim.testing.transports import collected

PAGE = ROOT / "docs" / "fleet-transports.md"


@pytest.fixture
def modem(tmp_path) -> Transport:
    (listing,) = re.findall(r"```python\n(# modem\.py.*?)```", PAGE.read_text(), re.DOTALL)
    part = listing[listing.index("class Modem") :]
    assert sum(map(bool, part.splitlines())) <= 50
    (tmp_path / "modem.py").write_text(listing)
    with registry.own_code(True):
        return Part[Transport]("transport", {"use": f"{tmp_path}/modem.py:Modem", "mtu": 60}).build(None)


@pytest.fixture
def air(modem: Transport) -> Iterator[tuple[RobotLink, RobotLink, int]]:
    """Two modems that hear one another, and where a third one would write what the second hears."""
    ours, names = zip(*(pty.openpty() for _ in range(2)), strict=True)
    stop = threading.Event()

    def carry() -> None:
        while not stop.is_set():
            for one, other in (ours, ours[::-1]):
                with suppress(BlockingIOError):
                    os.write(other, os.read(one, 4096))
            time.sleep(0.001)

    for one in ours:
        os.set_blocking(one, False)
    carrier = threading.Thread(target=carry)
    with closing(modem.open(os.ttyname(names[0]), 3)) as a, closing(modem.open(os.ttyname(names[1]), 4)) as b:
        carrier.start()
        yield a, b, ours[1]
        stop.set()
        carrier.join()
    for one in (*ours, *names):
        os.close(one)


def test_frames_of_any_bytes_arrive_as_they_are(air: tuple[RobotLink, RobotLink, int]) -> None:
    a, b, _ = air
    dice = random.Random(1)
    said = [b"\x00\x03" + bytes(dice.choice(b"\xc0\xdb\xdc\xdd\x00") for _ in range(i)) for i in range(59)]
    for frame in said:
        a.say(frame)
        time.sleep(0.001)
    assert [frame for frame, strength in collected(b, len(said)) if strength is None] == said
    assert b.present() == {3}
    assert a.present() == set()
    b.say(b"\x00\x04back")
    assert collected(a, 1) == [(b"\x00\x04back", None)]
    assert a.present() == {4}
    assert a.airtime(21) == pytest.approx(22 * 8 / 9600)


def test_noise_and_long_frames_are_passed_over(air: tuple[RobotLink, RobotLink, int]) -> None:
    a, b, receiver = air
    with pytest.raises(InputError, match="a frame of 61 bytes; it takes at most 60"):
        a.say(bytes(61))
    for noise in (*[bytes(1000)] * 100, b"\xc0"):
        while not select.select([], [receiver], [], 1.0)[1]:
            assert not b.heard()
        os.write(receiver, noise)
    a.say(b"\x00\x03clear")
    assert [frame for frame, _ in collected(b, 2)] == [b"\x00\x03clear"]


def test_a_port_that_takes_no_more_holds_nobody_up(air: tuple[RobotLink, RobotLink, int]) -> None:
    a, b, _ = air
    longest = 0.0
    for _ in range(5000):
        begun = time.monotonic()
        a.say(b"\x00\x03" + bytes(50))
        longest = max(longest, time.monotonic() - begun)
    assert longest < 0.5
    assert a.counts["unsent"] > 0
    heard = [frame for frame, _ in collected(b, 5000)]
    assert set(heard) == {b"\x00\x03" + bytes(50)}  # whole or not at all
    assert len(heard) + a.counts["unsent"] in (5000, 4999)  # the last may wait in the port


def test_a_modem_that_is_none_and_a_closed_link_are_told(modem: Transport, tmp_path) -> None:
    with pytest.raises(InputError, match=r"transport modem: .*nowhere: No such file or directory; expected a serial"):
        modem.open(str(tmp_path / "nowhere"), 0)
    ours, theirs = pty.openpty()
    link = modem.open(os.ttyname(theirs), 0)
    with pytest.raises(InputError, match="has no channels"):
        link.channel("to/0")
    link.close()
    with pytest.raises(LinkError):
        link.say(b"more")
    os.close(ours)
    os.close(theirs)
