"""Robots that start without knowing each other's places, and find them from their maps when they meet.

Each robot maps in its own frame of reference, which begins at its start, and cannot use others' messages until it knows
how their frames lie in its own. All maps share one lattice internally; received data is placed by the receiver's own
frame estimate, including its error.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core import memory
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Inbox
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Senses
from swarmsim.operations.mapping.maps import Frames, Maps
from swarmsim.operations.mapping.sharing.acquaintances import GROWN, Acquaintance, meetings
from swarmsim.operations.mapping.sharing.codecs import assembled, map_bytes, pieces
from swarmsim.operations.mapping.sharing.frames import cells_at, cropped, into_own_frame, moved, presented
from swarmsim.operations.mapping.sharing.gossip import GossipSharing
from swarmsim.operations.mapping.sharing.introductions import (
    FRAME,
    LINK,
    MAP,
    MOST,
    TILE,
    MergeCodec,
    MergeItems,
    as_told,
    cell_pieces,
)
from swarmsim.operations.mapping.sharing.links import Link, Links
from swarmsim.operations.mapping.sharing.places import AGREEMENT, Cells, Match, Place, Points, Transform, at, elsewhere
from swarmsim.operations.mapping.sharing.policies import cells_of, enclosing_cells, mark_sensed, tile_shape, tiles_of
from swarmsim.operations.mapping.sharing.registration import Meetings, register

CROSS: Final = np.array([[[0, 1, 0], [1, 1, 1], [0, 1, 0]]], np.bool_)  # a cell and those beside it
EDGE: Final = 5  # cells: no robot tells what lies in a square of this side around an edge of what it has sensed
SURE: Final = 60  # cells of excess beyond which robots do not test a link again
PATIENCE: Final = 5  # times `again` before robots test a known frame again, or compare maps that have hardly grown
MOVED: Final = 1.0  # cells: how much farther a better estimate of a frame puts what was heard, before it is heard anew
ELSEWHERE: Final = 5.0  # cells: beyond this it was another place, so the frame as it was is withdrawn
ENOUGH: Final = 50  # walls on each map, before which it is too early to compare them


class Merge(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots start without knowing each other's places: they gossip, and hear only those whose frame they have found.

    Robots that hear each other `within` reach have met, and note where on their own maps: the tile in a message gives
    its sender's estimated position, to half a cell. Those that have met tell what they have sensed themselves, at most
    once in `again` iterations, and as it grows. The receiver looks for all rotations and translations that agree with
    all their meetings and with both maps. It takes the other's frame for known once the maps refute every place but one
    (`places`); until then it uses what the other says for nothing else. Meetings and maps are kept, so each new one can
    refute more. Where rooms are equal, that may never be enough. Meetings with robots whose frames are linked to the
    other's count too. A place is proved only once walls also pin its turn, to a standard error of a degree.

    What two robots have found is a link between their frames. Each message tells one link that its sender knows, the
    one told longest ago, and every robot puts frames together from links. A link is known by its pair, so being passed
    on makes no link stronger. Robots that meet again test it again. If their maps now refute it, or links around a
    circle of robots do not fit together, it is withdrawn. A robot that loses a frame, or finds it elsewhere, forgets
    what it has not sensed itself, and hears it anew. Robots tell what they have sensed themselves, never hearsay.

    Beyond gossip, 1 byte says what follows, a link takes 22, and a map 14 and 2 bits per cell of its smallest enclosing
    rectangle.
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
        self._long = PATIENCE * parameters.again  # iterations
        self._starts = [into_own_frame(pose, lattice) for pose in context.starts]  # by number
        self._own = [self._starts[robot] for robot in context.ids.tolist()]
        self._links = [Links(robot) for robot in context.ids.tolist()]
        self._known: dict[tuple[int, int], Acquaintance] = {}  # by row and number
        self._offers = np.zeros(count, np.bool_)  # robots that tell their whole map next
        self._offered_at = np.full(count, -parameters.again, np.int64)  # the iteration in which each told its map ...
        self._offered = np.zeros(count, np.int64)  # ... and how many cells it had
        self._told: NDArray[np.bool_] = memory.zeros((count, *lattice.shape), np.bool_)  # cells worth telling
        self._sensed: NDArray[np.bool_] = memory.zeros((count, *lattice.shape), np.bool_)
        self._maps: Maps | None = None  # at the end of the last iteration
        #: The robots' knowledge of each other's frames, and its errors.
        itself: NDArray[np.bool_] = self._ids[:, None] == np.arange(context.swarm)
        self.frames = Frames(
            itself, np.zeros((*pairs, 3)), np.zeros(pairs, np.int32), np.zeros(count, np.int32),
            np.zeros(count, np.bool_), self._sensed,
        )  # fmt: skip

    def say(self, senses: Senses, maps: Maps) -> Broadcast[MergeItems]:
        """Gossip, then a link, then, from robots that have met a stranger, the whole map."""
        self._maps, now, robots, tile = maps, senses.iteration, self._robots, self._tile
        said = self._gossip.say(senses, self._worth_telling(maps))
        mark_sensed(self._sensed, senses.alive, tiles_of(senses))
        speakers = [np.repeat(robots, np.diff(said.ends, prepend=0))]
        items = [MergeItems.of(said.content, TILE)]
        sizes = said.sizes + senses.alive.astype(np.int32)
        told = {row: self._links[row].next_to_tell(now) for row in np.flatnonzero(senses.alive).tolist()}
        links = {row: link for row, link in told.items() if link is not None}
        if links:
            items.append(MergeItems.telling(list(links.values()), tile, now))
            speakers.append(np.array(list(links), np.int32))
            sizes[list(links)] += np.int32(FRAME.size)
        offering = np.flatnonzero(self._offers & senses.alive).astype(np.int32)
        if len(offering):
            known = self._sensed_by_itself(maps)[offering]
            owners, origins, values = pieces(known, tile)
            items.append(MergeItems.of(cell_pieces(values, origins, now), MAP))
            speakers.append(offering[owners])
            sizes[offering] += map_bytes(enclosing_cells(known))
        whole = np.concatenate(speakers)
        order = np.argsort(whole, kind="stable")
        content = MergeItems.joined(items).take(order)
        return Broadcast(content, np.searchsorted(whole[order], robots, side="right"), sizes)

    def _worth_telling(self, maps: Maps) -> Maps:
        """The part of its map that each robot tells: what it has sensed itself, but for the edges of that.

        What is passed on from frame to frame would be placed anew each time, and an edge that lands beside its place
        hides cells that no robot has sensed.
        """
        cells = self._sensed_by_itself(maps)
        unknown = cells == UNKNOWN
        edge = (cells == FREE) & ndimage.binary_dilation(unknown, CROSS)
        told: NDArray[np.bool_] = ~unknown & ~ndimage.maximum_filter(edge, (1, EDGE, EDGE))
        robots, where = np.nonzero((told & ~self._told).reshape(len(told), -1))
        changes = np.stack([robots, where, np.zeros_like(where)], axis=1).astype(np.int32)
        self._told = told
        return replace(maps, observed=told, changes=changes)

    def _sensed_by_itself(self, maps: Maps) -> NDArray[np.uint8]:
        """The part of its map that each robot has sensed itself, as `cells_of` gives it."""
        return np.asarray(cells_of(maps) * self._sensed)

    def accepted(self, senses: Senses, inbox: Inbox[MergeItems]) -> Inbox[MergeItems]:
        """The items from robots with known frames, placed by the receiver's estimate."""
        now, frames, content = senses.iteration, self.frames, inbox.content
        frames.spoilt[:] = False
        self._compare_maps(now, inbox)
        for row in np.flatnonzero(content.part == LINK).tolist():
            self._learn(int(inbox.receivers[row]), content.link(row))
        self._meet(senses, inbox)
        known = frames.known[inbox.receivers, inbox.senders]
        heard = inbox.take(np.flatnonzero(known & (content.part != LINK)))
        errors = frames.errors[heard.receivers, heard.senders]
        values, origins = moved(heard.content.values, heard.content.origins, errors)
        return replace(heard, content=replace(heard.content, values=values, origins=origins))

    def _meet(self, senses: Senses, inbox: Inbox[MergeItems]) -> None:
        """Note which robots hear each other nearby, and which ones will tell their maps."""
        content, now = inbox.content, senses.iteration
        own = np.flatnonzero((content.part == TILE) & (content.sources == inbox.senders))  # where their senders are
        here = cells_at(senses.pose[inbox.receivers[own]], self._lattice)
        there = content.origins[own] + np.array(self._tile) / 2.0
        near = np.hypot(*(here - there).T) * self._lattice.cell <= self._parameters.within
        eager, heard = np.zeros(len(self._robots), np.bool_), np.zeros_like(self.frames.known)
        heard[inbox.receivers[own], inbox.senders[own]] = True
        for row in np.flatnonzero(near).tolist():
            hearer, teller = int(inbox.receivers[own[row]]), int(inbox.senders[own[row]])
            if not self._wants(hearer, teller, now):
                continue
            never = now - self._long
            other = self._known.setdefault((hearer, teller), Acquaintance(never))
            eager[hearer] |= other.meet(np.stack([here[row], there[row]]))
        for hearer, teller in self._known:
            eager[hearer] |= heard[hearer, teller] and not self.frames.known[hearer, teller]
        sensed = np.count_nonzero(self._sensed, axis=(1, 2))
        rests = now + 1 - self._offered_at
        more = (sensed >= GROWN * self._offered) | ((rests >= self._long) & (sensed > self._offered))
        self._offers = eager & (rests >= self._parameters.again) & more
        self._offered_at[self._offers], self._offered[self._offers] = now + 1, sensed[self._offers]

    def _wants(self, hearer: int, teller: int, now: int) -> bool:
        """Whether a robot compares maps with another: with strangers, and now and then to test a link that is weak."""
        pair = self._pair(hearer, teller)
        link, other = self._links[hearer].of(pair), self._known.get((hearer, teller))
        if link is not None and link.excess >= SURE:
            return False
        rested = other is None or now - other.tried >= self._long
        return rested or not self.frames.known[hearer, teller]

    def _pair(self, hearer: int, teller: int) -> tuple[int, int]:
        robot = int(self._ids[hearer])
        return min(robot, teller), max(robot, teller)

    def _compare_maps(self, now: int, inbox: Inbox[MergeItems]) -> None:
        """Look where the maps told may lie on their hearers' own."""
        part = np.flatnonzero(inbox.content.part == MAP)
        if not len(part) or self._maps is None:
            return
        cells = self._sensed_by_itself(self._maps)
        pairs: list[tuple[int, int]]
        pairs = np.unique(np.stack([inbox.receivers[part], inbox.senders[part]], axis=1), axis=0).tolist()
        for hearer, teller in pairs:
            other = self._known.get((hearer, teller))
            if other is None or not self._wants(hearer, teller, now):
                continue
            rows: NDArray[np.int64] = part[(inbox.receivers[part] == hearer) & (inbox.senders[part] == teller)]
            told = assembled(inbox.content.values[rows], inbox.content.origins[rows], self._lattice.shape)
            met = meetings(
                hearer, teller, self._known, self._links[hearer], self._starts,
                self._parameters.within / self._lattice.cell,
            )  # fmt: skip
            both = int(np.count_nonzero(cells[hearer])) + int(np.count_nonzero(told))
            if other.has_grown(both, met.spread, self._least(hearer, teller, now)):
                other.tried = now
                self._judge(hearer, teller, cells[hearer], told, met, now)

    def _least(self, hearer: int, teller: int, now: int) -> float:
        """By how much maps or meetings have to grow before another comparison, hardly at all after a while.

        Of two robots the one with the higher number compares less often, since the other will tell it what it finds.
        """
        if now - self._known[hearer, teller].tried >= self._long:
            return 1.0
        return GROWN if self._ids[hearer] < teller else GROWN**2

    def _judge(self, hearer: int, teller: int, own: Cells, told: Cells, met: Meetings, now: int) -> None:
        """Link the frames of two robots if their maps prove a place, or withdraw what they refute."""
        if min(np.count_nonzero(one == OCCUPIED) for one in (own, told)) < ENOUGH:
            return
        fixed, corner = cropped(own)
        moving, first = presented(told, self._starts[teller])
        met = Meetings(met.fixed - corner - 0.5, met.moving - first - 0.5, met.within)
        match = register(fixed, moving, met)
        if match is None:
            return
        # From cells of the presented map to those of the robot's own, and between their frames.
        there = Transform(0.0, *(-first).tolist())
        here = self._own[hearer].after(Transform(0.0, *corner.tolist()))
        robot, links = int(self._ids[hearer]), self._links[hearer]
        self.frames.places[hearer, teller] = 1 + len(match.rivals)
        if match.accepted():
            place = here.after(match.best.transform).after(there)
            place = place if robot < teller else place.inverse()
            self._learn(hearer, Link(self._pair(hearer, teller), now, min(match.excess, MOST), as_told(place)))
        elif teller in links.frames:
            held = here.inverse().after(links.frames[teller]).after(there.inverse())
            if refuted(match, at(fixed, moving, held), met.moving):
                self._learn(hearer, links.weakest_towards(teller).withdrawn(now))

    def _learn(self, hearer: int, link: Link) -> None:
        """Take in a link, and what follows from it for the robot's knowledge of frames."""
        links, frames = self._links[hearer], self.frames
        before = dict(links.frames)
        links.learn(link)
        if links.frames == before:
            return
        shifts = [links.frames[one].shift(was) if one in links.frames else np.inf for one, was in before.items()]
        frames.spoilt[hearer] |= any(shift > MOVED for shift in shifts)
        frames.withdrawn[hearer] += sum(shift > ELSEWHERE for shift in shifts)
        frames.known[hearer] = False
        frames.known[hearer, [links.robot, *links.frames]] = True
        for other, found in links.frames.items():
            error = self._own[hearer].inverse().after(found).after(self._starts[other])
            frames.errors[hearer, other] = error.turn, error.rows, error.columns


def refuted(match: Match, held: Place, spots: Points) -> bool:
    """Whether maps and meetings at `spots` (m, 2) refute a place once proved: another one is, or it fits worse."""
    if match.placed():
        return elsewhere(match.best.transform, held.transform, spots)
    return held.agreement < AGREEMENT and held.contradictions - match.best.contradictions >= match.best.needed
