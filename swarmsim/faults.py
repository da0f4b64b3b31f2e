"""Faults: wrappers that make a part misbehave, with whom, when and how much."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Behaviour, Bodies, Motion, Parts, Setting
from swarmsim.core.state import Event, State

Iteration = Annotated[int, Meta(ge=1)]


class Remove(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots chosen at random vanish from the building and the network."""

    at: Iteration  # the first iteration without them
    every: Iteration | None = None  # iterations until the next are removed; default: never again
    count: Annotated[int, Meta(ge=1)] = 1  # robots at a time
    keep: Annotated[int, Meta(ge=0)] = 1  # robots that are never removed
    map: Literal["kept", "lost"] = "kept"  # whether what they mapped stays in the collective map

    def build(self, setting: Setting, number: int) -> Removal:
        """The fault, whose random choice is the stream of its `number` in the scenario."""
        if self.keep >= setting.robots.count:
            raise InputError(f"keep: {self.keep} of {setting.robots.count} robots, so that none is ever removed")
        return Removal(self, setting.streams.open("fault", number))


class Removal:
    """Wraps the bodies, and takes some out when their time has come."""

    def __init__(self, parameters: Remove, stream: np.random.Generator) -> None:
        self._parameters = parameters
        self._stream = stream

    def install(self, parts: Parts) -> Parts:
        """The parts with the bodies wrapped."""
        bodies = RemovingBodies(parts.bodies, parts.behaviour, parts.report.events, self._parameters, self._stream)
        return replace(parts, bodies=bodies)


class RemovingBodies:
    """Bodies of which some vanish at the end of an iteration's drive."""

    def __init__(
        self,
        inner: Bodies,
        behaviour: Behaviour,
        events: list[Event],
        parameters: Remove,
        stream: np.random.Generator,
    ) -> None:
        self._inner = inner
        self._behaviour = behaviour
        self._events = events
        self._parameters = parameters
        self._stream = stream

    def state(self) -> State:
        """The state now."""
        return self._inner.state()

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots out of the world."""
        self._inner.remove(robots)

    def crash(self, robots: NDArray[np.int64]) -> None:
        """Let robots stand as obstacles."""
        self._inner.crash(robots)

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put robots back into the world."""
        self._inner.place(robots, pose)

    def drive(self, motion: Motion, period: float) -> State:
        """The state one period later, without those whose time has come."""
        state = self._inner.drive(motion, period)
        alive = np.flatnonzero(state.alive)
        parameters = self._parameters
        count = min(parameters.count, len(alive) - parameters.keep)
        if count <= 0 or not self._is_due(state.iteration):
            return state
        chosen = np.sort(self._stream.choice(alive, count, replace=False))
        self._inner.remove(chosen)
        if parameters.map == "lost":
            self._behaviour.observed[chosen] = False
            self._behaviour.log_odds[chosen] = 0.0
        cause = f"remove at={parameters.at}" + (f" every={parameters.every}" if parameters.every else "")
        self._events.extend(Event(state.iteration, int(robot), "removed", cause) for robot in chosen)
        return self._inner.state()

    def _is_due(self, iteration: int) -> bool:
        since = iteration - self._parameters.at
        every = self._parameters.every
        return since == 0 or (every is not None and since > 0 and since % every == 0)
