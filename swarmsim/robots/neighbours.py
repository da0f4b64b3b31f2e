"""Range and bearing: places and headings of nearby robots, as seen from each robot."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.readings import Called, Channel, Channels, Name, Readings, ragged
from swarmsim.core.state import State
from swarmsim.kernels import graph
from swarmsim.world.sight import Sight

NO_GROUP: Final = 255  # stands where no robot is seen
Spread = Annotated[float, Meta(ge=0.0, le=10.0)]


class Neighbours(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Distance and bearing of the nearest robots, and their headings relative to the robot's own.

    The nearest come first, ties by number; walls hide robots, robots do not. Errors are normal, and a robot is missed
    with the probability `missed`, both drawn for each pair and iteration. With `groups` they are told apart by the
    number of their group of robots, from 0, without errors.
    """

    gives: ClassVar[dict[str, str]] = {
        "neighbours": "", "neighbours_group": "groups = true", "neighbours_led": "sees = ['led']",
    }  # fmt: skip
    margin: ClassVar[int] = 0  # cells that it maps

    name: Called | None = None  # of one of several on a robot: its channel is called NAME_neighbours
    reach: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0  # m, centre to centre
    most: Annotated[int, Meta(ge=1, le=1000)] | None = None  # robots reported; default: all others, up to 8
    view: Annotated[float, Meta(gt=0.0, le=360.0)] = 360.0  # degrees, with the middle straight ahead
    error: Spread = 0.0  # m, standard deviation of distances
    error_angle: Spread = 0.0  # rad, of bearings and headings
    missed: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0  # share of robots that are not seen in an iteration
    walls: bool = True  # whether they hide what is behind them
    groups: bool | None = None  # whether it reports each one's group, in a channel neighbours_group; default: no
    sees: tuple[Name, ...] = ()  # channels of actuators, such as led: the neighbours' values, in neighbours_led

    def build(self, context: BuildContext) -> NeighbourSensor:
        """The sensor. Raises InputError for an unknown actuator, and for too many groups."""
        if self.groups and len(context.robots.names) > NO_GROUP:
            raise InputError(f"groups: {len(context.robots.names)} cannot be told apart; expected {NO_GROUP} at most")
        for name in self.sees:
            if name not in context.actuators:
                raise InputError(
                    f"sees: no actuator of these robots is {name!r}; {nearest(name, context.actuators.places)}"
                )
        return NeighbourSensor(self, context)


class NeighbourSensor:
    """Distance, bearing and heading of others."""

    def __init__(self, parameters: Neighbours, context: BuildContext) -> None:
        self._parameters = parameters
        self._most = parameters.most or min(max(context.swarm - 1, 1), 8)
        names = ("range", "bearing", "heading")
        far = max(parameters.reach, math.pi)
        own = ragged("neighbours", self._most, names, "m, rad, rad", -far, far)
        told = [context.actuators[name].seen_of("neighbours", self._most) for name in dict.fromkeys(parameters.sees)]
        group = Channel("neighbours_group", "u1", (self._most,), "", 0, NO_GROUP - 1, NO_GROUP, count=own[1].name)
        self.channels = Channels(*own, *told, *([group] if parameters.groups else []))
        self._group = context.robots.kind.astype(np.uint8)
        self._sight = Sight(context.building) if parameters.walls else None
        self._salt = int(context.streams.open(f"neighbours {context.number}").integers(0, 2**64, dtype=np.uint64))

    def sense(self, state: State) -> Readings:
        """The nearest robots of each; the dead neither see nor are seen."""
        given, at, pose = self._parameters, state.iteration, state.pose
        near = graph.within(pose, state.alive, given.reach)
        seer, seen = graph.both_ways(near if self._sight is None else self._sight.clear(pose, near), state.robots).T
        apart = pose[seen, :2] - pose[seer, :2]
        distance = np.hypot(apart[:, 0], apart[:, 1])
        bearing = _turn(np.arctan2(apart[:, 1], apart[:, 0]) - pose[seer, 2])
        told = np.abs(bearing) <= 0.5 * math.radians(given.view)
        told &= chance.uniform(self._salt, at, seer, seen, 3) >= given.missed
        order = np.flatnonzero(told)
        order = order[np.lexsort((seen[order], distance[order], seer[order]))]
        seer, seen, distance, bearing = seer[order], seen[order], distance[order], bearing[order]
        noise = [chance.normal(self._salt, at, seer, seen, what) for what in range(3)]
        heading = pose[seen, 2] - pose[seer, 2] + given.error_angle * noise[2]
        found = np.stack([
            np.clip(distance + given.error * noise[0], 0.0, given.reach),
            _turn(bearing + given.error_angle * noise[1]), _turn(heading),
        ], axis=1)  # fmt: skip
        rank = np.arange(len(seer)) - np.searchsorted(seer, seer)
        kept = rank < self._most
        columns = [channel.blanks(state.robots) for channel in self.channels]
        columns[0][seer[kept], rank[kept]] = found[kept]
        columns[1][:] = np.minimum(np.bincount(seer, minlength=state.robots), self._most)
        told_of = [state.actuators[name] for name in dict.fromkeys(given.sees)]
        for column, of_each in zip(columns[2:], [*told_of, *([self._group] if given.groups else [])], strict=True):
            column[seer[kept], rank[kept]] = of_each[seen[kept]]
        return Readings(self.channels, tuple(columns))


def _turn(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angle wrapped to half a turn either way."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
