"""Robots that explore by a rule: they keep, drop and follow plans like robots that walk to the nearest frontier."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.state import Intents, Senses
from swarmsim.kernels import decide, frontier_costs, search
from swarmsim.operations.mapping.exploration.nearest import NearestFrontier, Patience, PlannedStrategy
from swarmsim.operations.mapping.maps import Maps, TileItems
from swarmsim.operations.mapping.sharing.codecs import GoalItems
from swarmsim.operations.mapping.sharing.policies import tiles_of

Grain = Annotated[int, Meta(ge=1, le=1_000_000)] | None


@dataclass(frozen=True, slots=True, eq=False)
class Others:
    """The robots that a robot hears, by their latest tiles."""

    ids: NDArray[np.int32]  # (h,)
    goals: NDArray[np.int32] | None  # (h, 2): row and column of what they go to explore, -1 for none; None: not told
    left: NDArray[np.float64] | None  # (h,): cells left of their way there


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """One robot's choices: pieces of frontier, nearest first; at least one."""

    id: int  # the robot's number
    goals: NDArray[np.int32]  # (p, 2): row and column of the nearest cell of each piece
    ways: NDArray[np.float64]  # (1 + h, p): cells from the robot, then from each it hears; inf where it knows no way
    sizes: NDArray[np.int32]  # (p,): cells of each piece
    unknown: NDArray[np.float64]  # (p,): unknown share of the disc within the sensor's reach of the goal
    present: int  # the piece that the robot was going for, -1 for none
    others: Others
    random: np.random.Generator  # the robot's own
    descend: Callable[[float], int]  # the piece at which a walk down the potential ends, see `PotentialField`

    @property
    def own(self) -> NDArray[np.float64]:
        """Cells from the robot to each piece (p,)."""
        return np.asarray(self.ways[0])

    def announced(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The straight distance in cells of each announced goal from each piece (g, p), and the ways left (g,).

        Raises InputError if robots do not tell their goals.
        """
        others = self.others
        if others.goals is None or others.left is None:
            raise InputError(
                "mind.strategy.use: this strategy needs to hear where others go; expected "
                "mind.computation.sharing.use = 'tile-and-goal', or 'gossip' with goals = true"
            )
        has = others.goals[:, 0] >= 0
        apart = others.goals[has, None, :] - self.goals[None]
        return np.asarray(np.hypot(apart[..., 0], apart[..., 1])), others.left[has]


class Exploring(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys that all rules share: when they are called, and how a robot that follows one moves."""

    replan: Literal["on-arrival", "every-iteration"] = "on-arrival"
    neighbours: Literal[4, 8] = 8  # of a cell, for paths
    patience: Patience = None  # iterations without progress; default: 4 cells' time
    grain: Grain = 7  # cells: frontiers are cut at the lines of such a grid; None: they are not

    @property
    def needs_others(self) -> bool:
        """Whether it needs the others' ways, which take a while to compute."""
        return True

    @property
    def keeps_ways(self) -> bool:
        """Whether robots walk to the end of a way whose frontier others have explored meanwhile."""
        return False

    @abstractmethod
    def choose(self, candidates: Candidates) -> int:
        """The piece to explore."""

    def build(self, context: BuildContext) -> ExploringStrategy:
        """The plans of a whole swarm."""
        return ExploringStrategy(self, context)


class ExploringStrategy(PlannedStrategy):
    """The plans of a swarm whose robots choose by one rule."""

    def __init__(self, rule: Exploring, context: BuildContext) -> None:
        movement = NearestFrontier(replan=rule.replan, neighbours=rule.neighbours, patience=rule.patience)
        super().__init__(movement, context)
        self._rule, self._shape = rule, context.lattice.shape
        self._ground = frontier_costs.ground(*self._shape)
        self._grain = rule.grain or max(self._shape)
        self._ids, self._random = context.ids.tolist(), context.own_streams("explore")

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], maps: Maps) -> Intents:
        now, plans, rules = senses.iteration + 1, self._plans, self._rules
        grids = search.Maps(maps.log_odds, maps.observed, self._barred, self._shunned)
        if self._rule.keeps_ways:
            self._keep_ways(grids)
        here, chooses, stuck, draws, before = decide.look(
            now, senses.pose, senses.alive, maps.new_cells, grids, plans, self._patrol, rules, self._salts,
            self._scratch,
        )  # fmt: skip
        height, width = tiles_of(senses).values.shape[1:]
        heard = latest_tiles(maps.accepted)
        starts = np.searchsorted(heard.receivers, np.arange(len(here) + 1))
        middles = np.clip(np.add(heard.content.origins, (height // 2, width // 2)), 0, np.subtract(self._shape, 1))
        cells = (middles @ (self._columns, 1)).astype(np.int32)
        reach = min(height, width) // 2
        disc = frontier_costs.disc(reach)
        for i in np.flatnonzero(chooses).tolist():
            mine = slice(starts[i], starts[i + 1])
            others = cells[mine] if self._rule.needs_others else cells[:0]
            at = (grids, i, now, rules, here[i])
            found = frontier_costs.survey(*at, others, before[i], self._grain, reach, self._tie_salts[i], self._ground)
            if not len(found.goals):
                decide.stay(now, i, here[i], stuck[i], draws[i], grids, plans, rules)
                continue
            candidates = Candidates(
                id=self._ids[i],
                goals=np.stack(np.divmod(found.goals, self._columns), axis=1).astype(np.int32),
                ways=np.where(found.costs == frontier_costs.FAR, np.inf, found.costs / frontier_costs.STRAIGHT),
                sizes=found.sizes,
                unknown=found.unknown / disc,
                present=found.present,
                others=_others(heard, mine),
                random=self._random[i],
                descend=_Descent(at, others, found, self._ground),
            )
            chosen = self._rule.choose(candidates)
            decide.go(now, i, here[i], found.goals[chosen], found.stands[chosen], grids, plans, rules, self._scratch)
        return self._intents()

    def _keep_ways(self, grids: search.Maps) -> None:
        """Make goals that are no frontiers any more mere ways, which robots walk to their ends."""
        goals = self._plans.goal
        for i in np.flatnonzero(goals >= 0).tolist():
            if not search.is_frontier(grids, i, *divmod(int(goals[i]), self._columns)):
                goals[i] = -1


@dataclass(frozen=True, slots=True, eq=False)
class _Descent:
    """A walk down the potential of `choosing.PotentialField`, from where one robot is."""

    at: tuple[Any, ...]
    others: NDArray[np.int32]
    found: frontier_costs.Found
    ground: frontier_costs.Ground

    def __call__(self, reach: float) -> int:
        """The piece at which it ends; robots within `reach` cells push."""
        return int(frontier_costs.descend(*self.at, self.others, self.found, reach, self.ground))


def latest_tiles(inbox: Inbox[TileItems]) -> Inbox[TileItems]:
    """The latest tile heard of each robot, sorted by receiver and by the robot that sensed it."""
    items = inbox.content
    order = np.lexsort((items.sensed, items.sources, inbox.receivers))
    order = order[items.sources[order] >= 0]
    receivers, sources = inbox.receivers[order], items.sources[order]
    last: NDArray[np.bool_] = np.append((receivers[1:] != receivers[:-1]) | (sources[1:] != sources[:-1]), True)[
        : len(order)
    ]
    return inbox.take(order[last])


def _others(heard: Inbox[TileItems], mine: slice) -> Others:
    content = heard.content
    if not isinstance(content, GoalItems):
        return Others(content.sources[mine], None, None)
    return Others(content.sources[mine], content.goals[mine], content.left[mine].astype(np.float64))
