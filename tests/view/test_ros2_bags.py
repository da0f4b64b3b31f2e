"""Runs as rosbag2 of ROS 2's own messages, read back by rosbags, and by mcap and pycdr2, which wrote nothing."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import swarmsim as sw
from swarmsim.core.errors import InputError
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.fleet.adapters.ros2_messages import LaserScan, RosOdometry
from swarmsim.operations.mapping.replay import MapReplay

VALUES = {UNKNOWN: -1, FREE: 0, OCCUPIED: 100}


@pytest.fixture(scope="module")
def run() -> sw.Run:
    return sw.run(ROOT / "scenarios" / "room.toml", overrides={"localisation.use": "odometry", "stop.iterations": 22})


@pytest.fixture(scope="module")
def bag(run: sw.Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bags") / "run-bag"
    assert run.export(ros2=out) == [out]
    return out


@pytest.fixture(scope="module")
def told(bag: Path) -> dict[str, list[tuple[int, object]]]:
    found: dict[str, list[tuple[int, object]]] = {}
    with AnyReader([bag]) as reader:
        for connection, now, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((now, message))
    return found


def yaw_of(turned: object) -> float:
    return math.remainder(2.0 * math.atan2(turned.z, turned.w), 2.0 * math.pi)


def test_every_iteration_has_its_frames(run: sw.Run, told: dict) -> None:
    poses = run.recording["pose"]
    assert [now for now, _ in told["/tf"]] == [round(1e9 * row * run.recording.scenario.period) for row in range(22)]
    for (now, message), row in zip(told["/tf"], poses, strict=True):
        assert [one.child_frame_id for one in message.transforms] == ["robot_0/base", "robot_1/base", "robot_2/base"]
        for one, (x, y, yaw) in zip(message.transforms, row, strict=True):
            stamp = one.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == now
            assert (one.transform.translation.x, one.transform.translation.y) == (x, y)
            assert math.remainder(yaw_of(one.transform.rotation) - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_odometry_is_what_a_robot_believes_as_another_library_reads_it(run: sw.Run, bag: Path) -> None:
    rows, believed = 0, run.recording["believed"]
    assert np.abs(believed - run.recording["pose"]).max() > 1e-3
    with (bag / "run-bag.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=["/robot_1/odom"]):
            assert (schema.name, channel.message_encoding) == ("nav_msgs/msg/Odometry", "cdr")
            found = RosOdometry.deserialize(message.data)
            pose = found.pose.pose
            assert (pose.position.x, pose.position.y) == tuple(believed[rows, 1, :2])
            assert yaw_of(pose.orientation) == pytest.approx(math.remainder(believed[rows, 1, 2], 2 * math.pi))
            if rows:
                before, after = run.recording["pose"][rows - 1 : rows + 1, 1]
                speed = np.hypot(found.twist.twist.linear.x, found.twist.twist.linear.y)
                assert speed == pytest.approx(np.hypot(*(after - before)[:2]) / run.recording.scenario.period)
            rows += 1
    assert rows == 22


def test_scans_reach_the_walls(run: sw.Run, bag: Path) -> None:
    lengths = []
    with (bag / "run-bag.mcap").open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=["/robot_0/scan"]):
            found = LaserScan.deserialize(message.data)
            assert len(found.ranges) == 72
            assert found.angle_increment == pytest.approx(2 * math.pi / 72)
            assert found.angle_max == pytest.approx(found.angle_min + 71 * found.angle_increment, abs=1e-5)
            assert max(found.ranges) <= found.range_max
            lengths.append(min(found.ranges))
    assert len(lengths) == 22
    assert min(lengths) > 0.0
    truth, lattice = run.recording["truth"], run.recording.lattice
    x, y, yaw = run.recording["pose"][21, 0]
    for beam, length in enumerate(found.ranges):
        if length < 0.99 * found.range_max:  # it ends at a wall: a little further on is no free cell
            bearing = yaw + beam * found.angle_increment
            spot = (x + (length + 0.02) * math.cos(bearing), y + (length + 0.02) * math.sin(bearing))
            row, column = int((spot[1] - lattice.y0) / lattice.cell), int((spot[0] - lattice.x0) / lattice.cell)
            assert truth[row, column], (beam, length)


def test_maps_are_those_of_the_recording(run: sw.Run, told: dict) -> None:
    assert [now // 10**9 for now, _ in told["/map"]] == [0, 10, 20, 21]
    replay = MapReplay(run.recording)
    for now, message in told["/map"]:
        replay.advance(now // 10**9)
        lattice = run.recording.lattice
        rows, columns = lattice.shape
        assert (message.info.height, message.info.width) == (rows, columns)
        assert message.info.resolution == pytest.approx(lattice.cell)
        assert (message.info.origin.position.x, message.info.origin.position.y) == (
            run.recording.lattice.x0,
            run.recording.lattice.y0,
        )
        wanted = np.vectorize(VALUES.get)(replay.collective())
        assert (np.reshape(message.data, (rows, columns)) == wanted).all()
    own = np.vectorize(VALUES.get)(replay.maps[2])
    assert (np.reshape(told["/robot_2/map"][-1][1].data, own.shape) == own).all()


def test_a_folder_that_exists_is_refused(run: sw.Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--ros2 .*: exists already; expected a new folder"):
        run.export(ros2=tmp_path)
    with pytest.raises(InputError, match=r"--ros2 .*: is a name for ROS 1; expected a new folder, such as x-bag"):
        run.export(ros2=tmp_path / "x.bag")
