"""The timeline of a fault: when it strikes, which robots, and for how long."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Parts
from swarmsim.core.state import State

Iteration = Annotated[int, Meta(ge=0, le=100_000)]  # no run is longer
Duration = Annotated[int, Meta(ge=1, le=100_000)]  # iterations
Share = Annotated[float, Meta(gt=0.0, le=1.0)]
Robots = NDArray[np.int64]  # (r,): ids, sorted


class Life(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Weibull lifetimes (Weibull 1951); shape 1 is exponential, above 1 models wear-out."""

    mean: Annotated[float, Meta(gt=0.0)]  # iterations
    shape: Annotated[float, Meta(ge=0.1)] = 1.0  # below 0.1 the law is so skew that its mean says nothing


#: How pictures mark robots that have a fault; robots that are dead are drawn as such.
Mark = Literal["", "fault", "removed", "late"]


class Timed(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys that every kind of fault has. One of `at`, `between`, `progress`, `rate` and `life` says when."""

    at: Iteration | None = None  # the first iteration with the fault
    every: Duration | None = None  # after `at`: iterations until it strikes again; default: never
    between: tuple[Iteration, Iteration] | None = None  # the first iteration with, and the first without it
    progress: Share | None = None  # strikes once this share of the task is done
    rate: Annotated[float, Meta(gt=0.0, le=1000.0)] | None = None  # strikes per iteration, as a Poisson process
    life: Life | None = None  # strikes each robot once, after its own random lifetime
    duration: Duration | None = None  # iterations with the fault; default: for good
    duty: tuple[Duration, Duration] | None = None  # intermittent: iterations with and then without it, in turn
    robots: tuple[Annotated[int, Meta(ge=0)], ...] | None = None  # these
    group: str | None = None  # those of this group of robots, by its name or number
    count: Annotated[int, Meta(ge=1)] | None = None  # robots at a time; default: 1, or all in `region`
    fraction: Share | None = None  # share of the live robots, rounded, but one at least
    target: Literal["random", "nearest", "farthest", "hub"] = "random"  # the hub is heard by most
    point: tuple[float, float] | None = None  # m: what nearest and farthest are measured from
    region: tuple[float, float, float, float] | None = None  # m: only robots with centres in left, lower, right, upper
    min_alive: Annotated[int, Meta(ge=0)] = 1  # live robots that are never struck


class Timeline:
    """Which robots have the fault in the coming iteration.

    It moves forward between two iterations, so that a fault `at` an iteration holds from its first beam on.
    """

    def __init__(self, fault: Timed, context: BuildContext) -> None:
        """Its streams are named by the fault's place in the scenario. Raises InputError."""
        number = context.number
        _check(fault, context.swarm)
        self._fault = fault
        self._those: list[int] | None = None if fault.robots is None else list(fault.robots)
        if fault.group is not None:
            self._those = context.robots.group(fault.group, "group").tolist()
        self._stream = context.streams.open("fault", number)
        self._since = np.full(context.swarm, -1, np.int64)  # the iteration in which it struck; -1 for not
        self._spent = np.zeros(context.swarm, np.bool_)  # robots whose life has ended
        self._reached = False
        self._lives = np.full(context.swarm, np.inf)
        if fault.life is not None:
            scale = fault.life.mean / math.gamma(1.0 + 1.0 / fault.life.shape)
            for robot in range(context.swarm):
                stream = context.streams.open(f"fault {number} life", robot)
                self._lives[robot] = np.ceil(scale * stream.weibull(fault.life.shape))
        #: Which robots have the fault in this iteration (n,); a live view.
        self.active: NDArray[np.bool_] = np.zeros(context.swarm, np.bool_)

    def advance(self, state: State, progress: float, parts: Parts) -> tuple[Robots, Robots]:
        """Move on to the iteration of `state`; gives the robots that get the fault, and those that lose it."""
        now, fault = state.iteration, self._fault
        if fault.between is not None:
            lasts: int | None = fault.between[1] - fault.between[0]
        else:
            lasts = fault.duration
        if lasts is not None:
            self._since[(self._since >= 0) & (now - self._since >= lasts)] = -1
        for _ in range(self._strikes(now, progress)):
            self._since[self._struck(state, parts)] = now
        active = self._since >= 0
        if fault.duty is not None:
            active &= (now - self._since) % sum(fault.duty) < fault.duty[0]
            active &= state.alive | self.active  # robots that are out by another fault are not this one's to bring back
        begins, ends = np.flatnonzero(active & ~self.active), np.flatnonzero(self.active & ~active)
        self.active[:] = active
        return begins, ends

    def _strikes(self, now: int, progress: float) -> int:
        """How often the fault strikes at the start of iteration `now`."""
        fault = self._fault
        first = fault.at if fault.between is None else fault.between[0]
        if first is not None:
            since = now - first
            return int(since == 0 or (fault.every is not None and since > 0 and since % fault.every == 0))
        if fault.progress is not None:
            before, self._reached = self._reached, self._reached or progress >= fault.progress
            return int(self._reached and not before)
        if fault.rate is not None:
            return int(self._stream.poisson(fault.rate)) if now > 0 else 0
        return int((self._lives <= now).any())

    def _struck(self, state: State, parts: Parts) -> Robots:
        """The robots it strikes now; `min_alive` are kept."""
        fault = self._fault
        open_ = state.alive & (self._since < 0)
        room = int(open_.sum()) - fault.min_alive
        if self._those is not None:
            chosen = np.zeros_like(open_)
            chosen[self._those] = True
            open_ = open_ & chosen
        if fault.life is not None:
            open_ = open_ & (self._lives <= state.iteration) & ~self._spent
        if fault.region is not None:
            left, low, right, high = fault.region
            x, y = state.pose[:, 0], state.pose[:, 1]
            open_ = open_ & (x >= left) & (x <= right) & (y >= low) & (y <= high)
        candidates = np.flatnonzero(open_)
        count = min(self._wanted(candidates, state), len(candidates), room)
        if count <= 0:
            return candidates[:0]
        if fault.target == "random":
            struck = self._stream.choice(candidates, count, replace=False)
        else:
            struck = candidates[np.argsort(self._order(state, parts)[candidates], kind="stable")[:count]]
        self._spent[struck] = True
        return np.sort(struck)

    def _wanted(self, candidates: Robots, state: State) -> int:
        fault = self._fault
        if fault.fraction is not None:
            return max(1, round(fault.fraction * int(state.alive.sum())))
        if fault.count is not None:
            return fault.count
        everybody = self._those is not None or fault.region is not None or fault.life is not None
        return len(candidates) if everybody else 1

    def _order(self, state: State, parts: Parts) -> NDArray[np.float64]:
        """A number for each robot (n,): the lowest are struck first."""
        if self._fault.target == "hub":
            heard_by = np.bincount(parts.topology.links(state)[:, 1], minlength=state.robots)
            return -heard_by.astype(np.float64)
        apart: NDArray[np.float64] = np.hypot(*(state.pose[:, :2] - np.array(self._fault.point)).T)
        return apart if self._fault.target == "nearest" else -apart


def _check(fault: Timed, robots: int) -> None:
    """Raise InputError for keys that contradict each other or the swarm."""
    when = [key for key in ("at", "between", "progress", "rate", "life") if getattr(fault, key) is not None]
    if not when:
        raise InputError("at: required key is missing; expected at, between, progress, rate or life to say when")
    if len(when) > 1:
        raise InputError(
            f"{when[1]}: the fault strikes {when[0]}={getattr(fault, when[0])} already; expected one of them"
        )
    if fault.every is not None and fault.at is None:
        raise InputError("every: nothing to count from; expected `at` as well")
    if fault.between is not None and fault.between[1] <= fault.between[0]:
        raise InputError(f"between: {list(fault.between)} is empty; expected the second to be later than the first")
    if fault.between is not None and fault.duration is not None:
        raise InputError("duration: `between` says how long already; expected one of them")
    if fault.min_alive >= robots:
        raise InputError(f"min_alive: {fault.min_alive} of {robots} robots, so that none is ever struck")
    if fault.robots is not None and fault.group is not None:
        raise InputError("group: `robots` says whom already; expected one of them")
    if fault.robots == ():
        raise InputError("robots: the list is empty; expected at least one id, or no such key")
    for robot in fault.robots or ():
        if robot >= robots:
            raise InputError(f"robots: there is no robot {robot}; expected ids from 0 to {robots - 1}")
    if fault.count is not None and fault.fraction is not None:
        raise InputError("fraction: `count` says how many already; expected one of them")
    if fault.target in ("nearest", "farthest") and fault.point is None:
        raise InputError(f"point: required key is missing; expected x and y in m for target={fault.target!r}")
    if fault.point is not None and fault.target not in ("nearest", "farthest"):
        raise InputError(f"point: target={fault.target!r} measures nothing; expected target='nearest' or 'farthest'")
    if fault.region is not None and not (fault.region[0] < fault.region[2] and fault.region[1] < fault.region[3]):
        raise InputError(f"region: {list(fault.region)} holds nothing; expected left, lower, right, upper edge in m")
