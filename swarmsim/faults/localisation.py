"""Faults of localisation: robots that are not at their estimated positions."""

from __future__ import annotations

from abc import ABC
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
import shapely
from msgspec import Meta
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core import chance
from swarmsim.core.building import Building
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Parts, Tracking
from swarmsim.core.state import State
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.faults.timeline import Robots, Timed, Timeline
from swarmsim.robots.localisation import Belief

TOUCH = 1e-9  # m: how far a touching disc may reach into a wall, by rounding

Offset = Annotated[float, Meta(ge=-1e6, le=1e6)]
Spread = Annotated[float, Meta(gt=0.0, le=1e6)]


class LocalisationFault(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The robot errs about its pose: it maps, tells its tiles and steers by its wrong estimate.

    `bias`: the estimate is wrong by `dx`, `dy` and `dyaw`. `drift`: the error grows by these in every iteration
    and by a random walk whose steps have the standard deviations `sigma` in x and y and `sigma_yaw`.
    `kidnap`: the robot is put somewhere else, heading anywhere, and does not notice. When it ends, the estimate is
    right again. Tiles are shifted by whole cells and never turned: heading is assumed known (compass), a kidnapped
    robot's too.
    """

    failure: Literal["bias", "drift", "kidnap"]
    dx: Offset | None = None  # for bias: m; for drift: m per iteration
    dy: Offset | None = None  # for bias: m; for drift: m per iteration
    dyaw: Offset | None = None  # for bias: rad; for drift: rad per iteration
    sigma: Spread | None = None  # for drift: m per square root of an iteration
    sigma_yaw: Spread | None = None  # for drift: rad per square root of an iteration

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for a key that its failure lacks or does not have."""
        constant, random = ("dx", "dy", "dyaw"), ("sigma", "sigma_yaw")
        own = {"bias": constant, "drift": (*constant, *random), "kidnap": ()}[self.failure]
        given = [key for key in (*constant, *random) if getattr(self, key) is not None]
        for key in given:
            if key not in own:
                right = "failure = 'drift'" + (" or 'bias'" if key in constant else "")
                raise InputError(f"{key}: localisation with {self.failure!r} has none; expected {right}")
        if own and not any(getattr(self, key) for key in given):
            raise InputError(f"{own[0]}: no error is given; expected a number other than 0 for {' or '.join(own)}")
        return TimedFault(Timeline(self, context), self._effect(context), context.number)

    def _effect(self, context: BuildContext) -> Misplacement:
        constant = np.array([self.dx or 0.0, self.dy or 0.0, self.dyaw or 0.0])
        if self.failure == "kidnap":
            return Kidnapping(context)
        if self.failure == "bias":
            return Bias(context, constant)
        spread = np.array([self.sigma or 0.0, self.sigma or 0.0, self.sigma_yaw or 0.0])
        stream = context.streams.open(f"fault localisation {context.number}")
        return Drift(context, constant, spread, int(stream.integers(0, 2**64, dtype=np.uint64)))


class Misplacement(StatelessEffect, ABC):
    """Wraps the localisation: its estimates have an error, which is 0 until the fault begins."""

    def __init__(self, context: BuildContext) -> None:
        self._lattice = context.lattice
        #: Each robot's estimate minus its true pose (n, 3): m, m, rad.
        self.error: NDArray[np.float64] = np.zeros((context.swarm, 3))

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the localisation wrapped."""
        belief = Belief(self.error, active, self._lattice)
        return replace(parts, localisation=WrongLocalisation(parts.localisation, self, belief))

    def grow(self, iteration: int, robots: Robots) -> None:
        """Set the error of these robots (r,) to that of an iteration."""

    def end(self, robots: Robots, state: State) -> Robots:
        """Their estimates are right again."""
        self.error[robots] = 0.0
        return robots


class Bias(Misplacement):
    """A constant error."""

    def __init__(self, context: BuildContext, constant: NDArray[np.float64]) -> None:
        super().__init__(context)
        self._constant = constant

    def begin(self, robots: Robots, state: State) -> None:
        """All of the error is there at once."""
        self.error[robots] = self._constant


class Drift(Misplacement):
    """An error that grows, from the first iteration on, by a constant and by normal steps."""

    def __init__(
        self, context: BuildContext, constant: NDArray[np.float64], spread: NDArray[np.float64], salt: int
    ) -> None:
        super().__init__(context)
        self._constant, self._spread, self._salt = constant, spread, salt

    def grow(self, iteration: int, robots: Robots) -> None:
        """One more step each, drawn for the robot and the iteration."""
        steps = chance.normal(self._salt, iteration, robots[:, None], np.arange(3))
        self.error[robots] += self._constant + self._spread * steps


class Kidnapping(Misplacement):
    """An error equal to the distance that robots have been carried."""

    def __init__(self, context: BuildContext) -> None:
        super().__init__(context)
        self._radius = context.robots.radius
        self._streams = [context.streams.open(f"fault localisation {context.number}", i) for i in range(context.swarm)]
        self._version = -1  # of the building that these places belong to
        self._places = np.empty((0, 2))

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the localisation wrapped; bodies can be carried as they are."""
        self._bodies, self._building = parts.bodies, parts.building
        return super().wrap(parts, active)

    def begin(self, robots: Robots, state: State) -> None:
        """Live robots are put to random places that all of them could reach; without any, they stay."""
        if self._version != self._building.version:
            self._version = self._building.version
            self._places = landing_places(self._building, self._lattice, self._radius)
        for robot in robots[state.alive[robots]]:
            stream = self._streams[robot]
            order, yaw = stream.permutation(len(self._places)), stream.uniform(-np.pi, np.pi)
            # Drawing among all places until one is free keeps the draw independent of where the others are.
            free = order[self._is_free()[order]]
            if len(free):
                before, place = self._bodies.state().pose[robot, :2], self._places[free[0]]
                self._bodies.remove(np.array([robot]))
                self._bodies.place(np.array([robot]), np.array([[*place, yaw]]))
                self.error[robot, :2] = before - place

    def _is_free(self) -> NDArray[np.bool_]:
        """Which of the places touch neither robots nor people."""
        bodies = self._bodies.state().pose[self._bodies.solid, :2]
        discs = np.concatenate(
            [np.column_stack([bodies, np.full(len(bodies), self._radius)]), self._building.walkers()]
        )
        apart = np.hypot(*(self._places[:, None] - discs[:, :2]).transpose(2, 0, 1))
        return np.asarray((apart >= self._radius + discs[:, 2]).all(axis=1))


def landing_places(building: Building, lattice: Lattice, radius: float) -> NDArray[np.float64]:
    """The centres (c, 2) in m of the cells in which a disc of `radius` (m) can stand, and which it can reach.

    These are the free cells of the coverage domain whose centres are at least the radius from any wall and that
    connect, edge to edge, to such a cell of the entrance.
    """
    fits = building.explorable & ~building.occupied
    walls = shapely.multilinestrings(building.walls.reshape(-1, 2, 2)) if len(building.walls) else shapely.Point()
    shapely.prepare(walls)
    fits[fits] = ~shapely.dwithin(shapely.points(lattice.centres(np.argwhere(fits))), walls, radius - TOUCH)
    pieces, _ = ndimage.label(fits)
    entrance = pieces[tuple(lattice.cells(building.entrance).T)]
    return lattice.centres(np.argwhere(fits & np.isin(pieces, entrance)))


class WrongLocalisation:
    """Localisation whose estimates err."""

    exact = False

    def __init__(self, inner: Tracking, source: Misplacement, belief: Belief) -> None:
        self._inner, self._source, self._belief = inner, source, belief

    def locate(self, state: State) -> NDArray[np.float64]:
        """The estimates, with the errors of this iteration."""
        pose = self._inner.locate(state)
        if self._belief.active.any():
            self._source.grow(state.iteration, np.flatnonzero(self._belief.active))
        return self._belief.of(pose)

    def track(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The estimates, with the errors of this iteration, of robots that have moved on."""
        return self._inner.track(self._belief.of(pose))
