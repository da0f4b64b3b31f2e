"""Ways between the places of a known building, and what robots on such ways see."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from swarmsim.studies.benchmark.views import Stands

Routes = list[list[int]]  # by robot: the places of its stops, its start first


@dataclass(eq=False)
class Net:
    """Shortest ways from some places to all places, found when first asked for."""

    ground: Stands

    def __post_init__(self) -> None:
        self.views = self.ground.views.copy()
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

    def forget(self, routes: Routes, cells: NDArray[np.int64]) -> None:
        """Count no more on seeing these cells of the domain (k,) from places on the routes.

        Cells that are seen from nowhere else stay as they are.
        """
        driven, gone = (np.zeros(size, np.bool_) for size in self.views.shape)
        driven[np.concatenate([self.walk(route) for route in routes])] = True
        gone[cells] = True
        seen = self.views.tocoo()
        kept = ~(driven[seen.row] & gone[seen.col])
        kept |= np.bincount(seen.col[kept], minlength=len(gone))[seen.col] == 0
        ends = (seen.row[kept], seen.col[kept])
        self.views = sparse.csr_array((seen.data[kept], ends), shape=self.views.shape)
        self._seen.clear()

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
            self._seen[start, end] = np.unique(self.views[self.leg(start, end)].indices)
        return self._seen[start, end]

    def length(self, route: list[int]) -> float:
        """The length in m of a route."""
        return float(sum(self.ways(one)[other] for one, other in pairwise(route)))

    def walk(self, route: list[int]) -> NDArray[np.int64]:
        """All places on a route, in order."""
        return np.concatenate([np.array(route[:1], np.int64), *(self.leg(*pair) for pair in pairwise(route))])


class Tally:
    """How often each cell of the domain is seen on the legs of routes."""

    def __init__(self, net: Net, routes: Routes) -> None:
        self._net, self._counts = net, np.zeros(len(net.ground.domain), np.int64)
        for route in routes:
            self._counts[np.unique(net.views[route[:1]].indices)] += 1
            for pair in pairwise(route):
                self._counts[net.seen(*pair)] += 1

    @property
    def missing(self) -> NDArray[np.bool_]:
        """The cells (m,) that nobody sees."""
        return np.asarray(self._counts == 0)

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
