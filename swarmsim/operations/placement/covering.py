"""Area coverage: robots divide an area among them into Voronoi cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Inbox, MessageBatch
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Intents, Knowledge, Measured, Senses
from swarmsim.operations.placement.positions import Positions
from swarmsim.operations.placement.rendezvous import Clearance, Positive
from swarmsim.operations.steering import Steering

POINTS: Final = 4000  # that represent an area, at most


class Lloyd(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot goes to the centroid of its Voronoi cell among those it hears (Cortes, Martinez, Karatas, Bullo 2004).

    x_i moves towards C_i, the mean of the points of the area that are nearer to it than to any robot it hears. If it
    hears all Voronoi neighbours, that descends H = mean over the area of the squared distance to the nearest robot. The
    area is the page of the floor plan less a `margin`.
    """

    margin: Annotated[float, Meta(ge=0.0)] = 0.2  # m along the page's edges that are not floor
    speed: Positive | None = None  # m/s; default: two thirds of what wheels can
    clearance: Clearance = 0.2  # m, from walls

    def build(self, context: BuildContext) -> LloydLaw:
        return LloydLaw(self, context)


class LloydLaw:
    """Lloyd's descent."""

    requires_knowledge: type[Knowledge] = Positions

    def __init__(self, parameters: Lloyd, context: BuildContext) -> None:
        left, low, right, high = context.building.bounds
        margin = parameters.margin
        side = float(np.sqrt((right - left - 2 * margin) * (high - low - 2 * margin) / POINTS))
        x = np.arange(left + margin + side / 2, right - margin, side)
        y = np.arange(low + margin + side / 2, high - margin, side)
        self._points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        self._steering = Steering(context, parameters.speed, parameters.clearance)

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Positions) -> Intents:
        place = senses.pose[:, :2]
        goal = place.copy()
        starts = np.searchsorted(knowledge.receivers, np.arange(len(place) + 1))
        for robot in np.flatnonzero(senses.alive):
            others = knowledge.place[starts[robot] : starts[robot + 1]]
            goal[robot] = centroid(place[robot], others, self._points)
        return self._steering.intents(senses, self._steering.towards(place, goal))


def centroid(
    place: NDArray[np.float64], others: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The mean (2,) of the points (p, 2) nearer to a place (2,) than to others (k, 2); without any, the place."""
    # |q - x|^2 <= |q - y|^2 is linear in q.
    line = points @ (others - place).T
    mine: NDArray[np.bool_] = (line <= 0.5 * ((others**2).sum(axis=1) - (place**2).sum())).all(axis=1)
    return np.asarray(points[mine].mean(axis=0)) if mine.any() else place


class LocationalCost(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every live robot is within `tolerance` of the centroid of its Voronoi cell of the floor."""

    tolerance: Positive = 0.15  # m

    def build(self, context: BuildContext) -> CoveringTask:
        return CoveringTask(self.tolerance, context)


class CoveringTask:
    """Measures the distances of the floor to robots, and of robots to their centroids."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve("cost", "locational cost H, m^2", low=0.0, format=".3f", rises=False)

    def __init__(self, tolerance: float, context: BuildContext) -> None:
        building = context.building
        cells = np.argwhere(building.explorable & ~building.occupied)
        self._points = context.lattice.centres(cells[:: -(-len(cells) // POINTS) or 1])
        self._tolerance = tolerance

    def measure(self, done: Done[Knowledge]) -> Measured:
        """H and the largest distance of a live robot from its centroid."""
        place = done.state.pose[done.state.alive, :2]
        if len(place) == 0:
            return Measured({"cost": float("nan"), "off_centre": float("nan")})
        square = ((self._points[:, None] - place) ** 2).sum(axis=2)
        nearest = square.argmin(axis=1)
        counts = np.maximum(np.bincount(nearest, minlength=len(place)), 1)
        sums = [np.bincount(nearest, self._points[:, axis], minlength=len(place)) for axis in (0, 1)]
        off = float(np.hypot(*(np.stack(sums, axis=1) / counts[:, None] - place).T).max())
        values = {"cost": float(square.min(axis=1).mean()), "off_centre": off}
        return Measured(values, {}, min(1.0, self._tolerance / off) if off else 1.0, off <= self._tolerance)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        return (Last(),)
