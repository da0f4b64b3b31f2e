"""Perimeter defence: robots spread evenly along a closed curve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
import shapely
from msgspec import Meta, Struct

from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Intents, Knowledge, Measured, Senses
from swarmsim.operations.placement.positions import Positions
from swarmsim.operations.placement.rendezvous import Clearance, Positive, separation
from swarmsim.operations.steering import Steering

Corners = Annotated[tuple[tuple[float, float], ...], Meta(min_length=3)]


def ring(corners: Corners) -> shapely.LinearRing:
    """The closed curve through these corners (m). Raises InputError if it crosses itself or has no length."""
    found = shapely.LinearRing(corners)
    if not found.is_valid or not found.is_simple or found.length == 0.0:
        raise InputError("corners: they make no closed curve that does not cross itself; expected 3 or more in order")
    return found


class Perimeter(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot goes to the perimeter, and on it to the middle between the next robots ahead and behind.

    It goes to s_i + (g_ahead - g_behind) / 4, where s is the place along the curve and g the gaps to the nearest robot
    that it hears each way: even deployment on a ring by local gaps, as in Elor and Bruckstein (2011).
    """

    corners: Corners  # m
    speed: Positive | None = None  # m/s; default: two thirds of what wheels can
    clearance: Clearance = 0.2  # m, from walls

    def build(self, context: BuildContext) -> PerimeterLaw:
        """The strategy. Raises InputError for corners that make no perimeter."""
        return PerimeterLaw(self, context)


class PerimeterLaw:
    """Gaps along a curve, evened out."""

    requires_knowledge: type[Knowledge] = Positions

    def __init__(self, parameters: Perimeter, context: BuildContext) -> None:
        self._curve = ring(parameters.corners)
        self._apart = 3.0 * context.robots.radius
        self._steering = Steering(context, parameters.speed, parameters.clearance)

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Positions) -> Intents:
        """Move to the middle of the gap."""
        place = senses.pose[:, :2]
        length = self._curve.length
        at = np.asarray(shapely.line_locate_point(self._curve, shapely.points(place)))
        other = np.asarray(shapely.line_locate_point(self._curve, shapely.points(knowledge.place)))
        ahead = (other - at[knowledge.receivers]) % length
        gaps = np.full((2, len(place)), length)
        np.minimum.at(gaps[0], knowledge.receivers, ahead)
        np.minimum.at(gaps[1], knowledge.receivers, length - ahead)
        target = (at + 0.25 * (gaps[0] - gaps[1])) % length
        goal = shapely.get_coordinates(shapely.line_interpolate_point(self._curve, target))
        push = separation(place, knowledge, self._apart, self._steering.speed)
        return self._steering.intents(senses, self._steering.towards(place, goal) + push)


class Guarded(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Live robots stand on the perimeter, and no gap is much longer than an even share."""

    corners: Corners  # m
    gap: Annotated[float, Meta(gt=1.0)] = 1.15  # largest, in even shares, that finishes the run
    off: Positive = 0.1  # m, from the perimeter, at most

    def build(self, context: BuildContext) -> PerimeterTask:
        """The task. Raises InputError for corners that make no perimeter."""
        return PerimeterTask(self)


class PerimeterTask:
    """Measures gaps."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve("gap", "largest gap over even gap", low=0.0, format=".2f", rises=False)

    def __init__(self, parameters: Guarded) -> None:
        self._parameters, self._curve = parameters, ring(parameters.corners)

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The largest gap, and the largest distance of a robot from the perimeter."""
        points = np.asarray(shapely.points(done.state.pose[done.state.alive, :2]))
        if len(points) == 0:
            return Measured({"gap": float("nan"), "off": float("nan")})
        length, wanted = self._curve.length, self._parameters
        at = np.sort(shapely.line_locate_point(self._curve, points))
        gaps = np.diff(np.append(at, at[0] + length))
        gap, off = float(gaps.max() * len(points) / length), float(shapely.distance(self._curve, points).max())
        finished = gap <= wanted.gap and off <= wanted.off
        return Measured({"gap": gap, "off": off}, {}, min(1.0, wanted.gap / gap), finished)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        return (Last(),)
