"""Faults of sensors: tiles that are blind, stuck, random, short-sighted, out of place, or lack beams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Parts
from swarmsim.core.parts import Sensor as SensorPart
from swarmsim.core.setting import Setting
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Readings, State, Tiles
from swarmsim.faults.effect import Lasting, TimedFault
from swarmsim.faults.timeline import Robots, Timed, Timeline
from swarmsim.robots.rangefinders import RangefinderSensor
from swarmsim.robots.sensors import FieldSensor, IrRingSensor, MixedSensor

Cells = Annotated[int, Meta(ge=-1000, le=1000)]

#: Changes the tiles of these robots in place: state, robots (r,), values (n, rows, columns), origins (n, 2).
Spoil = Callable[[State, Robots, NDArray[np.uint8], NDArray[np.int32]], None]


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
    beams: Annotated[tuple[Annotated[int, Meta(ge=0)], ...], Meta(min_length=1)] | None = None  # for beams: 0 is ahead

    def build(self, setting: Setting) -> TimedFault:
        """The fault; raises InputError for a key that its failure lacks or does not have."""
        for key, failure in (("value", "stuck"), ("range", "range"), ("offset", "offset"), ("beams", "beams")):
            given = getattr(self, key) is not None
            if given and self.failure != failure:
                raise InputError(f"{key}: a sensor that is {self.failure!r} has none; expected failure = {failure!r}")
            if not given and self.failure == failure:
                raise InputError(f"{key}: required key is missing; expected it with failure = {failure!r}")
        effect = (
            DeadBeams(self.beams) if self.beams else SensorFailure(_spoil(self, setting), blind=self.failure == "off")
        )
        return TimedFault(Timeline(self, setting), effect, setting.number)


def _spoil(fault: Sensor, setting: Setting) -> Spoil:
    """What the failure does to tiles."""
    if fault.failure == "stuck":
        return _filled(OCCUPIED if fault.value == "occupied" else FREE)
    if fault.range is not None:
        return _cut(fault.range, setting.lattice)
    if fault.offset is not None:
        return _aside(fault.offset)
    if fault.failure == "garbage":
        return _garbage([setting.streams.open(f"fault sensor {setting.number}", i) for i in range(setting.swarm)])
    return _filled(UNKNOWN)


def _filled(value: int) -> Spoil:
    def fill(state: State, robots: Robots, values: NDArray[np.uint8], origins: NDArray[np.int32]) -> None:
        values[robots] = value

    return fill


def _garbage(streams: list[np.random.Generator]) -> Spoil:
    def draw(state: State, robots: Robots, values: NDArray[np.uint8], origins: NDArray[np.int32]) -> None:
        for robot in robots:
            values[robot] = streams[robot].integers(UNKNOWN, OCCUPIED, values.shape[1:], np.uint8, endpoint=True)

    return draw


def _cut(reach: float, lattice: Lattice) -> Spoil:
    def cut(state: State, robots: Robots, values: NDArray[np.uint8], origins: NDArray[np.int32]) -> None:
        within = np.moveaxis(np.indices(values.shape[1:]), 0, -1)  # (rows, columns, 2)
        centres = lattice.centres(origins[robots, None, None] + within)
        apart = centres - state.pose[robots, None, None, :2]
        values[robots] = np.where(np.hypot(apart[..., 0], apart[..., 1]) > reach, UNKNOWN, values[robots])

    return cut


def _aside(offset: tuple[int, int]) -> Spoil:
    def move(state: State, robots: Robots, values: NDArray[np.uint8], origins: NDArray[np.int32]) -> None:
        origins[robots] += np.array(offset, np.int32)

    return move


class SensorFailure(Lasting):
    """Wraps the sensor: its tiles are spoilt."""

    def __init__(self, spoil: Spoil, *, blind: bool) -> None:
        self._spoil, self._blind = spoil, blind

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sensor wrapped."""
        return replace(parts, sensor=FailingSensor(parts.sensor, active, self._spoil, self._blind))


@dataclass(frozen=True, slots=True, eq=False)
class FailingSensor:
    """A sensor of which some tiles are spoilt; those of dead robots stay UNKNOWN."""

    inner: SensorPart
    active: NDArray[np.bool_]  # (n,): a live view
    spoil: Spoil
    blind: bool  # whether nothing at all is measured

    def sense(self, state: State) -> Readings:
        """The readings, but for those that fail."""
        readings = self.inner.sense(state)
        failing = np.flatnonzero(self.active & state.alive)
        if len(failing) == 0:
            return readings
        tiles, beams, field = readings.tiles, readings.beams, readings.field
        if tiles is not None:
            evidence = None if tiles.evidence is None else tiles.evidence.copy()
            if evidence is not None:
                evidence[failing] = np.nan  # what is made up is believed as any tile is
            tiles = Tiles(tiles.values.copy(), tiles.origins.copy(), evidence)
            self.spoil(state, failing, tiles.values, tiles.origins)
        if self.blind and beams is not None:
            beams = replace(beams, ranges=beams.ranges.copy())
            beams.ranges[failing] = np.inf
        if self.blind and field is not None:
            field = field.copy()
            field[failing] = np.nan
        return Readings(tiles, beams, field)


class DeadBeams(Lasting):
    """Wraps the ring of beams beneath all failures that spoil its tiles, whichever was installed first."""

    def __init__(self, beams: tuple[int, ...]) -> None:
        self._beams = beams

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sensor wrapped. Raises InputError for a sensor without a ring, or without these beams."""
        return replace(parts, sensor=self._wrapped(parts.sensor, active))

    def _wrapped(self, sensor: SensorPart, active: NDArray[np.bool_]) -> SensorPart:
        if isinstance(sensor, FailingSensor):
            return replace(sensor, inner=self._wrapped(sensor.inner, active))
        if isinstance(sensor, FieldSensor | MixedSensor):
            return sensor.wrapped(lambda inner: self._wrapped(inner, active))
        if isinstance(sensor, IrRingSensor | RangefinderSensor | MaimedRing):
            return MaimedRing(sensor, sensor.without(self._beams), active)
        raise InputError("failure: this sensor has no beams that could die; expected the sensor 'ir-ring'")


@dataclass(frozen=True, slots=True, eq=False)
class MaimedRing:
    """A ring of beams of which some robots lack some."""

    whole: IrRingSensor | RangefinderSensor | MaimedRing
    maimed: IrRingSensor | RangefinderSensor | MaimedRing
    active: NDArray[np.bool_]  # (n,): a live view of who senses with the maimed ring

    def without(self, beams: tuple[int, ...]) -> MaimedRing:
        """The same with these beams dead for everybody. Raises InputError for one not there."""
        return MaimedRing(self.whole.without(beams), self.maimed.without(beams), self.active)

    def sense(self, state: State) -> Readings:
        """The readings, those of robots that lack beams sensed without these."""
        whole = self.whole.sense(state)
        if not self.active.any():
            return whole
        fewer, tiles = self.maimed.sense(state).tiles, whole.tiles
        assert fewer is not None
        assert tiles is not None
        lacking = self.active[:, None, None]
        values = np.where(lacking, fewer.values, tiles.values)
        evidence = None
        if tiles.evidence is not None and fewer.evidence is not None:
            evidence = np.where(lacking, fewer.evidence, tiles.evidence)
        return replace(whole, tiles=Tiles(values, tiles.origins, evidence))
