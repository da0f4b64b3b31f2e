"""The local computation of collective mapping: each robot keeps an occupancy grid.

Lines 2 to 5 of Algorithm 1 of Kit, Mateo and Bouffanais, "A Decentralized Mobile Computing Network for
Multi-Robot Systems Operations" (2018).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Final, Literal, TypeVar

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError, PlacedError
from swarmsim.core.lending import lent
from swarmsim.core.messages import Broadcast, Codec, Inbox
from swarmsim.core.readings import Tiles
from swarmsim.core.reports import Report
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Knowledge, Senses
from swarmsim.kernels import occupancy
from swarmsim.operations.mapping import reporting
from swarmsim.operations.mapping.grids import OccupancyGrids, QuorumGrids
from swarmsim.operations.mapping.lies import LIES
from swarmsim.operations.mapping.maps import Frames, Maps, PlainTiles, TileItems
from swarmsim.operations.mapping.sharing.policies import tiles_of
from swarmsim.operations.mapping.sharing.seam import Sharing

MOST: Final = 20_000_000_000  # cells of all maps together

Probability = Annotated[float, Meta(gt=0.0, lt=1.0)]


class OccupancyGrid(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot keeps an occupancy grid (Elfes 1989) of the tiles that it senses and hears.

    The increments are the log-odds of `hit` and `miss`: the probability that a cell is occupied, given
    that one beam ended in it or that all beams passed. A beam that ends proves matter, a passing one only
    its own line, so a hit outweighs several misses. The log-odds stay between those of `lowest` and
    `highest`, so that maps can follow a changing world: a removed wall is free again after more than
    logit(highest) / -logit(miss) misses, 9 by default, and a new one is a wall after one hit.

    With a `decay` every map loses that share of its log-odds in each iteration, and a cell whose log-odds have
    fallen below half of one observation's, min(logit(hit), -logit(miss)) / 2, becomes unknown again, hence a frontier.
    A cell last left at log-odds l is forgotten ln(2 |l| / that observation's) / -ln(1 - decay) iterations later: by
    default 2.3 / decay for a cell at `lowest`, 2.8 / decay for a wall. Equal clamps, logit(highest) =
    -logit(lowest), make both equally long. A dead robot forgets nothing.

    With `hits = "spared"` a robot takes back occupied cells, of its tile or one that it hears, at the known place of a
    robot: itself, or one whose present tile it hears. That is for sensors to which robots look like walls; later free
    readings correct what remains on maps.

    `share` says what a robot tells: `current-tile`, `gossip`, ..., a table with `use` and the policy's own keys.
    `trust` is the defence against lying robots. With "own" a robot's own sensing of a cell overrides, for good, all
    that it hears of it; with "quorum", messages about other cells also count only once `quorum` different senders have
    said the same.
    """

    hit: Probability = 0.9  # probability of a wall where a beam ended
    miss: Probability = 0.4  # the same where a beam passed
    lowest: Probability = 0.12  # least probability of a cell
    highest: Probability = 0.97  # largest probability of a cell
    decay: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0  # share of the log-odds lost per iteration; 0 never forgets
    sharing: Part[Sharing[TileItems]] = Part("sharing")  # what is told
    hits: Literal["kept", "spared"] = "kept"  # spared: an occupied cell at a robot's known place is no wall
    trust: Literal["all", "own", "quorum"] = "all"  # own: messages change no cell that the receiver has sensed itself
    quorum: Annotated[int, Meta(ge=2, le=64)] | None = None  # for trust = "quorum": senders that must agree; default 2

    @property
    def cell_bytes(self) -> int:
        """The memory of a cell of one robot's map: 5 bytes of it, 12 of what strategies keep for ways and bars."""
        return 17

    @property
    def merges(self) -> bool:
        """Whether robots have their own frames of reference."""
        return self.sharing.declares("merges", False)

    def build(self, context: BuildContext) -> MapComputation:
        """The maps of a whole swarm. Raises InputError for numbers that contradict each other."""
        cells = context.lattice.rows * context.lattice.columns
        if context.swarm * cells > MOST:
            raise PlacedError(
                f"grid.cell: {context.swarm} robots with maps of {cells} cells each would have more than {MOST} cells; "
                f"expected fewer robots or larger cells"
            )
        if not self.lowest < self.miss < 0.5 < self.hit < self.highest:
            raise InputError(
                f"hit: expected lowest < miss < 0.5 < hit < highest, got "
                f"{self.lowest:g}, {self.miss:g}, {self.hit:g}, {self.highest:g}"
            )
        if self.quorum is not None and self.trust != "quorum":
            raise InputError(f"quorum: robots with trust {self.trust!r} need none; expected trust = 'quorum'")
        others = context.swarm - 1
        if self.trust == "quorum" and (self.quorum or 2) > others:
            raise InputError(f"quorum: {self.quorum or 2} of {others} others never agree; expected {others} at most")
        return MapComputation(self, context, self.sharing.build(context, "sharing"))


class MapComputation:
    """One occupancy grid per robot; only its own robot writes to it."""

    requires = ("tiles",)
    knowledge_type: type[Knowledge] = Maps
    lies = LIES

    def __init__(self, parameters: OccupancyGrid, context: BuildContext, sharing: Sharing[TileItems]) -> None:
        count, lattice = len(context.ids), context.lattice
        grids = OccupancyGrids(count, lattice, parameters.hit, parameters.miss, parameters.lowest, parameters.highest)
        quorum = parameters.quorum or 2 if parameters.trust == "quorum" else 1
        self._grids = grids if parameters.trust == "all" else QuorumGrids(grids, quorum)
        self._sharing = sharing
        spared = parameters.hits == "spared"
        # A robot is up to half a cell, each way, from the middle of its tile, and a hit from that of its cell.
        self._spared = context.robots.radius / lattice.cell + math.sqrt(2.0) if spared else 0.0
        weakest = min(logit(parameters.hit), -logit(parameters.miss))
        self._forgets = parameters.decay > 0.0
        self._kept, self._least = np.float32(1.0 - parameters.decay), np.float32(0.5 * weakest)
        self._observed, self._log_odds = _read_only(grids.observed), _read_only(grids.log_odds)
        self._columns, self._lattice = lattice.columns, lattice
        self._robots = np.arange(count, dtype=np.int32)  # their rows
        self._shown = memory.zeros((count, lattice.rows * lattice.columns), np.uint8)  # the states last reported
        self._rewritten = False  # whether maps have since changed other than by readings
        #: Of the last `hear`: own tiles, whether changes were looked for everywhere, whether all heard was taken in.
        self._how: tuple[Tiles, bool, bool] | None = None
        nobody = np.empty(0, np.int32)
        nothing = PlainTiles(np.empty((0, 0, 0), np.uint8), np.empty((0, 2), np.int32), nobody, nobody)
        #: The robots' knowledge, as `hear` gave it last.
        self.maps = self._maps(
            np.empty((0, 3), np.int32), np.zeros(count, np.int32), Inbox(nobody, nobody, nobody, nothing)
        )

    @property
    def codec(self) -> Codec[TileItems]:
        """The sharing policy's."""
        return self._sharing.codec

    def say(self, senses: Senses) -> Broadcast[TileItems]:
        """The sharing policy's messages."""
        return self._sharing.say(senses, self.maps if registry.is_ours(self._sharing) else lent(self.maps))

    def hear(self, senses: Senses, inbox: Inbox[TileItems]) -> Maps:
        """Map own tiles, then those heard."""
        tiles, alive = tiles_of(senses), senses.alive
        accepted = self._sharing.accepted(senses, inbox)
        self._forget_hearsay()
        if self._forgets:
            known, log_odds = (grid.reshape(len(alive), -1) for grid in (self._grids.observed, self._grids.log_odds))
            occupancy.fade(log_odds, known, alive, self._kept, self._least)
        if self._spared:
            tiles, accepted = self._without_robots(tiles, accepted, senses.iteration)
        fresh = self._grids.update(alive, tiles, accepted)
        new_cells = fresh[: len(alive)].copy()
        np.add.at(new_cells, accepted.receivers, fresh[len(new_cells) :])
        self._how = tiles, self._forgets or self._rewritten, accepted is inbox
        self.maps = self._maps(self._changes(tiles, accepted), new_cells, accepted)
        return self.maps

    def report(self, knowledge: Maps) -> Report:
        """The changes of its only robot's map, and what it took in. Raises RuntimeError before it has heard."""
        if self._how is None:
            raise RuntimeError("a report of a robot that has not heard yet")
        return reporting.told(knowledge, *self._how, self._columns)

    def combined(self, row: int, before: Report, came: Sequence[Report]) -> Report:
        """One report for those of a robot that came in an iteration."""
        return reporting.combined(before, came)

    def adopt(self, reports: Sequence[Report], inbox: Inbox[TileItems]) -> Maps:
        """The maps that reports make; of log-odds they have the signs. Raises FrameError."""
        shape, observed = self._shown.shape, self._grids.observed.reshape(self._shown.shape)
        changes = reporting.changes_of(reports, shape[1], self._rewritten)
        reporting.write(changes, observed, self._grids.log_odds.reshape(shape))
        if self._rewritten:  # a robot that began anew does not tell what it knew before
            changes = reporting.with_forgotten(changes, self._shown, observed)
        self._rewritten = False
        self._shown[changes[:, 0], changes[:, 1]] = changes[:, 2]
        reporting.take_frames(reports, self._frames)
        new_cells = np.array([report[reporting.HEAD][1] for report in reports], np.int32)
        self.maps = self._maps(changes, new_cells, reporting.accepted_of(reports, inbox))
        return self.maps

    def _without_robots(self, tiles: Tiles, accepted: Inbox[TileItems], now: int) -> tuple[Tiles, Inbox[TileItems]]:
        """The same without hits on robots at known places."""
        values, heard = tiles.values.copy(), accepted.content.values.copy()
        fresh: NDArray[np.bool_] = (accepted.content.sensed == now) & (accepted.content.sources >= 0)
        occupancy.spare(
            values, tiles.origins, accepted.receivers, heard, accepted.content.origins, fresh, self._spared
        )  # fmt: skip
        return replace(tiles, values=values), replace(accepted, content=replace(accepted.content, values=heard))

    def places(self, items: TileItems, sender: int) -> NDArray[np.float64]:
        """The middle of the tiles (p, 2) that the sender sensed itself, up to half a cell from where it was."""
        own = items.take(np.flatnonzero(items.sources == sender))
        return self._lattice.centres(own.origins) + 0.5 * self._lattice.cell * (np.array(own.values.shape[:0:-1]) - 1)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Empty the maps of robots (r,)."""
        self._grids.reset(robots)
        self._rewritten = True

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give robots (r,) the map of another one."""
        self._grids.copy_from(robots, source)
        self._rewritten = True

    def amounts(self) -> NDArray[np.int64]:
        """How many cells each robot's map holds (n,)."""
        return np.asarray(np.count_nonzero(self._observed, axis=(1, 2)))

    @property
    def _frames(self) -> Frames | None:
        """What robots know of each other's frames of reference; most policies need none."""
        frames: Frames | None = getattr(self._sharing, "frames", None)
        return frames

    def _forget_hearsay(self) -> None:
        """Let robots that may have put it in wrong places forget what they heard."""
        frames = self._frames
        if frames is not None and frames.spoilt.any():
            self._grids.keep(np.flatnonzero(frames.spoilt), frames.sensed)
            self._rewritten = True

    def _maps(self, changes: NDArray[np.int32], new_cells: NDArray[np.int32], accepted: Inbox[TileItems]) -> Maps:
        frames = self._frames
        views = None if frames is None else frames.views()
        return Maps(self._observed, self._log_odds, changes, new_cells, accepted, views)

    def _changes(self, tiles: Tiles, accepted: Inbox[TileItems]) -> NDArray[np.int32]:
        """The cells whose state differs from that last reported: under tiles or, if need be, everywhere."""
        shown = self._shown
        log_odds, observed = self._grids.log_odds.reshape(shown.shape), self._grids.observed.reshape(shown.shape)
        if self._forgets or self._rewritten:
            self._rewritten = False
            found = np.empty((shown.size, 3), np.int32)
            count = occupancy.changes_anywhere(log_odds, observed, shown, found)
        else:
            shape = tiles.values.shape[1:]
            found = np.empty(((len(self._robots) + len(accepted)) * shape[0] * shape[1] + 1, 3), np.int32)
            count = occupancy.changes_under(
                log_odds, observed, shown, self._robots, tiles.origins, accepted.receivers, accepted.content.origins,
                shape, self._columns, found,
            )  # fmt: skip
        return found[:count].copy()


S = TypeVar("S", bound=np.generic)


def _read_only(grids: NDArray[S]) -> NDArray[S]:
    view = grids.view()
    view.flags.writeable = False
    return view


def logit(probability: float) -> float:
    """The log-odds of a probability."""
    return math.log(probability / (1.0 - probability))
