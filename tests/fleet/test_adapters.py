"""Bodies behind ROS 2's messages and under a camera, each in a process of its own."""

from __future__ import annotations

import json
import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import zenoh
from fleet.places import for_a_while, free, until
from fleet.turtle import KINDS, STORE, odometry, scan

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.adapter import Adapter, Felt, RobotBody
from swarmsim.fleet.adapters import ros2_messages
from swarmsim.fleet.guard import GuardedBody, Limits
from swarmsim.fleet.transport import LinkError

TURTLE = Path(__file__).with_name("turtle.py")


def reached(robot: int = 3, **keys: object) -> RobotBody:
    return Part[Adapter]("adapter", keys).build(None).open(robot)


@pytest.fixture
def turtle() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a bridge with robot 3 behind it, which prints its commands as they change."""
    place = free()
    words = [sys.executable, str(TURTLE), place.rpartition(":")[2]]
    started = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert started.stdout is not None
    assert started.stdout.readline() == "there\n"
    yield place, started
    started.kill()
    started.communicate()


def commanded(robot: subprocess.Popen[str], wanted: list[float]) -> None:
    assert robot.stdout is not None
    ends = time.monotonic() + 10.0
    while [float(word) for word in robot.stdout.readline().split()] != wanted:
        assert time.monotonic() < ends


def test_commands_are_the_bytes_that_another_library_packs() -> None:
    ours = ros2_messages.Twist(ros2_messages.Vector3(x=0.2), ros2_messages.Vector3(z=-0.5)).serialize()
    vector = KINDS["geometry_msgs/msg/Vector3"]
    theirs = KINDS["geometry_msgs/msg/Twist"](vector(0.2, 0.0, 0.0), vector(0.0, 0.0, -0.5))
    assert ours == bytes(STORE.serialize_cdr(theirs, "geometry_msgs/msg/Twist"))
    assert len(ours) == 52
    read = ros2_messages.LaserScan.deserialize(scan([0.5, 1.5]))
    assert list(read.ranges) == [0.5, 1.5]
    assert STORE.deserialize_cdr(read.serialize(), "sensor_msgs/msg/LaserScan").range_max == 8.0
    assert bytes(ros2_messages.RosOdometry.deserialize(odometry(1.0, 2.0, 0.5, 0.1, 0.0)).serialize()) == odometry(
        1.0, 2.0, 0.5, 0.1, 0.0
    )


def test_a_robot_with_ros_drives_and_tells_where_it_is(turtle: tuple[str, subprocess.Popen[str]]) -> None:
    place, robot = turtle
    with closing(reached(use="ros2", address=place)) as body:
        assert body.sense().pose == pytest.approx((0.0, 0.5, 0.0))
        body.drive(0.4, 0.0)
        commanded(robot, [0.4, 0.0])
        until(lambda: (body.sense().pose or (0.0,))[0] > 0.2)
        felt = body.sense()
        assert felt.velocity == pytest.approx((0.4, 0.0))
        assert felt.pose is not None
        assert len(felt.values["ranges"]) == 13
        assert felt.values["ranges"][6] == pytest.approx(2.0 - felt.pose[0], abs=0.05)  # the wall, straight ahead
        assert felt.values["beams"] == (-3.0, 0.5)
        body.drive(0.0, 1.0)
        until(lambda: (body.sense().pose or (0.0, 0.0, 0.0))[2] > 0.3)
    commanded(robot, [0.0, 0.0])


def test_a_fence_stops_a_robot_with_ros(turtle: tuple[str, subprocess.Popen[str]]) -> None:
    """Told to go on for ever, it stands a little behind the fence: what it drove within two looks of the guard."""
    place, _ = turtle
    limits = Limits(period=1.0, fence=(-1.0, 0.0, 0.3, 1.0))
    with closing(GuardedBody({"use": "ros2", "address": place}, 3, limits)) as body:

        def stands() -> bool:
            body.drive(0.5, 0.0)
            time.sleep(0.02)
            return body.sense().pose is not None and body.why == "outside the fence"

        until(stands, 10.0)
        until(lambda: body.sense().velocity == (0.0, 0.0))
        pose = body.sense().pose
        assert pose is not None
        assert 0.3 < pose[0] < 0.3 + 0.5 * 0.5


def test_no_bridge_no_robot_and_a_robot_that_goes_are_told(turtle: tuple[str, subprocess.Popen[str]]) -> None:
    place, robot = turtle
    with pytest.raises(InputError, match=r"adapter ros2: nobody answers at .* within 0\.5 s; expected zenoh-bridge"):
        reached(use="ros2", address=free(), patience=0.5)
    with pytest.raises(InputError, match=r"adapter ros2: no odometry on robot4/odom within 0\.5 s"):
        reached(4, use="ros2", address=place, patience=0.5)
    with closing(reached(use="ros2", address=place)) as body:
        robot.kill()
        with pytest.raises(LinkError, match="adapter ros2: no odometry for 2 s"):
            for_a_while(body.sense)


def test_what_is_no_message_is_dropped_and_counted(turtle: tuple[str, subprocess.Popen[str]]) -> None:
    place, _ = turtle
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/{place}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    dice, good = random.Random(5), odometry(9.0, 9.0, 0.0, 0.0, 0.0)
    with closing(reached(use="ros2", address=place)) as body, zenoh.open(config) as stranger:
        for i in range(2000):
            for topic, bad in (("odom", dice.randbytes(i % 100)), ("scan", good[: i % len(good)])):
                stranger.put(f"robot3/{topic}", bad, congestion_control=zenoh.CongestionControl.BLOCK)
        last = odometry(float("nan"), 0.0, 0.0, 0.0, 0.0)
        stranger.put("robot3/odom", last, congestion_control=zenoh.CongestionControl.BLOCK)
        until(lambda: body.counts["odom"] >= 2001)  # type: ignore[attr-defined]
        time.sleep(0.1)
        assert body.sense().pose == pytest.approx((0.0, 0.5, 0.0))


class Blind:
    """A body that senses nothing but its battery."""

    def sense(self) -> Felt:
        return Felt(values={"battery": (3.7,)})

    def drive(self, ahead: float, turn: float) -> None: ...

    def stop(self) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[RobotBody, socket.socket]]:
    """A tracked body as robot 3, and a camera that is connected to it."""
    from swarmsim.fleet.adapters.thymio import ThymioAdapter

    monkeypatch.setattr(ThymioAdapter, "open", lambda keys, robot: Blind())
    place = free()
    host, port = place.split(":")
    with closing(reached(use="tracker", over={"use": "thymio"}, listen=place, fresh=0.3)) as body:
        with pytest.raises(InputError, match=rf"adapter tracker: cannot listen at {place} \(Address already in use\)"):
            reached(use="tracker", over={"use": "thymio"}, listen=place)
        with socket.socket(type=socket.SOCK_DGRAM) as sender:
            sender.connect((host, int(port)))
            yield body, sender


def test_a_camera_tells_where_a_body_is_until_it_is_hidden(camera: tuple[RobotBody, socket.socket]) -> None:
    body, sender = camera
    assert body.sense() == Felt(values={"battery": (3.7,)})
    poses = [{"robot": i, "x": i + 0.5, "y": 2.0, "yaw": -1.0} for i in range(5)]
    sender.send(json.dumps(poses).encode())
    until(lambda: body.sense().pose == (3.5, 2.0, -1.0))
    assert body.sense().values == {"battery": (3.7,)}
    sender.send(json.dumps(poses[2]).encode())  # another robot
    assert body.sense().pose == (3.5, 2.0, -1.0)
    until(lambda: body.sense().pose is None)
    sender.send(json.dumps({**poses[3], "x": 9}).encode())
    until(lambda: body.sense().pose == (9.0, 2.0, -1.0))


def test_what_is_no_pose_is_dropped_and_counted(camera: tuple[RobotBody, socket.socket]) -> None:
    body, sender = camera
    dice = np.random.default_rng(6)
    good = {"robot": 3, "x": 1.0, "y": 1.0, "yaw": 0.0}
    wrong = [b"", b"[]" * 3, b"null", b"[" * 60_000, json.dumps({**good, "x": "far"}).encode(), b'{"robot": 3}']
    wrong += [json.dumps({**good, "y": bad}).encode() for bad in (float("nan"), float("inf"), None, [1], 10**400)]
    wrong += [dice.bytes(int(size)) for size in dice.integers(1, 300, 200)]
    for one in wrong:
        sender.send(one)
        assert body.sense().pose is None
    until(lambda: body.sense().pose is None and body.counts["no pose"] == len(wrong))  # type: ignore[attr-defined]
    sender.send(json.dumps(good).encode())
    until(lambda: body.sense().pose == (1.0, 1.0, 0.0))
