"""A recording as a rosbag2 of ROS 2's own messages, which `ros2 bag play` and rviz take.

Importing this raises InputError where rosbags is not installed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.recording.reader import Recording
from swarmsim.view.scene import Frame, Scene
from swarmsim.world.rosmap import occupancy

try:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore
except ImportError as problem:
    raise InputError("--ros2 needs rosbags; install it with: pip install 'swarmsim-lab[bag]'") from problem

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

MAPS: Final = 10  # iterations from one map to the next
VERSION: Final = 8  # of the bag's metadata
STORE: Final = get_typestore(Stores.ROS2_HUMBLE)
_UNKNOWN: Final = np.zeros(36)  # a covariance that nobody has estimated
_EVEN: Final = 1e-6  # rad, by which even bearings may differ

Message = tuple[str, str, object]  # topic, type, message


def write_bag(recording: Recording, out: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Write a run to the new folder `out`, stored as MCAP; time is simulated time, from 0 on.

    /tf has the true frame robot_I/base of each robot in `map`, /robot_I/odom the pose that it believes, in `map`, with
    its velocity, and /robot_I/scan the beams of a ring with even bearings: as measured if lengths are recorded, else as
    ideal beams reach. /map is the union of all maps and /robot_I/map one robot's, every tenth iteration and at the end.
    """
    scene = Scene(recording)
    topics: dict[str, Connection] = {}
    with Writer(out, version=VERSION, storage_plugin=StoragePlugin.MCAP) as bag:
        for row in range(recording.iterations):
            now = round(1e9 * row * scene.period)
            for topic, kind, message in _told(recording, scene, scene.at(row), _stamp(now)):
                if topic not in topics:
                    topics[topic] = bag.add_connection(topic, kind, typestore=STORE)
                bag.write(topics[topic], now, STORE.serialize_cdr(message, kind))
            if progress is not None:
                progress(row + 1, recording.iterations)


def _told(recording: Recording, scene: Scene, shot: Frame, stamp: object) -> Iterator[Message]:
    """All messages of an iteration."""
    row = shot.row
    believed = recording["believed"][row] if scene.has_beliefs else shot.pose
    before, after = (recording["pose"][max(row + shift, 0)] for shift in (-1, 0))
    transforms = [
        _made("geometry_msgs/msg/TransformStamped", _header(stamp), f"robot_{robot}/base", _transform(*pose))
        for robot, pose in enumerate(shot.pose.tolist())
    ]
    yield "/tf", "tf2_msgs/msg/TFMessage", _made("tf2_msgs/msg/TFMessage", transforms)
    for robot, pose in enumerate(believed.tolist()):
        twist = _twist(before[robot], after[robot], scene.period)
        yield f"/robot_{robot}/odom", "nav_msgs/msg/Odometry", _odometry(stamp, robot, pose, twist)
        scan = _scan(recording, scene, shot, robot, stamp)
        if scan is not None:
            yield f"/robot_{robot}/scan", "sensor_msgs/msg/LaserScan", scan
    if scene.has_maps and (row % MAPS == 0 or row == recording.iterations - 1):
        yield "/map", "nav_msgs/msg/OccupancyGrid", _grid(recording, scene.cells(row), stamp)
        for robot in range(scene.robots):
            own = _grid(recording, scene.own_cells(robot, row), stamp)
            yield f"/robot_{robot}/map", "nav_msgs/msg/OccupancyGrid", own


def _made(kind: str, *fields: object) -> object:
    make: Callable[..., object] = STORE.types[kind]  # rosbags makes its types at run time
    return make(*fields)


def _stamp(now: int) -> object:
    return _made("builtin_interfaces/msg/Time", *divmod(now, 1_000_000_000))


def _header(stamp: object, frame: str = "map") -> object:
    return _made("std_msgs/msg/Header", stamp, frame)


def _turned(yaw: float) -> object:
    return _made("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def _vector(x: float, y: float, z: float = 0.0) -> object:
    return _made("geometry_msgs/msg/Vector3", x, y, z)


def _transform(x: float, y: float, yaw: float) -> object:
    return _made("geometry_msgs/msg/Transform", _vector(x, y), _turned(yaw))


def _pose(x: float, y: float, yaw: float = 0.0) -> object:
    return _made("geometry_msgs/msg/Pose", _made("geometry_msgs/msg/Point", x, y, 0.0), _turned(yaw))


def _twist(before: NDArray[np.float64], after: NDArray[np.float64], period: float) -> object:
    """The mean velocity of an iteration, in the robot's frame."""
    along, turn = (after[:2] - before[:2]) / period, math.remainder(after[2] - before[2], 2.0 * math.pi) / period
    c, s = math.cos(after[2]), math.sin(after[2])
    ahead, aside = float(c * along[0] + s * along[1]), float(c * along[1] - s * along[0])
    return _made("geometry_msgs/msg/Twist", _vector(ahead, aside), _vector(0.0, 0.0, float(turn)))


def _odometry(stamp: object, robot: int, pose: list[float], twist: object) -> object:
    return _made(
        "nav_msgs/msg/Odometry", _header(stamp), f"robot_{robot}/base",
        _made("geometry_msgs/msg/PoseWithCovariance", _pose(*pose), _UNKNOWN),
        _made("geometry_msgs/msg/TwistWithCovariance", twist, _UNKNOWN),
    )  # fmt: skip


def _scan(recording: Recording, scene: Scene, shot: Frame, robot: int, stamp: object) -> object | None:
    """A robot's beams; None without any, or with bearings that are not even, which a LaserScan cannot hold."""
    measured = [one for one in recording.channels if one.axis and one.unit == "m" and one.recorded_as in recording]
    bearings = np.array(measured[0].axis if measured else scene.bearings[robot])
    if len(bearings) < 2 or np.ptp(steps := np.diff(bearings)) > _EVEN or not shot.alive[robot]:
        return None
    lengths = recording[measured[0].recorded_as][shot.row, robot] if measured else scene.beams(robot, shot)
    reach = measured[0].high if measured else scene.reach(robot)
    first, step = float(bearings[0]), float(steps[0])
    return _made(
        "sensor_msgs/msg/LaserScan", _header(stamp, f"robot_{robot}/base"), first, first + step * (len(bearings) - 1),
        step, 0.0, scene.period, 0.0, float(reach), np.asarray(lengths, np.float32), np.empty(0, np.float32),
    )  # fmt: skip


def _grid(recording: Recording, states: NDArray[np.uint8], stamp: object) -> object:
    lattice = recording.lattice
    rows, columns = states.shape
    about = _made("nav_msgs/msg/MapMetaData", stamp, lattice.cell, columns, rows, _pose(lattice.x0, lattice.y0))
    return _made("nav_msgs/msg/OccupancyGrid", _header(stamp), about, occupancy(states))
