"""Tours of several robots that cover a building which they know, the longest way as short as possible.

Viewpoints that see everything are chosen greedily, joined by one tour, and split among the robots. Then guided local
search (OR-tools) shortens the longest way, viewpoints that the ways see anyway are dropped, and what is missing is
inserted, in turn. Only whole coverage counts, and it is always counted from the ways themselves: a shorter way that
loses cells looks like a better one.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csgraph

from swarmsim.studies.benchmark.solver import routing
from swarmsim.studies.benchmark.views import Ground

UNITS: Final = 100  # of the solver's whole numbers in a cell
SPAN: Final = 100  # how much more the longest way counts than all ways together
Routes = list[list[int]]  # by robot: the places of viewpoints, the start first


class Effort(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How long to search for a good tour; in counts, so that the same tour comes out on any machine."""

    searches: int = 3  # how often guided local search starts again from what then covers everything
    steps: int = 2000  # solutions that one such search accepts
    repairs: int = 3  # replays after which cells that were missed are added to the tour


@dataclass(eq=False)
class Net:
    """Shortest ways from some places to all places, found when first asked for."""

    ground: Ground

    def __post_init__(self) -> None:
        self._rows = dict[int, tuple[NDArray[np.float64], NDArray[np.int32]]]()
        self._legs = dict[tuple[int, int], NDArray[np.int64]]()
        self._seen = dict[tuple[int, int], NDArray[np.int64]]()

    def prepare(self, places: NDArray[np.int64]) -> None:
        """Find the ways from these places (k,)."""
        new = np.array([place for place in dict.fromkeys(places.tolist()) if place not in self._rows], np.int64)
        if len(new):
            far, before = csgraph.dijkstra(self.ground.steps, indices=new, return_predecessors=True)
            self._rows.update(zip(new.tolist(), zip(far, before, strict=True), strict=True))

    def ways(self, place: int) -> NDArray[np.float64]:
        """The lengths in m (p,) of the ways from a place to all."""
        if place not in self._rows:
            self.prepare(np.array([place]))
        return self._rows[place][0]

    def leg(self, start: int, end: int) -> NDArray[np.int64]:
        """The places on the way from one to another, without the first."""
        if (start, end) not in self._legs:
            self.ways(start)
            before, found = self._rows[start][1], [end]
            while found[-1] != start:
                found.append(int(before[found[-1]]))
            self._legs[start, end] = np.array(found[-2::-1], np.int64)
        return self._legs[start, end]

    def seen(self, start: int, end: int) -> NDArray[np.int64]:
        """The cells of the domain seen on the way, each once."""
        if (start, end) not in self._seen:
            self._seen[start, end] = np.unique(self.ground.views[self.leg(start, end)].indices)
        return self._seen[start, end]

    def length(self, route: list[int]) -> float:
        """The length in m of a route."""
        return float(sum(self.ways(one)[other] for one, other in pairwise(route)))

    def longest(self, routes: Routes) -> float:
        """The length in m of the longest route."""
        return max(self.length(route) for route in routes)

    def walk(self, route: list[int]) -> NDArray[np.int64]:
        """All places on a route, in order."""
        return np.concatenate([np.array(route[:1], np.int64), *(self.leg(*pair) for pair in pairwise(route))])


class Coverage:
    """How often each cell of the domain is seen on the legs of routes."""

    def __init__(self, net: Net, routes: Routes) -> None:
        self._net, self._counts = net, np.zeros(len(net.ground.domain), np.int64)
        for route in routes:
            self._counts[np.unique(net.ground.views[route[:1]].indices)] += 1
            for pair in pairwise(route):
                self._counts[net.seen(*pair)] += 1

    @property
    def missing(self) -> NDArray[np.bool_]:
        """The cells (m,) that nobody sees."""
        return self._counts == 0

    def replace(self, old: list[int], new: list[int]) -> bool:
        """Replace a piece of a route by another one; whether no cell is lost by that."""
        for pair in pairwise(new):
            self._counts[self._net.seen(*pair)] += 1
        kept = True
        for pair in pairwise(old):
            cells = self._net.seen(*pair)
            self._counts[cells] -= 1
            kept &= bool(self._counts[cells].all())
        return kept


def viewpoints(ground: Ground, covered: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Places that together see all cells of the domain not yet `covered` (m,): each sees the most of the rest."""
    views, seen = ground.views, covered.copy()
    gains = views @ (~seen).astype(np.int64)
    heap = [(-int(gain), place) for place, gain in enumerate(gains) if gain]
    heapq.heapify(heap)
    chosen = []
    while heap:
        gain, place = heapq.heappop(heap)
        cells = views.indices[views.indptr[place] : views.indptr[place + 1]]
        now = -int(np.count_nonzero(~seen[cells]))
        if now > gain:  # others have taken some of its cells since
            if now < 0:
                heapq.heappush(heap, (now, place))
            continue
        seen[cells] = True
        chosen.append(place)
    return np.array(chosen, np.int64)


def first_routes(net: Net) -> Routes:
    """One tour of viewpoints, split so that the longest piece with the way to it is short."""
    ground = net.ground
    starts = ground.starts
    covered = np.zeros(len(ground.domain), np.bool_)
    covered[ground.views[starts].indices] = True
    stops = viewpoints(ground, covered)
    net.prepare(np.concatenate([starts, stops]))
    if not len(stops):
        return [[start] for start in starts.tolist()]
    order = shortened(net, [[int(starts[0]), *stops.tolist()]], [1], 20_000)[0][1:]
    pieces = _split(net, order, len(starts))
    cost = np.array(
        [[min(net.ways(start)[piece[0]], net.ways(start)[piece[-1]]) for piece in pieces] for start in starts.tolist()]
    )
    routes = [[start] for start in starts.tolist()]
    for robot, number in zip(*linear_sum_assignment(cost), strict=True):
        piece, ways = pieces[number], net.ways(int(starts[robot]))
        routes[robot] += piece if ways[piece[0]] <= ways[piece[-1]] else piece[::-1]
    return routes


def _split(net: Net, order: list[int], robots: int) -> Routes:
    """At most so many pieces of a tour, the longest, with the way to its nearer end, as short as bisection finds."""
    reach = np.min([net.ways(int(start)) for start in net.ground.starts], axis=0)
    low, high = 0.0, float(reach.max()) + net.length(order)

    def pieces(limit: float) -> Routes:
        found, length = [[order[0]]], 0.0
        for before, stop in pairwise(order):
            length += float(net.ways(before)[stop])
            if length + min(reach[found[-1][0]], reach[stop]) <= limit:
                found[-1].append(stop)
            else:
                found.append([stop])
                length = 0.0
        return found

    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if len(pieces(middle)) <= robots else (middle, high)
    return pieces(high)


def shortened(net: Net, routes: Routes, weights: list[int], steps: int) -> Routes:
    """The same stops in other orders and on other robots, with a shorter longest way if guided local search finds one.

    `steps` are the solutions that it accepts. Ways are open: nobody has to come back.
    """
    stops = [place for route in routes for place in route[1:]]
    if not stops or steps == 0:
        return routes
    nodes = [*(route[0] for route in routes), *stops]
    net.prepare(np.array(nodes))
    matrix = np.zeros((len(nodes) + 1, len(nodes) + 1), np.int64)  # the last node is where all ways end, at no cost
    for row, place in enumerate(nodes):
        matrix[row, :-1] = np.rint(net.ways(place)[nodes] * (UNITS / net.ground.lattice.cell))
    first, numbers = len(routes), []
    for route in routes:
        numbers.append(list(range(first, first + len(route) - 1)))
        first += len(route) - 1
    found = routing(matrix.tolist(), numbers, SPAN, steps)
    return [[nodes[robot], *(nodes[number] for number in way)] for robot, way in enumerate(found)]


def pruned(net: Net, routes: Routes, coverage: Coverage) -> Routes:
    """The routes without stops whose cells are seen on the ways anyway; those that save most go first."""
    routes = [list(route) for route in routes]
    dropped = True
    while dropped:
        dropped = False
        lengths = [net.length(route) for route in routes]
        for robot in np.argsort(lengths)[::-1].tolist():
            route = routes[robot]
            savings = sorted(((-_saving(net, route, at), at) for at in range(1, len(route))), key=lambda one: one)
            for stop in [route[at] for _, at in savings]:
                at = route.index(stop, 1)
                old = route[at - 1 : at + 2]
                new = [old[0], *old[2:]]
                if coverage.replace(old, new):
                    del route[at]
                    dropped = True
                else:
                    coverage.replace(new, old)
    return routes


def _saving(net: Net, route: list[int], at: int) -> float:
    """How much shorter a route is without one of its stops."""
    old = route[at - 1 : at + 2]
    return net.length(old) - net.length([old[0], *old[2:]])


def completed(net: Net, routes: Routes, coverage: Coverage) -> Routes:
    """The routes with more stops, so that they see everything, where that lengthens the longest least."""
    routes = [list(route) for route in routes]
    while (missing := coverage.missing).any():
        gains = net.ground.views @ missing.astype(np.int64)
        places = np.flatnonzero(gains)
        longest = net.longest(routes)
        best = min(
            _dearest(net, route, places, gains[places], longest) + (robot,) for robot, route in enumerate(routes)
        )
        _, at, place, robot = best
        old = routes[robot][at - 1 : at + 1]
        coverage.replace(old, [old[0], place, *old[1:]])
        routes[robot].insert(at, place)
    return routes


def _dearest(
    net: Net, route: list[int], places: NDArray[np.int64], gains: NDArray[np.int64], longest: float
) -> tuple[float, int, int]:
    """The cheapest place (of k) to insert into a route by what it costs for each cell gained: cost, where, and place."""
    ways = np.stack([net.ways(stop)[places] for stop in route])
    extra = ways.copy()  # the last row: at the end
    legs = np.array([net.ways(one)[other] for one, other in pairwise(route)])
    extra[:-1] += ways[1:] - legs[:, None]
    cost = extra + SPAN * np.maximum(legs.sum() + extra - longest, 0.0)
    rate = (cost + net.ground.lattice.cell) / gains
    at, number = np.unravel_index(int(rate.argmin()), rate.shape)
    return float(rate[at, number]), int(at) + 1, int(places[number])


def rebuilt(net: Net, routes: Routes, rounds: int, random: np.random.Generator) -> Routes:
    """The routes after so many attempts to take out some stops and to see what is lost in another way (Shaw 1998)."""
    best, score = routes, _score(net, routes)
    for _ in range(rounds):
        trial = [list(route) for route in best]
        lengths = np.array([net.length(route) for route in trial])
        robot = int(lengths.argmax()) if random.random() < 0.5 else int(random.integers(len(trial)))
        if len(trial[robot]) < 2:
            continue
        centre = trial[robot][int(random.integers(1, len(trial[robot])))]
        near = net.ways(centre)
        others = sorted((float(near[stop]), stop) for route in trial for stop in route[1:])
        gone = {stop for _, stop in others[: int(random.integers(2, 8))]}
        trial = [[route[0], *(stop for stop in route[1:] if stop not in gone)] for route in trial]
        trial = completed(net, trial, Coverage(net, trial))
        trial = pruned(net, trial, Coverage(net, trial))
        now = _score(net, trial)
        if now < score:
            best, score = trial, now
    return best


def _score(net: Net, routes: Routes) -> float:
    lengths = np.array([net.length(route) for route in routes])
    return float(np.linalg.norm(lengths / lengths.max(), 16) * lengths.max())


def best_routes(net: Net, effort: Effort) -> Routes:
    """The best routes found that cover all of the domain."""
    routes = first_routes(net)
    best = routes = pruned(net, routes, Coverage(net, routes))
    for _ in range(effort.searches):
        routes = shortened(net, best, [], effort.steps)
        coverage = Coverage(net, routes)
        routes = completed(net, routes, coverage)
        routes = pruned(net, routes, Coverage(net, routes))
        print(net.longest(best) / 0.15, net.longest(routes) / 0.15)
        if net.longest(routes) < net.longest(best):
            best = routes
    return best
