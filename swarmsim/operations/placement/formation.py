"""Formations, standing or marching: each robot keeps its place among those it hears."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Intents, Knowledge, Measured, Senses
from swarmsim.operations.placement.positions import Positions
from swarmsim.operations.placement.rendezvous import Clearance, Positive
from swarmsim.operations.steering import Steering

Places = tuple[tuple[float, float], ...]


def offsets_of(places: Places, context: BuildContext) -> NDArray[np.float64]:
    """The places (N, 2) of all robots. Raises InputError unless there is one for each."""
    if len(places) != context.swarm:
        raise InputError(f"places: {len(places)} for {context.swarm} robots; expected one for each")
    return np.array(places, np.float64)


class Formation(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Consensus on the formation's place, by displacements (Ren and Beard 2008, section 4).

    u_i = v + gain / k sum_j ((x_j - x_i) - (d_j - d_i)) over the k robots heard, where d are the wanted `places`, in
    the floor plan's axes, up to a common shift. With a velocity v in `march` the formation moves on.
    """

    places: Places  # m, one for each robot
    gain: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.5  # 1/s
    march: tuple[float, float] = (0.0, 0.0)  # m/s
    speed: Positive | None = None  # m/s; default: two thirds of what wheels can
    clearance: Clearance = 0.2  # m, from walls

    def build(self, context: BuildContext) -> FormationLaw:
        """The strategy. Raises InputError unless there is a place for each robot."""
        return FormationLaw(self, offsets_of(self.places, context), context)


class FormationLaw:
    """Displacements, evened out."""

    requires_knowledge: type[Knowledge] = Positions

    def __init__(self, parameters: Formation, offsets: NDArray[np.float64], context: BuildContext) -> None:
        self._gain, self._march, self._offsets = parameters.gain, np.array(parameters.march), offsets
        self._own = offsets[context.ids]
        self._steering = Steering(context, parameters.speed, parameters.clearance)

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Positions) -> Intents:
        """Move to the place among the robots heard, and on."""
        own = senses.pose[:, :2] - self._own
        apart = knowledge.place - self._offsets[knowledge.senders] - own[knowledge.receivers]
        counts = np.maximum(knowledge.counts(len(own)), 1)[:, None]
        return self._steering.intents(senses, self._march + self._gain * knowledge.total(apart, len(own)) / counts)


class FormationError(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Live robots are in formation: their root-mean-square distance from their places falls to `tolerance`.

    Places are shifted to fit best, since the formation may stand anywhere.
    """

    places: Places  # m, one for each robot
    tolerance: Positive = 0.05  # m

    def build(self, context: BuildContext) -> FormationTask:
        """The task. Raises InputError unless there is a place for each robot."""
        return FormationTask(self.tolerance, offsets_of(self.places, context))


class FormationTask:
    """Measures the distances of robots from their places."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve("error", "formation error, m", low=0.0, format=".3f", rises=False)

    def __init__(self, tolerance: float, offsets: NDArray[np.float64]) -> None:
        self._tolerance, self._offsets = tolerance, offsets

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The root-mean-square and the largest distance of live robots from their places, shifted to fit best."""
        alive = done.state.alive
        own = done.state.pose[alive, :2] - self._offsets[alive]
        if len(own) == 0:
            return Measured({"error": float("nan"), "worst": float("nan")})
        off = np.hypot(*(own - own.mean(axis=0)).T)
        error = float(np.sqrt((off**2).mean()))
        progress = min(1.0, self._tolerance / error) if error else 1.0
        return Measured({"error": error, "worst": float(off.max())}, {}, progress, error <= self._tolerance)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        return (Last(),)
