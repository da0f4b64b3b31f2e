"""The floor under each robot: a grey level, a colour or any other value of a field."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta, Struct

from swarmsim.core import chance
from swarmsim.core.context import BuildContext, Field
from swarmsim.core.errors import InputError
from swarmsim.core.readings import Called, Channel, Channels, Readings
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import State


class GroundColour(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The value of the floor under the robot's middle, one for each of `floors`: one for grey, three for a colour.

    Each is a field as in `[field]`, such as {use = "picture", values = {file = "floor.png"}} or a formula. With
    `steps`, the reading is the number of these values reached: 0 or 1 with one step, as for black and white.
    """

    gives: ClassVar[dict[str, str]] = {"ground": ""}
    margin: ClassVar[int] = 0  # cells that it maps

    name: Called | None = None  # of one of several on a robot: its channel is called NAME_ground
    floors: Annotated[tuple[Part[Field], ...], Meta(min_length=1, max_length=16)]
    steps: tuple[float, ...] = ()  # rising values, in the unit of the floor; none: the reading is the value itself
    error: Annotated[float, Meta(ge=0.0)] = 0.0  # standard deviation, in the unit of the floor, before steps

    def build(self, context: BuildContext) -> GroundSensor:
        """The sensor. Raises InputError for a floor that is not a field, and for steps that do not rise."""
        if sorted(set(self.steps)) != list(self.steps):
            raise InputError(f"steps: {list(self.steps)}; expected numbers that rise")
        floors = [part.build(context, f"floors[{number}]") for number, part in enumerate(self.floors)]
        return GroundSensor(self, floors, context)


class GroundSensor:
    """Samples the floor under the robots."""

    def __init__(self, parameters: GroundColour, floors: list[Field], context: BuildContext) -> None:
        self._floors, self._steps, self._error = floors, np.array(parameters.steps), parameters.error
        high = float(len(parameters.steps)) if parameters.steps else np.inf
        shape = (len(floors),) if len(floors) > 1 else ()
        self.channels = Channels(Channel("ground", "f8", shape, low=0.0 if parameters.steps else -np.inf, high=high))
        self._period = context.period
        self._salt = int(context.streams.open(f"ground {context.number}").integers(0, 2**64, dtype=np.uint64))

    def sense(self, state: State) -> Readings:
        """The floor's values; NaN for the dead."""
        points, time, robots = state.pose[:, :2], state.iteration * self._period, np.arange(state.robots)
        found = np.stack([floor.value(time, points) for floor in self._floors], axis=1)
        if self._error:
            found += self._error * chance.normal(
                self._salt, state.iteration, robots[:, None], np.arange(found.shape[1])
            )
        if len(self._steps):
            found = np.searchsorted(self._steps, found, side="right").astype(np.float64)
        found[~state.alive] = np.nan
        return Readings(self.channels, (found if len(self._floors) > 1 else found[:, 0],))
