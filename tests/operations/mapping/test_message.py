from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmsim.operations.mapping.sharing import codecs
from swarmsim.operations.mapping.sharing.codecs import RelayedTile

checked = settings(max_examples=150, deadline=None, derandomize=True)
shapes = st.tuples(st.integers(1, 9), st.integers(1, 9))
ids = st.integers(0, 2**16 - 1)
iterations = st.integers(0, 2**31 - 1)
places = st.tuples(st.integers(-(2**15), 2**15 - 1), st.integers(-(2**15), 2**15 - 1))


def cells(shape: tuple[int, int]) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.uint8, shape, elements=st.integers(0, 2))


@checked
@given(st.data(), shapes, ids, iterations, places)
def test_a_current_tile_comes_back_as_it_was_packed(data, shape, sender, iteration, place) -> None:
    tile = data.draw(cells(shape))
    packed = codecs.pack(sender, iteration, np.array(place, np.int32), tile)
    assert len(packed) == codecs.current_tile_bytes(*shape)
    sender_, iteration_, origin, tile_ = codecs.unpack(packed, shape)
    assert (sender_, iteration_, tuple(origin)) == (sender, iteration, place)
    np.testing.assert_array_equal(tile_, tile)


@checked
@given(st.data(), shapes, ids, iterations, places, st.integers(0, 5))
def test_relayed_readings_come_back_as_they_were_packed(data, shape, sender, iteration, place, count) -> None:
    readings = [
        RelayedTile(
            data.draw(ids),
            data.draw(iterations),
            data.draw(st.integers(1, 255)),
            np.array(data.draw(places), np.int32),
            data.draw(cells(shape)),
        )
        for _ in range(count)
    ]
    tile = data.draw(cells(shape))
    packed = codecs.pack_relay(sender, iteration, np.array(place, np.int32), tile, readings)
    assert len(packed) == codecs.current_tile_bytes(*shape) + count * codecs.relayed_tile_bytes(*shape)
    sender_, iteration_, origin, tile_, back = codecs.unpack_relay(packed, shape)
    assert (sender_, iteration_, tuple(origin)) == (sender, iteration, place)
    np.testing.assert_array_equal(tile_, tile)
    assert len(back) == count
    for ours, theirs in zip(readings, back, strict=True):
        assert (ours.source, ours.sensed, ours.hops) == (theirs.source, theirs.sensed, theirs.hops)
        np.testing.assert_array_equal(ours.origin, theirs.origin)
        np.testing.assert_array_equal(ours.tile, theirs.tile)


@checked
@given(st.data(), st.tuples(st.integers(1, 20), st.integers(1, 20)), ids, iterations)
def test_a_map_comes_back_as_it_was_packed(data, shape, sender, iteration) -> None:
    known = np.zeros(shape, np.uint8)
    rows, columns = (sorted(data.draw(st.tuples(st.integers(0, n), st.integers(0, n)))) for n in shape)
    part = known[rows[0] : rows[1], columns[0] : columns[1]]
    part[:] = data.draw(cells(part.shape))
    packed = codecs.pack_map(sender, iteration, known)
    sender_, iteration_, back = codecs.unpack_map(packed, shape)
    assert (sender_, iteration_) == (sender, iteration)
    np.testing.assert_array_equal(back, known)
    found = np.argwhere(known)
    box = np.prod(np.ptp(found, axis=0) + 1) if len(found) else 0
    assert len(packed) == codecs.map_bytes(np.array([box], np.int32))[0]


def test_messages_are_as_long_as_the_documentation_says() -> None:
    assert codecs.current_tile_bytes(6, 7) == 21
    assert codecs.relayed_tile_bytes(6, 7) == 22
    assert codecs.map_bytes(np.array([0, 1, 85 * 140], np.int32)).tolist() == [14, 15, 14 + 2975]
    assert len(codecs.pack_map(3, 9, np.ones((85, 140), np.uint8))) == 2989


def test_a_message_has_the_bytes_that_its_format_says() -> None:
    tile = np.array([[0, 1, 2], [2, 1, 0]], np.uint8)
    packed = codecs.pack(0x0102, 0x03040506, np.array([-1, 7]), tile)
    assert packed.hex() == "0102" + "03040506" + "ffff" + "0007" + "1a" + "40"
    mapped = np.zeros((4, 5), np.uint8)
    mapped[1:3, 2:5] = tile
    # The corners of the tile are unknown, but its first and last rows and columns are not all so.
    assert codecs.pack_map(1, 2, mapped).hex() == "0001" + "00000002" + "0001" + "0002" + "0002" + "0003" + "1a" + "40"
