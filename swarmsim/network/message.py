"""What a message looks like on the air, byte by byte; its length is what radios are charged for."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Sender (2 bytes), iteration (4) and the tile's origin as row and column (2 each, signed), big-endian.
HEADER: Final = struct.Struct(">HIhh")


def current_tile_bytes(rows: int, columns: int) -> int:
    """The size of a message with a robot's own tile: the HEADER, then 2 bits for each cell, filled up to a byte."""
    return HEADER.size + packed_bytes(rows * columns)


def packed_bytes(cells: int) -> int:
    """How many bytes hold so many cells of 2 bits each."""
    return -(-2 * cells // 8)


def pack_cells(values: NDArray[np.uint8]) -> bytes:
    """Cells of any shape, each UNKNOWN, FREE or OCCUPIED, as 2 bits in row-major order, the first in the high bits."""
    flat = values.reshape(-1)
    bits = np.stack([flat >> 1, flat & 1], axis=1)
    return np.packbits(bits.reshape(-1)).tobytes()


def unpack_cells(data: bytes, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """The cells that `pack_cells` packed."""
    count = int(np.prod(shape))
    bits = np.unpackbits(np.frombuffer(data, np.uint8), count=2 * count).reshape(-1, 2)
    return np.asarray((bits[:, 0] << 1) | bits[:, 1], np.uint8).reshape(shape)


def pack(sender: int, iteration: int, origin: NDArray[np.int32], tile: NDArray[np.uint8]) -> bytes:
    """One robot's current tile (rows, columns) as it goes on the air."""
    return HEADER.pack(sender, iteration, int(origin[0]), int(origin[1])) + pack_cells(tile)


def unpack(data: bytes, shape: tuple[int, int]) -> tuple[int, int, NDArray[np.int32], NDArray[np.uint8]]:
    """The sender, iteration, origin (2,) and tile of `shape` that `pack` packed."""
    sender, iteration, row, column = HEADER.unpack_from(data)
    return sender, iteration, np.array([row, column], np.int32), unpack_cells(data[HEADER.size :], shape)
