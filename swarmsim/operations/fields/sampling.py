"""Where robots go to sample: to random places, or to the least certain ones."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.state import Intents, Knowledge, Senses
from swarmsim.operations.fields.estimate import Basis, Reconstruction

ARRIVED = 0.15  # m: nearer than this to its place, a robot takes the next
PATIENCE = 3.0  # a robot gives up a place after this many times the time that its way should take

Margin = Annotated[float, Meta(ge=0.0, le=1e6)]


class RandomWaypoint(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot drives straight to one random place of the page after another (Johnson and Maltz 1996).

    It ignores walls: for open floors. It gives up a place not reached in three times the time it should take.
    """

    margin: Margin = 0.4  # m, from the edges of the page

    def build(self, context: BuildContext) -> Waypoints:
        return Waypoints(context, self.margin)


class Waypoints:
    """A place for each robot, drawn by its number and its count of places."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def __init__(self, context: BuildContext, margin: float) -> None:
        page, self._ids = context.building.bounds, context.ids
        self._low = np.array(page[:2]) + margin
        self._size = np.maximum(np.array(page[2:]) - margin - self._low, 0.0)
        self._salt = int(context.streams.open("waypoints").integers(0, 2**64, dtype=np.uint64))
        self._legs = Legs(context)

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """On to the place, or to a new one."""
        robots = self._legs.arrived(senses)
        return self._legs.intents(senses, robots, self.drawn(robots, self._legs.counts[robots]))

    def drawn(self, robots: NDArray[np.int64], legs: NDArray[np.int64]) -> NDArray[np.float64]:
        """Random places (r, 2) for robots (r,) that have had so many (r,)."""
        part = np.stack([chance.uniform(self._salt, self._ids[robots], legs, axis) for axis in (0, 1)], axis=1)
        return np.asarray(self._low + part * self._size)

    def inside(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        """Which of places (k, 2) are within the margin (i,)."""
        return np.flatnonzero(((places >= self._low) & (places <= self._low + self._size)).all(axis=1))


class MostUncertain(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot drives straight to the place where its estimate is least certain, nearer ones first.

    It goes where s - `nearness` d is greatest over the centres of the bells at least `margin` from the edges of the
    page: s is the standard deviation as a share of that before any sample, d the distance as a share of the page's
    diagonal. It ignores walls: for open floors.
    """

    margin: Margin = 0.4  # m, from the edges of the page
    nearness: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.5  # how much the way counts against uncertainty

    def build(self, context: BuildContext) -> Uncertainty:
        return Uncertainty(self, context)


class Uncertainty:
    """A place for each robot, chosen by its knowledge."""

    requires_knowledge: type[Knowledge] = Reconstruction

    def __init__(self, parameters: MostUncertain, context: BuildContext) -> None:
        self._parameters, self._page = parameters, context.building.bounds
        self._legs = Legs(context)
        self._diagonal = float(np.hypot(self._page[2] - self._page[0], self._page[3] - self._page[1]))

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Reconstruction) -> Intents:
        """On to the place, or to a new one."""
        robots = self._legs.arrived(senses)
        places = self._places(knowledge.basis)
        if len(robots) == 0:
            return self._legs.intents(senses, robots, np.empty((0, 2)))
        deviation = np.sqrt(knowledge.variance(places)[robots])
        first = np.sqrt((knowledge.basis.at(places) ** 2).sum(axis=1))
        away = np.hypot(*(places[:, None] - senses.pose[robots, :2]).transpose(2, 1, 0)) / self._diagonal
        worth = deviation / np.maximum(first, 1e-12) - self._parameters.nearness * away
        return self._legs.intents(senses, robots, places[worth.argmax(axis=1)])

    def _places(self, basis: Basis) -> NDArray[np.float64]:
        low, high = np.array(self._page[:2]), np.array(self._page[2:])
        margin = self._parameters.margin
        inside = ((basis.centres >= low + margin) & (basis.centres <= high - margin)).all(axis=1)
        return basis.centres[inside] if inside.any() else basis.centres


class Legs:
    """The robots' straight ways, one after another."""

    def __init__(self, context: BuildContext) -> None:
        count = len(context.ids)
        self._place = np.full((count, 2), np.nan)
        self._until = np.zeros(count, np.int64)  # iteration of giving up a place
        self._pace = context.robots.speed * context.period
        #: How many places each robot (n,) has had.
        self.counts = np.zeros(count, np.int64)

    def arrived(self, senses: Senses) -> NDArray[np.int64]:
        """The live robots (r,) that need a new place."""
        away = np.hypot(*(self._place - senses.pose[:, :2]).T)
        late = senses.iteration >= self._until
        return np.flatnonzero(senses.alive & (~(away > ARRIVED) | late))

    def intents(self, senses: Senses, robots: NDArray[np.int64], places: NDArray[np.float64]) -> Intents:
        """All robots' ways, with new places (r, 2) for robots (r,)."""
        way = np.hypot(*(places - senses.pose[robots, :2]).T)
        self._place[robots] = places
        self._until[robots] = senses.iteration + 2 + (PATIENCE * way / self._pace).astype(np.int64)
        self.counts[robots] += 1
        planned = np.zeros(len(self._place), np.bool_)
        planned[robots] = True
        there = np.flatnonzero(senses.alive & ~np.isnan(self._place[:, 0]))
        ways = {int(robot): np.stack([senses.pose[robot, :2], self._place[robot]]) for robot in there}
        return Intents.along(ways, len(self._place), planned)
