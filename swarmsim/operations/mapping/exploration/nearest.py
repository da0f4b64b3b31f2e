"""The control strategy of collective mapping: each robot walks to the nearest frontier of its map.

Lines 6 to 8 of Algorithm 1 of Kit, Mateo and Bouffanais, "A Decentralized Mobile Computing Network for
Multi-Robot Systems Operations" (2018), with each choice that it leaves open as a parameter.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import memory
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.state import Intents, Knowledge, Senses
from swarmsim.kernels import decide, occupancy, scratch, search
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.sharing.policies import tiles_of

Patience = Annotated[int, Meta(ge=1, le=1_000_000)] | None


class NearestFrontier(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks to the frontier of its map that is nearest by path length (Yamauchi 1997), by A*."""

    replan: Literal["on-arrival", "every-iteration"] = "on-arrival"
    ties: Literal["own-order", "row-order"] = "own-order"  # between frontiers equally near
    neighbours: Literal[4, 8] = 8  # of a cell, for paths
    patience: Patience = None  # iterations without progress; default: 4 cells' time
    idle: Literal["stand", "patrol"] = "stand"  # without a frontier: patrol goes to long unseen places
    search: Annotated[int, Meta(ge=1)] | None = None  # cells settled in one iteration, at most; None: all that it takes

    def build(self, context: BuildContext) -> FrontierStrategy:
        """The plans of a whole swarm. Raises InputError for robots that patrol and search with a bound."""
        if self.search is not None and self.idle == "patrol":
            raise InputError('search: robots that patrol search all that they can reach; expected idle = "stand"')
        return FrontierStrategy(self, context)


class PlannedStrategy(ABC):
    """One goal and path per robot; `kernels.decide.decide` lists the rules."""

    requires_knowledge: type[Knowledge] = Maps

    def __init__(self, parameters: NearestFrontier, context: BuildContext) -> None:
        robots, lattice = context.robots, context.lattice
        count, cells = len(context.ids), lattice.rows * lattice.columns
        self._barred, self._shunned = (memory.zeros((count, *lattice.shape), np.int32) for _ in range(2))
        self._plans = decide.Plans(
            goal=np.full(count, -1, np.int32),
            path=memory.zeros((count, cells), np.int32),
            steps=np.zeros(count, np.int32),
            cursor=np.zeros(count, np.int32),
            anchor=np.zeros((count, 2)),
            waited=np.zeros(count, np.int32),
            idle=np.zeros(count, np.int32),
            planned=np.zeros(count, np.bool_),
        )
        patrolled = lattice.shape if parameters.idle == "patrol" else (0, 0)
        self._patrol = search.Patrol(memory.zeros((count, *patrolled), np.int32), np.zeros(count, np.int32))
        per_iteration = robots.speed * context.period / lattice.cell  # cells, of the fastest
        slowest = robots.least("speed") * context.period / lattice.cell
        footprint = search.footprint(robots.radius / lattice.cell)
        self._rules = search.Rules(
            lattice.x0,
            lattice.y0,
            lattice.cell,
            footprint,
            int(np.abs(footprint).max()),
            parameters.neighbours,
            parameters.replan == "on-arrival",
            parameters.patience or max(4, math.ceil(4.0 / slowest)),
            math.ceil(per_iteration) + 3,
            parameters.search is not None,
        )
        self._scratch = scratch.working_memory(cells)
        self._salts = salts(context, "unstick")
        self._tie_salts = salts(context, "ties")
        if parameters.ties == "row-order":
            self._tie_salts[:] = 0
        self._lattice, self._columns = lattice, lattice.columns
        self._corner = np.array([lattice.x0, lattice.y0])

    @abstractmethod
    def step(self, senses: Senses, inbox: Inbox[MessageBatch], maps: Maps) -> Intents:
        """Choose goals and paths."""

    def _intents(self) -> Intents:
        """The plans as they are now."""
        plans = self._plans
        longest = int((plans.steps - plans.cursor).max(initial=0)) + 1
        waypoints = np.zeros((len(plans.steps), longest, 2))
        counts = decide.way_ahead(plans, self._rules, self._columns, waypoints)
        goals = np.empty((len(plans.goal), 2))  # the centres of cells, as from Lattice.centres
        goals[:, 1], goals[:, 0] = np.divmod(plans.goal, self._columns)
        goals += 0.5
        goals *= self._lattice.cell
        goals += self._corner
        goals[plans.goal < 0] = np.nan
        return Intents(goals, waypoints, counts, plans.planned.copy())


class FrontierStrategy(PlannedStrategy):
    """Robots walk to the nearest frontier."""

    def __init__(self, parameters: NearestFrontier, context: BuildContext) -> None:
        super().__init__(parameters, context)
        self._most = parameters.search
        if self._most is not None:  # a search that goes on needs memory of its own
            self._scratches = [scratch.working_memory(context.lattice.rows * self._columns) for _ in context.ids]

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], maps: Maps) -> Intents:
        if self._patrol.seen.size:
            self._see(senses, maps)
        if self._most is None:
            self._decide(senses, maps, slice(None), self._scratch)
        else:
            for row, work in enumerate(self._scratches):
                work.left[0] = self._most
                self._decide(senses, maps, slice(row, row + 1), work)
        return self._intents()

    def _decide(self, senses: Senses, maps: Maps, rows: slice, work: scratch.Scratch) -> None:
        """Let the robots of some rows decide."""
        decide.decide(
            senses.iteration + 1,  # counts from 1 here: 0 in `barred` and `shunned` means never
            senses.pose[rows],
            senses.alive[rows],
            maps.new_cells[rows],
            search.Maps(maps.log_odds[rows], maps.observed[rows], self._barred[rows], self._shunned[rows]),
            decide.Plans._make(column[rows] for column in self._plans),
            search.Patrol(*(column[rows] for column in self._patrol)),
            self._rules,
            self._salts[rows],
            self._tie_salts[rows],
            work,
        )

    def _see(self, senses: Senses, maps: Maps) -> None:
        """Note which cells were seen when."""
        tiles, accepted = tiles_of(senses), maps.accepted
        occupancy.see(
            self._patrol.seen,
            senses.iteration + 1,
            senses.alive,
            tiles.values,
            tiles.origins,
            accepted.receivers,
            accepted.content.values,
            accepted.content.origins,
            accepted.content.sources,
            accepted.content.sensed,
        )


def salts(context: BuildContext, purpose: str) -> NDArray[np.uint64]:
    """One random number per robot, never 0."""
    return np.array([stream.integers(1, 2**63) for stream in context.own_streams(purpose)], np.uint64)
