"""Pursuers: each chases the nearest free evader that it sees or hears of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.state import Estimates, Intents, Knowledge, Senses
from swarmsim.operations.pursuit.evaders import Surrender
from swarmsim.operations.pursuit.seen import NEEDS, seen
from swarmsim.operations.steering import Steering


@dataclass(frozen=True, slots=True, eq=False)
class Sighting(MessageBatch):
    """The pursuers' message: the place of the nearest free evader last seen; NaN for none."""

    x: NDArray[np.float64]  # (t,): m
    y: NDArray[np.float64]  # (t,): m


@dataclass(frozen=True, slots=True, eq=False)
class Quarry(Estimates):
    """The pursuers' knowledge: the place of the evader that each chases."""

    quarry: NDArray[np.float64]  # (n, 2): m; NaN for none


class Chase(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Pursuers tell each other of evaders: each knows the nearest that it sees, else the nearest it hears of.

    The sensor `neighbours` with `groups = true` shows them. Evaders that report giving up are left out.
    """

    of: str = "evaders"  # the group of robots to catch

    def build(self, context: BuildContext) -> ChaseComputation:
        """The computation. Raises InputError if there is no such group."""
        return ChaseComputation(self.of, context.robots.number_of(self.of, "of"), context)


class ChaseComputation:
    """Remembers the sightings of the last iteration, to tell them."""

    requires = NEEDS
    knowledge_type: type[Knowledge] = Quarry

    def __init__(self, of: str, group: int, context: BuildContext) -> None:
        self._name, self._group = of, group
        self._same = context.robots.radius  # m: two places nearer than this are of one robot
        self._seen = np.full((len(context.ids), 2), np.nan)
        self.codec = PlainCodec(Sighting(np.zeros(0), np.zeros(0)))

    def say(self, senses: Senses) -> Broadcast[Sighting]:
        """Each one's last sighting."""
        return Broadcast.each(Sighting(self._seen[:, 0].copy(), self._seen[:, 1].copy()), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[Sighting]) -> Quarry:
        """The nearest evader seen, else the nearest told of; without those that have given up."""
        there = seen(senses, self._group)
        told = np.stack([inbox.content.x, inbox.content.y], axis=1)
        hearers, told = inbox.receivers[~np.isnan(told[:, 0])], told[~np.isnan(told[:, 0])]
        free = there.take(~self._have_given_up(there.seers, there.place, inbox))
        open_: NDArray[np.bool_] = ~self._have_given_up(hearers, told, inbox)
        mine = _nearest(senses.pose[:, :2], free.seers, free.place)
        theirs = _nearest(senses.pose[:, :2], hearers[open_], told[open_])
        self._seen = np.where(senses.alive[:, None], mine, self._seen)
        return Quarry(np.where(np.isnan(mine), theirs, mine))

    def _have_given_up(
        self, rows: NDArray[np.integer], place: NDArray[np.float64], inbox: Inbox[Sighting]
    ) -> NDArray[np.bool_]:
        """Whether an evader has told the robots of these rows (s,) that it gave up where they see one (s, 2)."""
        found = np.zeros(len(rows), np.bool_)
        heard = inbox.others.get(self._name)
        if heard is None or not isinstance(heard.content, Surrender):
            return found
        for row, x, y in zip(heard.receivers, heard.content.x, heard.content.y, strict=True):
            found |= (rows == row) & (np.hypot(place[:, 0] - x, place[:, 1] - y) < self._same)
        return found

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Forget all sightings."""
        self._seen[robots] = np.nan

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another's sightings."""
        self._seen[robots] = self._seen[source]


def _nearest(here: NDArray[np.float64], rows: NDArray[np.integer], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nearest to each robot's own place (n, 2) of the places (s, 2) known to robots `rows` (s,); NaN for none."""
    apart = np.hypot(*(place - here[rows]).T)
    order = np.lexsort((apart, rows))
    found = np.full_like(here, np.nan)
    found[rows[order[::-1]]] = place[order[::-1]]  # the nearest is written last
    return found


class Pursue(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot goes straight for its quarry; without one it drives on along a way that bends at random.

    In each iteration the way then bends by a normal angle of the standard deviation `bend` sqrt(period).
    """

    bend: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.5  # rad after a second
    speed: Annotated[float, Meta(gt=0.0)] | None = None  # m/s; default: two thirds of what wheels can
    clearance: Annotated[float, Meta(ge=0.0)] = 0.2  # m, from walls

    def build(self, context: BuildContext) -> Pursuit:
        """The strategy."""
        return Pursuit(Steering(context, self.speed, self.clearance), self.bend, context)


class Pursuit:
    """Towards the quarry."""

    requires_knowledge: type[Knowledge] = Quarry

    def __init__(self, steering: Steering, bend: float, context: BuildContext) -> None:
        self._steering, self._bend = steering, bend * float(np.sqrt(context.period))
        streams = context.own_streams("pursue")
        self._salts = np.array([stream.integers(0, 2**63) for stream in streams], np.uint64)

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Quarry) -> Intents:
        """Drive to it, or on."""
        place = senses.pose[:, :2]
        yaw = senses.pose[:, 2] + self._bend * chance.normal(0, self._salts, np.array(senses.iteration))
        on = self._steering.speed * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        none = np.isnan(knowledge.quarry)
        towards = self._steering.towards(place, np.where(none, place, knowledge.quarry))
        return self._steering.intents(senses, np.where(none, on, towards))
