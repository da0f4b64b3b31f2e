"""Topologies drawn at random: each draw depends on the seed, the iteration and the two ids alone."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Links
from swarmsim.core.state import State
from swarmsim.kernels import draws
from swarmsim.network.topology import Degree, FixedLinks, check_degree

Probability = Annotated[float, Meta(ge=0.0, le=1.0)]


class RandomLinks(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears each other with probability p, drawn anew for every ordered pair in every iteration.

    Dead robots neither hear nor speak; other links stay. A directed G(n, p) (Gilbert 1959).
    """

    p: Probability  # probability of a link

    def build(self, context: BuildContext) -> PairLottery:
        """The topology, with a salt from the stream `topology`."""
        return PairLottery(_salt(context), self.p)


class PairLottery:
    """Links among live robots, each with the same probability."""

    def __init__(self, salt: np.uint64, p: float) -> None:
        self._salt = salt
        self._p = p

    def links(self, state: State) -> Links:
        """The links of this moment; the same whenever asked."""
        links: Links = draws.random_links(self._salt, state.iteration, state.alive, self._p)
        return links


class RandomNeighbours(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears k others drawn anew in every iteration: as many as with `knn`, near or far.

    When a robot dies, each of its listeners hears another instead, or all the others once fewer than k are left; other
    links stay.
    """

    k: Degree  # others heard

    def build(self, context: BuildContext) -> SenderLottery:
        """The topology, with a salt from the stream `topology`; raises InputError unless k is less than the robots."""
        check_degree(self.k, context.swarm)
        return SenderLottery(_salt(context), self.k)


class SenderLottery:
    """Links to k live others each, all equally probable; to all of them once fewer are left."""

    def __init__(self, salt: np.uint64, k: int) -> None:
        self._salt = salt
        self._k = k

    def links(self, state: State) -> Links:
        """The links of this moment; the same whenever asked."""
        links: Links = draws.random_senders(self._salt, state.iteration, state.alive, self._k)
        return links


class SmallWorld(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Static: each robot hears k others, its neighbours in a ring of ids, each of them redrawn with probability p.

    Neighbours in the ring are, until there are k, the next higher id, the next lower, the one after the next higher,
    and so on. After Watts & Strogatz 1998, except that links are directed and that each robot hears exactly k others
    for any p: from p = 0, a ring for k = 2, to p = 1, a random net. Drawn once, at the start; a dead robot leaves a
    gap.
    """

    k: Degree  # others heard
    p: Probability  # probability that a link is rewired

    def build(self, context: BuildContext) -> FixedLinks:
        """The topology, with a salt from the stream `topology`; raises InputError unless k is less than the robots."""
        count = context.swarm
        check_degree(self.k, count)
        links = draws.small_world(_salt(context), count, self.k, self.p)
        return FixedLinks([(int(receiver), int(sender)) for receiver, sender in links])


def _salt(context: BuildContext) -> np.uint64:
    return context.streams.open("topology").integers(2**64, dtype=np.uint64)
