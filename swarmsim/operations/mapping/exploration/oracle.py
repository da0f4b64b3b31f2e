"""What one planner that hears everything at once could do: a yardstick for rules, not a rule for a swarm."""

from __future__ import annotations

from typing import Annotated, Final, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.state import Intents, Senses
from swarmsim.kernels import decide, frontier_costs, search
from swarmsim.operations.mapping.exploration.nearest import NearestFrontier, Patience, PlannedStrategy
from swarmsim.operations.mapping.exploration.rules import NO_WAY, Cells, Weight, shared_out
from swarmsim.operations.mapping.exploration.strategy import latest_tiles
from swarmsim.operations.mapping.maps import Maps
from swarmsim.operations.mapping.sharing.codecs import GoalItems
from swarmsim.operations.mapping.sharing.policies import decided_goals, tiles_of

SALT: Final = np.uint64(1)  # one order of equally near frontiers for all


class OracleFrontier(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One planner for all robots at once: a yardstick, not a rule for a swarm.

    With `network.topology = {use = "full"}`, a perfect channel and the sharing `tile-and-goal` all robots have the same
    map and hear all places and goals in every iteration, so that each makes the same plan of all and follows its own
    part: what can be had while only the building is unknown.

    The price of a piece of frontier to a robot is its way there plus `weight` exp(-way / reach), with the way of the
    nearest of the others. Of all plans that give each robot a piece of its own the cheapest is taken, found as in
    `assigned-frontier`; robots that are left over go where their price is lowest. All is planned anew in every
    iteration.
    """

    neighbours: Literal[4, 8] = 8  # of a cell, for paths
    patience: Patience = None  # iterations without progress; default: 4 cells' time
    grain: Annotated[int, Meta(ge=1, le=1_000_000)] = 7  # cells: frontiers are cut at the lines of such a grid
    weight: Weight = 20.0  # cells
    reach: Cells = 15.0  # cells
    stays: Weight = 3.0  # cells that a robot's present goal counts as nearer

    def build(self, context: BuildContext) -> OracleStrategy:
        """The plans of a whole swarm."""
        return OracleStrategy(self, context)


class OracleStrategy(PlannedStrategy):
    """Each robot plans for all robots that it hears, and follows its own part of the plan."""

    def __init__(self, parameters: OracleFrontier, context: BuildContext) -> None:
        super().__init__(
            NearestFrontier(replan="every-iteration", neighbours=parameters.neighbours, patience=parameters.patience),
            context,
        )
        self._parameters, self._shape, self._ids = parameters, context.lattice.shape, context.ids.tolist()
        self._ground = frontier_costs.ground(*self._shape)
        self._made: dict[tuple[bytes, ...], list[tuple[int, int]]] = {}

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], maps: Maps) -> Intents:
        now, plans, rules = senses.iteration + 1, self._plans, self._rules
        grids = search.Maps(maps.log_odds, maps.observed, self._barred, self._shunned)
        here, chooses, stuck, draws, _ = decide.look(
            now, senses.pose, senses.alive, maps.new_cells, grids, plans, self._patrol, rules, self._salts,
            self._scratch,
        )  # fmt: skip
        self._made.clear()
        tiles, heard = tiles_of(senses), latest_tiles(maps.accepted)
        half = np.array(tiles.values.shape[1:]) // 2
        own, others = self._cells(tiles.origins + half), self._cells(heard.content.origins + half)
        goals = self._cells(decided_goals(senses, self._lattice)[0])
        content = heard.content
        if not isinstance(content, GoalItems):
            raise InputError(
                "mind.strategy.use: oracle-frontier needs to hear where others go; expected "
                "mind.computation.sharing.use = 'tile-and-goal', or 'gossip' with goals = true"
            )
        theirs = self._cells(content.goals)
        starts = np.searchsorted(heard.receivers, np.arange(len(here) + 1))
        for i in np.flatnonzero(chooses).tolist():
            mine = slice(starts[i], starts[i + 1])
            ids = np.append(content.sources[mine], self._ids[i])
            order = np.argsort(ids)
            place = int(np.flatnonzero(order == len(ids) - 1)[0])
            cells, going = np.append(others[mine], own[i])[order], np.append(theirs[mine], goals[i])[order]
            goal, stand = self._parts(i, now, grids, cells, going)[place]
            if stand < 0:
                decide.stay(now, i, here[i], stuck[i], draws[i], grids, plans, rules)
                continue
            decide.go(now, i, here[i], goal, stand, grids, plans, rules, self._scratch)
        return self._intents()

    def _cells(self, where: NDArray[np.int32]) -> NDArray[np.int32]:
        """The cells at these rows and columns (n, 2), those beyond the grid moved to its edge; -1 for -1."""
        cells = np.clip(where, 0, np.subtract(self._shape, 1)) @ (self._columns, 1)
        return np.where(where[:, 0] < 0, -1, cells).astype(np.int32)

    def _parts(
        self, i: int, now: int, grids: search.Maps, cells: NDArray[np.int32], going: NDArray[np.int32]
    ) -> list[tuple[int, int]]:
        """By robot i's map, for each robot at `cells` (n,), `going` (n,) there: what to explore, and where from."""
        known = (grids.observed[i], grids.log_odds[i] < 0.0, grids.barred[i] > now, grids.shunned[i] > now)
        key = (cells.tobytes(), going.tobytes(), *(np.packbits(one).tobytes() for one in known))
        if key not in self._made:
            self._made[key] = self._plan(i, now, grids, cells, going)
        return self._made[key]

    def _plan(
        self, i: int, now: int, grids: search.Maps, cells: NDArray[np.int32], going: NDArray[np.int32]
    ) -> list[tuple[int, int]]:
        keys, labels, nobody = self._parameters, self._ground.piece, cells[:0]
        pieces = [
            frontier_costs.survey(grids, i, now, self._rules, cell, nobody, -1, keys.grain, 0, SALT, self._ground)
            for cell in cells
        ]
        ways = np.full((len(cells), int(labels.max()) + 1), NO_WAY)
        goals, stands = np.full((2, *ways.shape), -1, np.int32)
        for robot, found in enumerate(pieces):
            which = labels[found.goals]
            ways[robot, which] = found.costs[0] / frontier_costs.STRAIGHT
            goals[robot, which], stands[robot, which] = found.goals, found.stands
        here = np.arange(len(cells))
        ways[here, np.where(going < 0, 0, labels[going])] -= keys.stays  # column 0 is no piece
        if ways.shape[1] == 1:
            return [(-1, -1)] * len(cells)
        chosen = 1 + shared_out(ways[:, 1:], keys.weight, keys.reach)
        return list(zip(goals[here, chosen].tolist(), stands[here, chosen].tolist(), strict=True))
