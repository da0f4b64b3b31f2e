"""What robots know of a gathered field, how old and how wrong it is, what that took, and what pictures show of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.jobs import Values
from swarmsim.core.probes import ProbeTable, Row
from swarmsim.core.state import Record
from swarmsim.jobs.facts.tellers import JobStanding
from swarmsim.jobs.pieces import given
from swarmsim.operations.gathering.gatherer import Gatherer, GatherPlan

FIELDS: Final = 5  # iterations between two pictures of a field


def tables_of(shape: tuple[int, int]) -> tuple[ProbeTable, ...]:
    """What is shown on a lattice of this shape."""
    return (
        ProbeTable("level", "i4", ("robots",), "", "levels known of its own piece", 0.0, drawn="robots"),
        ProbeTable("field", "f4", shape, meaning="field of who knows most", every=FIELDS, drawn="field"),
    )


@dataclass(frozen=True, slots=True, eq=False)
class KnownFields(JobStanding):
    """All robots' fields; arrays are read-only."""

    scheme: GatherPlan
    name: str
    own: NDArray[np.int64]  # (n,): the robot's own piece
    level: NDArray[np.int32]  # (n, p): of each piece, as far as the robot knows
    fields: NDArray[np.float64]  # (n, c)
    counts: NDArray[np.float64]  # (n, 6): operations; samples made, taken in; bytes of beacons, samples, answers
    truth: Values  # (c,): the field in this iteration
    age: NDArray[np.float64]  # (n, p): s, of what the robot knows
    free: NDArray[np.bool_]  # (rows, columns): where the cells of the field are
    now: int  # iteration

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """WholeFloor, fields and counts."""
        return self.level, self.fields, self.counts

    def record(self) -> Record:
        """WholeFloor and counts."""
        names = ("work", "made", "taken", "beacons", "samples", "answers")
        columns = {f"{self.name}_{name}": self.counts[:, at] for at, name in enumerate(names)}
        return Record({f"{self.name}_level": self.level, **columns})

    def sample(self, alive: NDArray[np.bool_]) -> dict[str, Row]:
        """The level of each robot's own piece, and the field of the living robot that knows the newest levels."""
        field = np.full(self.free.shape, np.nan, np.float32)
        known = np.where(alive, self.level.sum(axis=1), 0)
        if self.now % FIELDS == 0 and known.any():
            field[self.free] = self.fields[known.argmax()]
        return {"level": self.level[np.arange(len(self.own)), self.own], "field": field}

    def _done(self, alive: NDArray[np.bool_]) -> NDArray[np.int32]:
        """The level (a,) of each living robot's own piece, or of the oldest if all are to know the field."""
        its = self.level[alive]
        return its.min(axis=1) if self.scheme.whole else its[np.arange(len(its)), self.own[alive]]

    def share(self, alive: NDArray[np.bool_]) -> float:
        """The mean share of levels that living robots know; 1 if nothing is computed."""
        if not self.scheme.computers or not alive.any():
            return 1.0
        return float(self._done(alive).mean()) / self.scheme.levels

    def ended(self, alive: NDArray[np.bool_]) -> bool:
        """Whether all living robots know the last level."""
        return self.share(alive) == 1.0

    def numbers(self, alive: NDArray[np.bool_]) -> dict[str, float]:
        """Means over living robots of age and of the error, as a share of the truth's root mean square; and sums."""
        its = np.flatnonzero(alive)
        wrong = (self.fields[its] - self.truth) ** 2
        mine = [wrong[row, self.scheme.cells[self.own[robot]]].mean() for row, robot in enumerate(its)]
        size = float(np.sqrt((self.truth**2).mean())) or 1.0
        work, made, taken, *said = self.counts.sum(axis=0).tolist()
        return {
            "age_own": float(self.age[its, self.own[its]].mean()) if len(its) else 0.0,
            "age_floor": float(self.age[its].mean()) if len(its) else 0.0,
            "error_own": float(np.sqrt(np.mean(mine))) / size if len(its) else 0.0,
            "error_floor": float(np.sqrt(wrong.mean())) / size if len(its) else 0.0,
            "used": taken / made / max(1, len(self.scheme.computers)) if made else 0.0,
            "operations": work, "beacon_bytes": said[0], "sample_bytes": said[1], "answer_bytes": said[2],
        }  # fmt: skip


class FieldLedger:
    """Sums up what robots know and said."""

    def __init__(self, scheme: GatherPlan, name: str, context: BuildContext) -> None:
        self._scheme, self._name, self._context = scheme, name, context
        self._free = given(context).free
        self._points = context.lattice.centres(np.argwhere(self._free))
        self._now, self._truth = -1, np.zeros(len(self._points))

    def __call__(self, parts: Sequence[Gatherer], now: int) -> KnownFields:
        if now != self._now and self._context.scalar_field is not None:
            self._now = now
            self._truth = self._context.scalar_field.value(now * self._context.period, self._points)
        level, fields = np.array([part.level for part in parts], np.int32), np.array([part.field for part in parts])
        counts = np.array([[part.work, part.made, part.taken, *part.bytes] for part in parts], np.float64)
        age = np.asarray((now - level * self._scheme.every) * self._context.period, np.float64)
        for array in (level, fields, counts, age):
            array.setflags(write=False)
        return KnownFields(
            self._scheme, self._name, self._context.ids, level, fields.reshape(len(parts), -1), counts.reshape(-1, 6),
            self._truth, age, self._free, now,
        )  # fmt: skip
