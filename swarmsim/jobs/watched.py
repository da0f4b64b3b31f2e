"""What an onlooker sees of a job in pieces: who holds each piece, how old halos are, and where they travel.

Nothing of it goes back to a robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import Values
from swarmsim.core.lattice import Lattice
from swarmsim.core.probes import GONE, NOBODY, ONCE, PIECES, ProbeTable, Row
from swarmsim.jobs.plan import JobPlan

HEARD: Final = 8  # robots whose halos a robot's row names, at most
REMEMBERED: Final = 4  # levels of which it is known when a value was made
OFTEN: Final = 5  # iterations between two samples of a field ...
MANY: Final = 50_000  # ... of so many cells; more seldom of more


@dataclass(frozen=True, slots=True, eq=False)
class Sighted:
    """What was seen up to an exchange; arrays are read-only."""

    holder: NDArray[np.int32]  # (p,): the robot that computes each piece, NOBODY, or GONE: no robot alive has a state
    age: NDArray[np.float64]  # (p,): of the halos that its last step used, in exchanges; NaN for none
    halos: NDArray[np.int32]  # (n, HEARD): robots from whom each has heard a new halo in this iteration; -1 for none
    ages: float  # exchanges: the sum over all steps with halos
    aged: int  # how many steps these are


class Onlooker:
    """Watches all robots that share a job.

    The age of a halo is the time from the exchange in which somebody first made it to the one in which a step used it,
    less the one exchange that it takes at least. That of a step is the mean over the pieces that it reads.
    """

    def __init__(self, plan: JobPlan, rows: int) -> None:
        pieces = len(plan.pieces)
        self._plan = plan
        self._step = np.full((rows, pieces), NOBODY, np.int32)
        self._made: list[dict[int, int]] = [{} for _ in range(pieces)]  # exchange in which a step was first reached
        self._holder, self._age = np.full(pieces, NOBODY, np.int32), np.full(pieces, np.nan)
        self._from: list[dict[int, None]] = [{} for _ in range(rows)]
        self._ages, self._aged = 0.0, 0

    def begin(self) -> None:
        """A new iteration: no halo has travelled in it."""
        self._from = [{} for _ in self._from]

    def heard(self, row: int, sender: int) -> None:
        """A robot has got a halo that is new to it."""
        self._from[row][sender] = None

    def see(
        self, step: NDArray[np.int32], kept: NDArray[np.int32], alive: NDArray[np.bool_], clock: int,
        newest: Callable[[int, int], int | None],
    ) -> Sighted:  # fmt: skip
        """Look at the steps (n, p) that robots compute and keep after an exchange.

        `newest` gives the last step to which a robot knows what a piece shows, by row and piece.
        """
        changed = np.argwhere(step != self._step).tolist()
        for row, piece in changed:
            first = max(int(self._step[row, piece]) + 1, 0) if self._step[row, piece] >= 0 else int(step[row, piece])
            for one in range(first, int(step[row, piece]) + 1):
                self._made[piece].setdefault(one, clock)
        for row, piece in changed:
            if 0 <= self._step[row, piece] < step[row, piece]:
                self._used(row, piece, int(step[row, piece]) - 1, clock, newest)
        self._forget()
        self._step = step
        self._hold(np.where(alive[:, None], step, NOBODY), kept[alive])
        return self._sighted()

    def _used(self, row: int, piece: int, step: int, clock: int, newest: Callable[[int, int], int | None]) -> None:
        """Note the age of what a step has read."""
        found = []
        for joint in self._plan.joints[piece]:
            at = step if self._plan.keys.fence == "data" else newest(row, joint.piece)
            made = None if at is None else self._made[joint.piece].get(at)
            if made is not None:
                found.append(max(clock - made - 1, 0))
        if found:
            self._age[piece] = sum(found) / len(found)
            self._ages, self._aged = self._ages + self._age[piece], self._aged + 1

    def _forget(self) -> None:
        most = REMEMBERED * self._plan.job.level
        for made in self._made:
            while len(made) > 2 * most:
                del made[min(made)]

    def _hold(self, step: NDArray[np.int32], kept: NDArray[np.int32]) -> None:
        """Who computes each piece: who did so before, while it does, and else the robot that is farthest."""
        best = step.argmax(axis=0).astype(np.int32)
        pieces = np.arange(step.shape[1])
        still = (self._holder >= 0) & (step[np.maximum(self._holder, 0), pieces] >= 0)
        somebody = step.max(axis=0, initial=NOBODY) >= 0
        nobody = np.where(kept.max(axis=0, initial=NOBODY) >= 0, NOBODY, GONE)
        self._holder = np.where(still, self._holder, np.where(somebody, best, nobody)).astype(np.int32)

    def _watched(self) -> Sighted:
        halos = np.full((len(self._from), HEARD), -1, np.int32)
        for row, senders in enumerate(self._from):
            listed = list(senders)[:HEARD]
            halos[row, : len(listed)] = listed
        found = self._holder, self._age.copy(), halos
        for array in found:
            array.setflags(write=False)
        return Sighted(*found, self._ages, self._aged)


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


def rows_of(
    plan: JobPlan,
    lattice: Lattice,
    seen: Sighted,
    step: NDArray[np.int32],
    states: tuple[dict[int, tuple[int, Values]], ...],
) -> dict[str, Row]:
    """A row of each of these tables; `step` (p,) is what living robots have, `states` what each robot computes."""
    piece, field = np.full(lattice.shape, -1, np.int32), np.full(lattice.shape, np.nan, np.float32)
    for one, holder in zip(plan.pieces, seen.holder.tolist(), strict=True):
        at = tuple(one.cells.T)
        piece[at] = one.number
        if holder >= 0 and one.number in states[holder]:
            answer = plan.job.answer(one, states[holder][one.number][1])
            field[at] = np.asarray(answer, np.float64).reshape(len(one.cells), -1)[:, 0]
    return {"holder": seen.holder, "step": step, "age": seen.age, "halos": seen.halos, "piece": piece, "field": field}
