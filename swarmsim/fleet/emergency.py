"""The emergency stop: a frame on the air that lets one robot or all stand, until another one releases them."""

from __future__ import annotations

import struct
import time
from dataclasses import dataclass
from typing import Final, Self

from swarmsim.core.messages import HEADER
from swarmsim.fleet.transport import RobotLink

OPERATOR: Final = 65_535  #: the sender's number of such a frame, which no robot has
EVERYBODY: Final = 65_535
_WHAT: Final = {True: b"HALT", False: b"FREE"}
_TARGET: Final = struct.Struct(">4sH")  # what to do, and the robot's number
_TIMES, _APART = 10, 0.1  # how often it is said, since the air may lose it, and s between


@dataclass(frozen=True, slots=True)
class Halt:
    """An emergency stop, or its end."""

    robot: int  # its number, or EVERYBODY
    halts: bool  # False: the robot may move again
    when: int  # s since 1970 on the operator's clock: an older one is not obeyed after a newer one

    def packed(self) -> bytes:
        """Its frame: a header as of any message, so that `signed` can sign it, and what it asks for."""
        return HEADER.pack(OPERATOR, self.when) + _TARGET.pack(_WHAT[self.halts], self.robot)

    @classmethod
    def read(cls, frame: bytes) -> Self | None:
        """What `packed` made; None for any other frame."""
        if len(frame) != HEADER.size + _TARGET.size:
            return None
        sender, when = HEADER.unpack_from(frame)
        what, robot = _TARGET.unpack_from(frame, HEADER.size)
        return cls(robot, what == _WHAT[True], when) if sender == OPERATOR and what in _WHAT.values() else None

    def is_for(self, robot: int) -> bool:
        """Whether the robot of this number has to obey."""
        return self.robot in (robot, EVERYBODY)


def say(link: RobotLink, robot: int, halts: bool) -> None:
    """Let a robot, or EVERYBODY, stand, or end that: for a second, again and again."""
    for _ in range(_TIMES):
        link.say(Halt(robot, halts, int(time.time())).packed())
        time.sleep(_APART)
