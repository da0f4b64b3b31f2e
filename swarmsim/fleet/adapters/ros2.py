"""Robots with ROS 2, without ROS: its messages in CDR, over the keys of zenoh-bridge-ros2dds.

Tried against a simulated robot whose messages another library packs and reads, not on a robot.
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING, Annotated, Final, cast, final

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.fleet.adapter import Felt, Pose
from swarmsim.fleet.addresses import LOOPBACK, Address
from swarmsim.fleet.transport import LinkError

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

_SILENCE: Final = 2.0  # s without odometry, after which the robot counts as gone
_LARGEST: Final = 2**20  # bytes of a message that is read


class Ros2(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot that takes `cmd_vel` (Twist) and tells `odom` (Odometry) and `scan` (LaserScan), as a TurtleBot.

    zenoh-bridge-ros2dds beside it makes each topic a key of the same name. `{robot}` stands for the robot's number. Not
    tried on hardware.
    """

    address: str = f"{LOOPBACK}:7447"  # where the bridge, or a router of zenoh, listens
    namespace: str = "robot{robot}"  # before the names of topics; empty: none
    patience: Annotated[float, Meta(gt=0.0, le=60.0)] = 5.0  # s, in which the bridge and the robot have to answer

    def open(self, robot: int) -> Ros2Body:
        """Reach it. Raises InputError if there is no bridge, or no odometry."""
        try:
            import pycdr2  # noqa: F401
            import zenoh
        except ImportError as problem:
            raise InputError(
                "adapter ros2: needs eclipse-zenoh and pycdr2; install them with: pip install eclipse-zenoh pycdr2"
            ) from problem
        place, config = Address.of(self.address, "adapter ros2"), zenoh.Config()
        for key, value in {
            "mode": "client",
            "scouting/multicast/enabled": False,
            "connect/endpoints": [f"tcp/{place}"],
            "connect/timeout_ms": int(1000 * self.patience),
            "connect/exit_on_failure": True,
        }.items():
            config.insert_json5(key, json.dumps(value))
        try:
            session = zenoh.open(config)
        except zenoh.ZError as problem:
            raise InputError(
                f"adapter ros2: nobody answers at {place} within {self.patience:g} s; expected zenoh-bridge-ros2dds"
            ) from problem
        prefix = self.namespace.replace("{robot}", str(robot)).strip("/")
        return Ros2Body(session, f"{prefix}/" if prefix else "", self.patience)


@final
class Ros2Body:
    """A robot whose odometry is heard. What is no message of the kind expected is counted in `counts`, and dropped."""

    def __init__(self, session: zenoh.Session, prefix: str, patience: float) -> None:
        from swarmsim.fleet.adapters import ros2_messages

        self._messages, self._session, self._seen = ros2_messages, session, 0.0
        self._lock = threading.Lock()
        self._pose: Pose | None = None
        self._velocity: tuple[float, float] | None = None
        self._values: dict[str, tuple[float, ...]] = {}
        self.counts = Counter[str]()
        self._commands = session.declare_publisher(f"{prefix}cmd_vel")
        self._heard = [
            session.declare_subscriber(f"{prefix}{topic}", self._reader(topic, take))
            for topic, take in (("odom", self._odometry), ("scan", self._scan))
        ]
        ends = time.monotonic() + patience
        while not self._seen:
            if time.monotonic() > ends:
                session.close()
                raise InputError(f"adapter ros2: no odometry on {prefix}odom within {patience:g} s; expected a robot")
            time.sleep(0.01)

    def sense(self) -> Felt:
        """What it has told last.

        `ranges` has a distance (m) for each beam of `scan`, infinite if nothing is within `reach` (m) and NaN for none
        measured, and `beams` its first bearing and their steps (rad).
        """
        if time.monotonic() - self._seen > _SILENCE:
            raise LinkError(f"adapter ros2: no odometry for {_SILENCE:g} s")
        with self._lock:
            return Felt(self._pose, self._velocity, dict(self._values))

    def drive(self, ahead: float, turn: float) -> None:
        vector = self._messages.Vector3
        try:
            self._commands.put(self._messages.Twist(vector(x=ahead), vector(z=turn)).serialize())
        except Exception as problem:  # zenoh's own kind, if the session has ended
            raise LinkError(f"adapter ros2: the bridge cannot be reached ({problem})") from problem

    def stop(self) -> None:
        self.drive(0.0, 0.0)

    def close(self) -> None:
        self.stop()
        self._heard.clear()
        self._session.close()

    def _reader(self, topic: str, take: Callable[[bytes], None]) -> Callable[[zenoh.Sample], None]:
        def read(sample: zenoh.Sample) -> None:
            try:
                data = sample.payload.to_bytes()
                if len(data) > _LARGEST:
                    raise ValueError("too long")
                with self._lock:
                    take(data)
            except Exception:  # whatever a stranger's bytes make of a library
                self.counts[topic] += 1

        return read

    def _odometry(self, data: bytes) -> None:
        told = self._messages.RosOdometry.deserialize(data)
        place, yaw = told.pose.pose.position, self._messages.yaw_of(told.pose.pose.orientation)
        found = (place.x, place.y, yaw, told.twist.twist.linear.x, told.twist.twist.angular.z)
        if not all(map(math.isfinite, found)):
            raise ValueError("not finite")
        self._pose, self._velocity, self._seen = found[:3], found[3:], time.monotonic()

    def _scan(self, data: bytes) -> None:
        told = self._messages.LaserScan.deserialize(data)
        measured = (one if one >= told.range_min else math.nan for one in cast("list[float]", told.ranges))
        self._values = {
            "ranges": tuple(one if not one > told.range_max else math.inf for one in measured),
            "beams": (told.angle_min, told.angle_increment),
            "reach": (told.range_max,),
        }
