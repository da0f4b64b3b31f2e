"""The robots of a scenario: how many, where they start, what they are made of."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec import field as of
from numpy.typing import NDArray

from swarmsim.core.files import Table
from swarmsim.core.platforms import PLAIN

Positive = Annotated[float, Meta(gt=0.0)]
Length = Annotated[float, Meta(ge=1e-4, le=1e3)]  # m: from grains of sand to ships
Pace = Annotated[float, Meta(ge=1e-5, le=1e4)]  # m/s or m/s^2
Count = Annotated[int, Meta(ge=1, le=100_000)]


class Body(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a robot is made of: a disc on two wheels."""

    radius: Length = 0.055  # m
    wheel_base: Length = 0.10  # m
    speed: Pace = 0.15  # m/s, at a wheel's rim
    acceleration: Pace = 1.0  # m/s^2, at a wheel's rim
    mass: Annotated[float, Meta(ge=1e-6, le=1e6)] = 0.25  # kg
    traction: Annotated[float, Meta(ge=1e-4, le=1e3)] = 0.6  # friction coefficient of wheel on floor


class Group(Body, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots of one kind in a mixed swarm."""

    count: Count
    use: str = PLAIN
    sensor: Table = of(default_factory=dict)  # the kind's own; none: the scenario's
    sensors: tuple[Table, ...] | UnsetType = UNSET  # more of its own


class Robots(Body, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """How many robots there are, where they start and what they are made of.

    `use` names a robot that people have, whose numbers stand where none are given; its sensor is that of a scenario
    without one. Of a swarm of several `[[robots]]` groups, radius and speed are those of the largest and the fastest.
    """

    count: Count
    use: str = PLAIN  # paper, e-puck, kilobot, turtlebot3-burger, thymio, khepera-iv or gternal
    spawn: str = ""  # the spawn area's name; without, the one called spawn, or else the largest
    groups: tuple[Group, ...] = ()  # of a mixed swarm, in the order of its robots

    def each(self, key: str) -> NDArray[np.float64]:
        """A number of every robot (n,), by its key."""
        if not self.groups:
            return np.full(self.count, getattr(self, key), np.float64)
        return np.repeat([float(getattr(g, key)) for g in self.groups], [g.count for g in self.groups])
