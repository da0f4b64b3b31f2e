"""The job of finding an unknown source, and predicting its field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Broadcast, Inbox
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Knowledge, Record, Senses
from swarmsim.jobs.facts.board import FactBoard
from swarmsim.jobs.facts.tellers import JobStanding, Tellers
from swarmsim.jobs.facts.wire import Facts, check_budget
from swarmsim.jobs.pieces import given
from swarmsim.operations.models.job import Seconds, at_key
from swarmsim.operations.models.seam import Equation
from swarmsim.operations.sources.candidates import SourceCandidates
from swarmsim.operations.sources.greens import Greens
from swarmsim.operations.sources.inversion import FoundSource, Inversion
from swarmsim.operations.sources.searcher import SAMPLE, Searcher, SearchPlan

Positive = Annotated[float, Meta(gt=0.0, le=1e9)]
Count = Annotated[int, Meta(ge=1, le=1_000_000_000)]


class LocateSource(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots find the one source of a field and predict the field, each from its own samples and those it hears.

    Each takes a sample every so many iterations, and tells of all that it has. It tries candidate cells, `spacing`
    apart and then ever finer: by non-negative least squares on the candidates' Green's functions it estimates the
    strength in every `pulse`, and takes the cell that leaves least unexplained.

    Robots are told the model, the floor plan, whose free cells that are connected to the entrance are the domain, and
    that the field is 0 at first. They are told of no source.
    """

    model: Part[Equation]
    dt: Seconds  # s, of a step in time
    pulse: Seconds  # s, a whole number of steps: the source's strength is taken as constant meanwhile
    duration: Seconds  # s, a whole number of pulses: from the start up to the latest time predicted
    spacing: Positive = 2.0  # m between the first candidates
    noise: Positive = 0.05  # assumed standard deviation of a sample, in the field's unit
    change: Positive = 0.05  # unit m^2/s: by how much the strength changes from pulse to pulse (standard deviation)
    every: Count = 5  # iterations between two samples of a robot
    interval: Count = 10  # iterations between two inversions
    repeat: Count = 10  # iterations after which samples are told again, at most
    budget: Count | None = None  # bytes a message
    name: Annotated[str, Meta(pattern="^([a-z][a-z0-9_]*)?$")] = ""  # in recordings; default: the part's

    def build(self, context: BuildContext) -> SourceSearch:
        """The job. Raises InputError without a field, and for keys that do not fit together, which it names."""
        if context.scalar_field is None:
            raise InputError("use: 'locate-source' searches the source of a field; expected a table [field]")
        check_budget(self.budget, [SAMPLE.size], "a sample")
        domain = given(context)
        equation = self.model.build(context, "model")
        with at_key("model"):
            equations = equation.on(domain)
        greens = Greens(equations, domain, self.dt, self.pulse, self.duration)
        candidates = SourceCandidates(domain, self.spacing)
        if len(candidates.coarse) > greens.most:
            raise InputError(
                f"spacing: {len(candidates.coarse)} candidates at {self.spacing:g} m; the Green's functions "
                f"of {greens.most} can be kept; expected a larger spacing, or longer steps dt"
            )
        inversion = Inversion(greens, candidates, self.noise, self.change)
        plan = SearchPlan.of(inversion, domain, context.period, (self.every, self.interval, self.budget))
        return SourceSearch(plan, self.name or "locate_source", self.repeat * context.rounds, context)


class SourceSearch:
    """The job for some robots, or all: samples go into each robot's table, which the robots share.

    It may be their mind's computation too.
    """

    def __init__(self, plan: SearchPlan, name: str, longest: int, context: BuildContext) -> None:
        """Samples are told again after at most `longest` exchanges."""
        self._name, self._longest, self._ids = name, longest, context.ids.tolist()
        #: What all robots know before the run.
        self.plan = plan
        self._parts: dict[int, Searcher] = {}
        self._tellers = Tellers(context, self._new, self._located)
        #: The form of its messages.
        self.codec = self._tellers.codec
        #: What it tells.
        self.knowledge_type: type[Knowledge] = Located

    def _new(self, robot: int) -> Searcher:
        self._parts[robot] = Searcher(self.plan, robot, FactBoard(robot, self._longest))
        return self._parts[robot]

    def say(self, senses: Senses) -> Broadcast[Facts]:
        """Take samples, and tell of them."""
        field = senses.readings["field"]
        for row in np.flatnonzero(senses.alive).tolist():
            self._parts[self._ids[row]].sample(senses.iteration, senses.pose[row, :2], float(field[row]))
        return self._tellers.say(senses)

    def hear(self, senses: Senses, inbox: Inbox[Facts]) -> JobStanding:
        """What robots have found."""
        return self._tellers.hear(senses, inbox)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase all samples of these rows (r,)."""
        self._tellers.reset(robots)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give these rows (r,) the samples of the row `source`."""
        self._tellers.copy_from(robots, source)

    def _located(self, parts: Sequence[Searcher], now: int) -> Located:
        places, findings = self.plan.inversion.candidates.places, tuple(part.finding for part in parts)
        nowhere = np.full(2, np.nan)
        columns = (
            np.array([nowhere if one is None else places[one.cell] for one in findings]).reshape(-1, 2),
            np.array([np.nan if one is None else one.strengths[-1] for one in findings]),
            np.array([np.nan if one is None else one.spread for one in findings]),
            np.array([part.count() for part in parts], np.int64),
            np.array([part.age(now) for part in parts]),
            np.array([part.made for part in parts], np.int64),
        )
        for column in columns:
            column.setflags(write=False)
        return Located(self._name, self.plan, findings, tuple(part.tried for part in parts), *columns)


@dataclass(frozen=True, slots=True, eq=False)
class Located(JobStanding):
    """Where robots take the source to be; NaN as long as their samples tell of none. All arrays are read-only."""

    name: str
    plan: SearchPlan
    findings: tuple[FoundSource | None, ...]  # (n,): of the last inversion
    tried: tuple[frozenset[int], ...]  # (n,): the candidates whose Green's functions each has used
    place: NDArray[np.float64]  # (n, 2): m
    strength: NDArray[np.float64]  # (n,): unit m^2/s, at last
    spread: NDArray[np.float64]  # (n,): m, standard deviation of the place
    samples: NDArray[np.int64]  # (n,): how many each has
    age: NDArray[np.float64]  # (n,): s, mean time since the newest sample of each other robot heard of
    made: NDArray[np.int64]  # (n,): iteration of the last inversion; -1 for none

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All columns, in order, and all strengths one after another."""
        strengths = [one.strengths for one in self.findings if one is not None]
        columns = self.place, self.strength, self.spread, self.samples, self.age, self.made
        return *columns, np.concatenate([np.empty(0), *strengths])

    def record(self) -> Record:
        """The places, and what they rest on."""
        names = ("place", "strength", "spread", "samples", "age", "made")
        return Record({f"{self.name}_{name}": getattr(self, name) for name in names})

    def of(self, robot: int) -> SimpleNamespace:
        """One robot's finding."""
        return SimpleNamespace(place=self.place[robot], strength=self.strength[robot], spread=self.spread[robot])

    def share(self, alive: NDArray[np.bool_]) -> float:
        """The share of living robots that have found a source."""
        return float(np.isfinite(self.strength[alive]).mean()) if alive.any() else 0.0

    def ended(self, alive: NDArray[np.bool_]) -> bool:
        """Whether all have."""
        return self.share(alive) == 1.0

    def numbers(self, alive: NDArray[np.bool_]) -> dict[str, float]:
        """The share that has found a source, and how many samples a robot has on average."""
        return {"found_share": self.share(alive), "samples": float(self.samples[alive].mean()) if alive.any() else 0.0}

    def work(self, alive: NDArray[np.bool_]) -> tuple[float, float]:
        """Operations of Green's functions a living robot: of one that computes its own, and with all shared evenly."""
        used = [self.tried[robot] for robot in np.flatnonzero(alive).tolist()]
        if not used:
            return 0.0, 0.0
        one = self.plan.inversion.greens.work
        return one * float(np.mean([len(tried) for tried in used])), one * len(frozenset().union(*used)) / len(used)
