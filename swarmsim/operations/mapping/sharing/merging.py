"""Robots that start without knowing each other's places, and find them from their maps when they meet.

Each robot maps in its own frame of reference, which begins at its start, and cannot use others' messages until it knows
how their frames lie in its own. All maps share one lattice internally; received data is placed by the receiver's own
frame estimate, including its error.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import ArrayLike, NDArray

from swarmsim.core import memory
from swarmsim.core.context import BuildContext
from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Broadcast, Inbox
from swarmsim.core.state import OCCUPIED, UNKNOWN, Moment, Senses
from swarmsim.operations.mapping.maps import Frames, Maps, PlainTiles, TileItems
from swarmsim.operations.mapping.sharing.codecs import MapCodec, assembled, current_tile_bytes, map_bytes, pieces
from swarmsim.operations.mapping.sharing.gossip import GossipCodec, GossipSharing, piece_bytes
from swarmsim.operations.mapping.sharing.policies import cells_of, enclosing_cells, mark_sensed, tile_shape, tiles_of
from swarmsim.operations.mapping.sharing.registration import Cells, Meetings, Transform, register

#: The frame's robot and its number of walls (2 bytes each), then how it lies in the sender's: a turn (rad), rows and
#: columns (cells), 4 bytes each.
FRAME: Final = struct.Struct(">HHfff")

TILE, MAP, PLACE = 0, 1, 2  # what an item is: a tile or a piece of gossip, a piece of a whole map, another's frame
SPREAD: Final = 2.0  # times `within`, the least span of the places where two robots met
WALLS: Final = 40  # of one map on walls of the other, the least for accepting a frame ...
MARGIN: Final = 0.15  # ... by how much better it is than the next best ...
SURE: Final = 200  # ... and walls beyond which robots look for no better founded one
PATIENCE: Final = 5  # times `again` before a robot looks for a better founded frame than a known one
MOST: Final = 0xFFFF  # walls that a message can tell of
SECOND_HAND: Final = 0.8  # share of the walls behind a frame that counts after each robot that passes it on
EXACT: Final = 2.0  # cells: a frame that puts some place of the building farther off is not exact


@dataclass(frozen=True, slots=True, eq=False)
class MergeItems(TileItems):
    """Tiles, pieces of whole maps, and frames of reference, which contain no cells."""

    part: NDArray[np.uint8]  # (t,): TILE, MAP or PLACE
    whose: NDArray[np.int32]  # (t,): the robot whose frame is told; else -1
    weight: NDArray[np.int32]  # (t,): walls by which it was found; else 0
    place: NDArray[np.float32]  # (t, 3): how it lies in the sender's, as in FRAME; else 0

    @classmethod
    def of(
        cls, tiles: TileItems, part: int, whose: ArrayLike = -1, weight: ArrayLike = 0, place: ArrayLike = 0.0
    ) -> MergeItems:
        """The same tiles, all of one kind."""
        count = len(tiles)
        places = np.zeros((count, 3), np.float32)
        places[:] = place
        ids, walls = (np.full(count, value, np.int32) for value in (whose, weight))
        return cls(
            tiles.values, tiles.origins, tiles.sources, tiles.sensed, np.full(count, part, np.uint8), ids, walls, places
        )  # fmt: skip


class Merge(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots start without knowing each other's places: they gossip, and hear only those whose frame they have found.

    Robots that hear each other `within` reach have met, and note where on their own maps: the tile in a message gives
    its sender's estimated position, to half a cell. Those that have met in places far enough apart tell what they have
    mapped themselves, at most once in `again` iterations. The receiver searches for the rotation and translation that
    align it with its own map and agree with all their meetings, and accepts them if both maps agree and nothing else is
    nearly as good (`registration`). Besides, every message tells one frame that its sender knows, the one told longest
    ago, so that robots learn frames from those in between. A frame found by more walls is better founded, and replaces
    a less well founded one.

    Beyond gossip, 1 byte says what follows, a frame takes 16, and a map 14 and 2 bits per cell of its smallest
    enclosing rectangle.
    """

    within: Annotated[float, Meta(gt=0.0, le=1000.0)] = 1.0  # m, the largest distance of robots that meet
    again: Annotated[int, Meta(ge=1)] = 10  # iterations before a robot tells its map once more

    @property
    def merges(self) -> bool:
        """Whether robots have their own frames of reference."""
        return True

    def build(self, context: BuildContext) -> MergeSharing:
        return MergeSharing(self, context)


class MergeSharing:
    """Gossip among robots that have found each other's frames."""

    def __init__(self, parameters: Merge, context: BuildContext) -> None:
        lattice, count = context.lattice, len(context.ids)
        self._gossip, self._tile = GossipSharing(context), tile_shape(context)
        self.codec = MergeCodec(self._tile, lattice.shape)
        self._ids, self._robots = context.ids.astype(np.int32), np.arange(count, dtype=np.int32)  # and their rows
        pairs = count, context.swarm  # by one robot's row and another's number
        self._parameters, self._lattice = parameters, lattice
        self._frames = [_into_own_frame(pose, lattice) for pose in context.starts]  # by number
        self._own = [self._frames[robot] for robot in context.ids.tolist()]
        self._itself: NDArray[np.bool_] = self._ids[:, None] == np.arange(context.swarm)
        self._found = np.zeros((*pairs, 3))  # how the column's frame lies in the row's ...
        self._weight: NDArray[np.int64] = np.iinfo(np.int32).max * self._itself  # ... and the walls behind that
        self._told_at = np.zeros(pairs, np.int32)  # iterations from 1; 0: never
        self._offers = np.zeros(count, np.bool_)  # robots that tell their whole map next
        self._offered = np.full(count, -parameters.again, np.int64)
        self._tried = np.full(pairs, -PATIENCE * parameters.again, np.int64)
        self._met: dict[tuple[int, int], list[NDArray[np.float64]]] = {}  # places of receiver and sender, in cells
        self._sensed: NDArray[np.bool_] = memory.zeros((count, *lattice.shape), np.bool_)
        self._maps: Maps | None = None  # at the end of the last iteration
        #: The robots' knowledge of each other's frames, and its errors.
        self.frames = Frames(self._itself.copy(), np.zeros((*pairs, 3)))

    def say(self, senses: Senses, maps: Maps) -> Broadcast[MergeItems]:
        """Gossip, then a frame, then, from robots that have met a stranger, the whole map."""
        said = self._gossip.say(senses, maps)
        self._maps, now, robots, tile = maps, senses.iteration, self._robots, self._tile
        mark_sensed(self._sensed, senses.alive, tiles_of(senses))
        speakers = [np.repeat(robots, np.diff(said.ends, prepend=0))]
        items = [MergeItems.of(said.content, TILE)]
        sizes = said.sizes + senses.alive.astype(np.int32)
        tellers, whose = self._next_frames(senses.alive)
        if len(tellers):
            self._told_at[tellers, whose] = now + 1
            nothing = _tiles(np.zeros((len(tellers), *tile), np.uint8), np.zeros((len(tellers), 2), np.int32), now)
            weight, place = self._weight[tellers, whose], self._found[tellers, whose]
            items.append(MergeItems.of(nothing, PLACE, whose, weight, place))
            speakers.append(tellers)
            sizes[tellers] += np.int32(FRAME.size)
        offering = np.flatnonzero(self._offers & senses.alive).astype(np.int32)
        if len(offering):
            self._offered[offering] = now
            known = self._sensed_by_itself(maps)[offering]
            owners, origins, values = pieces(known, tile)
            items.append(MergeItems.of(_tiles(values, origins, now), MAP))
            speakers.append(offering[owners])
            sizes[offering] += map_bytes(enclosing_cells(known))
        whole = np.concatenate(speakers)
        order = np.argsort(whole, kind="stable")
        content = MergeItems.joined(items).take(order)
        return Broadcast(content, np.searchsorted(whole[order], robots, side="right"), sizes)

    def _sensed_by_itself(self, maps: Maps) -> NDArray[np.uint8]:
        """The part of its map that each robot has sensed itself, as `cells_of` gives it."""
        return np.asarray(cells_of(maps) * self._sensed)

    def _next_frames(self, alive: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Which robots have a frame to tell, and whose: the known one told longest ago."""
        others: NDArray[np.bool_] = self.frames.known & ~self._itself
        waited = np.where(others, self._told_at, np.iinfo(np.int32).max)
        tellers: NDArray[np.int32] = self._robots[alive & others.any(axis=1)]
        return tellers, waited[tellers].argmin(axis=1)

    def accepted(self, senses: Senses, inbox: Inbox[MergeItems]) -> Inbox[MergeItems]:
        """The items from robots with known frames, placed by the receiver's estimate."""
        self._find_frames(senses, inbox)
        self._hear_of_frames(inbox)
        self._meet(senses, inbox)
        known, part = self.frames.known[inbox.receivers, inbox.senders], inbox.content.part
        heard = inbox.take(np.flatnonzero(known & (part != PLACE)))
        errors = self.frames.errors[heard.receivers, heard.senders]
        values, origins = moved(heard.content.values, heard.content.origins, errors)
        return replace(heard, content=replace(heard.content, values=values, origins=origins))

    def _meet(self, senses: Senses, inbox: Inbox[MergeItems]) -> None:
        """Note which robots hear each other nearby; those that met in places far enough apart will tell their maps."""
        self._offers[:] = False
        content, now = inbox.content, senses.iteration
        own = np.flatnonzero((content.part == TILE) & (content.sources == inbox.senders))  # where their senders are
        here = _cells_at(senses.pose[inbox.receivers[own]], self._lattice)
        there = content.origins[own] + np.array(self._tile) / 2.0
        near = np.hypot(*(here - there).T) * self._lattice.cell <= self._parameters.within
        near &= self._wanted(now)[inbox.receivers[own], inbox.senders[own]]
        for row in np.flatnonzero(near).tolist():
            hearer, teller = int(inbox.receivers[own[row]]), int(inbox.senders[own[row]])
            met = self._met.setdefault((hearer, teller), [])
            both = np.stack([here[row], there[row]])
            if not met or np.hypot(*(both - met[-1]).T).max() >= 1.0:
                met.append(both)
            if now + 1 - self._offered[hearer] >= self._parameters.again:
                self._offers[hearer] |= self._far_enough(np.array(met))

    def _wanted(self, now: int) -> NDArray[np.bool_]:
        """Whose frame each robot looks for (n, N): strangers', and now and then poorly founded ones."""
        rested = now - self._tried >= PATIENCE * self._parameters.again
        return np.asarray((self._weight < SURE) & (rested | ~self.frames.known))

    def _far_enough(self, met: NDArray[np.float64]) -> bool:
        """Whether both robots' meetings (m, 2, 2) are far enough apart to find a turn by them."""
        spans = [np.hypot(*np.ptp(met[:, one], axis=0)) for one in (0, 1)]
        return bool(min(spans) * self._lattice.cell >= SPREAD * self._parameters.within)

    def _find_frames(self, senses: Senses, inbox: Inbox[MergeItems]) -> None:
        """Align strangers' maps with each robot's own."""
        part = np.flatnonzero(inbox.content.part == MAP)
        if not len(part) or self._maps is None:
            return
        cells = self._sensed_by_itself(self._maps)
        wanted = self._wanted(senses.iteration)
        pairs: list[tuple[int, int]]
        pairs = np.unique(np.stack([inbox.receivers[part], inbox.senders[part]], axis=1), axis=0).tolist()
        for hearer, teller in pairs:
            met = np.array(self._met.get((hearer, teller), []))
            if not wanted[hearer, teller] or not len(met) or not self._far_enough(met):
                continue
            self._tried[hearer, teller] = senses.iteration
            rows: NDArray[np.int64] = part[(inbox.receivers[part] == hearer) & (inbox.senders[part] == teller)]
            told = assembled(inbox.content.values[rows], inbox.content.origins[rows], self._lattice.shape)
            found = self._compared(cells[hearer], told, self._frames[teller], met)
            if found is not None:
                self._learn(hearer, teller, self._own[hearer].after(found[0]), min(found[1], MOST))

    def _compared(
        self, own: Cells, told: Cells, frame: Transform, met: NDArray[np.float64]
    ) -> tuple[Transform, int] | None:
        """How a received map lies on a robot's own, from its sender's `frame` to the lattice, and by how many walls.

        They `met` (m, 2, 2) at these cells of the lattice.
        """
        if np.count_nonzero(own == OCCUPIED) < WALLS or np.count_nonzero(told == OCCUPIED) < WALLS:
            return None
        fixed, at = _cropped(own)
        moving, corner = presented(told, frame)
        within = self._parameters.within / self._lattice.cell
        meetings = Meetings(met[:, 0] - at - 0.5, frame.apply(met[:, 1]) - corner - 0.5, within)
        match = register(fixed, moving, meetings)
        if match is None or not match.accepted(walls=WALLS, margin=MARGIN):
            return None
        shift, back = Transform(0.0, *-corner.astype(float)), Transform(0.0, *at.astype(float))
        return back.after(match.transform).after(shift), match.walls

    def _hear_of_frames(self, inbox: Inbox[MergeItems]) -> None:
        """Accept frames that others have found."""
        content, weight = inbox.content, self._weight
        for row in np.flatnonzero(content.part == PLACE).tolist():
            hearer, teller, third = int(inbox.receivers[row]), int(inbox.senders[row]), int(content.whose[row])
            told, walls = Transform(*map(float, content.place[row])), int(content.weight[row])
            if third != self._ids[hearer] and weight[hearer, teller] > 0:
                found = Transform(*self._found[hearer, teller]).after(told)
                self._learn(hearer, third, found, int(SECOND_HAND * min(walls, weight[hearer, teller])))
            if weight[hearer, third] > 0:  # may be the hearer itself
                found = Transform(*self._found[hearer, third]).after(told.inverse())
                self._learn(hearer, teller, found, int(SECOND_HAND * min(walls, weight[hearer, third])))

    def _learn(self, hearer: int, other: int, found: Transform, walls: int) -> None:
        """Accept a frame that is better founded than the present one."""
        if walls <= self._weight[hearer, other]:
            return
        error = self._own[hearer].inverse().after(found).after(self._frames[other])
        self._found[hearer, other] = found.turn, found.rows, found.columns
        self._weight[hearer, other] = walls
        self.frames.errors[hearer, other] = error.turn, error.rows, error.columns
        self.frames.known[hearer, other] = True


class MergeCodec:
    """Gossip, a frame and a whole map, each if there is one."""

    def __init__(self, shape: tuple[int, int], grid: tuple[int, int]) -> None:
        """`shape` of the tiles and of the whole `grid`, in rows and columns."""
        self._shape, self._gossip, self._map = shape, GossipCodec(shape), MapCodec(shape, grid)

    def pack(self, sender: int, iteration: int, items: MergeItems) -> bytes:
        """The message: a byte that says which of piece (1), frame (2) and map (4) follow, then these."""
        part = items.part
        gossip, frame, whole = (_only(items, np.flatnonzero(part == kind)) for kind in (TILE, PLACE, MAP))
        parts = [bytes([(len(gossip) > 1) + 2 * bool(len(frame)) + 4 * bool(len(whole))])]
        parts.append(self._gossip.pack(sender, iteration, gossip))
        if len(frame):
            (row,) = np.flatnonzero(part == PLACE)
            parts.append(FRAME.pack(int(items.whose[row]), int(items.weight[row]), *map(float, items.place[row])))
        if len(whole):
            parts.append(self._map.pack(sender, iteration, whole))
        return b"".join(parts)

    def unpack(self, data: bytes) -> tuple[int, int, MergeItems]:
        """Its sender, iteration and items."""
        end = 1 + current_tile_bytes(*self._shape) + (piece_bytes(*self._shape) if data[0] & 1 else 0)
        sender, iteration, gossip = self._gossip.unpack(data[1:end])
        items = [MergeItems.of(gossip, TILE)]
        if data[0] & 2:
            whose, weight, *place = FRAME.unpack_from(data, end)
            nothing = _tiles(np.zeros((1, *self._shape), np.uint8), np.zeros((1, 2), np.int32), iteration)
            items.append(MergeItems.of(nothing, PLACE, whose, weight, place))
            end += FRAME.size
        if data[0] & 4:
            items.append(MergeItems.of(self._map.unpack(data[end:])[2], MAP))
        return sender, iteration, MergeItems.joined(items)


class FrameMeasures:
    """An observer that counts the frames found, and their errors; silent where all are known from the start."""

    def __init__(self, domain: NDArray[np.bool_]) -> None:
        rows, columns = (np.flatnonzero(domain.any(axis=axis)) for axis in (1, 0))
        #: The corners of the building; one of them is displaced most.
        self._corners = np.array([(row, column) for row in rows[[0, -1]] for column in columns[[0, -1]]], float)
        self._joined: int | None = None
        self._last: Frames | None = None

    def sample(self, moment: Moment[Maps]) -> None:
        """Take note of one iteration."""
        self._last = moment.knowledge.frames
        alive = moment.state.alive
        if self._joined is None and self._last is not None and self._last.known[np.ix_(alive, alive)].all():
            self._joined = moment.state.iteration + 1

    def summary(self) -> dict[str, float | int | None]:
        """How many frames are known, when all were, and how many are not exact."""
        if self._last is None:
            return {}
        pairs = np.argwhere(self._last.known & ~np.eye(len(self._last.known), dtype=np.bool_))
        off = [self._displaced(self._last.errors[hearer, other]) for hearer, other in pairs]
        return {
            "frames_found": len(pairs),
            "frames_off": int(np.count_nonzero(np.array(off) > EXACT)),
            "frames_error": float(np.mean(off)) if off else None,
            "frames_worst": max(off, default=None),
            "frames_joined": self._joined,
        }

    def _displaced(self, error: NDArray[np.float64]) -> float:
        """The displacement, in cells, of the worst place of the building."""
        apart = Transform(*error).apply(self._corners) - self._corners
        return float(np.hypot(*apart.T).max())


def moved(
    values: NDArray[np.uint8], origins: NDArray[np.int32], errors: NDArray[np.float64]
) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Tiles (t, rows, columns) and their origins (t, 2) where `errors` (t, 3) put them, resampled on the lattice."""
    size = np.array(values.shape[1:])
    cos, sin = np.cos(errors[:, 0]), np.sin(errors[:, 0])
    middles = origins + size / 2.0
    row, column = middles[:, 0], middles[:, 1]
    middle = np.stack([row * cos + column * sin, column * cos - row * sin], axis=1) + errors[:, 1:]
    placed = np.round(middle - size / 2.0).astype(np.int32)
    cells = placed[:, :, None, None] + np.indices(values.shape[1:]) + 0.5 - errors[:, 1:, None, None]
    turn = cos[:, None, None], sin[:, None, None]
    rows = np.floor(cells[:, 0] * turn[0] - cells[:, 1] * turn[1]).astype(np.int64) - origins[:, 0, None, None]
    columns = np.floor(cells[:, 0] * turn[1] + cells[:, 1] * turn[0]).astype(np.int64) - origins[:, 1, None, None]
    inside: NDArray[np.bool_] = (rows >= 0) & (rows < size[0]) & (columns >= 0) & (columns < size[1])
    at = np.arange(len(values))[:, None, None], np.where(inside, rows, 0), np.where(inside, columns, 0)
    return np.where(inside, values[at], np.uint8(UNKNOWN)), placed


def presented(cells: Cells, frame: Transform) -> tuple[Cells, NDArray[np.int64]]:
    """The known part of a map in another frame, resampled on that frame's cells, and the cell it begins at (2,)."""
    rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    corners = np.array([(row, column) for row in (rows[0], rows[-1] + 1) for column in (columns[0], columns[-1] + 1)])
    there = frame.apply(corners.astype(float))
    low, high = np.floor(there.min(axis=0)).astype(np.int64), np.ceil(there.max(axis=0)).astype(np.int64)
    shape = tuple((high - low).tolist())
    centres = (np.indices(shape).reshape(2, -1).T + low) + 0.5
    at = np.floor(frame.inverse().apply(centres)).astype(np.int64)
    row, column = at[:, 0], at[:, 1]
    inside: NDArray[np.bool_] = (row >= 0) & (row < cells.shape[0]) & (column >= 0) & (column < cells.shape[1])
    found = np.where(inside, cells[np.where(inside, row, 0), np.where(inside, column, 0)], np.uint8(UNKNOWN))
    return found.reshape(shape), low


def _cropped(cells: Cells) -> tuple[Cells, NDArray[np.int64]]:
    """The known part of a map and the cell it begins at."""
    rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    return cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], np.array([rows[0], columns[0]])


def _into_own_frame(pose: NDArray[np.float64], lattice: Lattice) -> Transform:
    """From the lattice to the frame of a robot that starts at a pose: its place is 0, and it looks along a row."""
    turn = Transform(-float(pose[2]), 0.0, 0.0)
    start: list[float] = turn.apply(_cells_at(pose, lattice)[None]).ravel().tolist()
    return Transform(turn.turn, -start[0], -start[1])


def _cells_at(pose: NDArray[np.float64], lattice: Lattice) -> NDArray[np.float64]:
    """Row and column of places (..., 3), in cells from the corner of cell (0, 0)."""
    return np.stack([pose[..., 1] - lattice.y0, pose[..., 0] - lattice.x0], axis=-1) / lattice.cell


def _tiles(values: NDArray[np.uint8], origins: NDArray[np.int32], now: int) -> TileItems:
    """Cells without a sensing robot."""
    nobody, sensed = np.full(len(values), -1, np.int32), np.full(len(values), now, np.int32)
    return PlainTiles(values, origins, nobody, sensed)


def _only(items: MergeItems, rows: NDArray[np.int64]) -> TileItems:
    """Some of the items as tiles."""
    return PlainTiles(items.values[rows], items.origins[rows], items.sources[rows], items.sensed[rows])
