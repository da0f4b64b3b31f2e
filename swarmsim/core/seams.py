"""The table of seams that a scenario can name parts for, with all that depends on it.

Seams of parts in other parts' tables are not the core's: they are declared as entry points of the group
`swarmsim.seam`, under their names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint
from typing import Final

from swarmsim.core import parts
from swarmsim.core.adapters.forms import (
    FunctionComputation,
    FunctionLayer,
    FunctionStrategy,
    FunctionTask,
    FunctionTopology,
    OfFunction,
    OfMind,
)
from swarmsim.core.adapters.minds import MindComputation, MindStrategy
from swarmsim.core.capabilities import lacking, verbs_of
from swarmsim.core.code import distributions
from swarmsim.core.context import BuildContext, Field, WorldContext
from swarmsim.core.drawing import Layer, Shown
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import PieceJob, SwarmJob
from swarmsim.core.kinematics import Kinematics

GROUP: Final = "seam"  # of entry points: swarmsim.seam


@dataclass(frozen=True, slots=True)
class Seam:
    """One seam. Its checks are in `engine.promises`, and its skeleton is a file in `api/skeletons`."""

    name: str  # entry points are of the group swarmsim.NAME
    place: tuple[str, ...]  # the keys of its table in a scenario; none for a part named elsewhere
    protocol: type  # what a part must have
    default: str | None = None  # the part used if a scenario names none
    required: bool = False  # whether a scenario must name one
    elsewhere: str = "in another part's table"  # where a part without a place is named
    many: bool = False  # whether its place holds a list of tables
    more: str = ""  # key of a list of further tables in the scenario and in groups, if several are possible
    of_groups: bool = False  # whether a group may have its own, at the same place in its table
    given: type = BuildContext  # the argument of its parts' `build`
    function: OfFunction | None = None  # makes a part of a function
    mind: OfMind | None = None  # makes a part of a class of one robot's mind, or of a job's class
    also: type | None = None  # another Protocol that a part may have instead

    @property
    def at(self) -> str:
        """Its place in a scenario, as a dotted key."""
        return ".".join(self.place)

    @property
    def group(self) -> str:
        """The group of its entry points."""
        return f"swarmsim.{self.name}"

    @property
    def verbs(self) -> tuple[str, ...]:
        """The methods and properties of its Protocol, in order."""
        return verbs_of(self.protocol)

    def protocol_of(self, part: object) -> type:
        """Its Protocol, or the other one if the part has more of that."""
        others = () if self.also is None else (self.also,)
        known: tuple[type, ...] = (self.protocol, *others)
        return min(known, key=lambda one: len(lacking(one, part)))

    def missing(self, part: object) -> list[str]:
        """The verbs that a part lacks."""
        return lacking(self.protocol_of(part), part)


#: The seams with a place in a scenario, in listing order.
PLACED: Final = {
    seam.name: seam
    for seam in (
        Seam("generator", ("world", "generate"), parts.Generator, given=WorldContext),
        Seam("physics", ("physics",), parts.Bodies, "pymunk"),
        Seam("sensor", ("sensor",), parts.Sensor, "ir-ring", more="sensors", of_groups=True),
        Seam("actuator", ("actuators",), parts.Actuator, many=True),
        Seam("field", ("field",), Field),
        Seam("localisation", ("localisation",), parts.Localisation, "perfect"),
        Seam(
            "computation", ("mind", "computation"), parts.Computation, "occupancy-grid", of_groups=True,
            function=FunctionComputation, mind=MindComputation,
        ),
        Seam(
            "strategy", ("mind", "strategy"), parts.Strategy, "nearest-frontier", of_groups=True,
            function=FunctionStrategy, mind=MindStrategy,
        ),
        Seam(
            "job", ("jobs",), SwarmJob, many=True, also=PieceJob, mind=lambda found, make, context: make(),
        ),
        Seam("topology", ("network", "topology"), parts.Topology, required=True, function=FunctionTopology),
        Seam("channel", ("network", "channel"), parts.NetworkChannel, "perfect"),
        Seam("motion", ("motion",), parts.Motion, "pure-pursuit"),
        Seam("kinematics", ("kinematics",), Kinematics, "differential", of_groups=True),
        Seam("task", ("task",), parts.Task, "coverage", function=FunctionTask),
        Seam("fault", ("faults",), parts.Fault, many=True),
        Seam("probe", ("probes",), parts.Probe, many=True),
        Seam("layer", ("layers",), Layer, many=True, given=Shown, function=FunctionLayer),
    )
}  # fmt: skip


class Seams(Mapping[str, Seam]):
    """All seams by name: first those with a place in a scenario, then those declared by distributions."""

    def __getitem__(self, name: str) -> Seam:
        return PLACED[name] if name in PLACED else _loaded(distributions.parts().get(GROUP, {})[name])

    def __iter__(self) -> Iterator[str]:
        yield from PLACED
        yield from _declared()

    def __len__(self) -> int:
        return len(PLACED) + len(_declared())


SEAMS: Final = Seams()


def _declared() -> dict[str, Seam]:
    """The seams that installed distributions declare. Raises InputError for an invalid one."""
    return {name: _loaded(entry) for name, entry in distributions.parts().get(GROUP, {}).items()}


@lru_cache(maxsize=64)
def _loaded(entry: EntryPoint) -> Seam:
    seam = entry.load()
    if not isinstance(seam, Seam) or seam.name != entry.name or seam.place or entry.name in PLACED:
        raise InputError(
            f"swarmsim.{GROUP} {entry.name}: {entry.value} is {seam!r}; expected a Seam of this name, which no other "
            "has, without a place in scenarios"
        )
    return seam


def at_place(place: tuple[str, ...]) -> Seam | None:
    """The seam whose table is at these keys of a scenario."""
    return next((seam for seam in PLACED.values() if seam.place == place), None)
