"""Poses from outside, such as an overhead camera's: a stream of JSON datagrams beside a robot's own body."""

from __future__ import annotations

import json
import math
import socket
import time
from collections import Counter
from dataclasses import replace
from typing import Annotated, Final, final

from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.adapter import Adapter, Felt, Pose, RobotBody
from swarmsim.fleet.addresses import LOOPBACK, Address

_LARGEST: Final = 65_507  # bytes of a datagram
_AT_ONCE: Final = 1000  # datagrams that are read before the body has its turn


class Tracker(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A body whose pose a camera sees: UDP datagrams of {"robot": 3, "x": 1.25, "y": 0.5, "yaw": 1.57}, in m and rad.

    One datagram may hold a list of them, for several robots. A pose counts for `fresh` s, and is then unknown. It
    listens on loopback unless `listen` names the address of an interface. Datagrams are not signed.
    """

    over: Part[Adapter]  # the body itself
    listen: str = f"{LOOPBACK}:17777"  # HOST:PORT of this machine that the camera sends to
    fresh: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.5  # s

    def open(self, robot: int) -> TrackedBody:
        """Reach the body, and listen. Raises InputError for a port that is taken."""
        place = Address.of(self.listen, "adapter tracker")
        body = self.over.build(None, "over").open(robot)
        camera = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        camera.setblocking(False)
        try:
            camera.bind((place.host, place.port))
        except OSError as problem:
            camera.close()
            body.close()
            raise InputError(
                f"adapter tracker: cannot listen at {place} ({problem.strerror}); expected a free port of this machine"
            ) from problem
        return TrackedBody(body, camera, robot, self.fresh)


@final
class TrackedBody:
    """A body, and where a camera sees it. Datagrams that hold no pose are counted in `counts`."""

    def __init__(self, body: RobotBody, camera: socket.socket, robot: int, fresh: float) -> None:
        self._body, self._camera, self._robot, self._fresh = body, camera, robot, fresh
        self._pose: Pose | None = None
        self._seen = -math.inf
        self.counts = Counter[str]()
        self.drive, self.stop = body.drive, body.stop

    def sense(self) -> Felt:
        for _ in range(_AT_ONCE):
            try:
                self._take(self._camera.recv(_LARGEST))
            except OSError:
                break
        known = self._pose if time.monotonic() - self._seen <= self._fresh else None
        return replace(self._body.sense(), pose=known)

    def close(self) -> None:
        self._camera.close()
        self._body.close()

    def _take(self, data: bytes) -> None:
        try:
            told = json.loads(data)
            for one in told if isinstance(told, list) else [told]:
                pose = (float(one["x"]), float(one["y"]), float(one["yaw"]))
                if not all(map(math.isfinite, pose)):
                    raise ValueError("not finite")
                if one["robot"] == self._robot:
                    self._pose, self._seen = pose, time.monotonic()
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
            self.counts["no pose"] += 1
