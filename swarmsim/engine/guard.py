"""Holds somebody else's parts to what their seams promise; what breaks it ends the run, part and iteration named."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import registry
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.messages import Codec, Delivery, Said
from swarmsim.core.parts import (
    Channel,
    Computation,
    Curve,
    Field,
    Links,
    Localisation,
    Motion,
    Parts,
    Sensor,
    Setting,
    Strategy,
    Summary,
    Task,
    Topology,
    WheelSpeeds,
)
from swarmsim.core.state import Intents, Knowledge, Measured, Moment, Observations, Readings, State
from swarmsim.engine import contracts
from swarmsim.engine.foreign import told

T = TypeVar("T")


class Guard:
    """Calls a part, and raises PartError for what it raises and for what it gives that breaks its contract."""

    def __init__(self, seam: str, part: Any) -> None:
        kind = registry.author_of(part)
        file = getattr(sys.modules[kind.__module__], "__file__", None) if registry.is_own(kind) else None
        place = f"{Path(file).name}:" if file else f"{kind.__module__}."
        self._part, self._name = part, f"{seam} {place}{kind.__qualname__}"
        self._iteration = 0

    def _call(self, iteration: int, call: Callable[[], T], check: Callable[[T], str | None]) -> T:
        self._iteration = iteration
        try:
            given = call()
        except InputError:
            raise
        except Exception as problem:
            raise PartError(f"{self._name}, iteration {iteration}: {told(problem)}") from problem
        wrong = check(given)
        if wrong is not None:
            raise PartError(f"{self._name}, iteration {iteration}: {wrong}")
        return given


class GuardedSensor(Guard):
    """Readings with a row for each robot."""

    _part: Sensor

    def sense(self, state: State) -> Readings:
        """The readings, checked."""
        return self._call(state.iteration, lambda: self._part.sense(state), lambda r: contracts.readings(r, state))


class GuardedLocalisation(Guard):
    """Poses and readings with a row for each robot."""

    _part: Localisation

    def locate(self, state: State, readings: Readings) -> tuple[NDArray[np.float64], Readings]:
        """The estimates, checked."""
        return self._call(
            state.iteration,
            lambda: self._part.locate(state, readings),
            lambda given: contracts.first_of(
                contracts.pose(given[0], state),
                None if given[1] is readings else contracts.readings(given[1], state),
            ),
        )


class GuardedTopology(Guard):
    """Links among live robots, in order."""

    _part: Topology

    def links(self, state: State) -> Links:
        """The links, checked."""
        return self._call(state.iteration, lambda: self._part.links(state), lambda found: contracts.links(found, state))


class GuardedChannel(Guard):
    """Letters among robots, in order."""

    _part: Channel

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What arrives, checked."""
        return self._call(
            state.iteration,
            lambda: self._part.deliver(state, links, sizes),
            lambda found: contracts.delivery(found, state, len(links)),
        )


class GuardedComputation(Guard):
    """Messages of the sizes they have, and knowledge that follows from what was sensed and heard."""

    _part: Computation

    def __init__(self, part: Computation, setting: Setting) -> None:
        super().__init__("computation", part)
        self._auditor = part.knows.auditor(setting)

    @property
    def knows(self) -> type[Knowledge]:
        """What it says it gives."""
        return self._part.knows

    @property
    def codec(self) -> Codec[Any]:
        """Its own."""
        return self._part.codec

    @property
    def maps(self) -> Any:
        """What all robots know, for those who map."""
        return self._part.maps  # type: ignore[attr-defined]

    def say(self, observations: Observations) -> Said[Any]:
        """The messages, checked."""
        return self._call(
            observations.iteration,
            lambda: self._part.say(observations),
            lambda found: contracts.said(found, observations),
        )

    def hear(self, observations: Observations) -> Knowledge:
        """The knowledge, audited."""

        def check(found: Knowledge) -> str | None:
            wrong = contracts.knowledge(found, self._part.knows)
            return wrong if wrong is not None else self._auditor.audit(found, observations)

        return self._call(observations.iteration, lambda: self._part.hear(observations), check)

    def forget(self, robots: NDArray[np.int64]) -> None:
        """Pass it on."""
        self._call(self._iteration, lambda: self._part.forget(robots), lambda _: None)
        self._auditor.forget(robots)

    def adopt(self, robots: NDArray[np.int64], source: int) -> None:
        """Pass it on."""
        self._call(self._iteration, lambda: self._part.adopt(robots, source), lambda _: None)
        self._auditor.adopt(robots, source)


class GuardedStrategy(Guard):
    """Intents that motors can follow."""

    _part: Strategy

    @property
    def reads(self) -> type[Knowledge]:
        """What it says it needs."""
        return self._part.reads

    def step(self, observations: Observations) -> Intents:
        """The intents, checked."""
        return self._call(
            observations.iteration,
            lambda: self._part.step(observations),
            lambda found: contracts.intents(found, observations),
        )


class GuardedTask(Guard):
    """Measures that are numbers, of the same names in every iteration."""

    _part: Task
    _names: tuple[tuple[str, ...], tuple[str, ...]] | None = None

    @property
    def reads(self) -> type[Knowledge]:
        """What it says it measures."""
        return self._part.reads

    @property
    def curve(self) -> Curve:
        """Its own."""
        return self._part.curve

    def measure(self, moment: Moment) -> Measured:
        """The measures, checked."""

        def check(found: Measured) -> str | None:
            wrong = contracts.measured(found, moment.state.robots)
            names = None if wrong else (tuple(found.values), tuple(found.robots))
            self._names = self._names or names
            if names != self._names and wrong is None:
                return f"measure: {names} after {self._names}; expected the same names in every iteration"
            return wrong

        return self._call(moment.state.iteration, lambda: self._part.measure(moment), check)

    def summaries(self) -> Sequence[Summary]:
        """Its own."""
        return self._part.summaries()


class GuardedMotion(Guard):
    """Wheel speeds for every robot."""

    _part: Motion

    def __init__(self, part: Motion, setting: Setting) -> None:
        super().__init__("motion", part)
        self._robots = setting.robots.count

    def follow(self, intents: Intents) -> None:
        """Pass them on."""
        self._call(self._iteration + 1, lambda: self._part.follow(intents), lambda _: None)

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wheel speeds, checked at every sub-step."""
        return self._call(
            self._iteration,
            lambda: self._part.command(pose),
            lambda found: contracts.array("command", found, np.float64, self._robots, 2),
        )


class GuardedField(Guard):
    """One number for each point."""

    _part: Field

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values, checked."""
        return self._call(
            self._iteration,
            lambda: self._part.value(time, points),
            lambda found: contracts.array("value", found, np.float64, len(points)),
        )


def held_field(field: Field) -> Field:
    """The field; one that is not ours is held to its contract."""
    return field if registry.is_ours(field) else GuardedField("field", field)


def guarded(parts: Parts, setting: Setting, held: Collection[str]) -> Parts:
    """The same parts, those of these seams held to their contracts."""
    wrap: dict[str, Callable[[Any], Any]] = {
        "sensor": lambda part: GuardedSensor("sensor", part),
        "localisation": lambda part: GuardedLocalisation("localisation", part),
        "topology": lambda part: GuardedTopology("topology", part),
        "motion": lambda part: GuardedMotion(part, setting),
        "channel": lambda part: GuardedChannel("channel", part),
        "computation": lambda part: GuardedComputation(part, setting),
        "strategy": lambda part: GuardedStrategy("strategy", part),
        "task": lambda part: GuardedTask("task", part),
    }
    return replace(parts, **{seam: make(getattr(parts, seam)) for seam, make in wrap.items() if seam in held})
