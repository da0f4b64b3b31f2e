"""The tick: one iteration of Algorithm 1 for the whole swarm, then of the world's physics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from swarmsim.core.parts import Parts, Probe
from swarmsim.core.state import Coverage, Event, Moment, Observations
from swarmsim.kernels import occupancy


class Simulation:
    """A swarm in a building, advanced one iteration at a time until it has mapped enough."""

    def __init__(
        self,
        parts: Parts,
        period: float,
        coverage: float,
        limit: int,
        at_coverage: Literal["stop", "go-on"] = "stop",
    ) -> None:
        """`coverage` is the share of the building's domain that ends the run, `limit` the number of iterations
        after which it ends unfinished, `period` the duration of one in s. A run that goes on `at_coverage` ends at
        the limit, but finished.
        """
        self.parts = parts
        self._domain = np.empty(0, np.uint64)
        self._version = -1  # of the building whose domain that is
        self._wanted = coverage
        self._limit = limit
        self._stops = at_coverage == "stop"
        self._period = period
        self.state = parts.bodies.state()
        #: The iterations after which the coverage was first reached; None if it has not been.
        self.finished_after: int | None = None

    @property
    def finished(self) -> bool:
        """Whether the coverage has been reached."""
        return self.finished_after is not None

    @property
    def over(self) -> bool:
        """Whether the run has ended, finished or at its limit."""
        return (self.finished and self._stops) or self.state.iteration >= self._limit

    def run(self, probes: Sequence[Probe] = ()) -> bool:
        """Tick to the end of the run; gives whether the coverage was reached before the limit."""
        while not self.over:
            self.tick(probes)
        return self.finished

    def tick(self, probes: Sequence[Probe] = ()) -> None:
        """One iteration: everybody senses, shares, maps and decides; then everybody moves."""
        parts, state = self.parts, self.state
        tiles = parts.sensor.sense(state)
        pose, tiles = parts.localisation.locate(state, tiles)
        said = parts.sharing.say(state, tiles)
        links = parts.topology.links(state)
        delivery = parts.channel.deliver(state, links, said.sizes)
        inbox = parts.sharing.hear(delivery)
        intents = parts.behaviour.step(Observations(state.iteration, pose, state.alive, tiles, inbox))
        coverage = self._measure()
        parts.report.coverage = coverage.share
        parts.motion.follow(intents)
        self.state = parts.bodies.drive(parts.motion, self._period)
        if self.finished_after is None and coverage.share >= self._wanted:
            self.finished_after = self.state.iteration
        events = (*parts.report.events, *self._ending())
        parts.report.events.clear()
        moment = Moment(state, tiles, links, delivery, inbox, intents, coverage, events)
        for probe in probes:
            probe.sample(moment)

    def _ending(self) -> tuple[Event, ...]:
        if not self.over:
            return ()
        cause = f"coverage {self._wanted:g} reached" if self.finished else f"limit of {self._limit} iterations"
        return (Event(self.state.iteration - 1, -1, "finished" if self.finished else "not finished", cause),)

    def _measure(self) -> Coverage:
        building = self.parts.building
        if self._version != building.version:
            self._version = building.version
            self._domain = building.domain.reshape(-1).view(np.uint64)
            self._union = np.zeros_like(self._domain)
            self._cells = int(building.domain.sum())
        observed = self.parts.behaviour.observed.reshape(self.state.robots, -1).view(np.uint64)
        each, union = occupancy.count_observed(observed, self._domain, self._union)
        return Coverage(union, each, self._cells)
