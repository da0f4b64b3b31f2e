"""Which frontier to explore: rules from the literature, each a few lines over what one robot can choose from.

Every rule sees the pieces of frontier that its robot can reach, nearest first, and what it has heard of others. Each
names what it needs of them beyond their tiles, and how many bytes that takes. Between equal pieces the nearer wins, and
between equally near ones the first in the robot's own order.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.operations.mapping.exploration.strategy import Candidates, Exploring, Grain

NO_WAY: Final = 1e9  # cells: longer than any way, yet finite for sums
Weight = Annotated[float, Meta(ge=0.0, le=1e6)]
Cells = Annotated[float, Meta(gt=0.0, le=1e6)]


class RandomFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks to a frontier drawn at random, all equally likely. Needs nothing of others.

    The baseline without judgement; in place of the nearest of Yamauchi (1997). As it stands robots cross the building
    for every look, and turn back when others have seen their frontier meanwhile, so few runs end. With `keeps` a robot
    keeps what it has drawn: it walks its way to the end, goes on with the nearest frontier within `near` cells, and
    draws again only if there is none. That is the fair baseline beside rules that stay where they are.
    """

    grain: Grain = None  # cells: frontiers are cut at the lines of such a grid; None: they are not
    keeps: bool | None = None  # default: false
    near: Cells | None = None  # cells, with keeps; default: 7

    @property
    def needs_others(self) -> bool:
        return False

    @property
    def keeps_ways(self) -> bool:
        return bool(self.keeps)

    def choose(self, candidates: Candidates) -> int:
        """The piece that it keeps, or one drawn."""
        if self.keeps and candidates.present >= 0:
            return candidates.present
        if self.keeps and candidates.own[0] <= (self.near or 7.0):
            return 0
        return int(candidates.random.integers(len(candidates.own)))


class LargestFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks to the frontier with the most cells. Needs nothing of others.

    Yamauchi (1997) forms frontiers as regions of touching cells; their size estimates what can be seen.
    """

    grain: Grain = None  # cells: frontiers are cut at the lines of such a grid; None: they are not

    @property
    def needs_others(self) -> bool:
        return False

    def choose(self, candidates: Candidates) -> int:
        return int(np.argmax(candidates.sizes))


class UtilityFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks to the frontier with the largest gain less way, U - weight L / Lmax.

    Needs nothing of others.

    U is the unknown share of a disc as large as the sensor sees, L the way, Lmax the longest way of any piece: the
    utility of Julia, Gil and Reinoso, "A comparison of path planning strategies for autonomous exploration and mapping
    of unknown environments", Autonomous Robots 33 (2012).
    """

    weight: Weight = 0.5  # of the way against the gain

    @property
    def needs_others(self) -> bool:
        return False

    def choose(self, candidates: Candidates) -> int:
        return int(np.argmax(candidates.unknown - self.weight * candidates.own / max(1.0, candidates.own.max())))


class CoordinatedFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot also plans for those it hears, pair by pair; what one of them will see counts less for the next.

    Of all robots and pieces without one, the pair with the most of U - weight V is taken, V the way in cells; then
    every U falls by max(0, 1 - d / reach), d the distance to the piece taken: Burgard, Moors, Stachniss and Schneider,
    "Coordinated Multi-Robot Exploration", IEEE Transactions on Robotics 21 (2005). Of others it needs where they are,
    which their tiles say: no byte more.
    """

    weight: Weight = 0.02  # per cell of the way
    reach: Cells = 7.0  # cells seen from a frontier

    def choose(self, candidates: Candidates) -> int:
        """The piece left for the robot itself."""
        useful = np.ones(len(candidates.own))
        costs = self.weight * np.minimum(candidates.ways, NO_WAY)
        waiting = list(range(len(costs)))
        while True:
            place, piece = divmod(int(np.argmax(useful - costs[waiting])), len(useful))
            if waiting.pop(place) == 0:
                return piece
            apart = np.hypot(*(candidates.goals - candidates.goals[piece]).T)
            useful -= np.maximum(0.0, 1.0 - apart / self.reach)


class MinPos(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks to the frontier to which the fewest of those it hears are nearer; of these, to the nearest.

    Bautin, Simonin and Charpillet, "MinPos: A Novel Frontier Allocation Algorithm for Multi-robot Exploration", ICIRA
    (2012). Of others it needs where they are, which their tiles say: no byte more.
    """

    def choose(self, candidates: Candidates) -> int:
        """Where the robot's rank is best."""
        return int(np.argmin((candidates.ways[1:] < candidates.own).sum(axis=0)))


class AssignedFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot also plans for those it hears: one piece for each, so that the sum of all ways is least.

    The assignment is Kuhn's (1955), known as the Hungarian method, as Wurm, Stachniss and Burgard, "Coordinated
    Multi-Robot Exploration using a Segmentation of the Environment", IROS (2008), use it. Of others it needs where they
    are, which their tiles say: no byte more.
    """

    def choose(self, candidates: Candidates) -> int:
        """The robot's own piece; the nearest if there are not enough of them."""
        robots, pieces = assigned(np.minimum(candidates.ways, NO_WAY))
        mine = pieces[robots == 0]
        return int(mine[0]) if len(mine) else 0


class PotentialField(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks down a potential that frontiers lower and the robots it hears raise.

    The potential of a cell is the sum of -size / way over all frontiers, and of reach - way over all robots within
    reach, sizes and ways in cells; the goal is the frontier at which a walk to the lowest neighbour, never back,
    arrives: Yu et al., "SMMR-Explore: SubMap-based Multi-Robot Exploration System with Multi-robot Multi-target
    Potential Field Exploration Method", ICRA (2021). Of others it needs where they are, which their tiles say: no byte
    more.
    """

    grain: Grain = None  # cells: frontiers are cut at the lines of such a grid; None: they are not
    reach: Weight = 50.0  # cells: from how far off robots push each other

    def choose(self, candidates: Candidates) -> int:
        """Where the walk ends."""
        return candidates.descend(self.reach)


class Market(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot picks the most profitable frontier that no robot it hears goes for at a lower price.

    The profit is the unknown share of the view from there, times `revenue`, less the way in cells; the price is
    the way. A robot that hears of a lower price gives way: Zlot, Stentz, Dias and Thayer, "Multi-robot exploration
    controlled by a market economy", ICRA (2002), with announcements in place of an auctioneer. Of others it needs where
    they go and how far that is: 6 bytes, the sharing tile-and-goal or gossip with goals.

    The revenue draws robots to wide views, past the crumbs beside their way, which they leave for later. With
    `revenue = 0`, where no robot hears another, each walks to the nearest frontier.
    """

    replan: Literal["on-arrival", "every-iteration"] = "every-iteration"
    revenue: Weight = 10.0  # cells of way that seeing a wholly unknown disc is worth
    reach: Cells = 4.0  # cells: goals this close are the same

    def choose(self, candidates: Candidates) -> int:
        """The most profitable free piece; the nearest if all are taken."""
        apart, left = candidates.announced()
        lost = ((apart <= self.reach) & (left[:, None] < candidates.own)).any(axis=0)
        profit = self.revenue * candidates.unknown - candidates.own
        return 0 if lost.all() else int(np.argmax(np.where(lost, -np.inf, profit)))


class ReservedFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks to the nearest frontier that is not reserved, and changes its goal only for a much shorter way.

    Others' goals, and all frontiers within reach of these, are reserved for them unless they have the longer way; a
    robot's own goal counts as nearer by `stays` cells. This keeps robots with equal maps from herding. Of others it
    needs where they go and how far that is: 6 bytes, the sharing tile-and-goal or gossip with goals.
    """

    replan: Literal["on-arrival", "every-iteration"] = "every-iteration"
    reach: Cells = 7.0  # cells
    stays: Weight = 5.0  # cells that a new goal has to be nearer than the present one

    def choose(self, candidates: Candidates) -> int:
        """The nearest free piece, preferring the present one; the nearest of all if none is free."""
        apart, left = candidates.announced()
        reserved = ((apart <= self.reach) & (left[:, None] < candidates.own)).any(axis=0)
        ways = candidates.own + NO_WAY * reserved
        if candidates.present >= 0:
            ways[candidates.present] -= self.stays
        return int(np.argmin(ways))


class DispersedFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot walks to a frontier that is near for it and far for those it hears.

    It minimises its way plus, for every other robot, weight exp(-way / reach): a robot next to a frontier costs like
    `weight` more cells to walk, one `reach` cells off a third of that. Of others it needs where they are, which their
    tiles say: no byte more. With the sharing `gossip`, 15 bytes more for tiles of 6 x 7, this is the recommended way
    to map a building.

    Where dozens hear each other the sum outweighs every way: each step of the crowd makes another frontier the best,
    and all may turn back and forth for ever. With `heeds` only so many others count, those nearest to the frontier.
    """

    replan: Literal["on-arrival", "every-iteration"] = "every-iteration"
    weight: Weight = 10.0  # cells
    reach: Cells = 15.0  # cells
    stays: Weight = 3.0  # cells that a new goal has to be better than the present one
    heeds: Annotated[int, Meta(ge=1, le=1_000_000)] | None = None  # others that count; default: all

    def choose(self, candidates: Candidates) -> int:
        closeness = np.exp(-candidates.ways[1:] / self.reach)
        if self.heeds is not None:
            closeness = np.sort(closeness, axis=0)[-self.heeds :]
        price = candidates.own + self.weight * closeness.sum(axis=0)
        if candidates.present >= 0:
            price[candidates.present] -= self.stays
        return int(np.argmin(price))


class SharedFrontier(Exploring, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot also plans for those it hears: a piece for each, near for it and far from the nearest of the others.

    A piece costs a robot its way plus weight exp(-way / reach), with the way of the nearest of the others; the sum of
    all costs is least, as in `assigned-frontier` that of the ways. So it joins what `assigned-frontier` does where
    robots are many, and `dispersed-frontier` where they are few. `oracle-frontier` is the same with one planner. Of
    others it needs where they are, which their tiles say: no byte more.

    With `revenue` a piece costs everybody less by that many cells times the unknown share of the view from there.
    """

    replan: Literal["on-arrival", "every-iteration"] = "every-iteration"
    weight: Weight = 20.0  # cells
    reach: Cells = 15.0  # cells
    stays: Weight = 3.0  # cells that a new goal has to be better than the present one
    revenue: Weight | None = None  # cells of way that seeing a wholly unknown disc is worth; default: 0

    def choose(self, candidates: Candidates) -> int:
        """The robot's own part of the plan."""
        ways = np.minimum(candidates.ways, NO_WAY)
        if candidates.present >= 0:
            ways[0, candidates.present] -= self.stays
        revenues = (self.revenue or 0.0) * candidates.unknown
        return int(shared_out(ways, self.weight, self.reach, revenues)[0])


def shared_out(
    ways: NDArray[np.float64], weight: float, reach: float, revenues: NDArray[np.float64] | float = 0.0
) -> NDArray[np.int64]:
    """The piece that each robot gets (n,), given the ways (n, p) of all to all, NO_WAY where there is none.

    A piece costs a robot its way plus weight exp(-way / reach), with the way of the nearest of the others, less the
    piece's revenue (p,). Each robot gets a piece of its own, so that the sum of costs is least. If there are too few
    pieces, the robots left over take their cheapest one, even if others have it.
    """
    closeness = np.exp(-ways / reach)
    best = closeness.max(axis=0)
    second = np.sort(closeness, axis=0)[-2] if len(ways) > 1 else np.zeros_like(best)
    prices = ways + weight * np.where(closeness == best, second, best) - revenues
    chosen = prices.argmin(axis=1)
    robots, pieces = assigned(prices)
    reached = ways[robots, pieces] < NO_WAY / 2
    chosen[robots[reached]] = pieces[reached]
    return np.asarray(chosen, np.int64)


def assigned(prices: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows and columns of the cheapest assignment of rows to columns."""
    from scipy.optimize import linear_sum_assignment  # which robots with other rules can do without

    rows, columns = linear_sum_assignment(prices)
    return rows, columns
