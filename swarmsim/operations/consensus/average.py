"""Average consensus: robots agree on the mean of all measurements, each by talking to few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch, PlainCodec
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Estimates, Knowledge, Measured, Senses

CURVE: Final = Curve("error", "largest error", low=0.0, format=".2e", rises=False)


@dataclass(frozen=True, slots=True, eq=False)
class Share(MessageBatch):
    """The message: the robot's estimate, and how many robots it heard in the last iteration."""

    value: NDArray[np.float64]  # (t,)
    degree: NDArray[np.int32]  # (t,)


@dataclass(frozen=True, slots=True, eq=False)
class Values(Estimates):
    """Every robot's estimate of the average, and its own measurement."""

    value: NDArray[np.float64]  # (n,)
    measured: NDArray[np.float64]  # (n,)


class AverageConsensus(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot moves its estimate towards those that it hears: x_i += sum_j w_ij (x_j - x_i).

    It starts with its number in `values`, else with the field's value at its place or, without a field, with a random
    number between 0 and 1. `constant`: w_ij = `gain`, which has to be less than 1 / the largest number of robots heard.
    `metropolis`: w_ij = 1 / (1 + max(d_i, d_j)), where d is how many each heard in the last iteration (Xiao, Boyd and
    Kim 2007). If hearing is mutual and nothing is lost, the mean of all estimates is constant.
    """

    weights: Literal["metropolis", "constant"] = "metropolis"
    gain: Annotated[float, Meta(gt=0.0, lt=1.0)] | None = None  # for constant
    values: tuple[float, ...] | None = None  # of each robot

    def build(self, context: BuildContext) -> AverageComputation:
        """The computation. Raises InputError for keys that contradict each other or the swarm."""
        count = context.swarm
        if (self.gain is None) == (self.weights == "constant"):
            raise InputError(f"gain: expected one with weights = 'constant' alone, not with {self.weights!r}")
        if self.values is not None and len(self.values) != count:
            raise InputError(f"values: {len(self.values)} for {count} robots; expected one for each")
        return AverageComputation(self, context)


class AverageComputation:
    """One number a robot."""

    knowledge_type: type[Knowledge] = Values

    def __init__(self, parameters: AverageConsensus, context: BuildContext) -> None:
        count = len(context.ids)
        self.codec = PlainCodec(Share(np.zeros(0), np.zeros(0, np.int32)))
        self._gain = parameters.gain
        drawn = [stream.uniform() for stream in context.own_streams("average")]
        given = drawn if parameters.values is None else np.take(parameters.values, context.ids)
        self._given = np.array(given, np.float64)
        self._fixed = parameters.values is not None
        self._value, self._measured = np.zeros(count), np.zeros(count)
        self._degree, self._known = np.zeros(count, np.int32), np.zeros(count, np.bool_)

    def say(self, senses: Senses) -> Broadcast[Share]:
        field, new = senses.readings.field, ~self._known & senses.alive
        self._measured[new] = self._given[new] if field is None or self._fixed else field[new]
        self._value[new], self._known[new] = self._measured[new], True
        return Broadcast.each(Share(self._value.copy(), self._degree.copy()), self.codec.size)

    def hear(self, senses: Senses, inbox: Inbox[Share]) -> Values:
        """Move towards the estimates heard."""
        receivers, content = inbox.receivers, inbox.content
        heard = np.bincount(receivers, minlength=len(self._value)).astype(np.int32)
        if self._gain is not None:
            weight = np.full(len(receivers), self._gain)
        else:
            weight = 1.0 / (1.0 + np.maximum(content.degree, self._degree[receivers]))
            weight[(content.degree == 0) | (self._degree[receivers] == 0)] = 0.0  # not known yet
        step = np.bincount(receivers, weight * (content.value - self._value[receivers]), minlength=len(self._value))
        self._value += np.where(senses.alive, step, 0.0)
        self._degree[:] = heard
        return Values(self._value.copy(), self._measured.copy())

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Restart robots (r,) from their next measurement."""
        self._known[robots] = False

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give robots (r,) the estimate of another one."""
        self._value[robots], self._measured[robots] = self._value[source], self._measured[source]
        self._known[robots] = True


class Agreed(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every live robot's estimate is the mean of all robots' measurements."""

    tolerance: Annotated[float, Meta(gt=0.0)] = 1e-6  # the largest error that finishes the run

    def build(self, context: BuildContext) -> AgreementTask:
        return AgreementTask(self.tolerance)


class AgreementTask:
    """Compares estimates with the mean of all measurements, including those of dead robots."""

    requires_knowledge: type[Knowledge] = Values
    curve = CURVE

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._first: float | None = None

    def measure(self, done: Done[Values]) -> Measured:
        """The largest error, the spread of the estimates, and the error of each."""
        knowledge, alive = done.knowledge, done.state.alive
        each = np.abs(knowledge.value - knowledge.measured.mean())
        if not alive.any():
            return Measured({"error": float("nan"), "spread": float("nan")}, {"errors": each})
        error, spread = float(each[alive].max()), float(np.ptp(knowledge.value[alive]))
        self._first = max(error, self._tolerance) if self._first is None else self._first
        progress = 1.0 - np.log(max(error, self._tolerance) / self._tolerance) / max(
            np.log(self._first / self._tolerance), 1e-12
        )
        values = {"error": error, "spread": spread}
        return Measured(values, {"errors": each}, float(np.clip(progress, 0.0, 1.0)), error <= self._tolerance)

    def summaries(self) -> Sequence[Summary[Values]]:
        return (Last(),)
