"""Telegrams between a simulated world and robots that are processes: what a robot senses, hears and does, as bytes.

Robots' own messages are not among them: these are frames of their codec, and go on the air as they are. Bytes are
checked before memory is taken for what they claim, for a telegram may come from anybody who found the port.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.charge import VERSION
from swarmsim.core.messages import LATEST, FrameError
from swarmsim.core.readings import LONGEST, Channels, Column
from swarmsim.core.robot import Deed, Sensed
from swarmsim.core.state import Intents

#: Kinds: a robot joins, is told its charge, is ready; then in each iteration it senses, says, is told what reaches it
#: and decides. It may ask for frames that the air has lost. `END` comes at the end of a run.
JOIN, CHARGE, READY, SENSED, SAID, EARS, DEED, LACKS, END = range(9)
#: Big-endian: version, kind, robot, iteration, arrays, pieces of bytes.
_HEAD: Final = struct.Struct(">BBHIHH")
_SIDE, _LENGTH = struct.Struct(">I"), struct.Struct(">I")
_TYPES: Final = tuple(np.dtype(one) for one in ("?", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"))
_MOST_SIDES: Final = 8
_ABSENT: Final = np.empty((0, 0, 0), np.uint8)  # in the place of an array that is not there

Arrays = tuple[Column, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Telegram:
    """One telegram: numbers and bytes of a kind."""

    kind: int
    robot: int  # that it is for or from
    iteration: int = 0
    arrays: Arrays = ()
    pieces: tuple[bytes, ...] = ()

    def packed(self) -> bytes:
        """Its bytes."""
        head = _HEAD.pack(VERSION, self.kind, self.robot, self.iteration, len(self.arrays), len(self.pieces))
        return b"".join((head, *map(_packed, self.arrays), *(_LENGTH.pack(len(one)) + one for one in self.pieces)))

    @classmethod
    def read(cls, data: bytes) -> Telegram:
        """The telegram in these bytes. Raises FrameError for anything that `packed` cannot have made."""
        if len(data) < _HEAD.size:
            raise FrameError(f"a telegram of {len(data)} bytes; expected {_HEAD.size} or more")
        version, kind, robot, iteration, count, pieces = _HEAD.unpack_from(data)
        if version != VERSION:
            raise FrameError(f"a telegram of version {version}; expected {VERSION}")
        if kind > END or iteration > LATEST:
            raise FrameError(f"a telegram of kind {kind} and iteration {iteration}")
        at, arrays, found = _HEAD.size, list[Column](), list[bytes]()
        for _ in range(count):
            array, at = _array(data, at)
            arrays.append(array)
        for _ in range(pieces):
            length = int(_number(data, at, _LENGTH))
            at += _LENGTH.size + length
            if at > len(data):
                raise FrameError(f"a telegram of {len(data)} bytes with pieces up to {at}")
            found.append(data[at - length : at])
        if at != len(data):
            raise FrameError(f"a telegram of {len(data)} bytes that ends at {at}")
        return cls(kind, robot, iteration, tuple(arrays), tuple(found))


def _packed(array: Column) -> bytes:
    array = np.asarray(array)
    kind = _TYPES.index(array.dtype)
    sides = b"".join(_SIDE.pack(side) for side in array.shape)
    return bytes((kind, array.ndim)) + sides + array.astype(array.dtype.newbyteorder(">")).tobytes()


def _number(data: bytes, at: int, form: struct.Struct) -> int:
    if at + form.size > len(data):
        raise FrameError(f"a telegram that ends within a number, at {len(data)}")
    (found,) = form.unpack_from(data, at)
    return int(found)


def _array(data: bytes, at: int) -> tuple[Column, int]:
    """An array, and where it ends."""
    if at + 2 > len(data) or data[at] >= len(_TYPES) or data[at + 1] > _MOST_SIDES:
        raise FrameError(f"a telegram without the array that should begin at {at}")
    kind, sides = _TYPES[data[at]], data[at + 1]
    shape = [_number(data, at + 2 + side * _SIDE.size, _SIDE) for side in range(sides)]
    begins, size = at + 2 + sides * _SIDE.size, math.prod(shape) * kind.itemsize
    if size > len(data) - begins or max(shape, default=0) > LATEST:
        raise FrameError(f"an array of shape {tuple(shape)} in {len(data) - begins} bytes")
    if kind.kind == "b" and max(data[begins : begins + size], default=0) > 1:
        raise FrameError("a truth value that is neither 0 nor 1")
    held = np.frombuffer(data, kind.newbyteorder(">"), math.prod(shape), begins).reshape(shape)
    return held.astype(kind), begins + size


def _check(array: Column, kind: str, shape: tuple[int, ...], what: str) -> Column:
    if array.dtype != np.dtype(kind) or array.shape != shape:
        raise FrameError(f"{what}: {array.dtype} of shape {array.shape}; expected {np.dtype(kind)} of {shape}")
    return array


def row_of(intents: Intents, row: int, actuators: Channels) -> Arrays:
    """One robot's intents as arrays."""
    way, count = intents.waypoints[row], int(intents.counts[row])
    used = max(count, int(np.flatnonzero(way.any(axis=1)).max(initial=-1)) + 1)
    twists = np.empty(0) if intents.twists is None else intents.twists[row]
    numbers = np.array([count, len(way), intents.planned[row]], np.int32)
    commands = [intents.commands[one.name][row] if one.name in intents.commands else _ABSENT for one in actuators]
    return intents.goals[row], way[:used], numbers, twists, *map(np.asarray, commands)


def intents_of(arrays: Arrays, actuators: Channels) -> Intents:
    """The intents of one row that `row_of` gave. Raises FrameError."""
    if len(arrays) != 4 + len(actuators):
        raise FrameError(f"a decision of {len(arrays)} arrays; expected {4 + len(actuators)}")
    goal, way, numbers, twist, *commands = arrays
    count, width, planned = _check(numbers, "i4", (3,), "counts").tolist()
    if way.ndim != 2 or not 0 <= count <= len(way) <= width <= LONGEST or planned not in (0, 1):
        raise FrameError(f"a way of shape {way.shape}, of which {count} points of {width} are used")
    _check(goal, "f8", (2,), "goal")
    _check(way, "f8", (len(way), 2), "way")
    if len(twist) not in (0, 2, 3):
        raise FrameError(f"a velocity of shape {twist.shape}")
    waypoints = np.zeros((1, width, 2))
    waypoints[0, : len(way)] = way
    given = {
        one.name: _check(column, one.dtype, one.shape, one.name)[None]
        for one, column in zip(actuators, commands, strict=True)
        if column.shape != _ABSENT.shape
    }
    twists = _check(twist, "f8", (len(twist),), "velocity")[None] if len(twist) else None
    return Intents(goal[None], waypoints, np.array([count], np.int32), np.array([planned == 1]), twists, given)


def sensed_telegram(robot: int, sensed: Sensed, actuators: Channels) -> Telegram:
    """What a robot senses."""
    flags = np.array([sensed.alive, sensed.forget, sensed.decided is not None])
    decided = () if sensed.decided is None else row_of(sensed.decided, 0, actuators)
    faults = np.array(sensed.faults, np.int32)
    arrays = (flags, faults, sensed.pose, sensed.velocity, *map(np.asarray, sensed.readings), *decided)
    return Telegram(SENSED, robot, sensed.iteration, arrays)


def sensed_of(telegram: Telegram, channels: Channels, actuators: Channels) -> Sensed:
    """What a robot senses, with these channels. Raises FrameError."""
    sides = 4 + len(channels)
    if len(telegram.arrays) < sides:
        raise FrameError(f"readings of {len(telegram.arrays)} arrays; expected {sides}")
    flags, faults, pose, velocity, *columns = telegram.arrays
    alive, forget, has_decided = _check(flags, "?", (3,), "flags").tolist()
    readings = tuple(
        _check(column, one.dtype, one.shape, one.name)
        for one, column in zip(channels, columns[: len(channels)], strict=True)
    )
    decided = intents_of(telegram.arrays[sides:], actuators) if has_decided else None
    return Sensed(
        telegram.iteration, alive, _check(pose, "f8", (3,), "pose"), _check(velocity, "f8", (3,), "velocity"),
        readings, decided, forget, tuple(_check(faults, "i4", (faults.size,), "faults").tolist()),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Ears:
    """Which frames reach a robot in an iteration."""

    iteration: int
    awake: bool  # whether it takes anything in
    oldest: int  # no frame still under way was sent before this iteration
    letters: NDArray[np.int32]  # (m, 2): sender, iteration sent; sorted
    frames: tuple[bytes, ...] = ()  # of the letters, one by one: empty for those heard on the air as they are

    def telegram(self, robot: int) -> Telegram:
        """For a robot."""
        numbers = np.array([self.awake, self.oldest], np.int64)
        frames = self.frames if any(self.frames) else ()
        return Telegram(EARS, robot, self.iteration, (numbers, self.letters), frames)

    @classmethod
    def of(cls, telegram: Telegram) -> Ears:
        """What `telegram` made. Raises FrameError."""
        if len(telegram.arrays) != 2:
            raise FrameError("ears without their letters")
        awake, oldest = _check(telegram.arrays[0], "i8", (2,), "ears").tolist()
        letters = telegram.arrays[1]
        _check(letters, "i4", (len(letters), 2), "letters")
        if telegram.pieces and len(telegram.pieces) != len(letters):
            raise FrameError(f"{len(telegram.pieces)} frames of {len(letters)} letters")
        return cls(telegram.iteration, bool(awake), oldest, letters, telegram.pieces or (b"",) * len(letters))


def deed_telegram(robot: int, deed: Deed, actuators: Channels) -> Telegram:
    """What a robot decides and has learned."""
    decided = row_of(deed.intents, 0, actuators)
    return Telegram(DEED, robot, deed.iteration, (deed.heard, *decided, *deed.report))


def deed_of(telegram: Telegram, actuators: Channels) -> Deed:
    """What `deed_telegram` made; the report is checked when it is adopted. Raises FrameError."""
    count = 5 + len(actuators)
    if len(telegram.arrays) < count:
        raise FrameError(f"a deed of {len(telegram.arrays)} arrays; expected {count} or more")
    heard, report = telegram.arrays[0], telegram.arrays[count:]
    _check(heard, "i4", (len(heard) if heard.ndim else 0, 2), "letters heard")
    return Deed(telegram.iteration, intents_of(telegram.arrays[1:count], actuators), report, heard)


def frames_in(telegram: Telegram) -> Sequence[bytes]:
    """The frames that a robot has said: one or none. Raises FrameError."""
    if len(telegram.pieces) > 1:
        raise FrameError(f"{len(telegram.pieces)} frames at once; expected one at most")
    return telegram.pieces
