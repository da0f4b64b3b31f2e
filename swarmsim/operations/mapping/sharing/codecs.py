"""The contents of mapping robots' messages, and their form on the air, byte by byte."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import LATEST, FrameError, check_length, header_of
from swarmsim.core.state import OCCUPIED, UNKNOWN
from swarmsim.operations.mapping.maps import PlainTiles, TileItems

#: Sender (2 bytes), iteration (4) and the tile's origin as row and column (2 each, signed), big-endian.
HEADER: Final = struct.Struct(">HIhh")

#: Before each relayed tile: the robot that sensed it (2 bytes), when (4), its origin (2 each, signed) and the number of
#: links over which it came to the sender (1), big-endian.
RELAYED: Final = struct.Struct(">HIhhB")

#: Before a map: sender (2 bytes), iteration (4), then the first row and column (2 each, signed) and the numbers of rows
#: and columns (2 each) of the smallest rectangle with all known cells, big-endian.
MAP: Final = struct.Struct(">HIhhHH")

#: After a tile: the row and column of the cell that its sender goes to explore (2 bytes each, signed; -1 for none) and
#: how many cells of its way are left (2), big-endian.
GOAL: Final = struct.Struct(">hhH")


@dataclass(frozen=True, slots=True, eq=False)
class RelayedItems(TileItems):
    """Tiles that come over several links."""

    PROVENANCE: ClassVar[tuple[str, ...]] = ("sources", "sensed", "hops")

    hops: NDArray[np.uint8]  # (t,): links between the robot that sensed it and the one that tells it now


@dataclass(frozen=True, slots=True, eq=False)
class GoalItems(TileItems):
    """Tiles with their senders' goals."""

    goals: NDArray[np.int32]  # (t, 2): row and column of the cell that the sender goes to explore; -1, -1 for none
    left: NDArray[np.int32]  # (t,): cells left of its way there

    @classmethod
    def of(cls, tiles: TileItems, goals: NDArray[np.int32], left: NDArray[np.int32]) -> GoalItems:
        """The same tiles, with goals and ways."""
        return cls(tiles.values, tiles.origins, tiles.sources, tiles.sensed, goals, left)


@dataclass(frozen=True, slots=True)
class RelayedTile:
    """A tile on its way through the network."""

    source: int  # the robot that sensed it
    sensed: int  # the iteration in which it did
    hops: int  # links between that robot and the one that tells it now
    origin: NDArray[np.int32]  # (2,): row and column of its lower-left cell
    tile: NDArray[np.uint8]  # (rows, columns)


def current_tile_bytes(rows: int, columns: int) -> int:
    """The size of a message with a robot's own tile: the HEADER, then 2 bits for each cell, filled up to a byte."""
    return HEADER.size + packed_bytes(rows * columns)


def relayed_tile_bytes(rows: int, columns: int) -> int:
    """The bytes that each relayed tile adds to a message: RELAYED and the cells."""
    return RELAYED.size + packed_bytes(rows * columns)


def map_bytes(cells: NDArray[np.int32]) -> NDArray[np.int32]:
    """The sizes (n,) of messages with a map each, given the `cells` of the rectangle around its known ones."""
    return np.asarray(MAP.size - (-2 * cells // 8), np.int32)


def packed_bytes(cells: int) -> int:
    """How many bytes hold `cells` cells of 2 bits each."""
    return -(-2 * cells // 8)


def pack_cells(values: NDArray[np.uint8]) -> bytes:
    """Cells of any shape, each UNKNOWN, FREE or OCCUPIED, as 2 bits in row-major order, the first in the high bits."""
    flat = values.reshape(-1)
    bits = np.stack([flat >> 1, flat & 1], axis=1)
    return np.packbits(bits.reshape(-1)).tobytes()


def unpack_cells(data: bytes, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """The cells that `pack_cells` packed. Raises FrameError."""
    count = math.prod(shape)
    check_length(data, packed_bytes(count))
    bits = np.unpackbits(np.frombuffer(data, np.uint8)).reshape(-1, 2)
    cells = np.asarray((bits[:, 0] << 1) | bits[:, 1], np.uint8)
    if cells.max(initial=0) > OCCUPIED or cells[count:].any():
        raise FrameError(f"a cell of value {cells.max(initial=0)}, or one after the last")
    return cells[:count].reshape(shape)


def pack(sender: int, iteration: int, origin: NDArray[np.int32], tile: NDArray[np.uint8]) -> bytes:
    """One robot's current tile (rows, columns) as it goes on the air."""
    return HEADER.pack(sender, iteration, int(origin[0]), int(origin[1])) + pack_cells(tile)


def unpack(data: bytes, shape: tuple[int, int]) -> tuple[int, int, NDArray[np.int32], NDArray[np.uint8]]:
    """The sender, iteration, origin (2,) and tile of `shape` that `pack` packed. Raises FrameError."""
    check_length(data, current_tile_bytes(*shape))
    numbers: tuple[int, ...] = HEADER.unpack_from(data)
    _, _, row, column = numbers
    return *header_of(data), np.array([row, column], np.int32), unpack_cells(data[HEADER.size :], shape)


def pack_goal(goal: NDArray[np.int32], left: np.int32) -> bytes:
    """A robot's goal (2,) and the cells left of its way there."""
    return GOAL.pack(int(goal[0]), int(goal[1]), int(left))


def unpack_goal(data: bytes, start: int) -> tuple[NDArray[np.int32], int]:
    """The goal (2,) and the cells left that `pack_goal` packed, from this byte on. Raises FrameError."""
    check_length(data, start + GOAL.size, len(data))
    row, column, left = GOAL.unpack_from(data, start)
    return np.array([row, column], np.int32), left


def pack_relay(
    sender: int, iteration: int, origin: NDArray[np.int32], tile: NDArray[np.uint8], relayed: Sequence[RelayedTile]
) -> bytes:
    """One robot's current tile (rows, columns), then the readings of others that it relays, tiles of the same shape."""
    pieces = [pack(sender, iteration, origin, tile)]
    for reading in relayed:
        row, column = (int(index) for index in reading.origin)
        pieces.append(RELAYED.pack(reading.source, reading.sensed, row, column, reading.hops))
        pieces.append(pack_cells(reading.tile))
    return b"".join(pieces)


def unpack_relay(
    data: bytes, shape: tuple[int, int]
) -> tuple[int, int, NDArray[np.int32], NDArray[np.uint8], list[RelayedTile]]:
    """The sender, iteration, origin (2,), tile of `shape` and relayed readings that `pack_relay` packed.

    Raises FrameError.
    """
    own = current_tile_bytes(*shape)
    rest = (len(data) - own) % relayed_tile_bytes(*shape)
    check_length(data, max(own, len(data) - rest))
    relayed = []
    for start in range(own, len(data), relayed_tile_bytes(*shape)):
        numbers: tuple[int, ...] = RELAYED.unpack_from(data, start)
        source, sensed, row, column, hops = numbers
        if sensed > LATEST:
            raise FrameError(f"a tile of iteration {sensed}; expected {LATEST} at most")
        tile = unpack_cells(data[start + RELAYED.size : start + relayed_tile_bytes(*shape)], shape)
        relayed.append(RelayedTile(source, sensed, hops, np.array([row, column], np.int32), tile))
    return *unpack(data[:own], shape), relayed


def pack_map(sender: int, iteration: int, cells: NDArray[np.uint8]) -> bytes:
    """The known cells of one robot's map (rows, columns), each UNKNOWN, FREE or OCCUPIED."""
    rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    if len(rows) == 0:
        return MAP.pack(sender, iteration, 0, 0, 0, 0)
    part = cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return MAP.pack(sender, iteration, int(rows[0]), int(columns[0]), *part.shape) + pack_cells(part)


def unpack_map(data: bytes, shape: tuple[int, int]) -> tuple[int, int, NDArray[np.uint8]]:
    """The sender, iteration and map of `shape` that `pack_map` packed. Raises FrameError."""
    check_length(data, MAP.size, MAP.size + packed_bytes(shape[0] * shape[1]))
    numbers: tuple[int, ...] = MAP.unpack_from(data)
    _, _, row, column, rows, columns = numbers
    place = f"{rows} x {columns} cells from ({row}, {column}) on"
    if min(row, column) < 0 or row + rows > shape[0] or column + columns > shape[1]:
        raise FrameError(f"{place}; expected them within {shape[0]} x {shape[1]}")
    cells = np.full(shape, UNKNOWN, np.uint8)
    part = cells[row : row + rows, column : column + columns]
    part[:] = unpack_cells(data[MAP.size :], (rows, columns))
    if not all(edge.any() for edge in (part[:1], part[-1:], part[:, :1], part[:, -1:])) and any(numbers[2:]):
        raise FrameError(f"{place} with nothing at an edge; expected the smallest rectangle of known cells")
    return *header_of(data), cells


class TileCodec:
    """One robot's current tile per message."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape, self.longest = shape, current_tile_bytes(*shape)

    def pack(self, sender: int, iteration: int, items: TileItems) -> bytes:
        """The message with its one tile."""
        return pack(sender, iteration, items.origins[0], items.values[0])

    def unpack(self, data: bytes) -> tuple[int, int, TileItems]:
        """Its sender, iteration and tile."""
        sender, iteration, origin, tile = unpack(data, self._shape)
        return sender, iteration, PlainTiles(tile[None], origin[None], _ints(sender), _ints(iteration))


class GoalCodec:
    """One robot's current tile and goal per message."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._tile = TileCodec(shape)
        self.longest = self._tile.longest + GOAL.size

    def pack(self, sender: int, iteration: int, items: GoalItems) -> bytes:
        """The message with its one tile and goal."""
        return self._tile.pack(sender, iteration, items) + pack_goal(items.goals[0], items.left[0])

    def unpack(self, data: bytes) -> tuple[int, int, GoalItems]:
        """Its sender, iteration, tile and goal."""
        sender, iteration, items = self._tile.unpack(data[: max(0, len(data) - GOAL.size)])
        goal, left = unpack_goal(data, len(data) - GOAL.size)
        return sender, iteration, GoalItems.of(items, goal[None], _ints(left))


class RelayCodec:
    """One robot's current tile, then those that it relays."""

    def __init__(self, shape: tuple[int, int], most: int) -> None:
        """For tiles of this shape. A robot relays at most `most` of them; `longest` is right if no message is late."""
        self._shape = shape
        self.longest = current_tile_bytes(*shape) + most * relayed_tile_bytes(*shape)

    def pack(self, sender: int, iteration: int, items: RelayedItems) -> bytes:
        """The message; its first item is the sender's own."""
        columns = zip(items.sources, items.sensed, items.hops, items.origins, items.values, strict=True)
        readings = [RelayedTile(int(source), int(sensed), int(hops), o, v) for source, sensed, hops, o, v in columns]
        return pack_relay(sender, iteration, items.origins[0], items.values[0], readings[1:])

    def unpack(self, data: bytes) -> tuple[int, int, RelayedItems]:
        """Its sender, iteration and tiles."""
        sender, iteration, origin, tile, relayed = unpack_relay(data, self._shape)
        readings = [RelayedTile(sender, iteration, 0, origin, tile), *relayed]
        items = RelayedItems(
            np.array([one.tile for one in readings], np.uint8),
            np.array([one.origin for one in readings], np.int32),
            np.array([one.source for one in readings], np.int32),
            np.array([one.sensed for one in readings], np.int32),
            np.array([one.hops for one in readings], np.uint8),
        )
        return sender, iteration, items


class MapCodec:
    """The known cells of one robot's map, cut into tiles of one shape."""

    def __init__(self, shape: tuple[int, int], grid: tuple[int, int]) -> None:
        """`shape` of the tiles and of the whole `grid`, in rows and columns."""
        self._shape, self._grid = shape, grid
        #: Bytes of the messages in which nothing is known, and all is.
        self.shortest, self.longest = MAP.size, MAP.size + packed_bytes(grid[0] * grid[1])

    def pack(self, sender: int, iteration: int, items: TileItems) -> bytes:
        """The message with the smallest rectangle that holds all known cells."""
        return pack_map(sender, iteration, assembled(items.values, items.origins, self._grid))

    def unpack(self, data: bytes) -> tuple[int, int, TileItems]:
        """Its sender, iteration and the pieces of the map."""
        sender, iteration, cells = unpack_map(data, self._grid)
        _, origins, values = pieces(cells[None], self._shape)
        nobody, now = np.full(len(values), -1, np.int32), np.full(len(values), iteration, np.int32)
        return sender, iteration, PlainTiles(values, origins, nobody, now)


def _ints(value: int) -> NDArray[np.int32]:
    return np.array([value], np.int32)


def pieces(
    maps: NDArray[np.uint8], shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.uint8]]:
    """The `maps` (n, rows, columns) cut into tiles of `shape`, without wholly UNKNOWN ones.

    Gives the row in `maps` (t,), rising, the origins (t, 2) and the values (t, *shape) of the tiles.
    """
    robots, rows, columns = maps.shape
    down, across = -(-rows // shape[0]), -(-columns // shape[1])
    padded = np.full((robots, down * shape[0], across * shape[1]), UNKNOWN, np.uint8)
    padded[:, :rows, :columns] = maps
    cut = padded.reshape(robots, down, shape[0], across, shape[1]).swapaxes(2, 3)
    # Rows first: numpy is slow where it reduces the few cells of a tile's row one by one.
    strips: NDArray[np.bool_] = (padded != UNKNOWN).reshape(robots, down, shape[0], -1).any(axis=2)
    owners, row, column = np.nonzero(strips.reshape(robots, down, across, shape[1]).any(axis=3))
    origins = np.stack([row * shape[0], column * shape[1]], axis=1).astype(np.int32)
    return owners, origins, cut[owners, row, column]


def assembled(values: NDArray[np.uint8], origins: NDArray[np.int32], grid: tuple[int, int]) -> NDArray[np.uint8]:
    """The map (rows, columns) of a `grid`, put together from tiles (t, rows, columns), which may lie beyond it."""
    height, width = shape = values.shape[1:]
    touching = ((origins > -np.array(shape)) & (origins < grid)).all(axis=1)
    cells = np.full((grid[0] + 2 * height, grid[1] + 2 * width), UNKNOWN, np.uint8)
    for (row, column), tile in zip((origins[touching] + shape).tolist(), values[touching], strict=True):
        cells[row : row + height, column : column + width] = tile
    return cells[height : height + grid[0], width : width + grid[1]]
