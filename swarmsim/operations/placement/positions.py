"""Robots that tell their positions, and know those of the robots they hear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.reports import Report
from swarmsim.core.state import Knowledge, Record, Senses


@dataclass(frozen=True, slots=True, eq=False)
class Position(MessageBatch):
    """The message: the robot's estimated position."""

    x: NDArray[np.float64]  # (t,): m
    y: NDArray[np.float64]  # (t,): m


@dataclass(frozen=True, slots=True, eq=False)
class Positions(Knowledge):
    """The positions of others that each robot knows: the newest heard from each in this iteration."""

    receivers: NDArray[np.int32]  # (t,): row of the robot that knows it, ascending
    senders: NDArray[np.int32]  # (t,): number of the robot that it is of
    place: NDArray[np.float64]  # (t, 2): m

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        return self.receivers, self.senders, self.place

    def record(self) -> Record:
        """Nothing: it follows from the messages' fates and the robots' positions."""
        return Record()

    def of(self, robot: int) -> SimpleNamespace:
        """One robot's knowledge: `senders` (k,) and their `place` (k, 2)."""
        mine: NDArray[np.bool_] = self.receivers == robot
        return SimpleNamespace(senders=self.senders[mine], place=self.place[mine])

    def total(self, values: NDArray[np.float64], robots: int) -> NDArray[np.float64]:
        """The sums (robots, d) of values (t, d) over each robot's items."""
        sums = [np.bincount(self.receivers, column, minlength=robots) for column in values.T]
        return np.stack(sums, axis=1)

    def counts(self, robots: int) -> NDArray[np.int64]:
        """How many others each robot (robots,) knows of."""
        return np.bincount(self.receivers, minlength=robots)


class TellPositions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot tells its estimated position, and knows only what it hears in this iteration."""

    def build(self, context: BuildContext) -> PositionComputation:
        return PositionComputation()


class PositionComputation:
    """Remembers nothing from earlier iterations."""

    knowledge_type: type[Knowledge] = Positions

    def __init__(self) -> None:
        self.codec = PlainCodec(Position(np.zeros(0), np.zeros(0)))

    def say(self, senses: Senses) -> Broadcast[Position]:
        pose = senses.pose
        return Broadcast.each(Position(pose[:, 0].copy(), pose[:, 1].copy()), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[Position]) -> Positions:
        """The newest item of each sender."""
        receivers, senders = inbox.receivers, inbox.senders
        newest = np.ones(len(receivers), np.bool_)
        newest[:-1] = (receivers[:-1] != receivers[1:]) | (senders[:-1] != senders[1:])  # sorted by iteration sent
        place = np.stack([inbox.content.x, inbox.content.y], axis=1)
        return Positions(receivers[newest], senders[newest], place[newest])

    def places(self, items: Position, sender: int) -> NDArray[np.float64]:
        """Where a sender was (p, 2), in m."""
        return np.stack([items.x, items.y], axis=1)

    def report(self, knowledge: Positions) -> Report:
        """The positions that its only robot knows."""
        return knowledge.senders, knowledge.place

    def adopt(self, reports: Sequence[Report], inbox: Inbox[Position]) -> Positions:
        """The positions that all robots know."""
        receivers = np.repeat(np.arange(len(reports), dtype=np.int32), [len(senders) for senders, _ in reports])
        senders, place = (np.concatenate(column) for column in zip(*reports, strict=True))
        return Positions(receivers, senders, place)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Nothing to forget."""

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Nothing to adopt."""
