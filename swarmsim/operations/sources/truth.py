"""The probe that records where a field's sources truly are, for pictures beside what robots take them to be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from swarmsim.core.context import BuildContext
from swarmsim.core.drawing import LARGEST
from swarmsim.core.probes import Name, ProbeTable, Sampled
from swarmsim.core.state import Knowledge, Moment
from swarmsim.operations.models.emitters import Emitter
from swarmsim.operations.sources.found import emitted


class TrueSources(Sampled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the field's sources are once they have begun, or were when they ended, which no robot is told."""

    name: Name = "true_sources"

    def build(self, context: BuildContext) -> SourceProbe:
        """The probe. Raises InputError without a field that has sources."""
        return SourceProbe(emitted(context, "sources").emitters, context.period)


class SourceProbe:
    """Places by iteration."""

    def __init__(self, emitters: Sequence[Emitter], period: float) -> None:
        self._emitters, self._period = emitters, period
        self.tables = (
            ProbeTable(
                "place", shape=(len(emitters), 2), unit="m", meaning="where the field comes from", columns=("x", "y"),
                low=-LARGEST, high=LARGEST, drawn="spots",
            ),
        )  # fmt: skip

    def sample(self, moment: Moment[Knowledge]) -> Mapping[str, object]:
        """Each source's place now, or where it ended; NaN before it begins."""
        time = moment.state.iteration * self._period
        return {"place": [one.place(time) if one.begin <= time else (math.nan, math.nan) for one in self._emitters]}
