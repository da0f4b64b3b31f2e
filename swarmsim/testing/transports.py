"""Checks of a transport: that links carry frames as they are, and that nobody waits for anybody."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing

from swarmsim.core.errors import InputError
from swarmsim.fleet.transport import WORLD, Heard, LinkError, RobotLink, Transport
from swarmsim.testing.broken import BrokenError

_PATIENCE = 5.0  # s, for others to be seen and frames to arrive
_LONGEST = 0.5  # s that a verb may take that waits for nobody
_FLOOD, _KEPT = 20_000, 2**26  # frames that nobody takes, and bytes that may be kept of them
_FRAMES, _TELEGRAMS = 100, 1000


def check_transport(transport: Transport, address: str) -> None:
    """Links of a world and two robots at this address keep what the seam of transports promises, in one process.

    Frames arrive as they are, at most once, in the order of their sender, at all others and not at their own; a frame
    beyond the mtu is refused with both numbers; `heard` never waits and `wait` ends early; a flood that nobody takes
    holds nobody up and takes bounded memory; channels lose nothing and keep order, where there are any; who closes is
    gone, and can come back. The medium may lose frames, but not all. Raises BrokenError.
    """
    with ExitStack() as opened:
        links = [opened.enter_context(closing(transport.open(address, robot))) for robot in (WORLD, 0, 1)]
        _check_presence(links)
        _check_frames(links)
        _check_limits(links[1])
        _check_waiting(links)
        _check_channel(links)
        _check_flood(links)
        _check_leaving(transport, address, links)


def _broken(what: str) -> BrokenError:
    return BrokenError(f"transport: {what}", "transport")


def _until(reached: Callable[[], bool], what: str) -> None:
    ends = time.monotonic() + _PATIENCE
    while not reached():
        if time.monotonic() > ends:
            raise _broken(f"{what} within {_PATIENCE:g} s")
        time.sleep(0.01)


def _check_presence(links: Sequence[RobotLink]) -> None:
    numbers = (WORLD, 0, 1)
    for number, link in zip(numbers, links, strict=True):
        others = set(numbers) - {number}
        _until(lambda link=link, others=others: link.present() == others, f"{number} sees not just {sorted(others)}")  # type: ignore[misc]


def collected(link: RobotLink, enough: int, seconds: float = 1.0) -> list[Heard]:
    """What a link hears until it is enough, or nothing more has come for so long."""
    found = link.heard()
    while len(found) < enough and link.wait(seconds):
        found += link.heard()
    return found


def _check_frames(links: Sequence[RobotLink]) -> None:
    """Numbered frames of several lengths, to all."""
    most = min(links[1].mtu, 1000)
    said = [bytes([i]) + bytes(i * j % 256 for j in range(i * (most - 1) // (_FRAMES - 1))) for i in range(_FRAMES)]
    for frame in said:
        links[1].say(frame)
    for other in (links[0], links[2]):
        heard = [frame for frame, _ in collected(other, _FRAMES)]
        if not heard:
            raise _broken(f"none of {_FRAMES} frames arrives")
        if strange := [frame for frame in heard if frame not in said]:
            raise _broken(f"a frame arrives that nobody said, {strange[0][:20]!r}")
        order = [frame[0] for frame in heard]
        if order != sorted(set(order)):
            raise _broken(f"frames of one robot arrive twice or in another order: {order}")
    if links[1].heard():
        raise _broken("a robot hears itself")


def _check_limits(link: RobotLink) -> None:
    for length in (link.mtu + 1, 2 * link.mtu):
        try:
            link.say(bytes(length))
        except InputError as problem:
            if str(length) not in str(problem) or str(link.mtu) not in str(problem):
                raise _broken(f"{problem}; expected both {length} and {link.mtu}") from problem
        else:
            raise _broken(f"takes {length} bytes with an mtu of {link.mtu}")
    times = [link.airtime(length) for length in (1, link.mtu)]
    if not 0.0 < times[0] < times[1] and link.mtu > 1:
        raise _broken(f"airtime: {times} s for 1 and {link.mtu} bytes; expected more for more")


def _check_waiting(links: Sequence[RobotLink]) -> None:
    begun = time.monotonic()
    if links[2].heard() or links[2].wait(0.1):
        raise _broken("something is heard that nobody said")
    if time.monotonic() - begun < 0.09:
        raise _broken("wait ends before anything has arrived")
    for _ in range(20):  # some may get lost
        begun = time.monotonic()
        links[1].say(b"now")
        if links[2].wait(1.0):
            if time.monotonic() - begun > _LONGEST:
                raise _broken("wait goes on although a frame has arrived")
            links[2].heard()
            break
    else:
        raise _broken("wait finds no frame")
    collected(links[0], _FLOOD, 0.1)


def _check_channel(links: Sequence[RobotLink]) -> None:
    try:
        world, robot = (link.channel("testing/0") for link in links[:2])
    except InputError:  # it has none
        return
    _until(lambda: _answers(world, robot), "a channel that both have opened carries nothing")
    for sender, receiver in ((world, robot), (robot, world)):
        for i in range(_TELEGRAMS):
            sender.say(i.to_bytes(4) * 20)
        heard = [int.from_bytes(frame[:4]) for frame, _ in collected(receiver, _TELEGRAMS, _PATIENCE)]
        if heard != list(range(_TELEGRAMS)):
            raise _broken(f"of {_TELEGRAMS} telegrams {len(heard)} arrive, or in another order")
    if sum(len(link.heard()) for link in (*links, world, robot)):
        raise _broken("telegrams arrive twice or beside their channel")
    world.close()
    robot.close()


def _answers(world: RobotLink, robot: RobotLink) -> bool:
    """Whether a telegram gets through; until both know of each other it may be lost."""
    world.say(b"there?")
    arrived = robot.wait(0.2)
    time.sleep(0.05)
    robot.heard()
    return arrived


def _check_flood(links: Sequence[RobotLink]) -> None:
    frame, longest = bytes(min(links[1].mtu, 10_000)), 0.0
    for _ in range(_FLOOD):
        begun = time.monotonic()
        links[1].say(frame)
        longest = max(longest, time.monotonic() - begun)
    if longest > _LONGEST:
        raise _broken(f"say takes {longest:.2f} s while nobody listens")
    time.sleep(0.2)
    kept = sum(len(one) for one, _ in links[2].heard())
    if kept > _KEPT:
        raise _broken(f"{kept} bytes are kept of a flood that nobody takes; expected at most {_KEPT}")
    for link in links:
        collected(link, 2 * _FLOOD, 0.2)


def _check_leaving(transport: Transport, address: str, links: Sequence[RobotLink]) -> None:
    links[2].close()
    links[2].close()
    _until(lambda: 1 not in links[1].present(), "a robot that has closed its link is not gone")
    if links[2].heard():
        raise _broken("a closed link hears")
    try:
        for _ in range(100):  # some may be lost before anybody notices
            links[2].say(b"still here")
    except LinkError:
        pass
    else:
        raise _broken("a closed link says; expected LinkError")
    with closing(transport.open(address, 1)) as again:
        _until(lambda: 1 in links[1].present() and 0 in again.present(), "a robot that comes back is not seen")
        _until(lambda: _hears(links[1], again), "a robot that comes back hears nothing")


def _hears(one: RobotLink, other: RobotLink) -> bool:
    one.say(b"welcome")
    return other.wait(0.2) and any(frame == b"welcome" for frame, _ in other.heard())
