"""A model that is not computed in shares: samples go to those who compute it whole, and answers come back."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.scenario.part import Part
from swarmsim.jobs.facts.tellers import Tellers
from swarmsim.jobs.facts.wire import check_budget
from swarmsim.jobs.pieces import bisected, given
from swarmsim.operations.gathering.eyes import Eyes
from swarmsim.operations.gathering.gatherer import NUMBER, TAIL, Gatherer, GatherPlan
from swarmsim.operations.gathering.known import FieldLedger, tables_of
from swarmsim.operations.gathering.levels import WholeFloor
from swarmsim.operations.models.faces import Faces
from swarmsim.operations.models.job import problem_of
from swarmsim.operations.models.seam import Equation

To = Literal["none", "all", "base", "servers", "holders"]


class Gather(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot takes a sample in an iteration, and a model of the floor is computed from the samples of all.

    With `to = "none"` nobody says anything, and each robot computes from its own samples. `"all"`: samples are flooded,
    and each robot computes from all of them. `"base"`: one robot computes, and `"servers"`: some do, each from all
    samples; answers go back to the robots: to each its `"piece"`, or to all the `"field"`. `"holders"`: nobody
    computes; a sample goes to the robot that holds its piece at the start of a job in as many pieces as robots.

    A level lasts `every` iterations and is computed at its end from the samples in it. The floor plan is handed out
    before the run.
    """

    model: Part[Equation]
    to: To
    name: Annotated[str, Meta(pattern="^([a-z][a-z0-9_]*)?$")] = ""  # in recordings; default: the part's
    base: Annotated[int, Meta(ge=0, le=1_000_000_000)] = 0  # the robot
    servers: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 3  # evenly among the robots' numbers
    down: Literal["piece", "field"] = "piece"
    every: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 20  # iterations of a level
    levels: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 9  # of the run
    rate: Annotated[float, Meta(gt=0.0)] = 1.0  # 1/s, at which the field is drawn to samples
    budget: Annotated[int, Meta(ge=1, le=1_000_000_000)] | None = None  # bytes a message

    def build(self, context: BuildContext) -> Tellers[Gatherer]:
        """The job. Raises InputError for what cannot be gathered."""
        if context.scalar_field is None or "field" not in context.channels.places:
            raise InputError("use: 'gather' needs samples of a field; expected a table [field]")
        domain = given(context)
        problem = problem_of(self.model, (), self.every * context.period, domain, context)
        number = Faces.of(domain).number
        cells = tuple(number[tuple(one.cells.T)] for one in bisected(domain, context.swarm, 0))
        piece = np.empty(sum(map(len, cells)), np.int64)
        for which, one in enumerate(cells):
            piece[one] = which
        computers = self.computers(context.swarm)
        sinks = () if self.to in ("none", "all") else computers
        every = tuple((one,) if self.to == "holders" else sinks for one in range(context.swarm))
        scheme = GatherPlan(
            self.to == "all", computers, every, piece, cells, self.down == "field", self.every, self.levels,
            WholeFloor(problem, self.rate), self.budget,
        )  # fmt: skip
        largest = max(map(len, cells)) * NUMBER.itemsize + 1 if sinks else 0
        check_budget(self.budget, [max(largest, TAIL.size + max(map(len, every)))], "a sample or an answer")
        eyes, ledger = Eyes(context, number), FieldLedger(scheme, self.name or "gather", context)
        return Tellers(
            context, lambda robot: Gatherer(scheme, eyes, robot), ledger,
            look=lambda parts, senses: eyes.look(senses), tables=tables_of(context.lattice.shape),
        )  # fmt: skip

    def computers(self, swarm: int) -> tuple[int, ...]:
        """The robots that compute. Raises InputError for robots that there are not."""
        for key, value, most in (("base", self.base, swarm - 1), ("servers", self.servers, swarm)):
            if self.to == key and value > most:
                raise InputError(f"{key}: {value} with {swarm} robots; expected {most} or less")
        spread = tuple(swarm * number // self.servers for number in range(self.servers))
        everybody = tuple(range(swarm))
        return {"none": everybody, "all": everybody, "base": (self.base,), "servers": spread, "holders": ()}[self.to]
