"""Robots that meet, and robots that spread out."""

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
from swarmsim.operations.steering import Steering

Positive = Annotated[float, Meta(gt=0.0)]
Clearance = Annotated[float, Meta(ge=0.0)]


class Rendezvous(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Each robot goes to the centre of the smallest circle round itself and those it hears (Ando et al. 1999).

    With the `range` (m) of its radio it goes only so far that it loses no robot it hears: it stays in the circle of
    that diameter round the middle between them. Robots nearer than `apart` push each other away, since bodies cannot
    meet in a point.
    """

    range: Positive | None = None  # m
    apart: Positive | None = None  # m; default: three radii of a robot, centre to centre
    speed: Positive | None = None  # m/s; default: two thirds of what wheels can
    clearance: Clearance = 0.2  # m, from walls

    def build(self, context: BuildContext) -> RendezvousLaw:
        return RendezvousLaw(self, context)


class RendezvousLaw:
    """The circumcentre law."""

    requires_knowledge: type[Knowledge] = Positions

    def __init__(self, parameters: Rendezvous, context: BuildContext) -> None:
        self._range = parameters.range
        self._apart = parameters.apart or 3.0 * context.robots.radius
        self._steering = Steering(context, parameters.speed, parameters.clearance)

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Positions) -> Intents:
        """Move to the centre, as far as is safe."""
        place, steering = senses.pose[:, :2], self._steering
        way = centres(place, knowledge) - place
        if self._range is not None:
            way *= _safe(place, way, knowledge, self._range)[:, None]
        push = separation(place, knowledge, self._apart, steering.speed)
        return steering.intents(senses, steering.towards(place, place + way) + push)


def centres(place: NDArray[np.float64], knowledge: Positions) -> NDArray[np.float64]:
    """The centre (n, 2) of the smallest circle round each robot's place (n, 2) and the places it knows."""
    robots = np.concatenate([np.arange(len(place)), knowledge.receivers])
    order = np.argsort(robots, kind="stable")
    points = np.concatenate([place, knowledge.place])[order]
    import shapely  # which robots that do not meet can do without

    circles = shapely.minimum_bounding_circle(shapely.multipoints(points, indices=robots[order]))
    bounds: NDArray[np.float64] = shapely.bounds(circles)
    x0, y0, x1, y1 = bounds[:, 0], bounds[:, 1], bounds[:, 2], bounds[:, 3]
    return np.stack([(x0 + x1) / 2.0, (y0 + y1) / 2.0], axis=1)


def _safe(
    place: NDArray[np.float64], way: NDArray[np.float64], knowledge: Positions, reach: float
) -> NDArray[np.float64]:
    """The share (n,) of its way (n, 2) that each robot can go without losing others that keep the same rule."""
    mine = knowledge.receivers
    half, step = (place[mine] - knowledge.place) / 2.0, way[mine]  # from the middle between them; and onwards
    a = (step**2).sum(axis=1)
    b = (half * step).sum(axis=1)
    c = (half**2).sum(axis=1) - (reach / 2.0) ** 2
    root = (-b + np.sqrt(np.maximum(b**2 - a * c, 0.0))) / np.maximum(a, 1e-12)
    share = np.ones(len(place))
    np.minimum.at(share, mine, np.maximum(root, 0.0))
    return share


def separation(place: NDArray[np.float64], knowledge: Positions, apart: float, speed: float) -> NDArray[np.float64]:
    """A velocity (n, 2) away from robots nearer than `apart` (m): `speed` at distance 0, 0 at `apart`."""
    gap = place[knowledge.receivers] - knowledge.place
    size = np.maximum(np.hypot(gap[:, 0], gap[:, 1]), 1e-6)
    push = speed * np.maximum(1.0 - size / apart, 0.0) / size
    return knowledge.total(push[:, None] * gap, len(place))


class Gathered(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All live robots are together: the largest distance between two of them falls to `within`."""

    within: Positive | None = None  # m; default: for n bodies, each with as much room again around it

    def build(self, context: BuildContext) -> GatheringTask:
        robots = context.robots
        return GatheringTask(self.within or 4.0 * robots.radius * float(np.sqrt(context.swarm)))


class GatheringTask:
    """Measures distances between robots."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve("diameter", "diameter of the swarm, m", low=0.0, format=".2f", rises=False)

    def __init__(self, within: float) -> None:
        self._within = within

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The diameter, and the mean distance from the middle."""
        place = done.state.pose[done.state.alive, :2]
        if len(place) == 0:
            return Measured({"diameter": float("nan"), "off_middle": float("nan")})
        from scipy.spatial import distance

        diameter = float(distance.pdist(place).max(initial=0.0))
        off = float(np.hypot(*(place - place.mean(axis=0)).T).mean())
        progress = min(1.0, self._within / diameter) if diameter else 1.0
        return Measured({"diameter": diameter, "off_middle": off}, {}, progress, diameter <= self._within)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        return (Last(),)


class Disperse(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots heard nearer than `apart` push each robot away, the nearer the harder.

    The velocity is the gradient of pairwise potentials (Howard, Mataric and Sukhatme 2002), with walls pushing too.
    """

    apart: Positive = 1.2  # m, centre to centre
    speed: Positive | None = None  # m/s; default: two thirds of what wheels can
    clearance: Clearance = 0.3  # m, from walls

    def build(self, context: BuildContext) -> DispersionLaw:
        return DispersionLaw(self, context)


class DispersionLaw:
    """Repulsion."""

    requires_knowledge: type[Knowledge] = Positions

    def __init__(self, parameters: Disperse, context: BuildContext) -> None:
        self._apart, self._steering = parameters.apart, Steering(context, parameters.speed, parameters.clearance)

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Positions) -> Intents:
        push = separation(senses.pose[:, :2], knowledge, self._apart, 2.0 * self._steering.speed)
        return self._steering.intents(senses, push)


class Spacing(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """No two live robots are nearer than `apart`."""

    apart: Positive = 1.0  # m, centre to centre

    def build(self, context: BuildContext) -> SpacingTask:
        return SpacingTask(self.apart)


class SpacingTask:
    """Measures distances to the nearest robot."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve("nearest", "smallest distance of two robots, m", low=0.0, format=".2f", robots="gaps")

    def __init__(self, wanted: float) -> None:
        self._wanted = wanted

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The smallest and the mean distance to the nearest robot, and each one's; infinite for the dead."""
        alive = done.state.alive
        gaps = np.full(len(alive), np.inf)
        if alive.sum() > 1:
            from scipy.spatial import distance

            apart = distance.squareform(distance.pdist(done.state.pose[alive, :2]))
            np.fill_diagonal(apart, np.inf)
            gaps[alive] = apart.min(axis=1)
        nearest = float(gaps.min(initial=np.inf))
        if not alive.any():
            return Measured({"nearest": nearest, "mean_nearest": float("nan")}, {"gaps": gaps})
        values = {"nearest": nearest, "mean_nearest": float(gaps[alive].mean())}
        return Measured(values, {"gaps": gaps}, min(1.0, nearest / self._wanted), nearest >= self._wanted)

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        return (Last(),)
