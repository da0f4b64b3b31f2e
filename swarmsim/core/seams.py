"""The table of seams: what a scenario can name parts for, and all that follows from it."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
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
from swarmsim.core.context import BuildContext, Field, WorldContext
from swarmsim.core.drawing import Layer, Shown

_ABSENT: Final = object()


@dataclass(frozen=True, slots=True)
class Seam:
    """One seam. Its checks are in `engine.promises`, and its skeleton is a file in `cli/skeletons`."""

    name: str  # entry points are of the group swarmsim.NAME
    place: tuple[str, ...]  # the keys of its table in a scenario; none for a part named in another part's table
    protocol: type  # what a part has to have
    default: str | None = None  # the part where a scenario names none
    required: bool = False  # whether a scenario has to name one
    many: bool = False  # whether its place holds a list of tables
    more: str = ""  # the key of a list of further tables, of the scenario and of groups, if there can be several
    of_groups: bool = False  # whether a group of robots may have its own, at the key of the seam's name
    given: type = BuildContext  # what `build` of its parts gets
    function: OfFunction | None = None  # makes a part of a function
    mind: OfMind | None = None  # makes a part of a class of one robot's mind

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
        """The methods and properties of its Protocol, in their order."""
        found: dict[str, None] = {}
        for kind in reversed(self.protocol.__mro__):
            if getattr(kind, "_is_protocol", False):
                names = (*inspect.get_annotations(kind), *vars(kind))
                found |= dict.fromkeys(name for name in names if not name.startswith("_"))
        return tuple(found)

    def missing(self, part: object) -> list[str]:
        """The verbs that a part lacks. Properties are not asked for their values, which may not be there yet."""
        return [
            verb
            for verb in self.verbs
            if inspect.getattr_static(part, verb, _ABSENT) is _ABSENT and getattr(part, verb, _ABSENT) is _ABSENT
        ]


#: All seams by name, in the order in which they are listed.
SEAMS: Final = {
    seam.name: seam
    for seam in (
        Seam("generator", ("world", "generate"), parts.Generator, given=WorldContext),
        Seam("physics", ("physics",), parts.Bodies, "pymunk"),
        Seam("sensor", ("sensor",), parts.Sensor, "ir-ring", more="sensors", of_groups=True),
        Seam("actuator", ("actuators",), parts.Actuator, many=True),
        Seam("field", ("field",), Field),
        Seam("localisation", ("localisation",), parts.Localisation, "perfect"),
        Seam(
            "computation", ("mind", "computation"), parts.Computation, "occupancy-grid",
            function=FunctionComputation, mind=MindComputation,
        ),
        Seam("sharing", (), parts.Sharing, "current-tile"),
        Seam(
            "strategy", ("mind", "strategy"), parts.Strategy, "nearest-frontier",
            function=FunctionStrategy, mind=MindStrategy,
        ),
        Seam("topology", ("network", "topology"), parts.Topology, required=True, function=FunctionTopology),
        Seam("channel", ("network", "channel"), parts.Channel, "perfect"),
        Seam("motion", ("motion",), parts.Motion, "pure-pursuit"),
        Seam("task", ("task",), parts.Task, "coverage", function=FunctionTask),
        Seam("fault", ("faults",), parts.Fault, many=True),
        Seam("probe", ("probes",), parts.Probe, many=True),
        Seam("layer", ("layers",), Layer, many=True, given=Shown, function=FunctionLayer),
    )
}  # fmt: skip


def at_place(place: tuple[str, ...]) -> Seam | None:
    """The seam whose table stands at these keys of a scenario."""
    return next((seam for seam in SEAMS.values() if seam.place == place and place), None)
