"""What recordings and pictures get of a job in pieces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import Values
from swarmsim.core.lattice import Lattice
from swarmsim.core.probes import GONE, ONCE, PIECES, ProbeTable, Row
from swarmsim.jobs.plan import JobPlan

HEARD: Final = 8  # robots whose halos a robot's row names, at most
OFTEN: Final = 5  # iterations between two samples of a field ...
MANY: Final = 50_000  # ... of so many cells; more seldom of more


@dataclass(frozen=True, slots=True, eq=False)
class Sighted:
    """What was seen of a job, besides what robots have of it; arrays are read-only."""

    lattice: Lattice
    holder: NDArray[np.int32]  # (p,): the robot that computes each piece, NOBODY, or GONE: no robot alive has a state
    age: NDArray[np.float64]  # (p,): of the halos that its last step used, in exchanges; NaN for none
    halos: NDArray[np.int32]  # (n, HEARD): robots from whom each has heard a new halo in this iteration; -1 for none
    ages: float  # exchanges: the sum over all steps with halos
    aged: int  # how many steps these are

    def rows(
        self, plan: JobPlan, step: NDArray[np.int32], states: Sequence[Mapping[int, tuple[int, Values]]]
    ) -> dict[str, Row]:
        """A row of each of the tables of `tables_of`.

        `step` (p,) is what living robots have, `states` the step and state of what each robot computes, by piece.
        """
        shape = self.lattice.shape
        piece, field = np.full(shape, -1, np.int32), np.full(shape, np.nan, np.float32)
        for one, holder in zip(plan.pieces, self.holder.tolist(), strict=True):
            at = tuple(one.cells.T)
            piece[at] = one.number
            if holder >= 0 and one.number in states[holder]:
                answer = plan.job.answer(one, states[holder][one.number][1])
                field[at] = np.asarray(answer, np.float64).reshape(len(one.cells), -1)[:, 0]
        return {
            "holder": self.holder,
            "step": step,
            "age": self.age,
            "halos": self.halos,
            "piece": piece,
            "field": field,
        }


def tables_of(plan: JobPlan, lattice: Lattice, robots: int) -> tuple[ProbeTable, ...]:
    """The tables of a job in pieces. The rule may have a `unit` of what it answers."""
    count, unit = len(plan.pieces), str(getattr(plan.job, "unit", ""))
    cells = sum(len(one.cells) for one in plan.pieces)
    every = min(OFTEN * -(-cells // MANY), ONCE)
    last = float(robots - 1)
    return (
        ProbeTable(
            "holder", "i4", (count,), meaning="pieces and who computes them", low=GONE, high=last, drawn="holders"
        ),
        ProbeTable("step", "i4", (count,), meaning="step known to a living robot; -1: lost", low=-1.0),
        ProbeTable("age", "f8", (count,), "exchanges", "age of the halos that its last step used", 0.0),
        ProbeTable("halos", "i4", ("robots", HEARD), meaning="halo that travels", low=-1.0, high=last, drawn="links"),
        ProbeTable("piece", "i4", lattice.shape, "", "pieces", -1.0, PIECES - 1.0, every=ONCE, drawn="pieces"),
        ProbeTable("field", "f4", lattice.shape, unit, "field computed", every=every, drawn="field"),
    )
