"""For robots that are processes of their own: drizzle between them, and a kite for a body."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta, Struct

from swarmsim.core.scenario.part import Part
from swarmsim.fleet.adapter import Felt
from swarmsim.fleet.transport import Heard, RobotLink, Transport


class Drizzle(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Frames get lost in the drizzle; channels, which are no radio, stay dry."""

    over: Part[Transport] = Part("transport")  # what carries the frames that are not lost
    share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.3  # of frames that are lost
    seed: int = 0  # of which ones

    def open(self, address: str, robot: int) -> RobotLink:
        """Join what carries the frames. Raises InputError."""
        return Damp(self.over.build(None, "over").open(address, robot), self.share, self.seed + robot)


class Damp:
    """A link that loses some of what it says."""

    def __init__(self, dry: RobotLink, share: float, seed: int) -> None:
        self._dry, self._share, self._dice = dry, share, random.Random(seed)

    @property
    def mtu(self) -> int:
        return self._dry.mtu

    @property
    def counts(self) -> Mapping[str, int]:
        return self._dry.counts

    def say(self, frame: bytes) -> None:
        if self._dice.random() >= self._share or len(frame) > self.mtu:  # which is refused
            self._dry.say(frame)

    def heard(self) -> list[Heard]:
        return self._dry.heard()

    def wait(self, seconds: float) -> bool:
        return self._dry.wait(seconds)

    def airtime(self, length: int) -> float:
        return self._dry.airtime(length)

    def present(self) -> set[int]:
        return self._dry.present()

    def channel(self, name: str) -> RobotLink:
        return self._dry.channel(name)

    def close(self) -> None:
        self._dry.close()


class Kite(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A body that is not there: a kite, steered as if by wheels, and carried off by the wind."""

    wind: float = 0.1  # m/s, along x

    def open(self, robot: int) -> Flown:
        """The kite of a robot, at the place of its number. Raises nothing: it is always there."""
        return Flown(self.wind, float(robot))


class Flown:
    """One kite; it moves on whenever somebody looks at it or steers it."""

    def __init__(self, wind: float, y: float) -> None:
        self._wind, self._pose, self._deed, self._then = wind, (0.0, y, 0.0), (0.0, 0.0), time.monotonic()

    def sense(self) -> Felt:
        return Felt(self._fly(), self._deed)

    def drive(self, ahead: float, turn: float) -> None:
        self._fly()
        self._deed = ahead, turn

    def stop(self) -> None:
        self.drive(0.0, 0.0)

    def close(self) -> None:
        self.stop()

    def _fly(self) -> tuple[float, float, float]:
        now, (x, y, yaw), (ahead, turn) = time.monotonic(), self._pose, self._deed
        seconds, self._then = now - self._then, now
        x += seconds * (self._wind + ahead * math.cos(yaw))
        self._pose = x, y + seconds * ahead * math.sin(yaw), yaw + seconds * turn
        return self._pose
