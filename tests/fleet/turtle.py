"""A simulated robot with ROS 2 behind a bridge, whose messages rosbags packs and reads.

`python turtle.py PORT [X Y YAW]`.
"""

from __future__ import annotations

import json
import math
import sys
import time

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
KINDS = STORE.types
NOTHING = np.zeros(36)


def made(name: str, *fields: object) -> object:
    return KINDS[name](*fields)


def odometry(x: float, y: float, yaw: float, ahead: float, turn: float) -> bytes:
    def vector(*of: float) -> object:
        return made("geometry_msgs/msg/Vector3", *of)

    pose = made(
        "geometry_msgs/msg/Pose",
        made("geometry_msgs/msg/Point", x, y, 0.0),
        made("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
    )
    twist = made("geometry_msgs/msg/Twist", vector(ahead, 0.0, 0.0), vector(0.0, 0.0, turn))
    told = made(
        "nav_msgs/msg/Odometry", header(), "base",
        made("geometry_msgs/msg/PoseWithCovariance", pose, NOTHING),
        made("geometry_msgs/msg/TwistWithCovariance", twist, NOTHING),
    )  # fmt: skip
    return bytes(STORE.serialize_cdr(told, "nav_msgs/msg/Odometry"))


def header() -> object:
    return made("std_msgs/msg/Header", made("builtin_interfaces/msg/Time", 1, 2), "odom")


def scan(ranges: list[float]) -> bytes:
    told = made(
        "sensor_msgs/msg/LaserScan", header(), -3.0, 3.0, 0.5, 0.0, 0.1, 0.05, 8.0,
        np.array(ranges, np.float32), np.zeros(0, np.float32),
    )  # fmt: skip
    return bytes(STORE.serialize_cdr(told, "sensor_msgs/msg/LaserScan"))


def live(port: int, x: float = 0.0, y: float = 0.5, yaw: float = 0.0) -> None:
    """Drives as it is told, towards a wall at x = 2 m; prints each command that differs from the one before."""
    config = zenoh.Config()
    for key, value in {"mode": "router", "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    session = zenoh.open(config)
    wanted, shown = [0.0, 0.0], None

    def take(sample: zenoh.Sample) -> None:
        told = STORE.deserialize_cdr(sample.payload.to_bytes(), "geometry_msgs/msg/Twist")
        wanted[:] = told.linear.x, told.angular.z

    held = session.declare_subscriber("robot3/cmd_vel", take)
    print("there", flush=True)
    at = time.monotonic()
    while held is not None:
        time.sleep(0.02)
        (ahead, turn), now = wanted, time.monotonic()
        x, y = x + ahead * math.cos(yaw) * (now - at), y + ahead * math.sin(yaw) * (now - at)
        yaw, at = yaw + turn * (now - at), now
        session.put("robot3/odom", odometry(x, y, yaw, ahead, turn))
        session.put("robot3/scan", scan([8.0] * 6 + [2.0 - x] + [8.0] * 6))
        if [ahead, turn] != shown:
            shown = [ahead, turn]
            print(ahead, turn, flush=True)


if __name__ == "__main__":
    live(int(sys.argv[1]), *map(float, sys.argv[2:]))
