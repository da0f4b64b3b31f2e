"""Telegrams come back as they went, and whatever is none is refused before its memory is taken."""

from __future__ import annotations

import struct
import tracemalloc
from contextlib import suppress
from random import Random

import numpy as np
import pytest
from conftest import ROOT
from fleet.crews import fleet_of

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.robot import Robot
from swarmsim.fleet import wire
from swarmsim.fleet.wire import DEED, EARS, SENSED, Ears, Telegram
from swarmsim.testing.apart import BytesCrew, Diary

MUTANTS = 4000


@pytest.fixture(scope="module")
def diary() -> Diary:
    """The diary of one of the exploring robots."""
    fleet = fleet_of(ROOT / "scenarios" / "exploring.toml", iterations=8)
    crew = BytesCrew(fleet)
    fleet.run.simulation.run()
    return crew.diaries[5]


@pytest.fixture(scope="module")
def robot(diary: Diary) -> Robot:
    return Robot.of(Charge.read(diary.charge, "charge"))


def test_a_telegram_comes_back_as_it_went() -> None:
    arrays = (np.arange(6, dtype=np.float32).reshape(2, 3), np.array(True), np.empty((0, 4), np.int32), np.uint8([7]))
    back = Telegram.read(Telegram(DEED, 65_535, 2**31 - 1, arrays, (b"", b"abc")).packed())
    assert (back.kind, back.robot, back.iteration, back.pieces) == (DEED, 65_535, 2**31 - 1, (b"", b"abc"))
    for one, other in zip(arrays, back.arrays, strict=True):
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())


def test_changed_telegrams_are_refused_or_read_without_harm(diary: Diary, robot: Robot) -> None:
    dice, refused = Random(1), 0
    channels, actuators = robot.context.channels, robot.context.actuators
    whole = [*diary.sensed, *diary.ears, *diary.deeds]
    tracemalloc.start()
    try:
        for _ in range(MUTANTS):
            changed = bytearray(dice.choice(whole))
            match dice.randrange(4):
                case 0:
                    del changed[dice.randrange(len(changed)) :]
                case 1:
                    changed += dice.randbytes(dice.randrange(1, 30))
                case 2:
                    changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
                case 3:
                    at = dice.randrange(len(changed))
                    changed[at : at + 4] = b"\xff\xff\xff\xff"
            before = tracemalloc.get_traced_memory()[0]
            tracemalloc.reset_peak()
            try:
                telegram = Telegram.read(bytes(changed))
                assert telegram.packed() == bytes(changed)
                if telegram.kind == SENSED:
                    wire.sensed_of(telegram, channels, actuators)
                elif telegram.kind == EARS:
                    Ears.of(telegram)
                elif telegram.kind == DEED:
                    wire.deed_of(telegram, actuators)
            except FrameError:
                refused += 1
            assert tracemalloc.get_traced_memory()[1] - before < 2_000_000
    finally:
        tracemalloc.stop()
    assert refused > MUTANTS // 3


def test_claims_of_gigabytes_take_no_memory() -> None:
    head = struct.pack(">BBHIHH", 1, DEED, 0, 0, 1, 0)
    tracemalloc.start()
    try:
        with pytest.raises(FrameError, match="an array of shape"):
            Telegram.read(head + bytes((10, 2)) + struct.pack(">II", 60_000, 60_000))
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "a telegram of 0 bytes; expected 12 or more"),
        (struct.pack(">BBHIHH", 9, DEED, 0, 0, 0, 0), "a telegram of version 9; expected 1"),
        (struct.pack(">BBHIHH", 1, 77, 0, 0, 0, 0), "a telegram of kind 77 and iteration 0"),
        (struct.pack(">BBHIHH", 1, DEED, 0, 0, 0, 1) + b"\0\0\0\x09a", "with pieces up to 25"),
        (struct.pack(">BBHIHH", 1, DEED, 0, 0, 1, 0) + b"\0\1\0\0\0\1\2", "a truth value that is neither 0 nor 1"),
    ],
)
def test_what_is_no_telegram_is_refused_in_words(data: bytes, told: str) -> None:
    with pytest.raises(FrameError, match=told):
        Telegram.read(data)


def test_readings_and_decisions_have_the_form_that_the_charge_says(diary: Diary, robot: Robot) -> None:
    channels, actuators = robot.context.channels, robot.context.actuators
    sensed = Telegram.read(diary.sensed[1])
    with pytest.raises(FrameError, match=r"tiles.values: uint8 of shape \(2, 7\); expected uint8 of \(6, 7\)"):
        wire.sensed_of(Telegram(SENSED, 0, 1, (*sensed.arrays[:4], np.zeros((2, 7), np.uint8), *sensed.arrays[5:])),
                       channels, actuators)  # fmt: skip
    deed = Telegram.read(diary.deeds[1])
    numbers = np.array([3, 0, 0], np.int32)
    with pytest.raises(FrameError, match="of which 3 points of 0 are used"):
        wire.deed_of(Telegram(DEED, 0, 1, (*deed.arrays[:3], numbers, *deed.arrays[4:])), actuators)
    with pytest.raises(FrameError, match="a deed of 2 arrays; expected 5"):
        wire.deed_of(Telegram(DEED, 0, 1, deed.arrays[:2]), actuators)


def test_a_robot_reads_frames_of_others_alone(diary: Diary, robot: Robot) -> None:
    frame = next(frame for frames in diary.heard for frame in frames)
    assert robot.read(frame).sender != robot.number
    for sender in (robot.number, 12, 65_535):
        with pytest.raises(FrameError, match=f"a frame of robot {sender}; expected another one of 12"):
            robot.read(struct.pack(">H", sender) + frame[2:])


def test_hostile_frames_do_a_robot_no_harm(diary: Diary) -> None:
    robot, dice = Robot.of(Charge.read(diary.charge, "charge")), Random(3)
    channels, actuators = robot.context.channels, robot.context.actuators
    frames = [frame for frames in diary.heard for frame in frames]
    for sensed in diary.sensed:
        robot.sense(wire.sensed_of(Telegram.read(sensed), channels, actuators))
        letters = []
        for _ in range(200):
            changed = bytearray(dice.choice(frames))
            for _ in range(dice.randrange(1, 5)):
                changed[dice.randrange(len(changed))] = dice.randrange(256)
            with suppress(FrameError):
                letters.append(robot.read(bytes(changed)))
        assert letters
        robot.hear(letters)


def test_a_charge_that_is_none_is_refused_in_words(diary: Diary) -> None:
    with pytest.raises(InputError, match="charge: is no charge of a robot"):
        Charge.read(b"\xc1 nothing", "charge")
    with pytest.raises(InputError, match="charge: version: 2; expected 1, which `swarmsim robot charge` writes"):
        Charge.read(diary.charge.replace(b"version\x01", b"version\x02"), "charge")
    with pytest.raises(InputError, match="charge: robot: 99, and 12 starts; the swarm has 12"):
        Charge.read(diary.charge.replace(b"robot\x05", b"robot\x63"), "charge")
    with pytest.raises(InputError, match="charge: mine: unknown key; did you mean 'mind'"):
        Charge.read(diary.charge.replace(b"\xa4mind", b"\xa4mine"), "charge")
