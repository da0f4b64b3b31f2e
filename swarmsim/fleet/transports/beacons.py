"""Beacons, by which robots on a medium without connections tell that they are there."""

from __future__ import annotations

import hmac
import struct
import threading
import time
from collections import Counter
from collections.abc import Mapping
from typing import Final, final

from swarmsim.fleet.keyring import TAG, tag

HERE: Final = b"here"
GONE: Final = b"gone"
_PLAIN: Final = struct.Struct(">4si")  # a mark, and the sender's number
_STAMPED: Final = struct.Struct(">4siQ")  # and when it was made, ns on its clock: each is newer than all before
_PURPOSE: Final = b"swarmsim beacons"
_MOST: Final = 100_000  # robots that are kept
LONGEST: Final = _STAMPED.size + TAG  # bytes


@final
class Beacons:
    """Makes the beacons of one robot, and knows from those of others who is there; from any thread.

    With `keys`, those of all robots, beacons are signed: what is forged, or said again, is counted and changes nothing.
    """

    def __init__(self, robot: int, silence: float, keys: Mapping[int, bytes], counts: Counter[str]) -> None:
        """Who is silent for `silence` s has gone. `counts` what is no beacon, or none of the robot that it names."""
        self._robot, self._silence, self._keys, self._counts = robot, silence, keys, counts
        self._seen: dict[int, float] = {}  # when each other's was last heard, s
        self._newest: dict[int, int] = {}  # its stamp
        self._lock = threading.Lock()

    def made(self, mark: bytes) -> bytes:
        """One beacon: HERE or GONE."""
        if not self._keys:
            return _PLAIN.pack(mark, self._robot)
        told = _STAMPED.pack(mark, self._robot, time.time_ns())
        return told + tag(told, self._keys[self._robot], _PURPOSE)

    def take(self, data: bytes) -> None:
        """One that has arrived."""
        found = self._signed(data) if self._keys else _PLAIN.unpack(data) if len(data) == _PLAIN.size else None
        if found is None or found[0] not in (HERE, GONE):
            self._counts["no beacon"] += 1
            return
        mark, robot = found
        with self._lock:
            if mark == GONE:
                self._seen.pop(robot, None)
            elif robot in self._seen or len(self._seen) < _MOST:
                self._seen[robot] = time.monotonic()

    def _signed(self, data: bytes) -> tuple[bytes, int] | None:
        """The mark and sender of a beacon that is its sender's, and newer than all before; else None."""
        told, signed = data[:-TAG], data[-TAG:]
        if len(told) != _STAMPED.size:
            return None
        mark, robot, stamp = _STAMPED.unpack(told)
        key = self._keys.get(robot)
        if key is None or not hmac.compare_digest(signed, tag(told, key, _PURPOSE)):
            return None
        if stamp <= self._newest.get(robot, -1):
            return None
        self._newest[robot] = stamp
        return mark, robot

    @property
    def present(self) -> set[int]:
        """The others that are there."""
        now = time.monotonic()
        with self._lock:
            return {robot for robot, seen in self._seen.items() if now - seen < self._silence} - {self._robot}
