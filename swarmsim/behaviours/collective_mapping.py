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

from swarmsim.behaviours.mapping import OccupancyGrids, WaryGrids
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Setting
from swarmsim.core.state import Intents, Observations
from swarmsim.kernels import grid, occupancy

Probability = Annotated[float, Meta(gt=0.0, lt=1.0)]


class CollectiveMapping(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Occupancy grids by log-odds, nearest frontier by path length, A*.

    The increments are the log-odds of `hit` and `miss`: the probability that a cell is occupied, given
    that one beam ended in it or that all beams passed. A beam that ends proves matter, a passing one only
    its own line, so a hit outweighs several misses. The log-odds stay between those of `lowest` and
    `highest`, which bounds what has to be unlearned when the world changes: a wall that is gone is free again after
    more than logit(highest) / -logit(miss) misses, 9 by default, and a new one is a wall after one hit.

    With a `decay` every map loses that share of its log-odds in each iteration, and a cell whose log-odds have
    fallen below half of one observation's, min(logit(hit), -logit(miss)) / 2, becomes unknown again, hence a frontier.
    A cell last left at log-odds l is forgotten ln(2 |l| / that observation's) / -ln(1 - decay) iterations later: for
    what is free beyond doubt that is 2.3 / decay by default, for a wall 2.8 / decay. Equal clamps, logit(highest) =
    -logit(lowest), make both equally long. A robot that does not live forgets nothing.

    `trust` is the defence against robots that lie. With "own" a robot's own sensing voids, for good, what it hears of
    a cell; with "quorum", besides, what it hears of others counts only once `quorum` different senders have said the
    same.
    """

    replan: Literal["on-arrival", "every-iteration"] = "on-arrival"
    ties: Literal["own-order", "row-order"] = "own-order"  # between frontiers equally near
    neighbours: Literal[4, 8] = 8  # of a cell, for paths
    patience: Annotated[int, Meta(ge=1)] | None = None  # iterations without progress; default: 4 cells' time
    hit: Probability = 0.9
    miss: Probability = 0.4
    lowest: Probability = 0.12
    highest: Probability = 0.97
    decay: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0  # share of the log-odds lost per iteration; 0 never forgets
    idle: Literal["stand", "patrol"] = "stand"  # without a frontier: patrol goes where nobody looked for long
    trust: Literal["all", "own", "quorum"] = "all"  # own: what it hears changes no cell that a robot has sensed itself
    quorum: Annotated[int, Meta(ge=2, le=64)] | None = None  # for trust = "quorum": senders who must agree; default 2

    def build(self, setting: Setting) -> CollectiveMappers:
        """The minds of a whole swarm."""
        if not self.lowest < self.miss < 0.5 < self.hit < self.highest:
            raise InputError(
                f"hit: expected lowest < miss < 0.5 < hit < highest, got "
                f"{self.lowest:g}, {self.miss:g}, {self.hit:g}, {self.highest:g}"
            )
        if self.quorum is not None and self.trust != "quorum":
            raise InputError(f"quorum: robots with trust {self.trust!r} need none; expected trust = 'quorum'")
        others = setting.robots.count - 1
        if self.trust == "quorum" and (self.quorum or 2) > others:
            raise InputError(f"quorum: {self.quorum or 2} of {others} others never agree; expected {others} at most")
        return CollectiveMappers(self, setting)


class CollectiveMappers:
    """One occupancy grid, goal and path per robot; the rules stand at `kernels.grid.decide`."""

    def __init__(self, parameters: CollectiveMapping, setting: Setting) -> None:
        robots, lattice = setting.robots, setting.lattice
        count, cells = robots.count, lattice.rows * lattice.columns
        grids = OccupancyGrids(count, lattice, parameters.hit, parameters.miss, parameters.lowest, parameters.highest)
        quorum = parameters.quorum or 2 if parameters.trust == "quorum" else 1
        self._grids = grids if parameters.trust == "all" else WaryGrids(grids, quorum)
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
        patrolled = lattice.shape if parameters.idle == "patrol" else (0, 0)
        self._patrol = grid.Patrol(np.zeros((count, *patrolled), np.int32), np.zeros(count, np.int32))
        weakest = min(_logit(parameters.hit), -_logit(parameters.miss))
        self._kept, self._least = np.float32(1.0 - parameters.decay), np.float32(0.5 * weakest)
        per_iteration = robots.speed * setting.period / lattice.cell  # cells
        footprint = grid.footprint(robots.radius / lattice.cell)
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
        """Whether maps change elsewhere than under the tiles sensed and heard."""
        return bool(self._kept < 1.0)

    def step(self, observations: Observations) -> Intents:
        """Map what was sensed and heard, then choose goals and paths."""
        if self.forgets:
            rows = (len(observations.alive), -1)
            known, log_odds = self._grids.observed.reshape(rows), self._grids.log_odds.reshape(rows)
            occupancy.fade(log_odds, known, observations.alive, self._kept, self._least)
        fresh = self._grids.update(observations.alive, observations.tiles, observations.inbox)
        news = fresh[: len(observations.alive)].copy()
        np.add.at(news, observations.inbox.receivers, fresh[len(news) :])
        plans = self._plans
        if self._patrol.seen.size:
            self._see(observations)
        # The iteration counts from 1 here: 0 in `barred` and `shunned` means never.
        grid.decide(
            observations.iteration + 1,
            observations.pose,
            observations.alive,
            news,
            self._maps,
            plans,
            self._patrol,
            self._rules,
            self._salts,
            self._tie_salts,
            self._scratch,
        )
        longest = int((plans.steps - plans.cursor).max(initial=0)) + 1
        waypoints = np.zeros((len(plans.steps), longest, 2))
        counts = grid.way_ahead(plans, self._rules, self._columns, waypoints)
        goals = np.empty((len(plans.goal), 2), np.int32)
        np.divmod(plans.goal, self._columns, out=(goals[:, 0], goals[:, 1]))
        goals[plans.goal < 0] = -1
        return Intents(goals, waypoints, counts, plans.planned.copy())

    def _see(self, observations: Observations) -> None:
        """Note which cells were seen when."""
        tiles, inbox = observations.tiles, observations.inbox
        occupancy.see(
            self._patrol.seen,
            observations.iteration + 1,
            observations.alive,
            tiles.values,
            tiles.origins,
            inbox.receivers,
            inbox.values,
            inbox.origins,
            inbox.sources,
            inbox.sensed,
        )


def _logit(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _salts(setting: Setting, purpose: str, count: int) -> NDArray[np.uint64]:
    """One random number of each robot's own, never 0."""
    streams = (setting.streams.open(purpose, robot) for robot in range(count))
    return np.array([stream.integers(1, 2**63) for stream in streams], np.uint64)
