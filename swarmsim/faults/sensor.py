"""Faults of sensors: tiles that are blind, stuck, random, short-sighted, out of place, or lack beams."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Parts
from swarmsim.core.parts import Sensor as SensorPart
from swarmsim.core.readings import Channels, Readings
from swarmsim.core.setting import Setting
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, State
from swarmsim.faults.effect import Lasting, TimedFault
from swarmsim.faults.timeline import Robots, Timed, Timeline
from swarmsim.robots.suites import maimed

Cells = Annotated[int, Meta(ge=-1000, le=1000)]

#: What the readings of these robots (r,) become.
Spoil = Callable[[State, Robots, Readings], Readings]


class Sensor(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The tiles are wrong, and the robot maps and tells them as if they were right.

    `off`: all cells are unknown. `stuck`: all cells have one `value`. `garbage`: each cell is unknown, free or
    occupied, drawn anew in every iteration. `range`: cells with centres farther than `range` from the robot are
    unknown. `offset`: the tile is taken to lie so many cells aside. `beams`: these beams of a ring are dead.
    """

    failure: Literal["off", "stuck", "garbage", "range", "offset", "beams"]
    value: Literal["free", "occupied"] | None = None  # for stuck
    range: Annotated[float, Meta(gt=0.0)] | None = None  # for range: m
    offset: tuple[Cells, Cells] | None = None  # for offset: rows, columns
    beams: Annotated[list[Annotated[int, Meta(ge=0)]], Meta(min_length=1)] | None = None  # for beams: 0 is ahead

    def build(self, setting: Setting) -> TimedFault:
        """The fault; raises InputError for a key that its failure lacks or does not have."""
        for key, failure in (("value", "stuck"), ("range", "range"), ("offset", "offset"), ("beams", "beams")):
            given = getattr(self, key) is not None
            if given and self.failure != failure:
                raise InputError(f"{key}: a sensor that is {self.failure!r} has none; expected failure = {failure!r}")
            if not given and self.failure == failure:
                raise InputError(f"{key}: required key is missing; expected it with failure = {failure!r}")
        effect = (
            DeadBeams(self.beams)
            if self.beams
            else SensorFailure(_spoil(self, setting), of_tiles=self.failure != "off")
        )
        return TimedFault(Timeline(self, setting), effect, setting.number)


def _spoil(fault: Sensor, setting: Setting) -> Spoil:
    """What the failure does to readings."""
    if fault.failure == "stuck":
        return _filled(OCCUPIED if fault.value == "occupied" else FREE)
    if fault.range is not None:
        return _cut(fault.range, setting.lattice)
    if fault.offset is not None:
        return _aside(fault.offset)
    if fault.failure == "garbage":
        return _garbage(
            [setting.streams.open(f"fault sensor {setting.number}", i) for i in range(setting.robots.count)]
        )
    return _blank


def _blank(state: State, robots: Robots, readings: Readings) -> Readings:
    return readings.blanked(robots)


def _made_up(readings: Readings, robots: Robots, values: NDArray[np.uint8]) -> Readings:
    """The same with other values of tiles; what is made up is believed as any tile is."""
    evidence = readings.channels.groups["tiles"][2:]
    return readings.having({"tiles.values": values}).blanked(robots, evidence)


def _filled(value: int) -> Spoil:
    def fill(state: State, robots: Robots, readings: Readings) -> Readings:
        values = readings.tiled.values.copy()
        values[robots] = value
        return _made_up(readings, robots, values)

    return fill


def _garbage(streams: list[np.random.Generator]) -> Spoil:
    def draw(state: State, robots: Robots, readings: Readings) -> Readings:
        values = readings.tiled.values.copy()
        for robot in robots:
            values[robot] = streams[robot].integers(UNKNOWN, OCCUPIED, values.shape[1:], np.uint8, endpoint=True)
        return _made_up(readings, robots, values)

    return draw


def _cut(reach: float, lattice: Lattice) -> Spoil:
    def cut(state: State, robots: Robots, readings: Readings) -> Readings:
        values, origins = readings.tiled.values.copy(), readings.tiled.origins
        within = np.moveaxis(np.indices(values.shape[1:]), 0, -1)  # (rows, columns, 2)
        centres = lattice.centres(origins[robots, None, None] + within)
        apart = centres - state.pose[robots, None, None, :2]
        values[robots] = np.where(np.hypot(apart[..., 0], apart[..., 1]) > reach, UNKNOWN, values[robots])
        return _made_up(readings, robots, values)

    return cut


def _aside(offset: tuple[int, int]) -> Spoil:
    def move(state: State, robots: Robots, readings: Readings) -> Readings:
        tiles = readings.tiled
        origins = tiles.origins.copy()
        origins[robots] += np.array(offset, np.int32)
        return _made_up(readings.having({"tiles.origins": origins}), robots, tiles.values)

    return move


class SensorFailure(Lasting):
    """Wraps the sensor: its readings are spoilt."""

    def __init__(self, spoil: Spoil, *, of_tiles: bool) -> None:
        """`of_tiles` says whether it is tiles that are spoilt."""
        self._spoil, self._of_tiles = spoil, of_tiles

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sensor wrapped; one without tiles has none that could be spoilt."""
        if self._of_tiles and "tiles" not in parts.sensor.channels:
            return parts
        return replace(parts, sensor=FailingSensor(parts.sensor, active, self._spoil))


@dataclass(frozen=True, slots=True, eq=False)
class FailingSensor:
    """A sensor of which some tiles are spoilt; those of dead robots stay UNKNOWN."""

    inner: SensorPart
    active: NDArray[np.bool_]  # (n,): a live view
    spoil: Spoil

    @property
    def channels(self) -> Channels:
        """What the sensor inside gives."""
        return self.inner.channels

    def maimed(self, beams: Sequence[int], active: NDArray[np.bool_]) -> FailingSensor:
        """The same around a sensor that lacks beams: these die beneath all that spoils tiles."""
        return replace(self, inner=maimed(self.inner, beams, active))

    def sense(self, state: State) -> Readings:
        """The readings, but for those that fail."""
        readings = self.inner.sense(state)
        failing = np.flatnonzero(self.active & state.alive)
        return self.spoil(state, failing, readings) if len(failing) else readings


class DeadBeams(Lasting):
    """Wraps the ring of beams beneath all failures that spoil its tiles, whichever was installed first."""

    def __init__(self, beams: list[int]) -> None:
        self._beams = beams

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sensor wrapped. Raises InputError for a sensor without a ring, or without these beams."""
        return replace(parts, sensor=maimed(parts.sensor, self._beams, active))
