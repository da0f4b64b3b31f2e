"""What robots' wheels can do: the seam, and the wheels of a whole swarm, which may be of several kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Kinematics(Protocol):
    """Turns where robots want to go into what their wheels do, and that into forces on the floor."""

    @property
    def columns(self) -> tuple[tuple[str, str], ...]:
        """The name and the unit of each of the c numbers of a robot's command; motors run those per second."""
        ...

    def command(self, twists: Floats) -> Floats:
        """The commands (r, c) nearest to velocities (r, 3): m/s ahead, m/s to the left, rad/s; within the limits."""
        ...

    def approach(self, aims: Floats) -> Floats:
        """The commands (r, c) that lead to points (r, 4): m ahead, m to the left, how far in m, m/s at most.

        A robot with 0 m/s stands. To be asked in every sub-step, as `forces` is.
        """
        ...

    def forces(self, moving: Floats, wheels: Floats, wanted: Floats, dt: float) -> tuple[Floats, Floats]:
        """What wheels do (r, c) after `dt` (s), and the force (N) and torque (N m) that the floor gives (r, 3).

        `wheels` (r, c) is what they did, `wanted` (r, c) the command; `moving` (r, 6) is x, y, yaw and their rates, in
        the world frame as the forces are. Arrays may be written to, and given back.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Wheels:
    """Robots of a swarm that have the same kinematics."""

    kind: str  # the part's name
    kinematics: Kinematics
    rows: slice  # of the swarm
    sideways: bool  # whether they can move to the side
    bend: float  # m, radius of the tightest bend; 0 for robots that turn on the spot


class Drives:
    """The kinematics of a swarm: each row by its own; columns that a row's kinematics does not have are 0."""

    def __init__(self, kinds: Sequence[Wheels]) -> None:
        self._kinds = kinds
        count = kinds[-1].rows.stop
        #: How many numbers a command has, at most.
        self.width = max(len(one.kinematics.columns) for one in kinds)
        #: The names of the kinematics in the swarm.
        self.names = {one.kind for one in kinds}
        #: Who can move to the side (n,).
        self.sideways: NDArray[np.bool_] = np.zeros(count, np.bool_)
        #: The radius (n,) of the tightest bend, m; 0 for who turns on the spot.
        self.bends: Floats = np.zeros(count)
        #: The unit of each number of each command (n, width); empty for those that it does not have.
        self.units: NDArray[np.str_] = np.full((count, self.width), "", "U16")
        for one in kinds:
            self.sideways[one.rows], self.bends[one.rows] = one.sideways, one.bend
            self.units[one.rows, : len(one.kinematics.columns)] = [unit for _, unit in one.kinematics.columns]
        self._wanted, self._wheels, self._push = (np.zeros((count, c)) for c in (self.width, self.width, 3))

    @property
    def motors(self) -> NDArray[np.bool_]:
        """What of each command (n, width) a motor runs."""
        return np.strings.endswith(self.units, "/s")

    @property
    def alone(self) -> Kinematics | None:
        """The kinematics of all robots, if they have the same."""
        return self._kinds[0].kinematics if len(self._kinds) == 1 else None

    def kind_of(self, robot: int) -> str:
        """The name of one robot's kinematics."""
        return next(one.kind for one in self._kinds if one.rows.start <= robot < one.rows.stop)

    def command(self, twists: Floats) -> Floats:
        """The commands (n, width) nearest to velocities (n, 3)."""
        return self._each(lambda kinematics: kinematics.command, twists)

    def approach(self, aims: Floats) -> Floats:
        """The commands (n, width) that lead to points (n, 4); reused by the next call, as all that it gives."""
        return self._each(lambda kinematics: kinematics.approach, aims)

    def _each(self, verb: Callable[[Kinematics], Callable[[Floats], Floats]], given: Floats) -> Floats:
        if len(self._kinds) == 1:
            return verb(self._kinds[0].kinematics)(given)
        for one in self._kinds:
            found = verb(one.kinematics)(given[one.rows])
            self._wanted[one.rows, : found.shape[1]] = found
        return self._wanted

    def forces(self, moving: Floats, wheels: Floats, wanted: Floats, dt: float) -> tuple[Floats, Floats]:
        """What wheels do (n, width) after `dt` (s), and the forces (n, 3)."""
        if len(self._kinds) == 1:
            return self._kinds[0].kinematics.forces(moving, wheels, wanted, dt)
        for one in self._kinds:
            rows, mine = one.rows, (one.rows, slice(len(one.kinematics.columns)))
            self._wheels[mine], self._push[rows] = one.kinematics.forces(
                moving[rows], np.ascontiguousarray(wheels[mine]), np.ascontiguousarray(wanted[mine]), dt
            )
        return self._wheels, self._push
