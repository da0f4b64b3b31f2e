"""The tick: one iteration of Algorithm 1 for the whole swarm, then one period of physics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError, PartError
from swarmsim.core.events import Ended, Event
from swarmsim.core.messages import Delivery, Inbox, MessageBatch
from swarmsim.core.own import is_failure
from swarmsim.core.parts import Motion, Observer, Parts, Tick, Tracking, WheelSpeeds
from swarmsim.core.readings import Readings
from swarmsim.core.state import Done, Intents, Knowledge, Moment, Senses, State
from swarmsim.engine.exchange import Exchange
from swarmsim.engine.guard import Clock


@dataclass(frozen=True, slots=True, eq=False)
class Perceived:
    """An iteration up to the decision."""

    state: State
    events: tuple[Event, ...]  # at its start
    links: NDArray[np.int32]  # (m, 2): receiver, sender
    delivery: Delivery
    senses: Senses
    inbox: Inbox[MessageBatch]
    knowledge: Knowledge


class Steered:
    """Motion control on estimated poses."""

    def __init__(self, inner: Motion, localisation: Tracking) -> None:
        self._inner, self._localisation = inner, localisation

    def follow(self, intents: Intents) -> None:
        self._inner.follow(intents)

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wheel speeds at the estimates of these poses."""
        return self._inner.command(self._localisation.track(pose))


class Simulation:
    """A swarm in a building, advanced iteration by iteration until its task is done."""

    def __init__(
        self,
        parts: Parts,
        period: float,
        limit: int,
        when_done: Literal["stop", "continue"] = "stop",
        blamed: Callable[[BaseException], str | None] = lambda problem: None,
        name: str = "",
        clock: Clock | None = None,
        rounds: int = 1,
    ) -> None:
        """The run ends unfinished after `limit` iterations of `period` s each.

        A run that continues `when_done` ends at the limit, but finished. `blamed` finds the third-party part that
        raised an exception, if any. `name` is the scenario's file, for messages. The `clock` is that of the guards.
        `rounds` is the number of exchanges of messages in an iteration, all but the first for jobs alone.
        """
        self.parts = parts
        self.state = parts.bodies.state()
        #: The number of iterations after which the task was first done; None if it is not.
        self.finished_after: int | None = None
        self._period, self._limit, self._stops = period, limit, when_done == "stop"
        self._blamed = blamed
        self.name = name
        self.clock = clock or Clock()
        self._exchange = Exchange(rounds)
        self._now = Tick(0, self.state, self.state, 0.0)
        self._decided: Intents | None = None
        self._acted = Readings.filled(parts.actuator.channels, {}, self.state.alive)

    @property
    def finished(self) -> bool:
        """Whether the task has been done."""
        return self.finished_after is not None

    @property
    def over(self) -> bool:
        """Whether the run has ended, finished or at its limit."""
        return (self.finished and self._stops) or self.state.iteration >= self._limit

    def run(self, observers: Sequence[Observer] = ()) -> bool:
        """Tick to the end of the run; return whether the task was done before the limit."""
        while not self.over:
            self.tick(observers)
        return self.finished

    def tick(self, observers: Sequence[Observer] = ()) -> Moment[Knowledge]:
        """One iteration: due events fire; all robots sense, share, compute and decide; then all robots move.

        Raises PartError for what a third-party part raises.
        """
        with self._blaming():
            perceived = self._perceive()
            intents = self.parts.strategy.step(perceived.senses, perceived.inbox, perceived.knowledge)
            return self._act(perceived, intents, observers)

    def perceive(self) -> Perceived:
        """The first half of a tick: robots sense, receive and compute. Called once, before `act`."""
        with self._blaming():
            return self._perceive()

    def act(self, perceived: Perceived, intents: Intents, observers: Sequence[Observer] = ()) -> Moment[Knowledge]:
        """The other half: robots carry out these intents, made without their strategy, and the task is measured."""
        with self._blaming():
            return self._act(perceived, intents, observers)

    @contextmanager
    def _blaming(self) -> Iterator[None]:
        try:
            yield
        except InputError as problem:  # conflicts of parts that appear only in a run
            raise InputError(f"{self.name}: {problem}" if self.name else str(problem)) from problem
        except PartError:
            raise
        except BaseException as problem:
            whose = self._blamed(problem) if is_failure(problem) else None
            if whose is None:
                raise
            raise PartError(f"iteration {self.clock.iteration}, {whose}", whose.partition(" ")[0]) from problem

    def _perceive(self) -> Perceived:
        parts = self.parts
        self.clock.turn(self.state.iteration)
        events = parts.schedule.advance(self._now)
        state = parts.bodies.state() if parts.schedule else self.state
        if self._acted.columns:
            state = replace(state, actuators=self._acted.blanked(~state.alive))
        sensed = parts.sensor.sense(state)
        pose = parts.localisation.locate(state)
        readings = sensed.put(state.pose, pose, parts.lattice)
        senses = Senses(state.iteration, pose, state.velocity, state.alive, readings, self._decided)
        said = parts.computation.say(senses)
        links = parts.topology.links(state)
        inbox = self._exchange.first(parts.channel, state, links, said)
        knowledge = parts.computation.hear(senses, inbox)
        self._exchange.rest(parts.channel, state, links, senses, parts.jobs)
        delivery, own = self._exchange.delivery, replace(inbox, beside=()) if inbox.beside else inbox
        return Perceived(state, events, links, delivery, senses, own, knowledge)

    def _act(self, perceived: Perceived, intents: Intents, observers: Sequence[Observer]) -> Moment[Knowledge]:
        parts, state, senses = self.parts, perceived.state, perceived.senses
        self._decided = intents
        if self._acted.columns:
            wanted = Readings.filled(self._acted.channels, intents.commands, state.alive)
            self._acted = parts.actuator.act(wanted, state)
        people = parts.building.walkers() if parts.building.crowds else None
        parts.motion.follow(intents)
        motion = parts.motion if parts.localisation.exact else Steered(parts.motion, parts.localisation)
        self.state = parts.bodies.drive(motion, self._period)
        all_of_it = (
            parts.building, senses.readings, perceived.links, perceived.delivery, perceived.inbox, perceived.knowledge,
            intents, senses.pose, people, parts.jobs.told if parts.jobs else (), self._exchange.traffic,
        )  # fmt: skip
        measured = parts.task.measure(Done(state, perceived.events, *all_of_it))
        if measured.finished and not self.finished:
            self.finished_after = self.state.iteration
        self._now = Tick(self.state.iteration, state, self.state, measured.progress)
        events = (*perceived.events, *self._ending())
        moment = Moment(state, events, *all_of_it, measured)
        for observer in observers:
            observer.sample(moment)
        return moment

    def _ending(self) -> tuple[Event, ...]:
        return (Ended(self.state.iteration - 1, self.finished),) if self.over else ()
