"""Topologies, which say which live robot hears which others: links between fixed ids, and to the nearest robots."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Links
from swarmsim.core.state import State
from swarmsim.kernels import graph

Id = Annotated[int, Meta(ge=0)]
Degree = Annotated[int, Meta(ge=0)]


def check_degree(k: int, robots: int) -> None:
    """Raise InputError unless each robot has at least k others."""
    if k >= robots:
        raise InputError(f"k: {k} neighbours asked of {robots} robots; expected at most {robots - 1}")


class NearestNeighbours(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears its k nearest others, moving with the robots: directed, or only where both chose each other.

    Ties in distance go to the lower id. Dead robots are ignored: each robot hears the k nearest live robots, or all of
    them once fewer than k others are left. On a `periodic` page, as particles can have, distances are the shortest
    around it.
    """

    k: Degree  # others heard
    mutual: bool = False
    periodic: bool = False

    def build(self, context: BuildContext) -> NearestNeighbourLinks | MutualNeighbourLinks:
        """The topology; raises InputError unless k is less than the number of robots."""
        check_degree(self.k, context.swarm)
        left, low, right, high = context.building.bounds
        nearest = NearestNeighbourLinks(self.k, (right - left, high - low) if self.periodic else None)
        return MutualNeighbourLinks(nearest) if self.mutual else nearest


class NearestNeighbourLinks:
    """Links to the k nearest live others, ties by id; to all of them once fewer than k are left."""

    def __init__(self, k: int, around: tuple[float, float] | None = None) -> None:
        """`around`: width and height in m of a page whose opposite edges coincide."""
        self._k, self._around = k, around

    def links(self, state: State) -> Links:
        """The links of this moment."""
        if self._around is not None:
            around: Links = graph.nearest_around(state.pose, state.alive, self._k, *self._around)
            return around
        links: Links = graph.nearest(state.pose, state.alive, self._k)
        return links


class MutualNeighbourLinks:
    """The links to the nearest that both ends chose: at most k per robot, perhaps none."""

    def __init__(self, nearest: NearestNeighbourLinks) -> None:
        self._nearest = nearest

    def links(self, state: State) -> Links:
        """The links of this moment; with each its reverse."""
        links: Links = graph.mutual(self._nearest.links(state))
        return links


class Isolated(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """No robot hears another."""

    def build(self, context: BuildContext) -> FixedLinks:
        return FixedLinks(())


class Chain(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Static: each robot hears those with the next lower and the next higher id; the two end robots hear one.

    A dead robot leaves a gap: the chain is cut in two.
    """

    def build(self, context: BuildContext) -> FixedLinks:
        return FixedLinks(_both_ways((i, i + 1) for i in range(context.swarm - 1)))


class Ring(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Static: the chain with its two ends linked. A dead robot leaves a gap: the ring opens."""

    def build(self, context: BuildContext) -> FixedLinks:
        count = context.swarm
        return FixedLinks(_both_ways((i, (i + 1) % count) for i in range(count) if count > 1))


class Star(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Static: the hub hears all robots, and all hear the hub. Once the hub is dead, no robot hears another."""

    hub: Id = 0  # id of the robot in the middle

    def build(self, context: BuildContext) -> FixedLinks:
        """The star; raises InputError if no robot has the hub's id."""
        count = context.swarm
        if self.hub >= count:
            raise InputError(f"hub: there is no robot {self.hub}; expected an id from 0 to {count - 1}")
        return FixedLinks(_both_ways((self.hub, i) for i in range(count) if i != self.hub))


class Edges(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Static: the links of a list of pairs [receiver, sender], also from a file: {file = "net.csv"}.

    A dead robot's links are gone, and no other robot takes its place.
    """

    links: tuple[tuple[Id, Id], ...]  # pairs of ids: receiver, sender

    def build(self, context: BuildContext) -> FixedLinks:
        """The listed links; raises InputError for an unknown robot, a robot that hears itself, or a repeat."""
        count = context.swarm
        first: dict[tuple[int, int], int] = {}
        for place, link in enumerate(self.links):
            if max(link) >= count:
                raise InputError(f"links[{place}]: there is no robot {max(link)}; expected ids from 0 to {count - 1}")
            if link[0] == link[1]:
                raise InputError(f"links[{place}]: robot {link[0]} hears itself; expected two different robots")
            if link in first:
                raise InputError(f"links[{place}]: {list(link)} repeats links[{first[link]}]; expected each link once")
            first[link] = place
        return FixedLinks(self.links)


def _both_ways(edges: Iterable[tuple[int, int]]) -> set[tuple[int, int]]:
    return {link for i, j in edges for link in ((i, j), (j, i))}


class FixedLinks:
    """Links between fixed ids; a dead robot leaves a gap."""

    def __init__(self, links: Collection[tuple[int, int]]) -> None:
        self._links: Links = np.array(sorted(links), np.int32).reshape(-1, 2)

    def links(self, state: State) -> Links:
        """The links whose two robots are alive."""
        links: Links = graph.among_live(self._links, state.alive)
        return links


class Full(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every live robot hears every other."""

    def build(self, context: BuildContext) -> AllLinks:
        return AllLinks()


class AllLinks:
    """Links among all live robots."""

    def links(self, state: State) -> Links:
        """The links of this moment."""
        links: Links = graph.everybody(state.alive)
        return links
