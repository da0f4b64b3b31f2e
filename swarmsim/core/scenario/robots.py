"""The robots of a scenario: their number, starts and bodies."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from msgspec import UNSET, Meta, Struct, UnsetType
from numpy.typing import NDArray

from swarmsim.core.crew import Body, Crew, Kind
from swarmsim.core.kinematics import Kinematics
from swarmsim.core.parts import AnyComputation, AnyStrategy, Sensor
from swarmsim.core.processors import Processor
from swarmsim.core.readings import Called
from swarmsim.core.scenario.part import NONE, Part
from swarmsim.core.scenario.platforms import PLAIN

Positive = Annotated[float, Meta(gt=0.0)]
LONGEST: Final = 100_000  # most iterations of a run
Count = Annotated[int, Meta(ge=1, le=LONGEST)]


class GroupMind(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The mind of a group of robots; a missing half is the scenario's."""

    computation: Part[AnyComputation] = NONE  # what these robots know and tell
    strategy: Part[AnyStrategy] = NONE  # where they go


class Group(Body, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots of one kind in a mixed swarm."""

    count: Count  # robots of this kind
    name: Called | UnsetType = UNSET  # of the group, for other parts; default: its number, from 0
    use: str = PLAIN  # a real robot, as robots.use
    sensor: Part[Sensor] = NONE  # of these robots; default: the scenario's
    sensors: tuple[Part[Sensor], ...] | UnsetType = UNSET  # their further ones
    kinematics: Part[Kinematics] | UnsetType = UNSET  # what their wheels can do; default: the scenario's
    mind: GroupMind | UnsetType = UNSET  # of these robots; default: the scenario's
    processor: Processor | UnsetType = UNSET  # of jobs; default: that of all robots


class Robots(Body, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The number of robots, their starts and their bodies.

    `use` names a real robot, whose numbers replace missing ones, and whose sensor a scenario without one gets. In a
    swarm of several `[[robots]]` groups, radius and speed are those of the largest and the fastest.
    """

    count: Count  # robots
    use: str = PLAIN  # a real one: paper, e-puck, kilobot, turtlebot3-burger, thymio, khepera-iv or gternal
    spawn: str = ""  # the spawn area's name; default: the one called spawn, or the largest
    groups: tuple[Group, ...] = ()  # of a mixed swarm, in robot order
    processor: Processor | UnsetType = UNSET  # of jobs; default: unlimited

    def __post_init__(self) -> None:
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"two groups have one name ({', '.join(self.names)}); expected a name for each")

    @property
    def names(self) -> tuple[str, ...]:
        """The groups' names, in order: their `name` or, without one, their number."""
        return tuple(str(i) if one.name is UNSET else one.name for i, one in enumerate(self.groups))

    @property
    def processors(self) -> tuple[Processor, ...]:
        """The processor of each group, or of all robots."""
        found = [one.processor for one in self.groups] or [self.processor]
        given = [self.processor if one is UNSET else one for one in found]
        return tuple(Processor() if one is UNSET else one for one in given)

    def each(self, key: str) -> NDArray[np.float64]:
        """A number of every robot (n,), by its key."""
        return self.crew(np.arange(self.count)).each(key)

    def crew(self, ids: NDArray[np.int64]) -> Crew:
        """The bodies of the robots with these numbers (rows,)."""
        keys = Body.__struct_fields__
        groups = self.groups or (self,)
        kinds = tuple(Kind(**{key: getattr(group, key) for key in keys}) for group in groups)
        kind = np.repeat(np.arange(len(groups)), [group.count for group in groups])[ids]
        kind.flags.writeable = False
        return Crew(
            **{key: getattr(self, key) for key in keys}, kinds=kinds, kind=kind, names=self.names,
            processors=self.processors,
        )  # fmt: skip
