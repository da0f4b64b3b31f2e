"""Localisation: where each robot believes it is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Motion, WheelSpeeds
from swarmsim.core.setting import Setting
from swarmsim.core.state import Intents, Readings, State

Spread = Annotated[float, Meta(ge=0.0, le=100.0)]


class Perfect(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot knows its pose exactly."""

    def build(self, setting: Setting) -> PerfectLocalisation:
        """The localisation."""
        return PerfectLocalisation()


class PerfectLocalisation:
    """Gives the true pose and leaves what was sensed where it was sensed."""

    def locate(self, state: State, readings: Readings) -> tuple[NDArray[np.float64], Readings]:
        """The pose as it is."""
        return state.pose, readings


class Noisy(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot knows its pose with a normal error, drawn anew in every iteration, as from beacons or cameras."""

    sigma: Spread = 0.02  # m, standard deviation in x and in y
    sigma_yaw: Spread = 0.02  # rad

    def build(self, setting: Setting) -> NoisyLocalisation:
        """The localisation."""
        return NoisyLocalisation(self, setting)


class Odometry(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every robot knows where it starts, and from then on counts the turns of its wheels, which drifts.

    A way is a turn, a straight piece and another turn, each measured with a normal error whose variance grows with its
    size (Thrun, Burgard, Fox, Probabilistic Robotics, 2005, section 5.4): wheels slip by `slip` on a metre, the
    heading goes astray by `veer` on a metre and by `spin` on a radian. Unequal wheels add a constant bend of each
    robot's own, with the standard deviation `bias`. Ticks of the encoders, `tick` apart, add their rounding.
    """

    slip: Spread = 0.01  # m, standard deviation of a measured way of 1 m
    veer: Spread = 0.005  # rad, of the heading after 1 m
    spin: Spread = 0.01  # rad, of a measured turn of 1 rad
    bias: Spread = 0.002  # rad/m, between robots
    tick: Spread = 0.0005  # m, a wheel's way between two ticks

    def build(self, setting: Setting) -> OdometryLocalisation:
        """The localisation."""
        return OdometryLocalisation(self, setting)


class Erring(ABC):
    """Localisation with errors: tiles lie, and robots steer, where they believe to be."""

    def __init__(self, setting: Setting) -> None:
        self._lattice = setting.lattice
        #: What each robot's estimate (n, 3) is more than its true pose: m, m, rad.
        self.error: NDArray[np.float64] = np.zeros((setting.swarm, 3))
        #: Where robots believe to be, wherever they are.
        self.belief = Belief(self.error, np.ones(setting.swarm, np.bool_), setting.lattice)

    def locate(self, state: State, readings: Readings) -> tuple[NDArray[np.float64], Readings]:
        """The estimates, and the readings where they put them; to be asked once in each iteration."""
        self.err(state)
        believed = self.belief.of(state.pose)
        return believed, moved(readings, state.pose, believed, self._lattice)

    @abstractmethod
    def err(self, state: State) -> None:
        """Let the errors become those of this iteration."""


class NoisyLocalisation(Erring):
    """Errors that know nothing of those before."""

    def __init__(self, parameters: Noisy, setting: Setting) -> None:
        super().__init__(setting)
        self._spread = np.array([parameters.sigma, parameters.sigma, parameters.sigma_yaw])
        self._salt = _salt(setting)

    def err(self, state: State) -> None:
        """Drawn anew."""
        robots = np.arange(state.robots)[:, None]
        self.error[:] = self._spread * chance.normal(self._salt, state.iteration, robots, np.arange(3))


class OdometryLocalisation(Erring):
    """Errors that add up on the way."""

    def __init__(self, parameters: Odometry, setting: Setting) -> None:
        super().__init__(setting)
        self._parameters, self._salt = parameters, _salt(setting)
        self._bend = parameters.bias * chance.normal(self._salt, np.arange(setting.swarm), 0)  # rad/m, (n,)
        ticks = parameters.tick / np.sqrt(12.0)
        self._rounding = ticks / np.sqrt(2.0), ticks * np.sqrt(2.0) / setting.robots.each("wheel_base")
        self._before: NDArray[np.float64] | None = None  # (n, 3): true poses when wheels were last counted
        self._alive = np.zeros(setting.swarm, np.bool_)

    def err(self, state: State) -> None:
        """Add what was measured wrong since the last iteration; who has just come knows where it is."""
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
        backwards = np.abs(first) > 0.5 * np.pi
        first = np.where(backwards, _turn(first - np.pi), first)
        second = _turn(step[:, 2]) - first
        drawn = chance.normal(self._salt, state.iteration, np.arange(state.robots)[:, None], np.arange(1, 4))
        parameters, moving = self._parameters, way > 1e-9
        length = way + drawn[:, 0] * np.sqrt(parameters.slip**2 * way + moving * self._rounding[0] ** 2)
        astray = np.sqrt(parameters.spin**2 * np.abs(first) + moving * self._rounding[1] ** 2)
        first = first + drawn[:, 1] * astray
        spread = parameters.spin**2 * np.abs(second) + parameters.veer**2 * way
        second = second + drawn[:, 2] * np.sqrt(spread) + self._bend * way
        course = believed[:, 2] + first + np.where(backwards, np.pi, 0.0)
        self.error[:, 0] = believed[:, 0] + length * np.cos(course) - state.pose[:, 0]
        self.error[:, 1] = believed[:, 1] + length * np.sin(course) - state.pose[:, 1]
        self.error[:, 2] = _turn(believed[:, 2] + first + second - state.pose[:, 2])
        self._before = state.pose.copy()


def _salt(setting: Setting) -> int:
    return int(setting.streams.open("localisation").integers(0, 2**64, dtype=np.uint64))


def _turn(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same angle between half a turn to the right and half a turn to the left."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def moved(readings: Readings, pose: NDArray[np.float64], believed: NDArray[np.float64], lattice: Lattice) -> Readings:
    """The readings of robots at `pose` where they put them that are `believed` to be elsewhere, in whole cells."""
    tiles = readings.tiles
    if tiles is None:
        return readings
    aside = lattice.cells(believed[:, :2]) - lattice.cells(pose[:, :2])
    return replace(readings, tiles=replace(tiles, origins=(tiles.origins + aside).astype(np.int32)))


def misled(motion: Motion, localisation: object) -> Motion:
    """The motion, steering by where a localisation that errs has robots believe to be."""
    return MisledMotion(motion, localisation.belief) if isinstance(localisation, Erring) else motion


class Belief:
    """Where robots believe to be: their poses with their errors, but never off the lattice of their maps."""

    def __init__(self, error: NDArray[np.float64], active: NDArray[np.bool_], lattice: Lattice) -> None:
        """`error` (n, 3) and `active` (n,) are live views; rows that are not active pass unchanged."""
        self._error, self.active = error, active
        left, right, low, high = lattice.extent
        # By a millionth of a cell inside, so that rounding never finds the cell beyond the edge.
        inset = 1e-6 * lattice.cell
        self._low, self._high = np.array([left, low]) + inset, np.array([right, high]) - inset

    def of(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The poses (n, 3) believed of these true ones."""
        if not self.active.any():
            return pose
        believed = pose + self._error
        believed[:, :2] = np.clip(believed[:, :2], self._low, self._high)
        return np.where(self.active[:, None], believed, pose)


class MisledMotion:
    """Motion that steers by where robots believe to be."""

    def __init__(self, inner: Motion, belief: Belief) -> None:
        self._inner, self._belief = inner, belief

    def follow(self, intents: Intents) -> None:
        """Take up new intents."""
        self._inner.follow(intents)

    def command(self, pose: NDArray[np.float64]) -> WheelSpeeds:
        """The wheel speeds wanted at the poses believed of these."""
        return self._inner.command(self._belief.of(pose))
