"""The task of finding a source: how far off robots' estimates and predictions are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Final, Protocol, runtime_checkable

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext, Field
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Knowledge, Measured, Moment
from swarmsim.operations.models.emitters import Emitter
from swarmsim.operations.sources.errors import Errors, errors_of
from swarmsim.operations.sources.locate import Located

CURVE: Final = Curve("near_share", "robots that know the source, %", scale=100.0, high=100.0, format=".0f")

Positive = Annotated[float, Meta(gt=0.0, le=1e6)]


@runtime_checkable
class Emitted(Field, Protocol):
    """A field that knows its sources."""

    @property
    def emitters(self) -> Sequence[Emitter]:
        """The sources."""
        ...


class SourceFound(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A share of the living robots take the source to be within a distance of where it is, for some time on end.

    It also measures predictions so many seconds `ahead`, at each inversion, of robots that are sure of the place: whose
    own `spread` is within the distance too.
    """

    within: Positive = 0.5  # m
    share: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0  # of living robots
    hold: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 30  # iterations
    ahead: Annotated[tuple[Positive, ...], Meta(min_length=1, max_length=10)] = (30.0, 60.0, 120.0)  # s

    def build(self, context: BuildContext) -> SourceTask:
        """The task. Raises InputError without a field that has sources."""
        return SourceTask(self, emitted(context, "source-found"), context.period)


def emitted(context: BuildContext, part: str) -> Emitted:
    """The field. Raises InputError unless it has sources."""
    field = context.scalar_field
    if not isinstance(field, Emitted) or not field.emitters:
        raise InputError(
            f'use: {part!r} looks where a field\'s sources are; expected [field] use = "model" with sources or hidden '
            "ones"
        )
    return field


class SourceTask:
    """Compares what the first job of this kind has found with the truth."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = CURVE

    def __init__(self, keys: SourceFound, field: Emitted, period: float) -> None:
        self._keys, self._field, self._period = keys, field, period
        self._held = 0

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The median distance from the source of living robots that have found one, and the share that is near it."""
        located, alive = located_by(done), done.state.alive
        time = done.state.iteration * self._period
        sources = [one.place(time) for one in self._field.emitters if one.begin <= time]
        apart = located.place[:, None] - np.reshape(np.array(sources, np.float64), (1, -1, 2))
        distances = np.hypot(*apart.transpose(2, 0, 1)).min(axis=1, initial=math.inf)
        distances = np.where(np.isfinite(located.strength) & bool(sources), distances, np.nan)
        near = distances[alive] <= self._keys.within
        share = float(near.mean()) if alive.any() else 0.0
        self._held = self._held + 1 if share >= self._keys.share else 0
        known, ages = distances[alive & np.isfinite(distances)], located.age[alive & np.isfinite(located.age)]
        values = {
            "source_distance": float(np.median(known)) if len(known) else math.nan,
            "near_share": share,
            "found_share": located.share(alive),
            "sample_age": float(ages.mean()) if len(ages) else math.nan,
        }
        return Measured(values, {"distances": distances}, share, self._held >= self._keys.hold)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        """New observers of how it went."""
        return (SourceSummary(self._keys, self._field, self._period),)


def located_by(done: Done[Knowledge] | Moment[Knowledge]) -> Located:
    """What robots' minds, or the first job that searches a source, have found. Raises InputError without one."""
    for one in (done.knowledge, *(job.knowledge for job in done.jobs)):
        if isinstance(one, Located):
            return one
    raise InputError(
        "task.use: 'source-found' measures 'locate-source', and it is neither a job nor the minds' computation; "
        "expected either"
    )


class SourceSummary:
    """When the source was found, and how good predictions were, in numbers at the end of a run."""

    def __init__(self, keys: SourceFound, field: Field, period: float) -> None:
        self._keys, self._field, self._period = keys, field, period
        self._since: int | None = None
        self._ages: list[float] = []
        self._errors: list[Errors] = []
        self._last: Moment[Knowledge] | None = None

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note one iteration; of predictions those that robots have made in it and trust by their own spread."""
        self._last, values, now = moment, moment.measured.values, moment.state.iteration
        if values["near_share"] < self._keys.share:
            self._since = None
        elif self._since is None:
            self._since = now
        if not math.isnan(values["sample_age"]):
            self._ages.append(values["sample_age"])
        located = located_by(moment)
        fresh = np.flatnonzero(moment.state.alive & (located.made == now) & (located.spread <= self._keys.within))
        if len(fresh):
            time = now * self._period
            self._errors += errors_of(located, fresh.tolist(), self._field, time, self._keys.ahead)

    def summary(self) -> dict[str, float | int | None]:
        """The numbers, defined in docs/computing-source.md."""
        if self._last is None:
            return {}
        located, alive = located_by(self._last), self._last.state.alive
        distance, (own, shared) = self._last.measured.values["source_distance"], located.work(alive)
        found: dict[str, float | int | None] = {
            "source_distance_end": None if math.isnan(distance) else distance,
            "near_share_end": self._last.measured.values["near_share"],
            "source_near_since": self._since,
            "sample_age": float(np.mean(self._ages)) if self._ages else None,
            "work_alone": own,
            "work_shared": shared,
        }
        for ahead in self._keys.ahead:
            found |= _summed([one for one in self._errors if one.ahead == ahead], ahead)
        return found


def _summed(errors: Sequence[Errors], ahead: float) -> dict[str, float | int | None]:
    """Mean square errors as shares of the truth's variance, and the skill over persistence."""
    names = ("prediction", "persistence", "truth_persistence", "variance")
    table: NDArray[np.float64] = np.array([[getattr(one, name) for name in names] for one in errors]).reshape(-1, 4)
    prediction, persistence, still, variance = table.sum(axis=0).tolist()
    there = variance > 0.0
    return {
        f"error_{ahead:g}s": prediction / variance if there else None,
        f"persistence_{ahead:g}s": persistence / variance if there else None,
        f"truth_persistence_{ahead:g}s": still / variance if there else None,
        f"skill_{ahead:g}s": 1.0 - prediction / persistence if persistence > 0.0 else None,
    }
