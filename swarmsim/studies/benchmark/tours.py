"""Tours of several robots that cover a building which they know, the longest way as short as possible.

Viewpoints that see everything are chosen greedily, joined by one tour, and split among the robots. Then guided local
search (OR-tools) shortens the longest way, viewpoints that the ways see anyway are dropped, and what is missing is
inserted, in turn. Only whole coverage counts, and it is always counted from the ways themselves: a shorter way that
loses cells looks like a better one.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from itertools import pairwise
from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from swarmsim.studies.benchmark.net import Net, Routes, Tally
from swarmsim.studies.benchmark.solver import shorter
from swarmsim.studies.benchmark.views import Stands

UNITS: Final = 100  # of the solver's whole numbers in a cell
CHOICE: Final = 0.3  # of the largest gain: places that gain less are not looked at
FIRST: Final = 20_000  # looks of the search for one tour of all viewpoints
LOOSE: Final = 0.02  # how much longer than the best routes may be to go on from them, at first
SPAN: Final = 100  # how much more the longest way counts than all ways together


class Effort(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How long to search for a good tour; in counts, so that the same tour comes out on any machine."""

    searches: int = 2  # how often guided local search starts again from what then covers everything
    looks: int = 100_000  # of one such search at what it has
    rounds: int = 100  # of taking out stops and covering what is lost, after each
    repairs: int = 8  # replays after which cells that were missed are added to the tour


def viewpoints(ground: Stands, covered: NDArray[np.bool_]) -> NDArray[np.int64]:
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
    covered[net.views[starts].indices] = True
    stops = viewpoints(ground, covered)
    net.prepare(np.concatenate([starts, stops]))
    if not len(stops):
        return [[start] for start in starts.tolist()]
    order = shortened(net, [[int(starts[0]), *stops.tolist()]], FIRST)[0][1:]
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


def shortened(net: Net, routes: Routes, looks: int) -> Routes:
    """The same stops in other orders and on other robots, with a shorter longest way if guided local search finds one.

    It looks so often at what it has. Ways are open: nobody has to come back.
    """
    stops = [place for route in routes for place in route[1:]]
    if not stops:
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
    found = shorter(matrix, numbers, SPAN, looks)
    return [[nodes[robot], *(nodes[number] for number in way)] for robot, way in enumerate(found)]


def pruned(net: Net, routes: Routes, coverage: Tally, which: Iterable[int] | None = None) -> Routes:
    """The routes without stops whose cells are seen on the ways anyway; those that save most go first.

    `which` are the only ones to look at, if given.
    """
    routes = [list(route) for route in routes]
    asked = range(len(routes)) if which is None else which
    waiting = sorted(asked, key=lambda robot: -net.length(routes[robot]))
    while waiting:
        waiting = [robot for robot in waiting if _prune(net, routes[robot], coverage)]
    return routes


def _prune(net: Net, route: list[int], coverage: Tally) -> bool:
    """Take stops out of a route; whether any went."""
    before = len(route)
    savings = sorted((-_saving(net, route, at), at) for at in range(1, len(route)))
    for stop in [route[at] for _, at in savings]:
        at = route.index(stop, 1)
        old = route[at - 1 : at + 2]
        new = [old[0], *old[2:]]
        if coverage.replace(old, new):
            del route[at]
        else:
            coverage.replace(new, old)
    return len(route) < before


def _saving(net: Net, route: list[int], at: int) -> float:
    """How much shorter a route is without one of its stops."""
    old = route[at - 1 : at + 2]
    return net.length(old) - net.length([old[0], *old[2:]])


def completed(net: Net, routes: Routes, coverage: Tally) -> Routes:
    """The routes with more stops, so that they see everything, where that lengthens the longest least."""
    routes = [list(route) for route in routes]
    while (missing := coverage.missing).any():
        robot, at, place = _dearest(net, routes, net.views @ missing.astype(np.int64))
        old = routes[robot][at - 1 : at + 1]
        coverage.replace(old, [old[0], place, *old[1:]])
        routes[robot].insert(at, place)
    return routes


def _dearest(net: Net, routes: Routes, gains: NDArray[np.int64]) -> tuple[int, int, int]:
    """The robot, where in its route, and the place to insert there that costs least for each cell gained (p,)."""
    places = np.flatnonzero(gains >= max(1.0, CHOICE * gains.max()))
    owner = np.repeat(np.arange(len(routes)), [len(route) for route in routes])
    stops = [stop for route in routes for stop in route]
    ways = np.stack([net.ways(stop)[places] for stop in stops])
    legs = np.array([net.ways(one)[other] for one, other in pairwise(stops)] + [0.0])
    inner = np.append(owner[1:] == owner[:-1], False)  # others are last on their route: no way on from there
    legs[~inner] = 0.0
    extra = ways.copy()
    extra[inner] += ways[1:][inner[:-1]] - legs[inner, None]
    lengths = np.bincount(owner, legs)
    cost = extra + SPAN * np.maximum(lengths[owner][:, None] + extra - lengths.max(), 0.0)
    rate = (cost + net.ground.lattice.cell) / gains[places]
    at, number = np.unravel_index(int(rate.argmin()), rate.shape)
    first = int(np.searchsorted(owner, owner[at]))
    return int(owner[at]), int(at) - first + 1, int(places[number])


def rebuilt(net: Net, routes: Routes, rounds: int, random: np.random.Generator) -> Routes:
    """The best routes found by taking out some stops, again and again, and covering what is lost in another way.

    This is large neighbourhood search (Shaw 1998), which also goes on from routes slightly longer than the best, as in
    Dueck's record-to-record travel (1993).
    """
    best = now = routes
    record = score = _score(net, routes)
    for done in range(rounds):
        stops = [stop for route in now for stop in route[1:]]
        if not stops:
            break
        longest = max(now, key=net.length)[1:]
        among = longest if longest and random.random() < 0.5 else stops
        near = net.ways(among[int(random.integers(len(among)))])
        gone = set(sorted(stops, key=lambda stop: (near[stop], stop))[: int(random.integers(2, 9))])
        trial = [[route[0], *(stop for stop in route[1:] if stop not in gone)] for route in now]
        coverage = Tally(net, trial)
        trial = completed(net, trial, coverage)
        trial = pruned(net, trial, coverage, [robot for robot, route in enumerate(trial) if route != now[robot]])
        score = _score(net, trial)
        if score < record * (1.0 + LOOSE * (1.0 - done / rounds)):
            now = trial
        if score < record:
            best, record = trial, score
    return best


def _score(net: Net, routes: Routes) -> float:
    lengths = np.array([net.length(route) for route in routes])
    return float(np.linalg.norm(lengths / lengths.max(), 16) * lengths.max())


def best_routes(net: Net, effort: Effort) -> Routes:
    """The best routes found that cover all of the domain."""
    routes = first_routes(net)
    best = pruned(net, routes, Tally(net, routes))
    random = np.random.default_rng(len(best))
    for _ in range(effort.searches):
        routes = covering(net, shortened(net, best, effort.looks))
        best = min(best, routes, key=lambda one: _score(net, one))
        best = rebuilt(net, best, effort.rounds, random)
    return best


def covering(net: Net, routes: Routes) -> Routes:
    """The routes with as few more stops and as many fewer as cover everything."""
    coverage = Tally(net, routes)
    return pruned(net, completed(net, routes, coverage), coverage)
