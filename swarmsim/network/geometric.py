"""Topologies of distance and sight: robots within radio range, in view, or farthest away."""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta, Struct

from swarmsim.core.building import Building
from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Links
from swarmsim.core.state import State
from swarmsim.kernels import graph
from swarmsim.network.topology import Degree, check_degree
from swarmsim.world.sight import Sight

Range = Annotated[float, Meta(gt=0.0)]


class Radius(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears all others at most `radius` (m) away, centre to centre: the disc model of radio.

    Dead robots neither hear nor speak; other links stay.
    """

    radius: Range  # m

    def build(self, context: BuildContext) -> RadiusLinks:
        return RadiusLinks(self.radius)


class RadiusLinks:
    """Links among live robots within the radius."""

    def __init__(self, radius: float) -> None:
        self._radius = radius

    def links(self, state: State) -> Links:
        """The links of this moment; with each its reverse."""
        links: Links = graph.both_ways(graph.within(state.pose, state.alive, self._radius), state.robots)
        return links


class LineOfSight(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears all others with no wall between the two centres, up to `radius` (m) if given.

    A line that touches a wall in one point is blocked. Other robots do not block it. Dead robots neither hear nor
    speak; other links stay.
    """

    radius: Range | None = None  # m

    def build(self, context: BuildContext) -> SightLinks:
        return SightLinks(math.inf if self.radius is None else self.radius, context.building)


class SightLinks:
    """Links among live robots with no wall between them now."""

    def __init__(self, radius: float, building: Building) -> None:
        self._radius, self._sight = radius, Sight(building)

    def links(self, state: State) -> Links:
        """The links of this moment; with each its reverse."""
        near = graph.within(state.pose, state.alive, self._radius)
        links: Links = graph.both_ways(self._sight.clear(state.pose, near), state.robots)
        return links


class FarthestRobots(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears the k others farthest away: directed, and moving with the robots; the opposite of knn.

    Ties in distance go to the lower id. Each robot hears the k farthest live robots, or all of them once fewer than k
    others are left.
    """

    k: Degree  # others heard

    def build(self, context: BuildContext) -> FarthestLinks:
        """The topology; raises InputError unless k is less than the number of robots."""
        check_degree(self.k, context.swarm)
        return FarthestLinks(self.k)


class FarthestLinks:
    """Links to the k farthest live others, ties by id; to all of them once fewer than k are left."""

    def __init__(self, k: int) -> None:
        self._k = k

    def links(self, state: State) -> Links:
        """The links of this moment."""
        links: Links = graph.farthest(state.pose, state.alive, self._k)
        return links
