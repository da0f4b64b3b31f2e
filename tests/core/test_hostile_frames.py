"""What robots hear may come from anybody: whatever is not a message that a robot can have packed is refused, unread."""

from __future__ import annotations

import struct
import tracemalloc
from contextlib import suppress
from dataclasses import dataclass
from random import Random

import numpy as np
import pytest
from conftest import made

from swarmsim.core.bundle import whole
from swarmsim.core.messages import LATEST, FrameError, MessageBatch, PlainCodec, check_length, header_of
from swarmsim.core.scenario import registry
from swarmsim.operations.mapping.sharing.codecs import MAP, MapCodec

MINDS = [
    *(("exploring", f'mind.computation.sharing={{use="{policy}"}}') for policy in registry.known("sharing")),
    ("exploring", 'mind.computation.sharing={use="gossip", goals=true}'),
    ("operations/turn", "seed=1"),
    ("operations/average-consensus", "seed=1"),
    ("operations/field", "seed=1"),
    ("operations/wandering", "seed=1"),
    ("operations/formation", "seed=1"),
    ("operations/pursuit", "seed=1"),
    ("computing/heat", "robots.count=4"),
    ("computing/stigmergy", "robots.count=4"),
    ("computing/buoys", "robots.count=3"),
]
MUTANTS = 1500  # of each kind of message
ROOM = 2_000_000  # bytes that one frame may take while it is read, grids of the largest scenario here included


def frames_of(scenario: str, key: str) -> tuple[object, list[bytes]]:
    """The codec of a scenario's robots, and messages of its first iterations."""
    run = made(key, scenario=scenario)
    computation, frames = run.simulation.parts.computation, list[bytes]()
    say = computation.say

    def saying(senses):
        said = say(senses)
        frames.extend(
            computation.codec.pack(robot, senses.iteration, whole(said, robot))
            for robot in np.flatnonzero(said.sizes).tolist()
        )
        return said

    computation.say = saying
    for _ in range(6):
        run.simulation.tick()
    return computation.codec, frames


def mutant(frame: bytes, other: bytes, dice: Random) -> bytes:
    """A frame with some bytes changed, cut off, added, or taken from another frame."""
    changed = bytearray(frame)
    match dice.randrange(6):
        case 0:
            return frame[: dice.randrange(len(frame))]
        case 1:
            return frame + dice.randbytes(dice.randrange(1, 40))
        case 2:
            return dice.randbytes(dice.randrange(60))
        case 3:
            cut = dice.randrange(len(frame))
            return frame[:cut] + other[cut:]
        case 4:
            at = dice.randrange(len(frame))
            changed[at : at + 4] = dice.choice([b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x80\x00\x00\x00"])
            return bytes(changed)
    for _ in range(dice.randrange(1, 4)):
        changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
    return bytes(changed)


@pytest.mark.parametrize(("scenario", "key"), MINDS)
def test_a_changed_message_is_refused_or_is_one_that_a_robot_could_have_said(scenario: str, key: str) -> None:
    codec, frames = frames_of(scenario, key)
    dice, refused = Random(1), 0
    assert frames
    for frame in frames:
        sender, iteration, items = codec.unpack(frame)
        assert codec.pack(sender, iteration, items) == frame
    for _ in range(MUTANTS):
        data = mutant(dice.choice(frames), dice.choice(frames), dice)
        try:
            sender, iteration, items = codec.unpack(data)
        except FrameError:
            refused += 1
            continue
        assert 0 <= iteration <= LATEST
        assert same(codec.pack(sender, iteration, items), items, data, codec)
        assert all(len(column) < 100_000 for column in items.arrays())
    assert refused > MUTANTS // 4


def same(packed: bytes, items: MessageBatch, data: bytes, codec) -> bool:
    """Whether they are equal, but for the payload of NaN, which numpy changes where it converts a number."""
    if packed == data:
        return True
    again = codec.unpack(packed)[2].arrays()
    columns = [one for one in items.arrays() if one.dtype.kind == "f"]
    return any(np.isnan(one).any() for one in columns) and all(
        np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(items.arrays(), again, strict=True)
    )


@pytest.mark.parametrize(("scenario", "key"), MINDS)
def test_no_frame_takes_memory_for_what_it_claims(scenario: str, key: str) -> None:
    codec, frames = frames_of(scenario, key)
    dice = Random(2)
    tracemalloc.start()
    try:
        for _ in range(200):
            data = mutant(dice.choice(frames), dice.choice(frames), dice)
            before = tracemalloc.get_traced_memory()[0]
            tracemalloc.reset_peak()
            with suppress(FrameError):
                codec.unpack(data)
            assert tracemalloc.get_traced_memory()[1] - before < ROOM
    finally:
        tracemalloc.stop()


def test_a_map_of_fourteen_bytes_asks_for_no_gigabytes() -> None:
    codec = MapCodec((6, 7), (40, 40))
    tracemalloc.start()
    try:
        with pytest.raises(FrameError, match=r"60000 x 60000 cells from \(0, 0\) on; expected them within 40 x 40"):
            codec.unpack(MAP.pack(1, 2, 0, 0, 60_000, 60_000))
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()
    with pytest.raises(FrameError, match="smallest rectangle of known cells"):
        codec.unpack(MAP.pack(1, 2, 0, 0, 2, 2) + b"\x05")  # an empty row first
    with pytest.raises(FrameError, match="a cell of value 3"):
        codec.unpack(MAP.pack(1, 2, 0, 0, 2, 2) + b"\xff")


def test_headers_and_lengths_are_checked_in_words() -> None:
    with pytest.raises(FrameError, match="5 bytes; expected a header of 6 and what follows"):
        header_of(bytes(5))
    with pytest.raises(FrameError, match="iteration 2147483648; expected 2147483647 at most"):
        header_of(struct.pack(">HI", 1, 1 << 31))
    with pytest.raises(FrameError, match="3 bytes; expected 4 to 9"):
        check_length(bytes(3), 4, 9)


@dataclass(frozen=True, slots=True, eq=False)
class Flag(MessageBatch):
    up: np.ndarray


def test_a_truth_value_is_zero_or_one() -> None:
    codec = PlainCodec(Flag(np.zeros(0, np.bool_)))
    assert codec.unpack(codec.pack(3, 4, Flag(np.ones(1, np.bool_))))[2].up.tolist() == [True]
    with pytest.raises(FrameError, match="a truth value that is neither 0 nor 1"):
        codec.unpack(struct.pack(">HIB", 3, 4, 2))
