"""The task of a swarm that computes: all pieces of its jobs done, somewhere among living robots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec import Struct

from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.processors import Processors
from swarmsim.core.state import Done, Knowledge, Measured, Moment
from swarmsim.jobs.runtime import Parcel

COMPUTED: Final = "computed_share"


class Computed(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All jobs in pieces are done: each piece's last state is known to a living robot.

    A piece whose state no living robot has is lost. While one is, the task is not finished, however far the others are.
    """

    @property
    def needs_jobs(self) -> bool:
        """Whether it measures jobs, which a scenario then has to have."""
        return True

    def build(self, context: BuildContext) -> ComputedTask:
        return ComputedTask(context.processors)


class ComputedTask:
    """Measures the share of all steps that is done, and the pieces lost."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve(COMPUTED, "steps done (%)", 100.0, 0.0, 100.0, format=".1f")

    def __init__(self, processors: Processors | None) -> None:
        self._processors = processors

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The share of all pieces' steps that living robots have done, and how many pieces none of them has."""
        alive, its = done.state.alive, [one.knowledge for one in done.jobs if isinstance(one.knowledge, Parcel)]
        step = [np.maximum(one.progress(alive), 0) / one.plan.steps for one in its]
        share = float(np.concatenate(step).mean()) if its else 0.0
        lost = sum(one.numbers(alive)["pieces_lost"] for one in its)
        return Measured({COMPUTED: share, "pieces_lost": lost}, progress=share, finished=share == 1.0)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        """A new observer of what the jobs took."""
        return (JobCost(self._processors),)


class JobCost:
    """What all jobs in pieces took, at the end of a run."""

    def __init__(self, processors: Processors | None) -> None:
        self._processors = processors
        self._last: Moment[Knowledge] | None = None
        self._sent = self._heard = 0

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note one iteration."""
        self._last = moment
        self._sent += sum(one.sent for one in moment.jobs)
        self._heard += sum(one.heard for one in moment.jobs)

    def summary(self) -> dict[str, float | int | None]:
        """The numbers, defined in docs/computing.md."""
        if self._last is None:
            return {}
        parcels = [one.knowledge for one in self._last.jobs if isinstance(one.knowledge, Parcel)]
        steps, waited, taken, redone, work = np.sum([one.counts.sum(axis=0) for one in parcels], axis=0).tolist()
        return {
            "pieces_lost": int(self._last.measured.values["pieces_lost"]),
            "robots_deaf": sum(self._deaf(one) for one in parcels),
            "pieces_taken_over": int(taken),
            "steps_computed": int(steps),
            "steps_redone": int(redone),
            "halo_age": waited / steps if steps else None,
            "work": work,
            "job_bytes_sent": self._sent,
            "job_bytes_heard": self._heard,
            **({} if self._processors is None else self._processors.summary(steps)),
        }

    def _deaf(self, parcel: Parcel) -> int:
        """How many living robots have heard nobody for longer than the patience."""
        alive = self._last.state.alive if self._last is not None else np.zeros(0, np.bool_)
        return int(np.count_nonzero(parcel.silent[alive] > parcel.plan.keys.patience))
