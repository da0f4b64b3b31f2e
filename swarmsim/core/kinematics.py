"""Kinematics: the seam, and the wheels of a whole swarm, which may be of several kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Kinematics(Protocol):
    """Turns desired motion into wheel commands, and these into forces on the floor."""

    @property
    def columns(self) -> tuple[tuple[str, str], ...]:
        """The name and unit of each of a command's c numbers; those per second are run by motors."""
        ...

    def command(self, twists: Floats) -> Floats:
        """The commands (r, c) within limits nearest to velocities (r, 3): m/s ahead, m/s to the left, rad/s."""
        ...

    def approach(self, aims: Floats) -> Floats:
        """The commands (r, c) that lead to points (r, 4): m ahead, m to the left, distance in m, top speed in m/s.

        A robot with 0 m/s stands. Called in every sub-step, as is `forces`.
        """
        ...

    def forces(self, moving: Floats, wheels: Floats, wanted: Floats, dt: float) -> tuple[Floats, Floats]:
        """The wheels' state (r, c) after `dt` (s), and the floor's force (N) and torque (N m) on robots (r, 3).

        `wheels` (r, c) is their state before, `wanted` (r, c) the command; `moving` (r, 6) is x, y, yaw and their
        rates. Forces and `moving` are in the world frame. Arrays may be written to and returned.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Wheels:
    """Robots of a swarm with the same kinematics."""

    kind: str  # the part's name
    kinematics: Kinematics
    rows: slice  # of the swarm
    sideways: bool  # whether they can move sideways
    bend: float  # m, radius of the tightest turn; 0 for turning on the spot


class Drives:
    """The kinematics of a swarm, row by row; columns that a row's kinematics lacks are 0."""

    def __init__(self, kinds: Sequence[Wheels]) -> None:
        self._kinds = kinds
        count = kinds[-1].rows.stop
        #: The greatest length of a command.
        self.width = max(len(one.kinematics.columns) for one in kinds)
        #: The names of the kinematics in the swarm.
        self.names = {one.kind for one in kinds}
        #: Whether each robot can move sideways (n,).
        self.sideways: NDArray[np.bool_] = np.zeros(count, np.bool_)
        #: The radius (n,) of the tightest turn, m; 0 for turning on the spot.
        self.bends: Floats = np.zeros(count)
        #: The unit of each number of each command (n, width); empty for missing ones.
        self.units: NDArray[np.str_] = np.full((count, self.width), "", "U16")
        for one in kinds:
            self.sideways[one.rows], self.bends[one.rows] = one.sideways, one.bend
            self.units[one.rows, : len(one.kinematics.columns)] = [unit for _, unit in one.kinematics.columns]
        self._wanted, self._wheels, self._push = (np.zeros((count, c)) for c in (self.width, self.width, 3))

    @property
    def motors(self) -> NDArray[np.bool_]:
        """Which numbers of each command (n, width) a motor runs."""
        return np.strings.endswith(self.units, "/s")

    @property
    def alone(self) -> Kinematics | None:
        """The kinematics of all robots, if they share one."""
        return self._kinds[0].kinematics if len(self._kinds) == 1 else None

    def kind_of(self, robot: int) -> str:
        """The name of one robot's kinematics."""
        return next(one.kind for one in self._kinds if one.rows.start <= robot < one.rows.stop)

    def command(self, twists: Floats) -> Floats:
        """The commands (n, width) nearest to velocities (n, 3)."""
        return self._each(lambda kinematics: kinematics.command, twists)

    def approach(self, aims: Floats) -> Floats:
        """The commands (n, width) that lead to points (n, 4); like all results, reused by the next call."""
        return self._each(lambda kinematics: kinematics.approach, aims)

    def _each(self, verb: Callable[[Kinematics], Callable[[Floats], Floats]], given: Floats) -> Floats:
        if len(self._kinds) == 1:
            return verb(self._kinds[0].kinematics)(given)
        for one in self._kinds:
            found = verb(one.kinematics)(given[one.rows])
            self._wanted[one.rows, : found.shape[1]] = found
        return self._wanted

    def forces(self, moving: Floats, wheels: Floats, wanted: Floats, dt: float) -> tuple[Floats, Floats]:
        """The wheels' state (n, width) after `dt` (s), and the forces (n, 3)."""
        if len(self._kinds) == 1:
            return self._kinds[0].kinematics.forces(moving, wheels, wanted, dt)
        for one in self._kinds:
            rows, mine = one.rows, (one.rows, slice(len(one.kinematics.columns)))
            self._wheels[mine], self._push[rows] = one.kinematics.forces(
                moving[rows], np.ascontiguousarray(wheels[mine]), np.ascontiguousarray(wanted[mine]), dt
            )
        return self._wheels, self._push
