"""Faults of processors: they become slower, or stand still."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Parts
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.timeline import Timed, Timeline


class SlowProcessor(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The processor of jobs fails; the robot's mind, its radio and its wheels go on.

    `slow`: it has `factor` of its rate. `stopped`: the robot neither computes, says nor hears anything of jobs, as if
    it were dead to them; what it has in memory is there again when the fault ends.
    """

    failure: Literal["slow", "stopped"]
    factor: Annotated[float, Meta(gt=0.0, lt=1.0)] | None = None  # for slow; default 0.5

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for a key that its failure does not have, and for what has no effect."""
        if self.factor is not None and self.failure != "slow":
            raise InputError(f"factor: a processor that is {self.failure!r} has none; expected failure = 'slow'")
        if self.failure == "slow" and all(one.rate is None for one in context.robots.processors):
            raise InputError("failure: 'slow' changes nothing of unlimited processors; expected robots.processor.rate")
        factor = 0.0 if self.failure == "stopped" else self.factor or 0.5
        return TimedFault(Timeline(self, context), Slowdown(factor), context.number)


class Slowdown(StatelessEffect):
    """Makes processors slower, or stops them."""

    def __init__(self, factor: float) -> None:
        self._factor = factor

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The same parts, whose processors heed the fault. Raises InputError if they compute nothing."""
        if parts.jobs is None:
            raise InputError("use: processors compute jobs, and there are none; expected [[jobs]]")
        parts.jobs.processors.slow(active, self._factor)
        return parts
