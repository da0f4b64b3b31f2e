"""Topologies of distance and sight: who is within radio range, who is in view, who is farthest away."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.building import Building
from swarmsim.core.parts import Links
from swarmsim.core.setting import Setting
from swarmsim.core.state import State
from swarmsim.kernels import graph, rays, sight
from swarmsim.network.topology import Degree, check_degree

Range = Annotated[float, Meta(gt=0.0)]

MARGIN = 1e-6  # of a square of the coarse grid: rounding must not hide a wall that runs along its border
MOST_SQUARES = 20_000  # of the coarse grid: sorting walls into it takes their number times this


class Radius(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears all others at most `radius` (m) away, centre to centre: the disc model of radio.

    The dead neither hear nor speak; nothing else changes with them.
    """

    radius: Range  # m

    def build(self, setting: Setting) -> RadiusLinks:
        """The disc graph."""
        return RadiusLinks(self.radius)


class RadiusLinks:
    """Links among live robots at most so far apart."""

    def __init__(self, radius: float) -> None:
        self._radius = radius

    def links(self, state: State) -> Links:
        """The links of this moment; with each its reverse."""
        links: Links = graph.both_ways(graph.within(state.pose, state.alive, self._radius), state.robots)
        return links


class LineOfSight(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears all others between whose centre and its own there is no wall, as far as `radius` (m) if given.

    A line that touches a wall in one point is blocked. Other robots do not block it. The dead neither hear nor speak;
    nothing else changes with them.
    """

    radius: Range | None = None  # m

    def build(self, setting: Setting) -> SightLinks:
        """The visibility graph."""
        return SightLinks(math.inf if self.radius is None else self.radius, setting.building)


class SightLinks:
    """Links among live robots that the walls of this moment leave in view of each other."""

    def __init__(self, radius: float, building: Building) -> None:
        self._radius = radius
        self._building = building
        self._prepare()

    def _prepare(self) -> None:
        """Sort the walls of this moment by place, about one to a square."""
        walls, self._version = self._building.walls, self._building.version
        ends = walls.reshape(-1, 2) if len(walls) else np.zeros((1, 2))
        (x0, y0), (width, height) = ends.min(axis=0), np.ptp(ends, axis=0)
        squares = min(max(len(walls), 1), MOST_SQUARES)
        side = max(math.sqrt(width * height / squares), max(width, height) / squares) or 1.0
        coarse = (float(x0), float(y0), side, int(height / side) + 1, int(width / side) + 1)
        self._walls, self._coarse = walls, coarse
        self._start, self._members = rays.bins(walls, MARGIN * side, *coarse)

    def links(self, state: State) -> Links:
        """The links of this moment; with each its reverse."""
        if self._version != self._building.version:
            self._prepare()
        near = graph.within(state.pose, state.alive, self._radius)
        seen = sight.in_sight(state.pose, near, self._walls, self._start, self._members, self._coarse)
        links: Links = graph.both_ways(seen, state.robots)
        return links


class FarthestRobots(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears the k others farthest away: directed, and moving with the robots; knn turned inside out.

    Of others equally far away the one with the lower id is chosen first. Everybody hears the k farthest live robots,
    or all of them once fewer than k others are left.
    """

    k: Degree  # others heard

    def build(self, setting: Setting) -> FarthestLinks:
        """The topology; raises InputError unless k is less than the number of robots."""
        check_degree(self.k, setting.swarm)
        return FarthestLinks(self.k)


class FarthestLinks:
    """Links to the k farthest live others, ties by id; to all of them once fewer than k are left."""

    def __init__(self, k: int) -> None:
        self._k = k

    def links(self, state: State) -> Links:
        """The links of this moment."""
        links: Links = graph.farthest(state.pose, state.alive, self._k)
        return links
