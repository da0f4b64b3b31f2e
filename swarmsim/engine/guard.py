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
from swarmsim.core.messages import Codec, Delivery, Inbox, Said
from swarmsim.core.own import line_of, told
from swarmsim.core.parts import (
    Channel,
    Computation,
    Curve,
    Links,
    Localisation,
    Motion,
    Parts,
    Sensor,
    Strategy,
    Summary,
    Task,
    Topology,
    WheelSpeeds,
)
from swarmsim.core.setting import Field, Setting
from swarmsim.core.state import Done, Intents, Knowledge, Measured, Moment, Readings, Senses, State
from swarmsim.engine import contracts
from swarmsim.engine.foreign import copied, lent
from swarmsim.recording.measures import RunMeasures

T = TypeVar("T")


def nothing(found: Any) -> None:
    """There is nothing to check."""


def as_it_is(value: Any) -> Any:
    """The same."""
    return value


class Guard:
    """Calls a part, and raises PartError for what it raises and for what it gives that breaks its contract."""

    def __init__(self, seam: str, part: Any) -> None:
        kind = registry.author_of(part)
        file = getattr(sys.modules[kind.__module__], "__file__", None) if registry.is_own(kind) else None
        place = f"{Path(file).name}:" if file else f"{kind.__module__}."
        self._part, self._kind, self._name = part, kind, f"{seam} {place}{kind.__qualname__}"
        self._iteration = 0
        #: What makes of arguments what the part is given: code of others cannot write to their arrays.
        self.given: Callable[[Any], Any] = lent

    def _call(self, iteration: int, verb: Callable[..., T], *given: Any, check: Callable[[T], str | None]) -> T:
        self._iteration = iteration
        try:
            found = verb(*(self.given(one) for one in given))
        except InputError:
            raise
        except (Exception, SystemExit) as problem:  # a part must not end the process, least of all as if all were well
            at = line_of(self._kind, verb.__name__)
            raise PartError(f"{self._name}, iteration {iteration}: {told(problem, at)}") from problem
        wrong = check(found)
        if wrong is not None:
            at = "" if registry.is_ours(self._kind) else line_of(self._kind, verb.__name__)
            raise PartError(f"{self._name}, iteration {iteration}: {wrong}{at}")
        return found


class GuardedSensor(Guard):
    """Readings with a row for each robot."""

    _part: Sensor

    def sense(self, state: State) -> Readings:
        """The readings, checked."""
        return self._call(
            state.iteration, self._part.sense, state, check=lambda found: contracts.readings(found, state)
        )


class GuardedLocalisation(Guard):
    """Poses and readings with a row for each robot."""

    _part: Localisation

    def locate(self, state: State, readings: Readings) -> tuple[NDArray[np.float64], Readings]:
        """The estimates, checked."""

        def locate(given: State, measured: Readings) -> tuple[NDArray[np.float64], Readings]:
            found = self._part.locate(given, measured)
            if not isinstance(found, tuple) or len(found) != 2:
                return found
            pose, put = found  # what is only passed on is given back, not lent
            return state.pose if pose is given.pose else pose, readings if put is measured else put

        return self._call(state.iteration, locate, state, readings, check=lambda found: contracts.located(found, state))


class GuardedTopology(Guard):
    """Links among live robots, in order."""

    _part: Topology

    def links(self, state: State) -> Links:
        """The links, checked."""
        return self._call(state.iteration, self._part.links, state, check=lambda found: contracts.links(found, state))


class GuardedChannel(Guard):
    """Letters among robots, in order."""

    _part: Channel

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What arrives, checked."""
        return self._call(
            state.iteration,
            self._part.deliver,
            state,
            links,
            sizes,
            check=lambda found: contracts.delivery(found, state, len(links)),
        )


class GuardedComputation(Guard):
    """Messages of the sizes they have, and knowledge that follows from what was sensed and heard."""

    _part: Computation[Any, Knowledge]

    def __init__(self, part: Computation[Any, Knowledge], setting: Setting) -> None:
        super().__init__("computation", part)
        self._auditor, self._robots = part.knows.auditor(setting), setting.swarm
        self._form: contracts.Form | None = None

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

    def say(self, senses: Senses) -> Said[Any]:
        """The messages, checked."""
        return self._call(senses.iteration, self._part.say, senses, check=lambda found: contracts.said(found, senses))

    def hear(self, senses: Senses, inbox: Inbox[Any]) -> Knowledge:
        """The knowledge, audited."""

        def check(found: Knowledge) -> str | None:
            wrong = contracts.knowledge(found, self._part.knows)
            if wrong is None:
                self._form, wrong = contracts.record(found.record(), "computation", self._robots, self._form)
            return wrong if wrong is not None else self._auditor.audit(found, senses, inbox)

        return self._call(senses.iteration, self._part.hear, senses, inbox, check=check)

    def forget(self, robots: NDArray[np.int64]) -> None:
        """Pass it on."""
        self._call(self._iteration, self._part.forget, robots, check=nothing)
        self._auditor.forget(robots)

    def adopt(self, robots: NDArray[np.int64], source: int) -> None:
        """Pass it on."""
        self._call(self._iteration, self._part.adopt, robots, source, check=nothing)
        self._auditor.adopt(robots, source)


class GuardedStrategy(Guard):
    """Intents that motors can follow."""

    _part: Strategy[Any]

    def __init__(self, part: Strategy[Any], setting: Setting) -> None:
        super().__init__("strategy", part)
        self._lattice = setting.lattice

    @property
    def reads(self) -> type[Knowledge]:
        """What it says it needs."""
        return self._part.reads

    def step(self, senses: Senses, inbox: Inbox[Any], knowledge: Knowledge) -> Intents:
        """The intents, checked."""
        return self._call(
            senses.iteration,
            self._part.step,
            senses,
            inbox,
            knowledge,
            check=lambda found: contracts.intents(found, senses, self._lattice),
        )


class GuardedTask(Guard):
    """Measures that are numbers, of the same names in every iteration."""

    _part: Task[Any]
    _form: contracts.Form | None = None

    def __init__(self, part: Task[Any], setting: Setting) -> None:
        super().__init__("task", part)
        self._taken = RunMeasures(setting.robots, setting.period, part.curve).summary().keys()

    @property
    def reads(self) -> type[Knowledge]:
        """What it says it measures."""
        return self._part.reads

    @property
    def curve(self) -> Curve:
        """Its own."""
        return self._part.curve

    def measure(self, done: Done[Any]) -> Measured:
        """The measures, checked."""

        def check(found: Measured) -> str | None:
            wrong = contracts.measured(found, done.state.robots, self._part.curve)
            if wrong is None:
                self._form, wrong = contracts.record(found.record(), "task", done.state.robots, self._form)
            return wrong

        return self._call(done.state.iteration, self._part.measure, done, check=check)

    def summaries(self) -> Sequence[Summary[Any]]:
        """Its own, held to their contracts."""
        return [GuardedSummary(one, self._taken) for one in self._part.summaries()]


class GuardedSummary(Guard):
    """Numbers under names that what is measured of every run does not have."""

    _part: Summary[Any]

    def __init__(self, part: Summary[Any], taken: Collection[str]) -> None:
        super().__init__("task", part)
        self._taken = taken

    def sample(self, moment: Moment[Any]) -> None:
        """Pass it on."""
        self._call(moment.state.iteration, self._part.sample, moment, check=nothing)

    def summary(self) -> dict[str, float | int | None]:
        """The numbers, checked."""
        return self._call(
            self._iteration, self._part.summary, check=lambda found: contracts.summary(found, self._taken)
        )


class GuardedMotion(Guard):
    """Wheel speeds for every robot."""

    _part: Motion

    def __init__(self, part: Motion, setting: Setting) -> None:
        super().__init__("motion", part)
        self._robots, self.given = setting.swarm, copied

    def follow(self, intents: Intents) -> None:
        """Pass them on."""
        self._call(self._iteration + 1, self._part.follow, intents, check=nothing)

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wheel speeds, checked at every sub-step."""
        return self._call(
            self._iteration,
            self._part.command,
            pose,
            check=lambda found: contracts.array("command", found, np.float64, self._robots, 2),
        )


class GuardedField(Guard):
    """One number for each point."""

    _part: Field

    def __init__(self, part: Field, period: float) -> None:
        """`period` of an iteration in s."""
        super().__init__("field", part)
        self._period = period

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values, checked."""
        return self._call(
            round(time / self._period),
            self._part.value,
            time,
            points,
            check=lambda found: contracts.array("value", found, np.float64, len(points)),
        )


def held_field(field: Field, period: float) -> Field:
    """The field; one that is not ours is held to its contract. `period` of an iteration in s."""
    return field if registry.is_ours(field) else GuardedField(field, period)


def guarded(parts: Parts, setting: Setting, held: Collection[str], theirs: Collection[str]) -> Parts:
    """The same parts, those of the seams `held` held to their contracts; in those of `theirs` there is code of others.

    Code of others cannot write to what it is given. Ours does not, which kernels need not be compiled anew for.
    """
    kinds: dict[str, Callable[[Any], Guard]] = {
        "sensor": lambda part: GuardedSensor("sensor", part),
        "localisation": lambda part: GuardedLocalisation("localisation", part),
        "topology": lambda part: GuardedTopology("topology", part),
        "motion": lambda part: GuardedMotion(part, setting),
        "channel": lambda part: GuardedChannel("channel", part),
        "computation": lambda part: GuardedComputation(part, setting),
        "strategy": lambda part: GuardedStrategy(part, setting),
        "task": lambda part: GuardedTask(part, setting),
    }
    guards = {seam: make(getattr(parts, seam)) for seam, make in kinds.items() if seam in held}
    for seam in guards.keys() - set(theirs):
        guards[seam].given = as_it_is
    changed: dict[str, Any] = dict(guards)
    return replace(parts, **changed)
