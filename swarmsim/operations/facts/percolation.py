"""Percolation by a swarm: how likely a random lattice is open from one side to the other, by Monte Carlo."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.context import BuildContext
from swarmsim.core.jobs import Values
from swarmsim.core.streams import Streams
from swarmsim.jobs.facts.bag import Carried, Hand, bag
from swarmsim.jobs.facts.tellers import Tellers
from swarmsim.operations.facts.stigmergy import Name

OPERATIONS = 10.0  # a site, about: drawing, comparing, labelling


class Percolation(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The chance that open sites of a random square lattice connect its first row with its last, through edges.

    Each site is open with probability `open`. An item is `lattices` lattices of `side` x `side` sites. In large ones
    the chance jumps from 0 to 1 where `open` is 0.5927 (Newman and Ziff 2000).

    A robot does the items of its own share first, then any that nobody claims.
    """

    name: Name = ""  # in recordings; default: the part's
    items: Annotated[int, Meta(ge=1, le=10_000)] = 60  # of the bag
    lattices: Annotated[int, Meta(ge=1, le=10_000)] = 20  # random lattices in an item
    side: Annotated[int, Meta(ge=2, le=1000)] = 32  # sites of a lattice's side
    open: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5927  # chance that a site is open
    rate: Annotated[float, Meta(gt=0.0)] | None = None  # operations a second of a robot; none: an item an exchange
    patience: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 12  # iterations of silence after which a claim lapses
    budget: Annotated[int, Meta(ge=1, le=1_000_000_000)] | None = None  # bytes a message

    def build(self, context: BuildContext) -> Tellers[Hand]:
        """The job. Raises InputError for a budget without room for a result."""
        keys = Carried(name=self.name or "percolation", rate=self.rate, patience=self.patience, budget=self.budget)
        return bag(Spanning(self, context.streams), keys, context)


class Spanning:
    """How many of an item's lattices are open from side to side."""

    length = 1

    def __init__(self, keys: Percolation, streams: Streams) -> None:
        self._keys, self._streams = keys, streams
        self.items = keys.items

    def work(self, item: int) -> float:
        """About OPERATIONS a site."""
        return OPERATIONS * self._keys.lattices * self._keys.side**2

    def result(self, item: int) -> Values:
        """The count, from the item's own random numbers."""
        dice = self._streams.open(f"percolation {self._keys.name}", item)
        shape = self._keys.lattices, self._keys.side, self._keys.side
        return np.array([sum(map(_spans, dice.random(shape) < self._keys.open))], np.float64)

    def answer(self, results: NDArray[np.float64]) -> dict[str, float]:
        """The share that is open, and the standard error of a share."""
        count = self._keys.items * self._keys.lattices
        share = float(results.sum()) / count
        return {"spanning_share": share, "spanning_error": math.sqrt(share * (1.0 - share) / count)}


def _spans(open_: NDArray[np.bool_]) -> bool:
    parts, _ = ndimage.label(open_)
    return bool(np.intersect1d(parts[0], parts[-1]).any())
