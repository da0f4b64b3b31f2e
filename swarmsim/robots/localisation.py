"""Localisation: each robot's estimated pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Localisation, Tracking
from swarmsim.core.scenario import registry
from swarmsim.core.state import State
from swarmsim.robots.kinematics import drives_of

Spread = Annotated[float, Meta(ge=0.0, le=100.0)]


class Exact(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot knows its pose exactly."""

    def build(self, context: BuildContext) -> PerfectLocalisation:
        return PerfectLocalisation()


class PerfectLocalisation:
    """Gives the true pose."""

    exact = True

    def locate(self, state: State) -> NDArray[np.float64]:
        """The pose as it is."""
        return state.pose

    def track(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose as it is."""
        return pose


class Noisy(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot knows its pose with a normal error, drawn anew in every iteration, as from beacons or cameras."""

    sigma: Spread = 0.02  # m, standard deviation in x and in y
    sigma_yaw: Spread = 0.02  # rad

    def build(self, context: BuildContext) -> NoisyLocalisation:
        return NoisyLocalisation(self, context)


class Odometry(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot knows its start, and from then on counts wheel turns, which drifts.

    A way is a turn, a straight piece and another turn, each measured with a normal error whose variance grows with its
    size (Thrun, Burgard, Fox, Probabilistic Robotics, 2005, section 5.4); robots that move to the side do not turn
    before and after. Wheels slip by `slip` per metre; the heading errs by `veer` per metre and by `spin` per radian.
    Unequal wheels add a constant bend per robot, with the standard deviation `bias`. Ticks of the encoders, `tick`
    apart, add their rounding.
    """

    slip: Spread = 0.01  # m, standard deviation of a measured way of 1 m
    veer: Spread = 0.005  # rad, of the heading after 1 m
    spin: Spread = 0.01  # rad, of a measured turn of 1 rad
    bias: Spread = 0.002  # rad/m, between robots
    tick: Spread = 0.0005  # m, a wheel's way between two ticks

    def build(self, context: BuildContext) -> OdometryLocalisation:
        return OdometryLocalisation(self, context)


class Erring(ABC):
    """Localisation whose errors stay the same from one iteration to the next."""

    exact = False

    def __init__(self, context: BuildContext) -> None:
        #: Each robot's estimate minus its true pose (n, 3): m, m, rad.
        self.error: NDArray[np.float64] = np.zeros((context.swarm, 3))
        self._belief = Belief(self.error, np.ones(context.swarm, np.bool_), context.lattice)

    def locate(self, state: State) -> NDArray[np.float64]:
        """The estimates (n, 3) of this iteration."""
        self.err(state)
        return self._belief.of(state.pose)

    def track(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The estimates (n, 3), with the errors of this iteration, of robots that have moved on."""
        return self._belief.of(pose)

    @abstractmethod
    def err(self, state: State) -> None:
        """Update the errors to this iteration."""


class NoisyLocalisation(Erring):
    """Errors independent of earlier ones."""

    def __init__(self, parameters: Noisy, context: BuildContext) -> None:
        super().__init__(context)
        self._spread = np.array([parameters.sigma, parameters.sigma, parameters.sigma_yaw])
        self._salt = _salt(context)

    def err(self, state: State) -> None:
        robots = np.arange(state.robots)[:, None]
        self.error[:] = self._spread * chance.normal(self._salt, state.iteration, robots, np.arange(3))


class OdometryLocalisation(Erring):
    """Errors that add up on the way."""

    def __init__(self, parameters: Odometry, context: BuildContext) -> None:
        super().__init__(context)
        self._parameters, self._salt = parameters, _salt(context)
        self._bend = parameters.bias * chance.normal(self._salt, np.arange(context.swarm), 0)  # rad/m, (n,)
        ticks = parameters.tick / np.sqrt(12.0)
        self._rounding = ticks / np.sqrt(2.0), ticks * np.sqrt(2.0) / context.robots.each("wheel_base")
        self._before: NDArray[np.float64] | None = None  # (n, 3): true poses when wheels were last counted
        self._alive = np.zeros(context.swarm, np.bool_)
        self._sideways = drives_of(context).sideways

    def err(self, state: State) -> None:
        """Add the measuring errors since the last iteration; a robot that has just entered knows its pose."""
        if self._before is None:
            self._before = state.pose.copy()
        came = state.alive & ~self._alive
        self._alive = state.alive.copy()
        self._before[came], self.error[came] = state.pose[came], 0.0
        step = state.pose - self._before
        believed = self._before + self.error
        way = np.hypot(step[:, 0], step[:, 1])
        heading = np.where(way > 1e-9, np.arctan2(step[:, 1], step[:, 0]), self._before[:, 2])
        first = _turn(heading - self._before[:, 2])
        aside = np.where(self._sideways, first, 0.0)  # of the heading, where no turn leads to the way
        backwards = (np.abs(first) > 0.5 * np.pi) & ~self._sideways
        first = np.where(self._sideways, 0.0, np.where(backwards, _turn(first - np.pi), first))
        second = _turn(step[:, 2]) - first
        drawn = chance.normal(self._salt, state.iteration, np.arange(state.robots)[:, None], np.arange(1, 4))
        parameters, moving = self._parameters, way > 1e-9
        length = way + drawn[:, 0] * np.sqrt(parameters.slip**2 * way + moving * self._rounding[0] ** 2)
        astray = np.sqrt(parameters.spin**2 * np.abs(first) + moving * self._rounding[1] ** 2)
        first = first + drawn[:, 1] * astray
        spread = parameters.spin**2 * np.abs(second) + parameters.veer**2 * way
        second = second + drawn[:, 2] * np.sqrt(spread) + self._bend * way
        course = believed[:, 2] + first + np.where(backwards, np.pi, aside)
        self.error[:, 0] = believed[:, 0] + length * np.cos(course) - state.pose[:, 0]
        self.error[:, 1] = believed[:, 1] + length * np.sin(course) - state.pose[:, 1]
        self.error[:, 2] = _turn(believed[:, 2] + first + second - state.pose[:, 2])
        self._before = state.pose.copy()


def _salt(context: BuildContext) -> int:
    return int(context.streams.open("localisation").integers(0, 2**64, dtype=np.uint64))


def _turn(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angle wrapped to half a turn either way."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def tracked(localisation: Localisation, context: BuildContext) -> Tracking:
    """The localisation; one that gives no estimates between iterations is wrapped, with constant errors in between."""
    return localisation if isinstance(localisation, Tracking) else Tracked(localisation, context)


class Tracked:
    """A localisation whose errors are assumed constant between iterations."""

    exact = False

    def __init__(self, inner: Localisation, context: BuildContext) -> None:
        #: The wrapped part, which has to keep its contract.
        self.written_by = registry.author_of(inner)
        self._inner, self._error = inner, np.zeros((context.swarm, 3))
        self._belief = Belief(self._error, np.ones(context.swarm, np.bool_), context.lattice)
        self._true = self._found = self._error

    def locate(self, state: State) -> NDArray[np.float64]:
        """The estimates (n, 3) of this iteration."""
        self._true, self._found = state.pose, self._inner.locate(state)
        return self._found

    def track(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The estimates (n, 3), with the errors of this iteration, of robots that have moved on."""
        self._error[:] = self._found - self._true
        return self._belief.of(pose)


class Belief:
    """The robots' estimated poses: true ones plus errors, but never off the lattice of their maps."""

    def __init__(self, error: NDArray[np.float64], active: NDArray[np.bool_], lattice: Lattice) -> None:
        """`error` (n, 3) and `active` (n,) are live views; rows that are not active pass unchanged."""
        self._error, self.active = error, active
        left, right, low, high = lattice.extent
        # A millionth of a cell inside, so that rounding never yields the cell beyond the edge.
        inset = 1e-6 * lattice.cell
        self._low, self._high = np.array([left, low]) + inset, np.array([right, high]) - inset

    def of(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The estimates (n, 3) of these true poses."""
        if not self.active.any():
            return pose
        believed = pose + self._error
        believed[:, :2] = np.clip(believed[:, :2], self._low, self._high)
        return np.where(self.active[:, None], believed, pose)
