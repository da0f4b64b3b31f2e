"""Topologies: which live robot hears which others, drawn anew in every iteration."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Building, Links, Setting
from swarmsim.core.state import State
from swarmsim.kernels import graph


class NearestNeighbours(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot hears its k nearest others: directed, and moving with the robots."""

    k: Annotated[int, Meta(ge=0)]

    def build(self, setting: Setting, building: Building) -> NearestNeighbourLinks:
        """The topology; raises InputError unless k is less than the number of robots."""
        count = setting.robots.count
        if self.k >= count:
            raise InputError(f"k: {self.k} neighbours asked of {count} robots; expected at most {count - 1}")
        return NearestNeighbourLinks(self.k)


class NearestNeighbourLinks:
    """Links to the k nearest live others, ties by id; to all of them once fewer than k are left."""

    def __init__(self, k: int) -> None:
        self._k = k

    def links(self, state: State) -> Links:
        """The links of this moment."""
        links: Links = graph.nearest(state.pose, state.alive, self._k)
        return links


class Isolated(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Nobody hears anybody."""

    def build(self, setting: Setting, building: Building) -> FixedLinks:
        """The topology without links."""
        return FixedLinks(setting.robots.count, (), closed=False)


class Chain(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Static: each robot hears those with the next lower and the next higher id; the two ends hear one."""

    def build(self, setting: Setting, building: Building) -> FixedLinks:
        """The open chain."""
        return FixedLinks(setting.robots.count, (-1, 1), closed=False)


class Ring(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Static: the chain with its two ends linked."""

    def build(self, setting: Setting, building: Building) -> FixedLinks:
        """The closed chain."""
        return FixedLinks(setting.robots.count, (-1, 1), closed=True)


class FixedLinks:
    """Links between fixed ids; a dead robot leaves a gap, nobody takes its place."""

    def __init__(self, robots: int, offsets: tuple[int, ...], closed: bool) -> None:
        receivers = np.repeat(np.arange(robots), len(offsets))
        senders = receivers + np.tile(np.array(offsets, np.int64), robots)
        if closed:
            senders %= max(robots, 1)
        kept = (senders >= 0) & (senders < robots) & (senders != receivers)
        self._links: Links = np.unique(np.stack([receivers[kept], senders[kept]], axis=1), axis=0).astype(np.int32)

    def links(self, state: State) -> Links:
        """Those of the links whose two robots are alive."""
        return self._links[state.alive[self._links].all(axis=1)]
