"""Which side of each robot touches something: a wall, another robot or a person."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.readings import Called, Channel, Channels, Readings
from swarmsim.core.state import State


class Bump(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contacts by sectors of the body, the first one straight ahead, the others counter-clockwise."""

    gives: ClassVar[dict[str, str]] = {"bump": ""}
    margin: ClassVar[int] = 0  # cells that it maps

    name: Called | None = None  # of one of several on a robot: its channel is called NAME_bump
    sectors: Annotated[int, Meta(ge=1, le=360)] = 4  # equal ones all round; each tells whether it touches
    slack: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.005  # m, up to which a gap is a contact

    def build(self, context: BuildContext) -> BumpSensor:
        return BumpSensor(self, context)


class BumpSensor:
    """Looks for the nearest point of every wall and body."""

    def __init__(self, parameters: Bump, context: BuildContext) -> None:
        self._sectors, self._slack, self._building = parameters.sectors, parameters.slack, context.building
        self._radii = context.robots.each("radius")
        middles = np.arange(parameters.sectors) * (2.0 * np.pi / parameters.sectors)
        self.channels = Channels(Channel("bump", "?", (parameters.sectors,), axis=tuple(middles.tolist())))

    def sense(self, state: State) -> Readings:
        """Which sectors (n, sectors) touch; none of a dead robot."""
        found = self.channels["bump"].blanks(state.robots)
        walls, people = self._building.walls, self._building.walkers()
        bodies = np.column_stack([state.pose[:, :2], self._radii])
        for robot in np.flatnonzero(state.alive):
            place, reach = state.pose[robot, :2], self._radii[robot] + self._slack
            others = np.concatenate([bodies[state.alive & (np.arange(state.robots) != robot)], people])
            away = np.concatenate([_nearest(walls, place), others[:, :2]]) - place
            gaps = np.hypot(away[:, 0], away[:, 1])
            gaps[len(walls) :] -= others[:, 2]
            touching = away[gaps <= reach]
            angles = np.arctan2(touching[:, 1], touching[:, 0]) - state.pose[robot, 2]
            found[robot, np.floor(angles * self._sectors / (2.0 * np.pi) + 0.5).astype(int) % self._sectors] = True
        return Readings(self.channels, (found,))


def _nearest(walls: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """The point (s, 2) of each wall (s, 4) that is nearest to a place (2,)."""
    start, way = walls[:, :2], walls[:, 2:] - walls[:, :2]
    along = ((place - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-300)
    return np.asarray(start + np.clip(along, 0.0, 1.0)[:, None] * way)
