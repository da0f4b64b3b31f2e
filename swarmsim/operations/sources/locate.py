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
from swarmsim.core.drawing import LARGEST
from swarmsim.core.errors import InputError
from swarmsim.core.probes import ProbeTable, Row
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Record, Senses
from swarmsim.jobs.facts.board import FactBoard
from swarmsim.jobs.facts.tellers import JobStanding, Tellers
from swarmsim.jobs.facts.wire import check_budget
from swarmsim.jobs.pieces import given
from swarmsim.operations.models.job import Seconds, at_key
from swarmsim.operations.models.seam import Equation
from swarmsim.operations.sources.candidates import SourceCandidates
from swarmsim.operations.sources.greens import Greens
from swarmsim.operations.sources.inversion import FoundSource, Inversion
from swarmsim.operations.sources.searcher import SAMPLE, Searcher, SearchPlan

Positive = Annotated[float, Meta(gt=0.0, le=1e9)]
Count = Annotated[int, Meta(ge=1, le=1_000_000_000)]
FIELDS = 5  # iterations between two fields in recordings


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

    def build(self, context: BuildContext) -> Tellers[Searcher]:
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
        name, longest = self.name or "locate_source", self.repeat * context.rounds
        return Tellers(
            context, lambda robot: Searcher(plan, robot, FactBoard(robot, longest)),
            lambda parts, now: _located(parts, now, plan, name), look=_sample, tables=_tables(plan.lattice.shape),
            knowledge_type=Located,
        )  # fmt: skip


def _tables(shape: tuple[int, int]) -> tuple[ProbeTable, ...]:
    """What recordings and pictures show, on a lattice of this shape."""
    return (
        ProbeTable("estimate", "f8", ("robots", 3), "m", "estimated source", -LARGEST, LARGEST,
                   ("x", "y", "spread"), drawn="places"),
        ProbeTable("field", "f4", shape, meaning="surest robot's field", every=FIELDS, drawn="field"),
    )  # fmt: skip


def _sample(parts: Sequence[Searcher], senses: Senses) -> None:
    """All take samples."""
    field = senses.readings["field"]
    for row in np.flatnonzero(senses.alive).tolist():
        parts[row].sample(senses.iteration, senses.pose[row, :2], float(field[row]))


def _located(parts: Sequence[Searcher], now: int, plan: SearchPlan, name: str) -> Located:
    places, findings = plan.inversion.candidates.places, tuple(part.finding for part in parts)
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
    return Located(name, plan, findings, tuple(part.tried for part in parts), *columns, now)


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
    now: int  # iteration

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All columns, in order, and all strengths one after another."""
        strengths = [one.strengths for one in self.findings if one is not None]
        columns = self.place, self.strength, self.spread, self.samples, self.age, self.made
        return *columns, np.concatenate([np.empty(0), *strengths])

    def record(self) -> Record:
        """The places, and what they rest on."""
        names = ("place", "strength", "spread", "samples", "age", "made")
        return Record({f"{self.name}_{name}": getattr(self, name) for name in names})

    def sample(self, alive: NDArray[np.bool_]) -> dict[str, Row]:
        """All estimates, and the present field by that of the living robot with the smallest spread."""
        lattice = self.plan.lattice
        field = np.full(lattice.shape, np.nan, np.float32)
        spread = np.where(alive, self.spread, np.nan)
        if self.now % FIELDS == 0 and np.isfinite(spread).any():
            best = self.findings[int(np.nanargmin(spread))]
            greens, time = self.plan.inversion.greens, self.now * self.plan.period
            cells = np.arange(greens.cells)
            if best is not None and time <= greens.duration:
                field[tuple(self.plan.cells.T)] = best.forecast(greens, time, cells)
        return {"estimate": np.column_stack([self.place, spread]), "field": field}

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
