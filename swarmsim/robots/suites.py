"""Several sensors as one: of a robot side by side, of a mixed swarm one below the other; and actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Actuator, Sensor
from swarmsim.core.readings import Channel, Channels, Column, Readings, tile_channels
from swarmsim.core.state import State


@runtime_checkable
class BeamSensor(Protocol):
    """A sensor of beams that can die."""

    def without(self, beams: Sequence[int]) -> Sensor:
        """The same sensor with these beams dead, counted from 0. Raises InputError for one that is not there."""
        ...


@runtime_checkable
class Around(Protocol):
    """A sensor around others, which may include rings."""

    def maimed(self, beams: Sequence[int], active: NDArray[np.bool_]) -> Sensor:
        """The same with dead beams in its rings, as `maimed`."""
        ...


def maimed(sensor: Sensor, beams: Sequence[int], active: NDArray[np.bool_]) -> Sensor:
    """The sensor without these beams for active robots (n,), a live view.

    Raises InputError for a sensor without beams, or without these.
    """
    if isinstance(sensor, Around):
        return sensor.maimed(beams, active)
    if isinstance(sensor, BeamSensor):
        return DegradedRing(sensor, sensor.without(beams), active)
    raise InputError("failure: this sensor has no beams that could die; expected the sensor 'ir-ring'")


def checked(beams: Sequence[int], count: int) -> list[int]:
    """The beams' numbers, below `count`. Raises InputError for one that does not exist."""
    for beam in sorted(beams):
        if not 0 <= beam < count:
            raise InputError(f"beams: there is no beam {beam}; expected 0 to {count - 1}")
    return list(beams)


class DegradedRing:
    """A ring in which some robots lack beams: these read NaN and add nothing to tiles."""

    def __init__(self, whole: Sensor, lacking: Sensor, active: NDArray[np.bool_]) -> None:
        """`active` (n,): a live view of the robots that lack beams."""
        self.channels = whole.channels
        self._whole, self._lacking, self._active = whole, lacking, active

    def without(self, beams: Sequence[int]) -> DegradedRing:
        """The same with these beams dead for all robots. Raises InputError for one that does not exist."""
        whole, lacking = (one.without(beams) for one in (self._whole, self._lacking) if isinstance(one, BeamSensor))
        return DegradedRing(whole, lacking, self._active)

    def sense(self, state: State) -> Readings:
        """The readings; robots that lack beams sense without them."""
        whole = self._whole.sense(state)
        return whole.joined(self._lacking.sense(state), self._active) if self._active.any() else whole


class TwiceError(InputError):
    """Two sensors, or two actuators, of the same robots have channels of the same name."""

    def __init__(self, name: str, first: int, second: int) -> None:
        super().__init__(f"two parts give {name!r}")
        self._name, self._first, self._second = name, first, second

    def told(self, places: Sequence[str]) -> str:
        """The message, with the parts' places in the scenario."""
        return (
            f"{places[self._second]}.name: gives {self._name!r}, as {places[self._first]} does; expected a name to "
            "tell them apart, as in name = 'second'"
        )


def _together(parts: Sequence[Sensor | Actuator], names: Sequence[str]) -> Channels:
    """The channels of several parts; those of a named part are called NAME_CHANNEL. Raises TwiceError."""
    found: dict[str, int] = {}
    channels: list[Channel] = []
    for number, (part, name) in enumerate(zip(parts, names, strict=True)):
        for channel in part.channels:
            mine = channel.prefixed(name)
            if mine.name in found:
                raise TwiceError(mine.group or mine.name, found[mine.name], number)
            found[mine.name] = number
            channels.append(mine)
    return Channels(*channels)


class Rig:
    """The actuators of all robots; there may be none."""

    def __init__(self, actuators: Sequence[Actuator], names: Sequence[str]) -> None:
        """Each with its name, or an empty one. Raises TwiceError for channels of the same name."""
        self._actuators = actuators
        self.channels = _together(actuators, names)

    def act(self, commands: Readings, state: State) -> Readings:
        """The values of all actuators."""
        columns: list[Column] = []
        for one in self._actuators:
            own = slice(len(columns), len(columns) + len(one.channels))
            columns += one.act(Readings(one.channels, commands.columns[own]), state).columns
        return Readings(self.channels, tuple(columns))


class Suite:
    """Several sensors of the same robots."""

    def __init__(self, sensors: Sequence[Sensor], names: Sequence[str] = ()) -> None:
        """Channels of named sensors are called NAME_CHANNEL. Raises TwiceError for channels of the same name."""
        self._sensors, self._names = sensors, names or [""] * len(sensors)
        self.channels = _together(sensors, self._names)

    def maimed(self, beams: Sequence[int], active: NDArray[np.bool_]) -> Suite:
        """The same with beams of the first ring among them dead. Raises InputError if there is none."""
        ring = next((i for i, one in enumerate(self._sensors) if isinstance(one, Around | BeamSensor)), 0)
        sensors = [maimed(one, beams, active) if i == ring else one for i, one in enumerate(self._sensors)]
        return Suite(sensors, self._names)

    def sense(self, state: State) -> Readings:
        """The readings of all sensors."""
        return Readings(self.channels, tuple([one for sensor in self._sensors for one in sensor.sense(state).columns]))


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """Where a column of one group's readings goes in those of all."""

    robots: NDArray[np.int64]  # (r,)
    column: int  # of the group's readings
    part: tuple[slice, slice] | None = None  # which part of a larger tile; None: all of it
    aside: NDArray[np.int32] | None = None  # (2,): subtracted from origins, since their tiles lie in larger ones


class MixedSensor:
    """The sensors of a mixed swarm: each group of robots has its own.

    A channel that all groups declare alike is one column. Each other one is NAME.GROUP, blank for the robots of other
    groups. Only tiles are always one column: a smaller tile lies in the middle of the largest.
    """

    def __init__(self, sensors: Sequence[tuple[Sensor, NDArray[np.int64]]]) -> None:
        """The sensor of each group with the robots (r,) that have it."""
        self._sensors = sensors
        self._plan: list[tuple[Channel, list[tuple[int, Member]]]] = []  # with the number of each member's group
        every = [sensor.channels for sensor, _ in sensors]
        for name in dict.fromkeys(name for channels in every for name in channels.groups):
            self._plan += self._tiles(name)
        for name in dict.fromkeys(channel.name for channels in every for channel in channels if not channel.group):
            self._plan += self._column(name)
        self.channels = Channels(*(channel for channel, _ in self._plan))

    def _tiles(self, group: str) -> list[tuple[Channel, list[tuple[int, Member]]]]:
        """The columns of tiles, those of all groups of robots in one."""
        having = [
            (number, robots, sensor.channels)
            for number, (sensor, robots) in enumerate(self._sensors)
            if group in sensor.channels
        ]
        shapes = [next(one.shape for one in channels if one.group == group) for _, _, channels in having]
        rows, columns = np.max(shapes, axis=0).tolist()
        plan = []
        for channel in tile_channels((rows, columns), any(len(one.groups[group]) > 2 for _, _, one in having)):
            mine, members = channel.prefixed(group.removesuffix("tiles").rstrip("_")), []
            for (number, robots, channels), (height, width) in zip(having, shapes, strict=True):
                if mine.name in channels:
                    low, left = (rows - height) // 2, (columns - width) // 2
                    part = (slice(low, low + height), slice(left, left + width))
                    place = channels.place(mine.name)
                    if mine.structure:
                        members.append((number, Member(robots, place, aside=np.array([low, left], np.int32))))
                    else:
                        members.append((number, Member(robots, place, part)))
            plan.append((mine, members))
        return plan

    def _column(self, name: str) -> list[tuple[Channel, list[tuple[int, Member]]]]:
        """One column of all robots if they declare the same, else one of each group."""
        having = [
            (number, robots, sensor.channels)
            for number, (sensor, robots) in enumerate(self._sensors)
            if name in sensor.channels
        ]
        first = having[0][2][name]
        if len(having) == len(self._sensors) and all(channels[name] == first for _, _, channels in having):
            return [(first, [(number, Member(robots, one.place(name))) for number, robots, one in having])]
        plan = []
        for number, robots, channels in having:
            one = channels[name]
            count = one.count and (one.count if self._alike(one.count) else f"{one.count}.{number}")
            ends = int(robots[0]), int(robots[-1]) + 1
            mine = one.called(f"{name}.{number}", count=count, robots=ends)
            plan.append((mine, [(number, Member(robots, channels.place(name)))]))
        return plan

    def _alike(self, name: str) -> bool:
        """Whether all groups declare a channel alike."""
        found = {channel for sensor, _ in self._sensors for channel in sensor.channels if channel.name == name}
        return len(found) == 1 and all(name in sensor.channels for sensor, _ in self._sensors)

    def maimed(self, beams: Sequence[int], active: NDArray[np.bool_]) -> MixedSensor:
        """The same with beams of every group's ring dead. Raises InputError for a group without one."""
        return MixedSensor([(maimed(sensor, beams, active), robots) for sensor, robots in self._sensors])

    def sense(self, state: State) -> Readings:
        found = [sensor.sense(state).columns for sensor, _ in self._sensors]
        columns: list[Column] = []
        for channel, members in self._plan:
            whole = channel.blanks(state.robots)
            for number, member in members:
                rows = found[number][member.column][member.robots]
                if member.part is None:
                    whole[member.robots] = rows if member.aside is None else rows - member.aside
                else:
                    whole[member.robots, member.part[0], member.part[1]] = rows
            columns.append(whole)
        return Readings(self.channels, tuple(columns))
