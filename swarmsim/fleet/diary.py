"""What one robot was told in a run, and what it said and did, as bytes: enough to try its mind on another computer."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Self

import msgspec
from msgspec import Struct, field

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.readings import Channels
from swarmsim.core.robot import Robot, Sensed, warm
from swarmsim.fleet import wire
from swarmsim.fleet.wire import Ears, Telegram

_MOST: Final = 2**30  # bytes of a diary


class Diary(Struct, forbid_unknown_fields=True):
    """A robot's diary: one entry an iteration in each list."""

    charge: bytes
    version: Literal[1] = 1
    sensed: list[bytes] = field(default_factory=list)  # telegrams
    said: list[list[bytes]] = field(default_factory=list)  # frames
    ears: list[bytes] = field(default_factory=list)  # telegrams
    heard: list[list[bytes]] = field(default_factory=list)  # frames
    deeds: list[bytes] = field(default_factory=list)  # telegrams

    def write(self, file: Path) -> None:
        """Keep it. Raises OSError."""
        file.write_bytes(msgspec.msgpack.encode(self))

    @classmethod
    def open(cls, file: Path) -> Self:
        """The diary in a file. Raises InputError."""
        try:
            if file.stat().st_size > _MOST:
                raise InputError(f"{file}: longer than {_MOST} bytes; expected a diary")
            found = msgspec.msgpack.decode(file.read_bytes(), type=cls)
            found.read_charge()
        except OSError as problem:
            raise InputError(f"{file}: cannot be read ({problem.strerror}); expected a diary") from problem
        except (msgspec.DecodeError, RecursionError) as problem:
            raise InputError(
                f"{file}: is no diary ({problem}); expected what `swarmsim robot replay --out` writes"
            ) from problem
        if len({len(one) for one in (found.sensed, found.said, found.ears, found.heard, found.deeds)}) != 1:
            raise InputError(f"{file}: has lists of several lengths; expected an entry of each for every iteration")
        return found

    def read_charge(self) -> Charge:
        """The robot's charge. Raises InputError."""
        return Charge.read(self.charge, "the diary's charge")

    def senses(self, iteration: int, channels: Channels, actuators: Channels) -> Sensed:
        """What it sensed in an iteration. Raises FrameError."""
        return wire.sensed_of(Telegram.read(self.sensed[iteration]), channels, actuators)


@dataclass(frozen=True, slots=True)
class DiaryReplay:
    """How a diary went when a robot lived through it again."""

    robot: int
    iterations: int
    difference: str  # the first one, in words; empty: all that it said and did is equal
    mean: float  # s of processor time, for one iteration
    longest: float  # s

    @property
    def equal(self) -> bool:
        """Whether the robot said and did the same, to the last bit."""
        return not self.difference

    def __str__(self) -> str:
        took = f"{1e3 * self.mean:.2f} ms of processor time an iteration, at most {1e3 * self.longest:.1f} ms"
        if self.equal:
            return f"robot {self.robot}: equal in all {self.iterations} iterations; {took}"
        return f"robot {self.robot}: different: {self.difference}"


def replayed(diary: Diary, name: str) -> DiaryReplay:
    """Let a robot live through a diary up to the first difference. `name` is the diary's in messages.

    Raises InputError for a diary that cannot have been written.
    """
    charge = diary.read_charge()
    warm(charge)
    robot, spent, difference = Robot.of(charge), list[float](), ""
    for iteration in range(len(diary.sensed)):
        begins = time.process_time()
        try:
            different = _lived(robot, diary, iteration)
        except FrameError as problem:
            raise InputError(f"{name}: iteration {iteration}: {problem}; expected what a run has told") from problem
        spent.append(time.process_time() - begins)
        if different:
            difference = f"iteration {iteration}, {different}"
            break
    return DiaryReplay(robot.number, len(spent), difference, sum(spent) / max(len(spent), 1), max(spent, default=0.0))


def _lived(robot: Robot, diary: Diary, iteration: int) -> str:
    """Live through an iteration; what differs, or nothing."""
    actuators = robot.context.actuators
    if robot.sense(diary.senses(iteration, robot.context.channels, actuators)) != diary.said[iteration]:
        return "what it says"
    told = Ears.of(Telegram.read(diary.ears[iteration]))
    deed = robot.hear([robot.read(frame) for frame in diary.heard[iteration]], told.awake, told.oldest)
    if wire.deed_telegram(robot.number, deed, actuators).packed() != diary.deeds[iteration]:
        return "what it does or reports"
    return ""
