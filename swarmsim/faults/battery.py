"""Batteries: every metre, byte and second costs energy, and a robot without any is out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext, Gauge
from swarmsim.core.errors import InputError
from swarmsim.core.events import Begins, Event
from swarmsim.core.messages import Delivery
from swarmsim.core.parts import Bodies, Links, NetworkChannel, Parts, Tick
from swarmsim.core.state import State
from swarmsim.faults.timeline import Mark

Cost = Annotated[float, Meta(ge=0.0, le=1e9)]


class Battery(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot with an empty battery is out from the next iteration on, for good: nothing revives it.

    Costs depend on the robot, so they have no defaults; 0 ignores a cost. A message costs once for each link it is
    sent on. Messages silenced by radio faults listed after the battery cost nothing.
    """

    capacity: Annotated[float, Meta(gt=0.0, le=1e12)]  # J, at the start
    spread: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0  # of capacities: sd over mean, of a lognormal law
    per_metre: Cost  # J/m of the straight line from where each iteration begins to where it ends
    per_byte: Cost  # J/byte sent
    idle: Cost  # W, as long as the robot is alive
    robots: tuple[Annotated[int, Meta(ge=0)], ...] | None = None  # which have such a battery; the others never tire
    empty: Literal["crash", "remove"] = "crash"  # whether an empty robot stays in the way

    @property
    def mark(self) -> Mark:
        """How an empty robot is marked."""
        return "removed" if self.empty == "remove" else "fault"

    def build(self, context: BuildContext) -> BatteryFault:
        """The fault; raises InputError for impossible batteries and for those that can never be empty."""
        count = context.swarm
        for robot in self.robots or ():
            if robot >= count:
                raise InputError(f"robots: there is no robot {robot}; expected ids from 0 to {count - 1}")
        if self.per_metre == self.per_byte == self.idle == 0.0:
            raise InputError("idle: nothing costs energy; expected idle, per_metre or per_byte above 0")
        return BatteryFault(self, Energy(self, context), context)


class Energy:
    """The energy of every robot."""

    def __init__(self, battery: Battery, context: BuildContext) -> None:
        count = context.swarm
        variance = math.log1p(battery.spread**2)  # of the logarithm: mean and spread of the law are as given
        #: What is left in each (n,) in J; infinite for robots without a battery.
        self.left: NDArray[np.float64] = np.full(count, np.inf)
        for robot in range(count) if battery.robots is None else battery.robots:
            draw = context.streams.open(f"fault battery {context.number}", robot).standard_normal()
            self.left[robot] = battery.capacity * math.exp(math.sqrt(variance) * draw - 0.5 * variance)

    def spend(self, energy: NDArray[np.floating]) -> None:
        """Take energy (n,) in J out of each, down to 0."""
        np.maximum(self.left - energy, 0.0, out=self.left)

    @property
    def empty(self) -> NDArray[np.bool_]:
        """Which (n,) are empty."""
        return self.left <= 0.0


@dataclass(frozen=True, slots=True)
class BatteryFault:
    """Wraps the channel to count bytes, and counts all other costs between two iterations."""

    battery: Battery
    batteries: Energy
    context: BuildContext

    def install(self, parts: Parts) -> Parts:
        channel = MeteredChannel(parts.channel, self.batteries, self.battery.per_byte)
        parts.schedule.enter(Exhaustion(parts.bodies, self))
        energy = Gauge("energy", "J", self.batteries.left.copy)
        return replace(parts, channel=channel, gauges=(*parts.gauges, energy))


class MeteredChannel:
    """Channel that charges senders for each message, whether or not it arrives."""

    def __init__(self, inner: NetworkChannel, batteries: Energy, per_byte: float) -> None:
        self._inner, self._batteries, self._per_byte = inner, batteries, per_byte

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """The fate of the messages; each costs its sender."""
        self._batteries.spend(self._per_byte * np.bincount(links[:, 1], minlength=len(sizes)) * sizes)
        return self._inner.deliver(state, links, sizes)


class Exhaustion:
    """Takes robots without energy out."""

    def __init__(self, bodies: Bodies, fault: BatteryFault) -> None:
        self._bodies, self._batteries, self._number = bodies, fault.batteries, fault.context.number
        self._per_metre, self._idle = fault.battery.per_metre, fault.battery.idle
        self._farthest, self._period = fault.context.robots.speed * fault.context.period, fault.context.period
        self._take_out = bodies.remove if fault.battery.empty == "remove" else bodies.crash
        self._reported = np.zeros(fault.context.swarm, np.bool_)

    def advance(self, now: Tick) -> Sequence[Event]:
        """Charge all robots for the last iteration, and take out those left empty."""
        if now.iteration == 0:
            return ()
        before, after = now.before, now.after
        moved = np.hypot(*(after.pose[:, :2] - before.pose[:, :2]).T)
        # No robot drives farther than this by itself: beyond that, another fault has carried it.
        driven = np.minimum(moved, self._farthest)
        self._batteries.spend(before.alive * (self._per_metre * driven + self._idle * self._period))
        out = np.flatnonzero(self._batteries.empty & self._bodies.state().alive)
        if len(out) == 0:
            return ()
        self._take_out(out)
        self._bodies.retire(out)
        new = out[~self._reported[out]]
        self._reported[out] = True
        return (Begins(now.iteration, self._number, tuple(new.tolist())),) if len(new) else ()
