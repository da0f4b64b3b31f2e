"""Robots that seek the warmest place that any of them has measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.parts import Curve
from swarmsim.core.state import Done, Estimates, Intents, Measured, Senses
from swarmsim.operations.mapping.maps import Maps, TileItems
from swarmsim.operations.mapping.sharing.policies import CurrentTile
from swarmsim.operations.mapping.sharing.seam import Sharing


@dataclass(frozen=True, slots=True, eq=False)
class Felt(MessageBatch):
    """A temperature and its place."""

    warmth: NDArray[np.float64]  # (t,)
    x: NDArray[np.float64]  # (t,): m
    y: NDArray[np.float64]  # (t,): m


@dataclass(frozen=True, slots=True, eq=False)
class Warmest(Estimates):
    """The warmest place that each robot knows."""

    warmth: NDArray[np.float64]  # (n,)
    place: NDArray[np.float64]  # (n, 2): m


class Hottest(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot keeps and sends the warmest place that it has measured or heard of: maximum consensus."""

    def build(self, context: BuildContext) -> HottestComputation:
        return HottestComputation(len(context.ids))


class HottestComputation:
    """One temperature and one place per robot."""

    knowledge_type = Warmest
    requires = ("field",)  # of the sensors' channels

    def __init__(self, count: int) -> None:
        self.codec = PlainCodec(Felt(np.zeros(0), np.zeros(0), np.zeros(0)))
        self._warmth, self._place = np.full(count, -np.inf), np.zeros((count, 2))

    def say(self, senses: Senses) -> Broadcast[Felt]:
        """The warmest place so far, which may be here and now."""
        felt = senses.readings["field"]
        better = senses.alive & (felt > self._warmth)
        self._warmth[better], self._place[better] = felt[better], senses.pose[better, :2]
        return Broadcast.each(Felt(self._warmth.copy(), *self._place.T.copy()), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[Felt]) -> Warmest:
        """The warmest place heard of."""
        order = np.lexsort((inbox.senders, inbox.content.warmth))
        for row in order:  # ascending, so that the warmest stays
            robot = inbox.receivers[row]
            if inbox.content.warmth[row] > self._warmth[robot]:
                self._warmth[robot] = inbox.content.warmth[row]
                self._place[robot] = inbox.content.x[row], inbox.content.y[row]
        return Warmest(self._warmth.copy(), self._place.copy())

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Forget all places."""
        self._warmth[robots] = -np.inf

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's knowledge."""
        self._warmth[robots], self._place[robots] = self._warmth[source], self._place[source]


class NowAndThen(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Mapping robots send their current tile in one iteration of `every`, and an unknown one in all others."""

    every: int = 2  # iterations

    def build(self, context: BuildContext) -> Sometimes:
        return Sometimes(CurrentTile().build(context), self.every)


class Sometimes:
    """The current tile, sometimes."""

    def __init__(self, inner: Sharing[TileItems], every: int) -> None:
        self._inner, self._every = inner, every
        self.codec, self.accepted = inner.codec, inner.accepted

    def say(self, senses: Senses, maps: Maps) -> Broadcast[TileItems]:
        """Tiles, or nothing worth knowing."""
        if senses.iteration % self._every:
            blank = np.zeros_like(senses.readings["tiles.values"])
            senses = replace(senses, readings=senses.readings.having({"tiles.values": blank}))
        return self._inner.say(senses, maps)


class ToTheHottest(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot drives straight to the warmest place that it knows."""

    speed: float = 0.08  # m/s

    def build(self, context: BuildContext) -> Seeker:
        return Seeker(self.speed)


class Seeker:
    """Straight on."""

    requires_knowledge = Warmest

    def __init__(self, speed: float) -> None:
        self._speed = speed

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Warmest) -> Intents:
        """Turn to the place and drive."""
        way = knowledge.place - senses.pose[:, :2]
        turn = np.arctan2(way[:, 1], way[:, 0]) - senses.pose[:, 2]
        turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
        goes = senses.alive & (np.hypot(*way.T) > 0.05) & np.isfinite(knowledge.warmth)
        ahead = self._speed * np.maximum(np.cos(turn), 0.0)
        return Intents.twisting(np.where(goes[:, None], np.stack([ahead, turn], axis=1), 0.0))


class Warmth(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All live robots agree on the warmest temperature, to within a tolerance."""

    within: float = 0.01  # degrees

    def build(self, context: BuildContext) -> WarmthTask:
        return WarmthTask(self.within)


class WarmthTask:
    """The robots' disagreement."""

    requires_knowledge = Warmest
    curve = Curve("spread", "disagreement, degrees", low=0.0, format=".2f", rises=False)

    def __init__(self, within: float) -> None:
        self._within = within

    def measure(self, done: Done[Warmest]) -> Measured:
        """The largest difference between live robots' temperatures."""
        warmth = done.knowledge.warmth[done.state.alive]
        spread = float(np.ptp(warmth)) if len(warmth) else 0.0
        return Measured({"spread": spread}, {}, float(spread <= self._within), spread <= self._within)

    def summaries(self) -> tuple[Last]:
        return (Last(),)
