"""Robots that wander and keep clear of obstacles that their beams meet: the simplest swarm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.reports import Report
from swarmsim.core.state import Done, Intents, Knowledge, Measured, Record, Senses, State
from swarmsim.kernels import wander

Positive = Annotated[float, Meta(gt=0.0)]
AHEAD: Final = 256  # iterations whose draws are made at once


class Wander(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot drives at constant speed along a randomly bending way, away from obstacles that its beams meet.

    Its sensor has to give ranges, `ranges = true`. In each iteration the way bends by a normal angle of the standard
    deviation `bend` sqrt(period), a correlated random walk (Kareiva and Shigesada 1983).
    """

    speed: Positive | None = None  # m/s; default: two thirds of what wheels can
    clearance: Annotated[float, Meta(ge=0.0)] = 0.3  # m; 0 avoids nothing
    bend: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.3  # rad after a second

    def build(self, context: BuildContext) -> Wandering:
        return Wandering(self, context)


class Wandering:
    """Velocities from beams."""

    requires = ("ranges",)
    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do

    def __init__(self, parameters: Wander, context: BuildContext) -> None:
        self._speed = parameters.speed or context.robots.speed * 2.0 / 3.0
        self._clearance, self._period = parameters.clearance, context.period
        self._bend = parameters.bend * float(np.sqrt(context.period))
        streams = context.own_streams("wander")
        self._salts = np.array([stream.integers(0, 2**63) for stream in streams], np.uint64)
        self._block, self._turns = -1, np.empty((0, 0))

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """Drive on, away from near obstacles."""
        readings = senses.readings
        block, within = divmod(senses.iteration, AHEAD)
        if block != self._block:
            when = np.arange(block * AHEAD, (block + 1) * AHEAD)[:, None]
            self._block, self._turns = block, self._bend * chance.normal(0, self._salts, when)
        twists: NDArray[np.float64] = wander.steer_clear(
            readings.channels.axis("ranges"), readings["ranges"], senses.alive, self._turns[within],
            self._clearance, self._speed, self._period,
        )  # fmt: skip
        return Intents.twisting(twists)


@dataclass(frozen=True, slots=True, eq=False)
class EmptyMessage(MessageBatch):
    """The message of silent robots: that they exist."""

    flag: NDArray[np.uint8]  # (t,): 0


@dataclass(frozen=True, slots=True, eq=False)
class NoKnowledge(Knowledge):
    """Empty knowledge."""

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """None."""
        return ()

    def record(self) -> Record:
        """Nothing."""
        return Record()


class Reactive(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots that compute nothing: they remember nothing and send a single byte."""

    def build(self, context: BuildContext) -> Reacting:
        return Reacting(len(context.ids))


class Reacting:
    """Nothing is computed."""

    knowledge_type: type[Knowledge] = NoKnowledge

    def __init__(self, robots: int) -> None:
        self.codec = PlainCodec(EmptyMessage(np.zeros(0, np.uint8)))
        self._said = Broadcast.each(EmptyMessage(np.zeros(robots, np.uint8)), self.codec.size)

    def say(self, senses: Senses) -> Broadcast[EmptyMessage]:
        """A single byte."""
        return self._said

    def hear(self, senses: Senses, inbox: Inbox[EmptyMessage]) -> NoKnowledge:
        """Nothing."""
        return NoKnowledge()

    def report(self, knowledge: NoKnowledge) -> Report:
        """Nothing."""
        return ()

    def adopt(self, reports: Sequence[Report], inbox: Inbox[EmptyMessage]) -> NoKnowledge:
        """Nothing."""
        return NoKnowledge()

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Nothing to forget."""

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Nothing to adopt."""


class Travelled(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The robots have driven `distance` on average."""

    distance: Positive  # m

    def build(self, context: BuildContext) -> TravelTask:
        return TravelTask(self.distance, context)


class TravelTask:
    """Adds up the ways of robots, live ones and others."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve("travelled", "way of a robot, m", format=".2f")

    def __init__(self, distance: float, context: BuildContext) -> None:
        self._distance, self._way = distance, 0.0
        self._leap = 2.0 * context.robots.speed * context.period  # m; a robot that moved this far was carried
        self._last: State | None = None

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The mean distance driven so far, in m."""
        state, last = done.state, self._last
        if last is not None:
            step = state.pose[:, :2] - last.pose[:, :2]
            length = np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2)
            self._way += float(length.sum(where=last.alive & (length < self._leap))) / state.robots
        self._last = state
        return Measured({"travelled": self._way}, {}, min(1.0, self._way / self._distance), self._way >= self._distance)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        return (Last(),)
