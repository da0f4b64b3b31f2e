"""Collective mapping: everybody maps its own and its neighbours' tiles and walks to the nearest frontier.

This is Algorithm 1 of Kit, Mateo and Bouffanais, "A Decentralized Mobile Computing Network for
Multi-Robot Systems Operations" (2018), with each choice that it leaves open as a parameter.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.behaviours.mapping import OccupancyGrids
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Setting
from swarmsim.core.state import Intents, Observations
from swarmsim.kernels import grid

Probability = Annotated[float, Meta(gt=0.0, lt=1.0)]


class CollectiveMapping(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Occupancy grids by log-odds, nearest frontier by path length, A*.

    The increments are the log-odds of `hit` and `miss`: the probability that a cell is occupied, given
    that one beam ended in it or that all beams passed. A beam that ends proves matter, a passing one only
    its own line, so a hit outweighs several misses. The log-odds stay between those of `lowest` and
    `highest`.
    """

    replan: Literal["on-arrival", "every-iteration"] = "on-arrival"
    ties: Literal["own-order", "row-order"] = "own-order"  # between frontiers equally near
    neighbours: Literal[4, 8] = 8  # of a cell, for paths
    patience: Annotated[int, Meta(ge=1)] | None = None  # iterations without progress; default: 4 cells' time
    hit: Probability = 0.9
    miss: Probability = 0.4
    lowest: Probability = 0.12
    highest: Probability = 0.97

    def build(self, setting: Setting) -> CollectiveMappers:
        """The minds of a whole swarm."""
        if not self.lowest < self.miss < 0.5 < self.hit < self.highest:
            raise InputError(
                f"hit: expected lowest < miss < 0.5 < hit < highest, got "
                f"{self.lowest:g}, {self.miss:g}, {self.hit:g}, {self.highest:g}"
            )
        return CollectiveMappers(self, setting)


class CollectiveMappers:
    """One occupancy grid, goal and path per robot; the rules stand at `kernels.grid.decide`."""

    def __init__(self, parameters: CollectiveMapping, setting: Setting) -> None:
        robots, lattice = setting.robots, setting.lattice
        count, cells = robots.count, lattice.rows * lattice.columns
        self._grids = OccupancyGrids(
            count, lattice, parameters.hit, parameters.miss, parameters.lowest, parameters.highest
        )
        self._maps = grid.Maps(
            self._grids.log_odds,
            self._grids.observed,
            np.zeros((count, *lattice.shape), np.int32),
            np.zeros((count, *lattice.shape), np.int32),
        )
        self._plans = grid.Plans(
            goal=np.full(count, -1, np.int32),
            path=np.zeros((count, cells), np.int32),
            steps=np.zeros(count, np.int32),
            cursor=np.zeros(count, np.int32),
            anchor=np.zeros((count, 2)),
            waited=np.zeros(count, np.int32),
            idle=np.zeros(count, np.int32),
            planned=np.zeros(count, np.bool_),
        )
        per_iteration = robots.speed * setting.period / lattice.cell  # cells
        footprint = _footprint(robots.radius / lattice.cell)
        self._rules = grid.Rules(
            lattice.x0,
            lattice.y0,
            lattice.cell,
            footprint,
            int(np.abs(footprint).max()),
            parameters.neighbours,
            parameters.replan == "on-arrival",
            parameters.patience or max(4, math.ceil(4.0 / per_iteration)),
            math.ceil(per_iteration) + 3,
        )
        self._scratch = grid.scratch(cells)
        self._salts = _salts(setting, "unstick", count)
        self._tie_salts = _salts(setting, "ties", count)
        if parameters.ties == "row-order":
            self._tie_salts[:] = 0
        self._columns = lattice.columns

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which cells each robot's map holds (n, rows, columns); a live view."""
        return self._grids.observed

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """Each robot's occupancy grid (n, rows, columns); a live view."""
        return self._grids.log_odds

    @property
    def forgets(self) -> bool:
        """Maps change under the tiles sensed and heard alone."""
        return False

    def step(self, observations: Observations) -> Intents:
        """Map what was sensed and heard, then choose goals and paths."""
        fresh = self._grids.update(observations.alive, observations.tiles, observations.inbox)
        news = fresh[: len(observations.alive)].copy()
        np.add.at(news, observations.inbox.receivers, fresh[len(news) :])
        plans = self._plans
        # The iteration counts from 1 here: 0 in `barred` and `shunned` means never.
        grid.decide(
            observations.iteration + 1,
            observations.pose,
            observations.alive,
            news,
            self._maps,
            plans,
            self._rules,
            self._salts,
            self._tie_salts,
            self._scratch,
        )
        longest = int((plans.steps - plans.cursor).max(initial=0)) + 1
        waypoints = np.zeros((len(plans.steps), longest, 2))
        counts = grid.way_ahead(plans, self._rules, self._columns, waypoints)
        goals = np.stack([plans.goal // self._columns, plans.goal % self._columns], axis=1).astype(np.int32)
        goals[plans.goal < 0] = -1
        return Intents(goals, waypoints, counts, plans.planned.copy())


def _salts(setting: Setting, purpose: str, count: int) -> NDArray[np.uint64]:
    """One random number of each robot's own, never 0."""
    streams = (setting.streams.open(purpose, robot) for robot in range(count))
    return np.array([stream.integers(1, 2**63) for stream in streams], np.uint64)


def _footprint(radius: float) -> NDArray[np.int32]:
    """Offsets (f, 2) of the cells that a disc of `radius` cells, centred in a cell, overlaps."""
    reach = math.ceil(max(radius - 0.5, 0.0))
    offsets = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, -1).T - reach
    gap = np.maximum(np.abs(offsets) - 0.5, 0.0)  # from the centre to the nearest point of each cell
    under = offsets[np.hypot(gap[:, 0], gap[:, 1]) < max(radius, 0.5)]
    return np.ascontiguousarray(under[np.argsort(np.hypot(under[:, 0], under[:, 1]), kind="stable")], np.int32)
