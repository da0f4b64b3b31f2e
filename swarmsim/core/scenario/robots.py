"""The robots of a scenario: how many, where they start, what they are made of."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import UNSET, Meta, UnsetType
from numpy.typing import NDArray

from swarmsim.core.crew import Body, Crew
from swarmsim.core.scenario.part import NONE, Part
from swarmsim.core.scenario.platforms import PLAIN

Positive = Annotated[float, Meta(gt=0.0)]
Count = Annotated[int, Meta(ge=1, le=100_000)]


class Group(Body, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots of one kind in a mixed swarm."""

    count: Count
    use: str = PLAIN
    sensor: Part[Any] = NONE  # the kind's own; none: the scenario's
    sensors: tuple[Part[Any], ...] | UnsetType = UNSET  # more of its own


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
        return self.crew(np.arange(self.count)).each(key)

    def crew(self, ids: NDArray[np.int64]) -> Crew:
        """The bodies of the robots with these numbers (rows,)."""
        keys = Body.__struct_fields__
        groups = self.groups or (self,)
        kinds = tuple(Body(**{key: getattr(group, key) for key in keys}) for group in groups)
        kind = np.repeat(np.arange(len(groups)), [group.count for group in groups])[ids]
        kind.flags.writeable = False
        return Crew(**{key: getattr(self, key) for key in keys}, kinds=kinds, kind=kind)
