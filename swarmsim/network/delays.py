"""Channels that hold messages back: by a delay, by a radio's bandwidth, and by time slots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Final, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Delivery, Packets
from swarmsim.core.parts import Links, NetworkChannel
from swarmsim.core.state import State
from swarmsim.network.channel import StackedChannel, but_lost, in_order

SLACK: Final = 1e-9  # relative; sums of decimal fractions of a second miss whole seconds by rounding

Income = Callable[[int], NDArray[np.float64]]  # bytes that each robot (n,) may send in an iteration


class Latency(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each message takes some iterations to arrive, even if its sender dies meanwhile.

    `fixed`: for exactly `delay` iterations. `geometric`: for k >= 0 with probability q (1 - q)^k, where
    q = 1 / (1 + `delay`), so that `delay` is the mean; a message can overtake another.
    """

    delay: Annotated[float, Meta(ge=0.0, le=1e6)]  # iterations
    law: Literal["fixed", "geometric"] = "fixed"

    @property
    def delays(self) -> bool:
        return True

    def build(self, context: BuildContext) -> LatentChannel:
        """The channel. Raises InputError for a fixed delay that is not a whole number."""
        below = self.below(context)
        if self.law == "fixed":
            if not self.delay.is_integer():
                raise InputError(f'delay: {self.delay:g} with law = "fixed"; expected a whole number of iterations')
            return LatentChannel(below, lambda arrived: np.full(len(arrived), self.delay, np.int64))
        salt, stay = self.salt(context), self.delay / (1.0 + self.delay)

        def geometric(arrived: Packets) -> NDArray[np.int64]:
            if stay == 0.0:
                return np.zeros(len(arrived), np.int64)
            draw = 1.0 - chance.uniform(salt, arrived[:, 2], arrived[:, 0], arrived[:, 1])  # in (0, 1]
            return np.asarray(np.floor(np.log(draw) / np.log(stay)), np.int64)

        return LatentChannel(below, geometric)


class LatentChannel:
    """Messages on the air, each with the iteration in which it is due."""

    def __init__(self, below: NetworkChannel, delays: Callable[[Packets], NDArray[np.int64]]) -> None:
        """`delays` gives how many iterations each of the messages (m, 4) is under way."""
        self._below = below
        self._delays = delays
        self._letters = np.empty((0, 4), np.int32)
        self._due = np.empty(0, np.int64)

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """The messages due now; those for robots that have died are lost as "receiver dead"."""
        below = self._below.deliver(state, links, sizes)
        letters = np.concatenate([self._letters, below.heard])
        due = np.concatenate([self._due, state.iteration + self._delays(below.heard)])
        arrived = due <= state.iteration
        self._letters, self._due = letters[~arrived], due[~arrived]
        return _received(state, letters[arrived], below, self._letters)


class Bandwidth(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot sends at a limited rate (bytes/s), each message separately to each receiver, first in first out.

    With `network.charged = "sent"` a message is sent once for all receivers. Unsent messages wait. Idle time is not
    saved up.
    """

    bytes_per_second: Annotated[float, Meta(gt=0.0)]  # bytes that a sender can send in a second
    queue: Annotated[int, Meta(ge=0)] | None = None  # messages that can wait from one iteration to the next
    expiry: Annotated[int, Meta(ge=0)] | None = None  # iterations, the oldest age at which a message is sent

    @property
    def delays(self) -> bool:
        return True

    def longest(self, period: float) -> float:
        """The bytes of the longest message that gets through before it expires, in iterations of `period` s."""
        return np.inf if self.expiry is None else self.bytes_per_second * period * (self.expiry + 1)

    def build(self, context: BuildContext) -> QueueingChannel:
        robots = context.swarm
        income = np.full(robots, self.bytes_per_second * context.period)
        queues = TransmitQueues(robots, self.queue, self.expiry, context.broadcasts)
        return QueueingChannel(self.below(context), queues, lambda iteration: income)


class Tdma(StackedChannel, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Time division: robots take turns, and send waiting messages when their own slot begins.

    Robot i's slot is number i mod `slots` of each frame of `slots` times `slot` seconds; the defaults are ten slots
    of 0.1 s in a frame of 1 s. A message whose slot begins within an iteration is heard in that iteration. Robots
    with the same slot are assumed not to collide.
    """

    slots: Annotated[int, Meta(ge=1)] = 10  # in a frame
    slot: Annotated[float, Meta(gt=0.0)] = 0.1  # s, from one slot to the next
    expiry: Annotated[float, Meta(ge=0.0)] = 1.4  # s, the oldest age at which a message is sent
    bytes: Annotated[float, Meta(gt=0.0)] | None = None  # per slot; default: any number

    @property
    def delays(self) -> bool:
        return True

    def longest(self, period: float) -> float:
        """The bytes of the longest message that gets through before it expires."""
        turns = int(self.expiry / (self.slots * self.slot) * (1.0 + SLACK)) + 1
        return np.inf if self.bytes is None else self.bytes * turns

    def build(self, context: BuildContext) -> QueueingChannel:
        robots, period = context.swarm, context.period
        frame, opening = self.slots * self.slot, np.arange(robots) % self.slots * self.slot
        capacity = np.inf if self.bytes is None else self.bytes

        def income(iteration: int) -> NDArray[np.float64]:
            before, after = (np.ceil((t * period - opening) / frame - SLACK) for t in (iteration, iteration + 1))
            return np.where(after > before, capacity * np.maximum(after - before, 1.0), 0.0)

        expiry = int(self.expiry / period * (1.0 + SLACK))
        queues = TransmitQueues(robots, None, expiry, context.broadcasts)
        return QueueingChannel(self.below(context), queues, income)


class QueueingChannel:
    """Robots that can send a limited number of bytes in each iteration."""

    def __init__(
        self, below: NetworkChannel, queues: TransmitQueues, income: Callable[[int], NDArray[np.float64]]
    ) -> None:
        """`income` gives how many bytes each robot (n,) may send in an iteration."""
        self._below = below
        self._queues = queues
        self._income = income

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """The waiting messages that are sent in this iteration."""
        below = self._below.deliver(state, links, sizes)
        return self._queues.send(state, below, self._income(state.iteration))


class TransmitQueues:
    """The messages waiting in each robot's radio, first in first out; within an iteration, lowest receiver id first.

    A robot's unused bytes add up while something waits, so that a message can be longer than one iteration's bytes.
    Messages are lost as "sender dead" with the robot in whose radio they wait, as "expired" if they get too old, as
    "queue full" if too many wait, and as "receiver dead" if the receiver has died.
    """

    def __init__(self, robots: int, limit: int | None, expiry: int | None, broadcasts: bool = False) -> None:
        """At most `limit` messages wait from one iteration to the next, and none longer than `expiry` iterations.

        One that `broadcasts` sends a message once for all its receivers.
        """
        self._broadcasts = broadcasts
        self._limit = limit
        self._expiry = expiry
        self._waiting = np.empty((0, 4), np.int32)  # by sender, then in the order in which they came
        self._credit = np.zeros(robots)  # bytes

    def send(self, state: State, below: Delivery, income: NDArray[np.float64]) -> Delivery:
        """Queue what the channel `below` delivers, then send up to `income` (n,) more bytes."""
        waiting = np.concatenate([self._waiting, below.heard])
        all_ = Delivery(waiting[np.argsort(waiting[:, 1], kind="stable")], below.lost, below.oldest)
        all_ = but_lost(all_, "sender dead", ~state.alive[all_.heard[:, 1]])
        if self._expiry is not None:
            all_ = but_lost(all_, "expired", all_.heard[:, 2] < state.iteration - self._expiry)
        waiting, senders = all_.heard, all_.heard[:, 1]
        self._credit += income
        costs = self._costs(waiting)
        fits = _running(costs, senders) <= self._credit[senders] * (1.0 + SLACK)
        sent, waiting = waiting[fits], waiting[~fits]
        self._credit -= np.bincount(sent[:, 1], costs[fits], len(self._credit))
        rest = Delivery(waiting, all_.lost, all_.oldest)
        if self._limit is not None:
            place = _running(np.ones(len(waiting), np.int64), waiting[:, 1])
            rest = but_lost(rest, "queue full", place > self._limit)
        self._waiting = rest.heard
        self._credit[np.bincount(self._waiting[:, 1], minlength=len(self._credit)) == 0] = 0.0
        return _received(state, sent, rest, self._waiting)

    def _costs(self, waiting: Packets) -> NDArray[np.int32]:
        """The bytes that each waiting message (m, 4) takes to send."""
        if not self._broadcasts:
            return waiting[:, 3]
        again = np.zeros(len(waiting), np.bool_)  # the same message for another receiver
        again[1:] = (waiting[1:, 1] == waiting[:-1, 1]) & (waiting[1:, 2] == waiting[:-1, 2])
        return np.where(again, 0, waiting[:, 3]).astype(np.int32)


def _running(amounts: NDArray[np.integer], groups: NDArray[np.int32]) -> NDArray[np.int64]:
    """The running sums of the `amounts` (m,) within each of the sorted `groups` (m,)."""
    total = np.cumsum(amounts, dtype=np.int64)
    first = np.searchsorted(groups, groups, side="left")
    return np.asarray(total - (total - amounts)[first])


def _received(state: State, arrived: Packets, rest: Delivery, under_way: Packets) -> Delivery:
    """The delivery of the messages that `arrived` and the losses so far, while more are `under_way`."""
    oldest = min(rest.oldest, state.iteration, int(under_way[:, 2].min(initial=state.iteration)))
    delivery = Delivery(in_order(arrived), rest.lost, oldest)
    return but_lost(delivery, "receiver dead", ~state.alive[delivery.heard[:, 0]])
