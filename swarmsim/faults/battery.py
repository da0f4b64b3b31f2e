"""Batteries: every metre, byte and second costs energy, and a robot without any is out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Bodies, Channel, Links, Motion, Parts, Report, Setting
from swarmsim.core.state import Delivery, Event, State
from swarmsim.faults.effect import WrappedBodies
from swarmsim.faults.timeline import described

Cost = Annotated[float, Meta(ge=0.0, le=1e9)]


class Battery(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot whose battery is empty is out from the next iteration on, for good: nothing else brings it back.

    Costs depend on the robot, so there are no defaults; 0 is for what need not be counted. A message costs
    once for each link that it is sent on. Radio faults listed after the battery spare it what they silence.
    """

    capacity: Annotated[float, Meta(gt=0.0, le=1e12)]  # J, at the start
    spread: Annotated[float, Meta(ge=0.0, le=10.0)] = (
        0.0  # of capacities between robots: sd by mean, of a lognormal law
    )
    per_metre: Cost  # J/m of the straight line from where each iteration begins to where it ends
    per_byte: Cost  # J/byte sent
    idle: Cost  # W, as long as the robot is alive
    robots: list[Annotated[int, Meta(ge=0)]] | None = None  # which have such a battery; the others never tire
    empty: Literal["crash", "remove"] = "crash"  # whether an empty robot stays in the way

    def build(self, setting: Setting, number: int) -> BatteryFault:
        """The fault; raises InputError for batteries that cannot be or can never be empty."""
        count = setting.robots.count
        for robot in self.robots or ():
            if robot >= count:
                raise InputError(f"robots: there is no robot {robot}; expected ids from 0 to {count - 1}")
        if self.per_metre == self.per_byte == self.idle == 0.0:
            raise InputError("idle: nothing costs energy; expected idle, per_metre or per_byte above 0")
        return BatteryFault(self, Batteries(self, setting, number), setting)


class Batteries:
    """The energy of every robot."""

    def __init__(self, battery: Battery, setting: Setting, number: int) -> None:
        count = setting.robots.count
        variance = math.log1p(battery.spread**2)  # of the logarithm: mean and spread of the law are as given
        #: What is left in each (n,) in J; infinite for robots without a battery.
        self.left: NDArray[np.float64] = np.full(count, np.inf)
        for robot in range(count) if battery.robots is None else battery.robots:
            draw = setting.streams.open(f"fault battery {number}", robot).standard_normal()
            self.left[robot] = battery.capacity * math.exp(math.sqrt(variance) * draw - 0.5 * variance)

    def spend(self, energy: NDArray[np.floating[Any]]) -> None:
        """Take energy (n,) in J out of each, down to nothing."""
        np.maximum(self.left - energy, 0.0, out=self.left)

    @property
    def empty(self) -> NDArray[np.bool_]:
        """Which (n,) hold nothing any more."""
        return self.left <= 0.0


@dataclass(frozen=True, slots=True)
class BatteryFault:
    """Wraps the channel, where bytes are counted, and the bodies, where everything else is."""

    battery: Battery
    batteries: Batteries
    setting: Setting

    def install(self, parts: Parts) -> Parts:
        """The parts, wrapped."""
        channel = MeteredChannel(parts.channel, self.batteries, self.battery.per_byte)
        return replace(parts, channel=channel, bodies=PoweredBodies(parts.bodies, self, parts.report))


class MeteredChannel:
    """Channel that charges senders for what they send, whether or not it arrives."""

    def __init__(self, inner: Channel, batteries: Batteries, per_byte: float) -> None:
        self._inner, self._batteries, self._per_byte = inner, batteries, per_byte

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What becomes of the messages; each costs its sender."""
        self._batteries.spend(self._per_byte * np.bincount(links[:, 1], minlength=len(sizes)) * sizes)
        return self._inner.deliver(state, links, sizes)


class PoweredBodies(WrappedBodies):
    """Bodies that move while there is energy."""

    def __init__(self, inner: Bodies, fault: BatteryFault, report: Report) -> None:
        self._inner, self._batteries, self._report = inner, fault.batteries, report
        self._per_metre, self._idle = fault.battery.per_metre, fault.battery.idle
        self._speed = fault.setting.robots.speed
        self._take_out = inner.remove if fault.battery.empty == "remove" else inner.crash
        self._reported = np.zeros(fault.setting.robots.count, np.bool_)
        self._cause = described(fault.battery, "battery")

    def drive(self, motion: Motion, period: float) -> State:
        """The state one period (s) later, without the robots that it has left empty."""
        before = self._inner.state()
        after = self._inner.drive(motion, period)
        moved = np.hypot(*(after.pose[:, :2] - before.pose[:, :2]).T)
        # No robot drives farther than this by itself: what is beyond, another fault has carried it.
        driven = np.minimum(moved, self._speed * period)
        self._batteries.spend(before.alive * (self._per_metre * driven + self._idle * period))
        out = np.flatnonzero(self._batteries.empty & after.alive)
        if len(out) == 0:
            return after
        self._take_out(out)
        for robot in out[~self._reported[out]]:
            self._report.events.append(Event(after.iteration, int(robot), "battery empty", self._cause))
        self._reported[out] = True
        return self._inner.state()

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put robots back into the world, but for those without energy."""
        powered = ~self._batteries.empty[robots]
        self._inner.place(robots[powered], pose[powered])
