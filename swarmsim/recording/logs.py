"""Logs of robots that exist: where they were, what their scanners measured, and who heard whom."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_POSE, _MESSAGE = ("time", "robot", "x", "y", "yaw"), ("time", "sender", "receiver", "bytes")
_SCAN: Final = ("time", "robot")  # and a distance in each further column
_MOST: Final = 10_000_000  # rows
_KINDS: Final = ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/LaserScan")


@dataclass(eq=False)
class RobotLog:
    """What was logged, by robot; times in s, each robot's in rising order."""

    poses: dict[int, NDArray[np.float64]] = field(default_factory=dict)  # (m, 4): time, x and y in m, yaw in rad
    scans: dict[int, NDArray[np.float64]] = field(default_factory=dict)  # (m, 1 + b): time, distances in m
    messages: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 4)))  # time, sender, receiver, bytes

    @property
    def begins(self) -> float:
        """When the first pose was logged."""
        return min(float(rows[0, 0]) for rows in self.poses.values())

    @property
    def ends(self) -> float:
        """When the last pose was logged."""
        return max(float(rows[-1, 0]) for rows in self.poses.values())


def read_logs(files: Sequence[Path]) -> RobotLog:
    """The log in some files: CSV with a line of names, a rosbag2 folder, or an MCAP file.

    CSV has time, robot, x, y, yaw; or time, robot and a distance in each further column; or time, sender, receiver,
    bytes. Of bags, Odometry and PoseStamped are poses, LaserScan are scans; a topic's last number is the robot's.
    Raises InputError.
    """
    rows: dict[str, list[list[float]]] = {"pose": [], "scan": [], "message": []}
    for file in files:
        found = _csv(file) if file.suffix.lower() == ".csv" else _bag(file)
        for kind, row in found:
            rows[kind].append(row)
            if len(rows[kind]) > _MOST:
                raise InputError(f"{file}: has more than {_MOST} rows; expected a shorter log")
    if not rows["pose"]:
        raise InputError(f"{', '.join(map(str, files))}: no pose in it; expected where robots were")
    messages = np.array(rows["message"]).reshape(-1, 4)
    return RobotLog(_by_robot(rows["pose"], "pose"), _by_robot(rows["scan"], "scan"), messages)


def _by_robot(rows: list[list[float]], kind: str) -> dict[int, NDArray[np.float64]]:
    """Rows of time, robot and numbers, by robot, sorted by time."""
    found: dict[int, list[list[float]]] = {}
    for time, robot, *numbers in rows:
        found.setdefault(int(robot), []).append([time, *numbers])
    tables = {}
    for robot, own in sorted(found.items()):
        if len({len(row) for row in own}) > 1:
            raise InputError(f"robot {robot}: its {kind}s have several lengths; expected one")
        table = np.array(own)
        tables[robot] = table[np.argsort(table[:, 0], kind="stable")]
    return tables


def _csv(file: Path) -> Iterator[tuple[str, list[float]]]:
    try:
        with file.open(newline="") as opened:
            lines = csv.reader(opened)
            names = tuple(name.strip() for name in next(lines, []))
            kind = {_POSE: "pose", _MESSAGE: "message"}.get(names, "scan" if names[:2] == _SCAN else "")
            if not kind or (kind == "scan" and (len(names) < 3 or "x" in names)):
                raise InputError(
                    f"{file}: columns {', '.join(names) or 'none'}; expected {', '.join(_POSE)}, or "
                    f"{', '.join(_MESSAGE)}, or time, robot and distances"
                )
            for number, line in enumerate(lines, 2):
                yield kind, _numbers(file, number, kind, line, len(names))
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise InputError(f"{file}: cannot be read ({problem}); expected a table in CSV") from problem


def _numbers(file: Path, line: int, kind: str, words: list[str], count: int) -> list[float]:
    try:
        found = [float(word) for word in words]
    except ValueError as problem:
        raise InputError(f"{file}: line {line}: {problem}; expected numbers") from problem
    sure = found if kind != "scan" else found[:2]  # a beam that meets nothing is inf or nan
    if len(found) != count or not all(map(math.isfinite, sure)):
        raise InputError(f"{file}: line {line}: {', '.join(words)}; expected {count} finite numbers")
    numbers = found[1:3] if kind == "message" else found[1:2]
    if not all(0 <= abs(one) < 2**31 and one == int(one) for one in numbers):
        raise InputError(f"{file}: line {line}: {', '.join(words)}; expected whole numbers of robots")
    return found


def _bag(file: Path) -> Iterator[tuple[str, list[float]]]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.highlevel.anyreader import AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as problem:
        raise InputError(f"{file}: needs rosbags; install it with: pip install 'swarmsim-lab[bag]'") from problem
    store: Typestore = get_typestore(Stores.ROS2_HUMBLE)
    try:
        with AnyReader([file], default_typestore=store) as reader:
            wanted = [one for one in reader.connections if one.msgtype in _KINDS and re.search(r"\d", one.topic)]
            for connection, _, data in reader.messages(wanted):
                robot = float(re.findall(r"\d+", connection.topic)[-1])
                yield _told(connection.msgtype, robot, reader.deserialize(data, connection.msgtype))
    except (AnyReaderError, OSError) as problem:
        raise InputError(f"{file}: {problem}; expected a rosbag2 folder, an MCAP file, or .csv") from problem


def _told(kind: str, robot: float, message: object) -> tuple[str, list[float]]:
    """A row of a message of one of the known kinds."""
    stamp = attrgetter("header.stamp.sec", "header.stamp.nanosec")(message)
    time = stamp[0] + 1e-9 * stamp[1]
    if kind == "sensor_msgs/msg/LaserScan":
        return "scan", [time, robot, *map(float, attrgetter("ranges")(message))]
    place = "pose.pose" if kind == "nav_msgs/msg/Odometry" else "pose"
    x, y, qx, qy, qz, qw = attrgetter(
        *(f"{place}.{name}" for name in ("position.x", "position.y", *(f"orientation.{one}" for one in "xyzw")))
    )(message)
    yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return "pose", [time, robot, x, y, yaw]
