"""The task of a swarm that computes: all pieces of its jobs done, somewhere among living robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.processors import Processors
from swarmsim.core.state import Done, Knowledge, Measured, Moment
from swarmsim.jobs.compared import AnswerCheck
from swarmsim.jobs.runtime import Parcel

COMPUTED: Final = "computed_share"
ERRORS: Final = ("error_sequential", "error_field")


class Computed(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All jobs in pieces are done: each piece's last state is known to a living robot.

    A piece whose state no living robot has is lost. While one is, the task is not finished, however far the others are.
    With `compare` the first such job is done in sequence too, before the first iteration, and each iteration's answer
    is compared with that and with the field.
    """

    compare: bool = False
    tolerance: Annotated[float, Meta(gt=0.0, le=1e9)] = 0.01  # share: of the error against the sequential answer

    @property
    def needs_jobs(self) -> bool:
        """Whether it measures jobs, which a scenario then has to have."""
        return True

    def build(self, context: BuildContext) -> ComputedTask:
        return ComputedTask(self, context)


class ComputedTask:
    """Measures the share of all steps that is done, and what that took so far."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve(COMPUTED, "steps done (%)", 100.0, 0.0, 100.0, format=".1f")

    def __init__(self, keys: Computed, context: BuildContext) -> None:
        self._keys, self._context = keys, context
        self._check: AnswerCheck | None = None

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The share of all pieces' steps that living robots have done, and how many pieces none of them has."""
        alive, parcels = done.state.alive, parcels_of(done)
        shares = [np.maximum(one.progress(alive), 0) / one.plan.steps for one in parcels]
        share = float(np.concatenate(shares).mean()) if shares else 0.0
        lost = sum(one.numbers(alive)["pieces_lost"] for one in parcels)
        values = {COMPUTED: share, "pieces_lost": lost, **taken(parcels), **self._errors(done, parcels)}
        return Measured(values, progress=share, finished=share == 1.0)

    def _errors(self, done: Done[Knowledge], parcels: Sequence[Parcel]) -> dict[str, float]:
        if not self._keys.compare or not parcels:
            return {}
        if self._check is None:
            self._check = AnswerCheck(parcels[0].plan, self._context)
        now = done.state.iteration * self._context.period
        return dict(zip(ERRORS, self._check.errors(parcels[0], done.state.alive, now), strict=True))

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        """A new observer of what the jobs took."""
        return (JobCost(self._keys, self._context.processors),)


def parcels_of(done: Done[Knowledge] | Moment[Knowledge]) -> list[Parcel]:
    """What robots have of the jobs in pieces."""
    return [one.knowledge for one in done.jobs if isinstance(one.knowledge, Parcel)]


def taken(parcels: Sequence[Parcel]) -> dict[str, float]:
    """What jobs took so far: take-overs, steps done again, the mean age of halos, and how work is spread."""
    counts = np.sum([one.counts for one in parcels], axis=0) if parcels else np.zeros((1, 5))
    seen = [one.seen for one in parcels if one.seen is not None]
    aged, work = sum(one.aged for one in seen), counts[:, 4]
    return {
        "pieces_taken_over": float(counts[:, 2].sum()),
        "steps_redone": float(counts[:, 3].sum()),
        "halo_age": sum(one.ages for one in seen) / aged if aged else math.nan,
        "load": float(work.max() / work.mean()) if work.any() else math.nan,
    }


class JobCost:
    """What all jobs in pieces took, at the end of a run."""

    def __init__(self, keys: Computed, processors: Processors | None) -> None:
        self._keys, self._processors = keys, processors
        self._last: Moment[Knowledge] | None = None
        self._sent = self._heard = 0
        self._near: tuple[int, int] | None = None  # iterations and bytes when it came within the tolerance for good

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note one iteration."""
        self._last = moment
        self._sent += sum(one.sent for one in moment.jobs)
        self._heard += sum(one.heard for one in moment.jobs)
        if self._keys.compare:
            if moment.measured.values.get(ERRORS[0], math.inf) > self._keys.tolerance:
                self._near = None
            elif self._near is None:
                self._near = moment.state.iteration + 1, self._sent

    def summary(self) -> dict[str, float | int | None]:
        """The numbers, defined in docs/measures.md."""
        if self._last is None:
            return {}
        parcels, values = parcels_of(self._last), self._last.measured.values
        steps, waited, *_, work = np.sum([one.counts.sum(axis=0) for one in parcels], axis=0).tolist()
        last = {
            name: None if math.isnan(values[name]) else values[name] for name in (*taken(parcels), *self._compared())
        }
        return {
            "pieces_lost": int(values["pieces_lost"]),
            "robots_deaf": sum(self._deaf(one) for one in parcels),
            **last,
            "steps_computed": int(steps),
            "step_wait": waited / steps if steps else None,
            "work": work,
            "job_bytes_sent": self._sent,
            "job_bytes_heard": self._heard,
            **self._tolerated(),
            **({} if self._processors is None else self._processors.summary(steps)),
        }

    def _compared(self) -> tuple[str, ...]:
        return ERRORS if self._keys.compare else ()

    def _tolerated(self) -> dict[str, float | int | None]:
        """When the answer came within the tolerance, to stay there until the end."""
        if not self._keys.compare:
            return {}
        iterations, sent = self._near or (None, None)
        return {"iterations_to_tolerance": iterations, "bytes_to_tolerance": sent}

    def _deaf(self, parcel: Parcel) -> int:
        """How many living robots have heard nobody for longer than the patience."""
        alive = self._last.state.alive if self._last is not None else np.zeros(0, np.bool_)
        return int(np.count_nonzero(parcel.silent[alive] > parcel.plan.keys.patience))
