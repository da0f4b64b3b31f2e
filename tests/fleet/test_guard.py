"""The guard between a mind and a body: when a body stands, whatever becomes of its mind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from fleet.places import for_a_while, free, until

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.adapter import Adapter, Felt
from swarmsim.fleet.guard import BodyGuard, GuardedBody, Limits
from swarmsim.fleet.transport import LinkError


class Shell:
    """A body of nothing but what it was told."""

    def __init__(self) -> None:
        self.pose: tuple[float, float, float] | None = (1.0, 1.0, 0.0)
        self.moves: tuple[float, float] | None = (9.0, 9.0)

    def sense(self) -> Felt:
        return Felt(pose=self.pose)

    def drive(self, ahead: float, turn: float) -> None:
        self.moves = (ahead, turn)

    def stop(self) -> None:
        self.moves = None

    def close(self) -> None:
        self.stop()


def test_a_body_stands_until_it_is_told_to_move_and_once_it_is_told_no_more() -> None:
    body = Shell()
    guard = BodyGuard(body, Limits(period=2.0))
    assert body.moves is None
    guard.tick(0.0)
    assert (body.moves, guard.why) == (None, "no fresh command")
    guard.drive(0.1, 0.5, 1.0)
    for now in (1.0, 3.0, 6.9):
        guard.tick(now)
        assert (body.moves, guard.why) == ((0.1, 0.5), "")
    guard.tick(7.1)
    assert (body.moves, guard.why) == (None, "no fresh command")
    guard.drive(0.2, 0.0, 8.0)
    guard.tick(8.0)
    assert body.moves == (0.2, 0.0)


def test_an_emergency_stop_holds_until_it_is_released_and_forgets_what_was_wanted() -> None:
    body = Shell()
    guard = BodyGuard(body, Limits())
    guard.drive(0.1, 0.0, 0.0)
    guard.tick(0.0)
    guard.halt()
    assert body.moves is None  # at once
    guard.drive(0.1, 0.0, 0.5)
    guard.tick(0.5)
    assert (body.moves, guard.why) == (None, "halted")
    guard.release()
    guard.tick(0.6)
    assert (body.moves, guard.why) == (None, "no fresh command")
    guard.drive(0.1, 0.0, 0.7)
    guard.tick(0.7)
    assert body.moves == (0.1, 0.0)


@pytest.mark.parametrize(
    ("pose", "blind", "why"),
    [
        ((0.5, 1.9, 3.0), False, ""),
        ((2.01, 1.0, 0.0), False, "outside the fence"),
        ((1.0, -0.01, 0.0), False, "outside the fence"),
        ((float("nan"), 1.0, 0.0), False, "outside the fence"),
        (None, False, "pose unknown"),
        (None, True, ""),
    ],
)
def test_a_body_outside_of_its_fence_stands(pose, blind: bool, why: str) -> None:
    body = Shell()
    guard = BodyGuard(body, Limits(fence=(0.0, 0.0, 2.0, 2.0), blind=blind))
    body.pose = pose
    guard.drive(0.1, 0.0, 0.0)
    guard.tick(0.0)
    assert guard.why == why
    assert (body.moves is None) == bool(why)


ASEBA = Path(__file__).with_name("aseba.py")


@pytest.fixture
def thymio() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A stand-in's address and process, which prints its motors' targets as they change."""
    place = free()
    started = subprocess.Popen(
        [sys.executable, str(ASEBA), place.rpartition(":")[2]], stdout=subprocess.PIPE, text=True
    )
    assert started.stdout is not None
    assert started.stdout.readline() == "there\n"
    yield place, started
    started.kill()
    started.communicate()


def targets(robot: subprocess.Popen[str], seconds: float, wanted: list[int]) -> float:
    """How long it takes until the motors have these targets."""
    begun = time.monotonic()
    assert robot.stdout is not None
    while [int(word) for word in robot.stdout.readline().split()] != wanted:
        assert time.monotonic() - begun < seconds
    return time.monotonic() - begun


def test_a_thymio_drives_turns_and_sees_the_wall(thymio: tuple[str, subprocess.Popen[str]]) -> None:
    place, robot = thymio
    body = Part[Adapter]("adapter", {"use": "thymio", "port": place}).build(None).open(0)
    try:
        far = body.sense().values["prox.horizontal"]
        assert len(far) == 7
        body.drive(0.05, 0.0)
        targets(robot, 2.0, [125, 125])
        until(lambda: body.sense().velocity == pytest.approx((0.05, 0.0)))
        until(lambda: body.sense().values["prox.horizontal"][2] > far[2] + 500)
        body.drive(-0.02, 0.0)
        targets(robot, 2.0, [-50, -50])
        until(lambda: body.sense().velocity == pytest.approx((-0.02, 0.0)))
        body.drive(0.0, 1.0)
        targets(robot, 2.0, [-119, 119])
        until(lambda: body.sense().velocity == pytest.approx((0.0, 2 * 119 * 0.0004 / 0.095)))
        body.drive(1.0, 2.0)  # too fast: slower along the same bend
        targets(robot, 2.0, [413, 500])
    finally:
        body.close()
    targets(robot, 2.0, [0, 0])


def test_a_thymio_that_is_none_or_goes_is_told(thymio: tuple[str, subprocess.Popen[str]]) -> None:
    place, robot = thymio
    with pytest.raises(InputError, match=r"adapter thymio: nothing answers at 127\.0\.0\.1:1 .*expected a Thymio"):
        Part[Adapter]("adapter", {"use": "thymio", "port": "127.0.0.1:1"}).build(None).open(0)
    with pytest.raises(InputError, match=r"adapter thymio: no Thymio tells of itself at .* within 0\.5 s; .*node 9"):
        Part[Adapter]("adapter", {"use": "thymio", "port": place, "node": 9, "patience": 0.5}).build(None).open(0)
    body = Part[Adapter]("adapter", {"use": "thymio", "port": place}).build(None).open(0)
    robot.kill()
    with pytest.raises(LinkError, match="adapter thymio"):
        for_a_while(body.sense)
    body.close()


MIND = """
import json, sys, time
from swarmsim.fleet.guard import GuardedBody, Limits
body = GuardedBody(json.loads(sys.argv[1]), 0, Limits(period=0.2))
print(body.pid, flush=True)
while True:
    body.drive(0.05, 0.0)
    body.sense()
    time.sleep(0.1)
"""


@pytest.fixture
def mind(thymio: tuple[str, subprocess.Popen[str]]) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A mind that drives the stand-in, and the process of its guard."""
    words = [sys.executable, "-c", MIND, json.dumps({"use": "thymio", "port": thymio[0]})]
    started = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert started.stdout is not None
    guard = int(started.stdout.readline())
    targets(thymio[1], 10.0, [125, 125])
    yield started, guard
    started.send_signal(signal.SIGCONT)
    started.kill()
    started.communicate()


@pytest.mark.parametrize(("how", "seconds"), [(signal.SIGKILL, 1.0), (signal.SIGSTOP, 1.5)])
def test_a_robot_whose_mind_is_killed_or_paused_stands(
    how: signal.Signals,
    seconds: float,
    mind: tuple[subprocess.Popen[str], int],
    thymio: tuple[str, subprocess.Popen[str]],
) -> None:
    started, guard = mind
    started.send_signal(how)
    assert targets(thymio[1], 10.0, [0, 0]) < seconds  # three periods take 0.6 s
    if how == signal.SIGKILL:
        until(lambda: not alive(guard))
    else:
        started.send_signal(signal.SIGCONT)
        targets(thymio[1], 10.0, [125, 125])


def alive(pid: int) -> bool:
    """Whether a process is there that does more than wait to be asked how it ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except OSError:
        return False


def test_a_guard_takes_a_halt_and_its_end_is_told(thymio: tuple[str, subprocess.Popen[str]]) -> None:
    place, robot = thymio
    body = GuardedBody({"use": "thymio", "port": place}, 0, Limits(period=5.0))
    body.drive(0.02, 0.0)
    targets(robot, 5.0, [50, 50])
    body.halt()
    targets(robot, 5.0, [0, 0])
    body.drive(0.02, 0.0)
    until(lambda: body.sense() is not None and body.why == "halted")
    body.release()
    body.drive(-0.02, 0.0)
    targets(robot, 5.0, [-50, -50])
    os.kill(body.pid, signal.SIGKILL)
    with pytest.raises(LinkError, match="the guard of a robot has ended"):
        for_a_while(lambda: body.drive(0.02, 0.0))
    body.close()
    with pytest.raises(InputError, match=r"nothing answers at 127\.0\.0\.1:1"):
        GuardedBody({"use": "thymio", "port": "127.0.0.1:1"}, 0, Limits())


def test_a_guard_stops_at_once_when_its_mind_lets_go(thymio: tuple[str, subprocess.Popen[str]]) -> None:
    place, robot = thymio
    body: GuardedBody = GuardedBody({"use": "thymio", "port": place}, 0, Limits(period=60.0))
    body.drive(0.02, 0.0)
    targets(robot, 5.0, [50, 50])
    body.close()
    assert targets(robot, 5.0, [0, 0]) < 1.0
    assert not alive(body.pid)


def test_a_stuck_reader_does_not_hold_a_guard_up(thymio: tuple[str, subprocess.Popen[str]]) -> None:
    place, robot = thymio
    body = GuardedBody({"use": "thymio", "port": place}, 0, Limits(period=5.0, rate=1000.0))
    ends = time.monotonic() + 2.0  # more than a pipe holds
    while time.monotonic() < ends:
        body.drive(0.02, 0.0)
        time.sleep(0.1)
    body.drive(-0.02, 0.0)
    assert targets(robot, 2.0, [-50, -50]) < 2.0
    body.sense()
    body.close()
