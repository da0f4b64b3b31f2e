"""Faults of radios: robots that fall silent or deaf, lost or delayed messages, and jammed or cut-off places."""

from __future__ import annotations

from abc import ABC
from dataclasses import replace
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.messages import Delivery, Packets
from swarmsim.core.parts import Links, NetworkChannel, Parts
from swarmsim.core.state import State
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.timeline import Duration, Robots, Share, Timed, Timeline
from swarmsim.network.channel import but_lost, in_order, letters

Group = Annotated[tuple[Annotated[int, Meta(ge=0)], ...], Meta(min_length=1)]


class Radio(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Messages get lost or come late.

    `transmit`: nothing is sent; `receive`: nothing is heard; `off`: neither. `loss`: each message sent or heard by
    the robots struck is lost with the probability `loss`. `delay`: it arrives this many iterations later.
    These strike robots, as their keys say. The following strike the network, and have no keys that select robots:
    `jam`: robots inside `area` at that moment neither send nor hear. `partition`: nothing passes between `groups` of
    ids (unnamed robots form one more), or between robots that are on different sides of `x` or `y` when it begins.
    A message under way is subject to the faults at its arrival.
    """

    failure: Literal["transmit", "receive", "off", "loss", "delay", "jam", "partition"]
    loss: Share | None = None  # for loss: probability
    delay: Duration | None = None  # for delay: iterations
    area: Box | None = None  # for jam: left, lower, right, upper in m
    groups: tuple[Group, ...] | None = None  # for partition: ids
    x: float | None = None  # for partition: m
    y: float | None = None  # for partition: m

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for keys that contradict each other, its failure or the swarm."""
        _check(self, context.swarm)
        of_robots = self.failure not in ("jam", "partition")
        course = Timeline(self, context) if of_robots else NetworkSchedule(self, context)
        return TimedFault(course, _disturbance(self, context), context.number)


def _check(fault: Radio, robots: int) -> None:
    own = {"loss": "loss", "delay": "delay", "area": "jam", "groups": "partition", "x": "partition", "y": "partition"}
    given = [key for key in own if getattr(fault, key) is not None]
    for key in given:
        if own[key] != fault.failure:
            raise InputError(f"{key}: a radio with {fault.failure!r} has none; expected failure = {own[key]!r}")
    needed = [key for key in own if own[key] == fault.failure]
    if needed and not given:
        raise InputError(f"{needed[0]}: required key is missing; expected {' or '.join(needed)}")
    if len(given) > 1:
        raise InputError(f"{given[1]}: {given[0]} says where the network parts already; expected one of them")
    if fault.area is not None and not (fault.area[0] < fault.area[2] and fault.area[1] < fault.area[3]):
        raise InputError(f"area: {list(fault.area)} has no size; expected [left, lower, right, upper] in m")
    if fault.groups is not None:
        _check_groups(fault.groups, robots)
    if fault.failure in ("jam", "partition"):
        for key in ("life", "robots", "group", "count", "fraction", "target", "point", "region", "min_alive"):
            if getattr(fault, key) != _default(key):
                raise InputError(f"{key}: {fault.failure!r} strikes the network, not robots; expected no such key")


def _default(key: str) -> object:
    return next(field.default for field in msgspec.structs.fields(Timed) if field.name == key)


def _check_groups(groups: tuple[Group, ...], robots: int) -> None:
    ids = [robot for group in groups for robot in group]
    for place, robot in enumerate(ids):
        if robot >= robots:
            raise InputError(f"groups: there is no robot {robot}; expected ids from 0 to {robots - 1}")
        if robot in ids[:place]:
            raise InputError(f"groups: robot {robot} is named twice; expected each id once")
    if len(groups) == 1 and len(ids) == robots:
        raise InputError("groups: all robots are in one; expected two groups or more")


def _disturbance(fault: Radio, context: BuildContext) -> Disturbance:
    if fault.loss is not None:
        stream = context.streams.open(f"fault radio {context.number}")
        return Loss(fault.loss, int(stream.integers(0, 2**64, dtype=np.uint64)))
    if fault.delay is not None:
        return Delay(fault.delay)
    if fault.area is not None:
        return Jam(fault.area)
    if fault.failure == "partition":
        return Partition(fault, context.swarm)
    return Silence(fault.failure)


class NetworkSchedule:
    """When a fault of the whole network is there: then all robots have it, and its events name none."""

    def __init__(self, fault: Timed, context: BuildContext) -> None:
        # The network acts as the only robot to strike.
        alone = replace(context, swarm=1)
        self._timeline = Timeline(msgspec.structs.replace(fault, min_alive=0), alone)
        #: Which robots have the fault (n,): all or none; a live view.
        self.active: NDArray[np.bool_] = np.zeros(context.swarm, np.bool_)

    def advance(self, state: State, progress: float, parts: Parts) -> tuple[Robots, Robots]:
        """Move on to the iteration of `state`; gives [-1] for a beginning and for an end, else nothing."""
        network = State(state.iteration, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 2)), np.ones(1, np.bool_))
        begins, ends = self._timeline.advance(network, progress, parts)
        self.active[:] = self._timeline.active[0]
        return begins - 1, ends - 1


class Disturbance(StatelessEffect, ABC):
    """Wraps the channel, together with all other disturbances; this one changes no message."""

    reason = ""  # why messages are lost

    def __init__(self) -> None:
        self._active: NDArray[np.bool_] = np.zeros(0, np.bool_)

    @property
    def active(self) -> bool:
        """Whether any robot has the fault in this iteration."""
        return bool(self._active.any())

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the channel wrapped, once for all disturbances."""
        self._active = active
        channel = parts.channel
        if isinstance(channel, DisturbedChannel):
            return replace(parts, channel=DisturbedChannel(channel.inner, (*channel.disturbances, self)))
        return replace(parts, channel=DisturbedChannel(channel, (self,)))

    def leaving(self, state: State, sent: Packets) -> NDArray[np.bool_]:
        """Which of the messages (m, 4) sent now never reach the channel."""
        return np.zeros(len(sent), np.bool_)

    def arriving(self, state: State, arrived: Packets) -> NDArray[np.bool_]:
        """Which of the messages (m, 4) that the channel delivers now are not heard."""
        return np.zeros(len(arrived), np.bool_)

    def delays(self, arrived: Packets) -> NDArray[np.int64]:
        """The delay, in iterations, of each of the messages (m, 4) that the channel delivers now."""
        return np.zeros(len(arrived), np.int64)


class Silence(Disturbance):
    """Robots that do not send, do not hear, or neither."""

    reason = "radio off"

    def __init__(self, failure: str) -> None:
        super().__init__()
        self._sends, self._hears = failure == "receive", failure == "transmit"

    def leaving(self, state: State, sent: Packets) -> NDArray[np.bool_]:
        """Messages of robots without a transmitter."""
        return self._active[sent[:, 1]] & (not self._sends)

    def arriving(self, state: State, arrived: Packets) -> NDArray[np.bool_]:
        """Messages to robots without a receiver."""
        return self._active[arrived[:, 0]] & (not self._hears)


class Loss(Disturbance):
    """Robots with a bad radio: some messages to and from them are lost."""

    reason = "loss"

    def __init__(self, probability: float, salt: int) -> None:
        super().__init__()
        self._probability, self._salt = probability, salt

    def leaving(self, state: State, sent: Packets) -> NDArray[np.bool_]:
        """Messages to or from robots with the fault, by one draw each."""
        draw = chance.uniform(self._salt, sent[:, 2], sent[:, 0], sent[:, 1])
        return self._active[sent[:, :2]].any(axis=1) & (draw < self._probability)


class Delay(Disturbance):
    """Robots with a slow radio: messages to and from them take longer."""

    def __init__(self, iterations: int) -> None:
        super().__init__()
        self._iterations = iterations

    def delays(self, arrived: Packets) -> NDArray[np.int64]:
        """The delay for messages to or from robots with the fault."""
        return np.where(self._active[arrived[:, :2]].any(axis=1), self._iterations, 0)


class Jam(Disturbance):
    """A place where nothing is sent or heard."""

    reason = "jammed"

    def __init__(self, area: Box) -> None:
        super().__init__()
        self._area = area

    def _inside(self, state: State) -> NDArray[np.bool_]:
        left, low, right, high = self._area
        x, y = state.pose[:, 0], state.pose[:, 1]
        return self._active & (x >= left) & (x <= right) & (y >= low) & (y <= high)

    def leaving(self, state: State, sent: Packets) -> NDArray[np.bool_]:
        """Messages from inside."""
        return self._inside(state)[sent[:, 1]]

    def arriving(self, state: State, arrived: Packets) -> NDArray[np.bool_]:
        """Messages to robots inside."""
        return self._inside(state)[arrived[:, 0]]


class Partition(Disturbance):
    """A network split into parts; nothing passes between them."""

    reason = "partition"

    def __init__(self, fault: Radio, robots: int) -> None:
        super().__init__()
        self._x, self._y = fault.x, fault.y
        self._part = np.zeros(robots, np.int64)  # 0 for robots in no group
        for number, group in enumerate(fault.groups or (), 1):
            self._part[list(group)] = number

    def begin(self, robots: Robots, state: State) -> None:
        """Robots belong to their present side of the line until the end."""
        if self._x is not None:
            self._part[:] = state.pose[:, 0] < self._x
        if self._y is not None:
            self._part[:] = state.pose[:, 1] < self._y

    def leaving(self, state: State, sent: Packets) -> NDArray[np.bool_]:
        """Messages between two parts."""
        return np.asarray(self._active[sent[:, 0]] & (self._part[sent[:, 0]] != self._part[sent[:, 1]]))

    def arriving(self, state: State, arrived: Packets) -> NDArray[np.bool_]:
        """Messages between two parts that were sent before it began."""
        return self.leaving(state, arrived)


class DisturbedChannel:
    """A channel with all disturbances around it; their order decides only the reason given for a loss.

    Messages that never leave a sender do not reach the channel; late ones are held here; and one that cannot be
    heard when it arrives is lost then, as "receiver dead" if the receiver died while it was held.
    """

    def __init__(self, inner: NetworkChannel, disturbances: tuple[Disturbance, ...]) -> None:
        self.inner, self.disturbances = inner, disturbances
        self._held = np.empty((0, 4), np.int32)
        self._due = np.empty(0, np.int64)

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """The fate of new messages, of those in the channel and of those held here."""
        now, acting = state.iteration, [one for one in self.disturbances if one.active]
        if not acting and len(self._held) == 0:
            return self.inner.deliver(state, links, sizes)
        sent = Delivery(letters(now, links, sizes), (), now)
        for one in acting:
            sent = but_lost(sent, one.reason, one.leaving(state, sent.heard))
        inner = self.inner.deliver(state, np.ascontiguousarray(sent.heard[:, :2]), sizes)
        late = sum((one.delays(inner.heard) for one in acting), np.zeros(len(inner.heard), np.int64))
        waiting, due = np.concatenate([self._held, inner.heard]), np.concatenate([self._due, now + late])
        arrived = due <= now
        self._held, self._due = waiting[~arrived], due[~arrived]
        oldest = min(inner.oldest, int(self._held[:, 2].min(initial=now)))
        delivery = Delivery(in_order(waiting[arrived]), (*sent.lost, *inner.lost), oldest)
        delivery = but_lost(delivery, "receiver dead", ~state.alive[delivery.heard[:, 0]])
        for one in acting:
            delivery = but_lost(delivery, one.reason, one.arriving(state, delivery.heard))
        return delivery
