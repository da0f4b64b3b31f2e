"""The bodies of robots, by number."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.processors import Processor

Length = Annotated[float, Meta(ge=1e-4, le=1e3)]  # m: from grains of sand to ships
Pace = Annotated[float, Meta(ge=1e-5, le=1e4)]  # m/s or m/s^2


class Body(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot's body: a disc on wheels."""

    radius: Length = 0.055  # m, of the disc
    wheel_base: Length = 0.10  # m, between wheels on opposite sides
    speed: Pace = 0.15  # m/s, at a wheel's rim
    acceleration: Pace = 1.0  # m/s^2, at a wheel's rim
    mass: Annotated[float, Meta(ge=1e-6, le=1e6)] = 0.25  # kg, of the whole robot
    traction: Annotated[float, Meta(ge=1e-4, le=1e3)] = 0.6  # friction coefficient of wheel on floor


class Kind(Body, frozen=True):
    """The body of one kind of robot."""


class Crew(Body, frozen=True, kw_only=True, eq=False):
    """The bodies of the robots that a part serves; `BuildContext.ids` and `BuildContext.swarm` give their number.

    In a swarm of several kinds, radius and speed are those of the largest and the fastest robot of the whole swarm.
    """

    kinds: tuple[Kind, ...]  # of the whole swarm, one for each group
    kind: NDArray[np.int64]  # (rows,): each robot's kind
    names: tuple[str, ...] = ()  # of the groups, in order; empty: no groups
    processors: tuple[Processor, ...]  # of each kind

    def each(self, key: str) -> NDArray[np.float64]:
        """A number of every robot served (rows,), by its key."""
        return self._of_kinds(key)[self.kind]

    def of(self, rows: NDArray[np.int64]) -> Crew:
        """Some of them."""
        return replace(self, kind=self.kind[rows])

    def number_of(self, group: str, key: str) -> int:
        """A group's number. Raises InputError, which starts with the `key`, for an unknown group."""
        if group not in self.names:
            why = f"known: {', '.join(self.names)}" if self.names else "there are none; expected several [[robots]]"
            raise InputError(f"{key}: no group of robots is called {group!r}; {why}")
        return self.names.index(group)

    def group(self, name: str, key: str) -> NDArray[np.int64]:
        """The rows (r,) of the robots of a group. Raises InputError as `number_of` does."""
        return np.flatnonzero(self.kind == self.number_of(name, key))

    def least(self, key: str) -> float:
        """The smallest value in the swarm, by its key."""
        return float(self._of_kinds(key).min())

    def _of_kinds(self, key: str) -> NDArray[np.float64]:
        return np.array([getattr(kind, key) for kind in self.kinds], np.float64)
