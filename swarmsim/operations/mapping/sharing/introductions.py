"""The messages of robots that look for each other's frames: gossip, a link between frames, now and then a whole map."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.messages import LATEST, FrameError, check_length
from swarmsim.operations.mapping.maps import PlainTiles, TileItems
from swarmsim.operations.mapping.sharing.codecs import MapCodec, current_tile_bytes
from swarmsim.operations.mapping.sharing.gossip import GossipCodec, piece_bytes
from swarmsim.operations.mapping.sharing.links import Link
from swarmsim.operations.mapping.sharing.places import Transform

#: A link's two robots (2 bytes each), when it was found (4) and its excess (2), then how the second's frame lies in the
#: first's: a turn (rad), rows and columns (cells), 4 bytes each.
FRAME: Final = struct.Struct(">HHIHfff")
MOST: Final = 0xFFFF  # cells of excess that a message can tell of

TILE, MAP, LINK = 0, 1, 2  # what an item is: a tile or a piece of gossip, a piece of a whole map, a link


def as_told(place: Transform) -> Transform:
    """A place as a message carries it, so that the robot that found it has the same as all others."""
    return Transform(*np.array([place.turn, place.rows, place.columns], np.float32).tolist())


@dataclass(frozen=True, slots=True, eq=False)
class MergeItems(TileItems):
    """Tiles, pieces of whole maps, and links between frames of reference, which contain no cells."""

    part: NDArray[np.uint8]  # (t,): TILE, MAP or LINK
    pair: NDArray[np.int32]  # (t, 2): the robots whose frames are linked; else -1
    found: NDArray[np.int32]  # (t,): the iteration in which the link was found or withdrawn; else 0
    excess: NDArray[np.int32]  # (t,): its excess; else 0
    place: NDArray[np.float32]  # (t, 3): how the second's frame lies in the first's, as in FRAME; else 0

    @classmethod
    def of(cls, tiles: TileItems, part: int) -> MergeItems:
        """Tiles, all of one kind."""
        count = len(tiles)
        nothing, nobody = np.zeros(count, np.int32), np.full((count, 2), -1, np.int32)
        return cls(
            tiles.values, tiles.origins, tiles.sources, tiles.sensed, np.full(count, part, np.uint8), nobody, nothing,
            nothing, np.zeros((count, 3), np.float32),
        )  # fmt: skip

    @classmethod
    def telling(cls, links: Sequence[Link], tile: tuple[int, int], now: int) -> MergeItems:
        """Links, with empty tiles."""
        count = len(links)
        nothing = cell_pieces(np.zeros((count, *tile), np.uint8), np.zeros((count, 2), np.int32), now)
        places = [(link.place.turn, link.place.rows, link.place.columns) for link in links]
        return replace(
            cls.of(nothing, LINK),
            pair=np.array([link.pair for link in links], np.int32).reshape(-1, 2),
            found=np.array([link.found for link in links], np.int32),
            excess=np.array([link.excess for link in links], np.int32),
            place=np.array(places, np.float32).reshape(-1, 3),
        )

    def link(self, row: int) -> Link:
        """The link of an item of this kind."""
        first, second = self.pair[row].tolist()
        return Link((first, second), int(self.found[row]), int(self.excess[row]), Transform(*self.place[row].tolist()))


class MergeCodec:
    """Gossip, a link and a whole map, each if there is one."""

    def __init__(self, shape: tuple[int, int], grid: tuple[int, int]) -> None:
        """`shape` of the tiles and of the whole `grid`, in rows and columns."""
        self._shape, self._gossip, self._map = shape, GossipCodec(shape), MapCodec(shape, grid)
        #: Bytes of the longest message.
        self.longest = 1 + self._gossip.longest + FRAME.size + self._map.longest

    def pack(self, sender: int, iteration: int, items: MergeItems) -> bytes:
        """The message: a byte that says which of piece (1), link (2) and map (4) follow, then these."""
        part = items.part
        gossip, links, whole = (_only(items, np.flatnonzero(part == kind)) for kind in (TILE, LINK, MAP))
        told = self._map.pack(sender, iteration, whole)
        cells = len(told) > self._map.shortest
        parts = [bytes([(len(gossip) > 1) + 2 * bool(len(links)) + 4 * cells])]
        parts.append(self._gossip.pack(sender, iteration, gossip))
        if len(links):
            (row,) = np.flatnonzero(part == LINK)
            link = (
                *items.pair[row].tolist(),
                int(items.found[row]),
                int(items.excess[row]),
                *items.place[row].tolist(),
            )
            parts.append(FRAME.pack(*link))
        if cells:
            parts.append(told)
        return b"".join(parts)

    def unpack(self, data: bytes) -> tuple[int, int, MergeItems]:
        """Its sender, iteration and items. Raises FrameError."""
        if not data or data[0] > 7:
            raise FrameError("no first byte from 0 to 7, which says what follows")
        end = 1 + current_tile_bytes(*self._shape) + (piece_bytes(*self._shape) if data[0] & 1 else 0)
        sender, iteration, gossip = self._gossip.unpack(data[1:end])
        items = [MergeItems.of(gossip, TILE)]
        if data[0] & 2:
            check_length(data, end + FRAME.size, len(data))
            first, second, found, excess, *place = FRAME.unpack_from(data, end)
            if found > LATEST:
                raise FrameError(f"a link of iteration {found}; expected {LATEST} at most")
            link = Link((first, second), found, excess, Transform(*place))
            items.append(MergeItems.telling([link], self._shape, iteration))
            end += FRAME.size
        if data[0] & 4:
            *head, whole = self._map.unpack(data[end:])
            if tuple(head) != (sender, iteration) or not len(whole):
                raise FrameError("a whole map with another header, or without cells")
            items.append(MergeItems.of(whole, MAP))
        else:
            check_length(data, end)
        return sender, iteration, MergeItems.joined(items)


def cell_pieces(values: NDArray[np.uint8], origins: NDArray[np.int32], now: int) -> TileItems:
    """Cells without a sensing robot."""
    nobody, sensed = np.full(len(values), -1, np.int32), np.full(len(values), now, np.int32)
    return PlainTiles(values, origins, nobody, sensed)


def _only(items: MergeItems, rows: NDArray[np.int64]) -> TileItems:
    """Some of the items as tiles."""
    return PlainTiles(items.values[rows], items.origins[rows], items.sources[rows], items.sensed[rows])
