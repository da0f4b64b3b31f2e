"""The transport: drizzle between robots that are processes of their own."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta, Struct

from swarmsim.core.scenario.part import Part
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
