"""Where robots go that search a source: to where those that may be it disagree."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.state import Intents, Knowledge, Senses
from swarmsim.operations.fields.sampling import Legs, Margin, Waypoints
from swarmsim.operations.sources.inversion import FoundSource
from swarmsim.operations.sources.locate import Located
from swarmsim.operations.sources.searcher import SearchPlan


class MostDisputed(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot drives straight to where a sample would tell its likely candidates for the source apart.

    It draws a cell with a probability that falls by 63 % every `nearness` metres and grows with ln(1 + v / noise^2),
    twice what the sample would tell in nats (Lindley 1956): v is how far the candidates disagree when it gets there,
    noise the one that its mind assumes. So robots that know the same go to different places. It draws anew when it has
    arrived, and when it has inverted its samples. As long as it has found no source it drives to random places. It
    ignores walls: for open floors. Its mind has to be `locate-source`.
    """

    margin: Margin = 0.4  # m, from the edges of the page
    nearness: Annotated[float, Meta(gt=0.0, le=1e6)] = 3.0  # m

    def build(self, context: BuildContext) -> Disputed:
        return Disputed(self, context)


class Disputed:
    """A place for each robot, drawn by its number, its count of places and what it has found."""

    requires_knowledge: type[Knowledge] = Located

    def __init__(self, parameters: MostDisputed, context: BuildContext) -> None:
        self._nearness, self._ids, self._speed = parameters.nearness, context.ids, context.robots.each("speed")
        self._period = context.period
        self._legs = Legs(context)
        self._anywhere = Waypoints(context, parameters.margin)
        self._salt = int(context.streams.open("disputed places").integers(0, 2**64, dtype=np.uint64))

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Located) -> Intents:
        """On to the place, or to a new one."""
        found = np.isfinite(knowledge.strength) & (knowledge.made == senses.iteration)
        robots = np.union1d(self._legs.arrived(senses), np.flatnonzero(senses.alive & found))
        places = self._anywhere.drawn(robots, self._legs.counts[robots])
        dice = chance.uniform(self._salt, self._ids[robots], self._legs.counts[robots], 0)
        for row, (robot, die) in enumerate(zip(robots.tolist(), dice.tolist(), strict=True)):
            finding = knowledge.findings[robot]
            place = None if finding is None else self._place(robot, finding, knowledge.plan, senses, die)
            places[row] = places[row] if place is None else place
        return self._legs.intents(senses, robots, places)

    def _place(
        self, robot: int, finding: FoundSource, plan: SearchPlan, senses: Senses, die: float
    ) -> NDArray[np.float64] | None:
        """The place (2,) that a robot draws with a number from 0 to 1; None if there is nothing to tell."""
        greens, candidates = plan.inversion.greens, plan.inversion.candidates
        cells = self._anywhere.inside(candidates.places)
        places = candidates.places[cells]
        away = np.hypot(*(places - senses.pose[robot, :2]).T)
        times = np.minimum(senses.iteration * self._period + away / self._speed[robot], greens.duration)
        variance = finding.variance(greens, times, cells) if len(cells) else np.empty(0)
        gains = np.cumsum(np.log1p(variance / plan.inversion.noise**2) * np.exp(-away / self._nearness))
        if len(gains) == 0 or not gains[-1] > 0.0:
            return None
        return np.asarray(places[np.searchsorted(gains, die * gains[-1], side="right")])
