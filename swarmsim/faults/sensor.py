"""Faults of sensors: readings that are missing, stuck, noisy, random, short-sighted, out of place, or lack beams."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core import chance
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Parts
from swarmsim.core.parts import Sensor as SensorPart
from swarmsim.core.readings import Channels, Readings
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, State
from swarmsim.faults.effect import Effect, StatelessEffect, TimedFault
from swarmsim.faults.timeline import Robots, Timed, Timeline
from swarmsim.robots.suites import maimed

Cells = Annotated[int, Meta(ge=-1000, le=1000)]

Places = tuple[int, ...]  # of columns
#: What the readings of these robots (r,) become, in these columns.
Spoil = Callable[[State, Robots, Readings, Places], Readings]


class SensorFault(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Readings are wrong; the robot uses and shares them as if they were right.

    `off`: nothing is measured. `stuck`: all cells have one `value` or, of other `channels`, readings stay what they
    were. `noisy`: normal errors of the standard deviation `sigma` are added. `garbage`: each cell is unknown, free or
    occupied, drawn anew in every iteration. `range`: cells with centres farther than `range` from the robot are
    unknown. `offset`: the tile is shifted by this many cells. `beams`: these beams of a ring are dead.

    `channels` are those that are off, stuck or noisy; default: all that can be.
    """

    failure: Literal["off", "stuck", "noisy", "garbage", "range", "offset", "beams"]
    channels: Annotated[tuple[str, ...], Meta(min_length=1)] | None = None  # for off, stuck, noisy: names of channels
    value: Literal["free", "occupied"] | None = None  # for stuck
    sigma: Annotated[float, Meta(gt=0.0, le=1e6)] | None = None  # for noisy: in the channel's unit
    range: Annotated[float, Meta(gt=0.0)] | None = None  # for range: m
    offset: tuple[Cells, Cells] | None = None  # for offset: rows, columns
    beams: Annotated[tuple[Annotated[int, Meta(ge=0)], ...], Meta(min_length=1)] | None = None  # for beams: 0 is ahead

    def build(self, context: BuildContext) -> TimedFault:
        """The fault; raises InputError for a key that its failure lacks or does not have."""
        keys = (
            ("value", "stuck"), ("sigma", "noisy"), ("range", "range"), ("offset", "offset"), ("beams", "beams")
        )  # fmt: skip
        for key, failure in keys:
            given = getattr(self, key) is not None
            if given and self.failure != failure:
                raise InputError(f"{key}: a sensor that is {self.failure!r} has none; expected failure = {failure!r}")
            if not given and self.failure == failure and not (key == "value" and self.channels):
                raise InputError(f"{key}: required key is missing; expected it with failure = {failure!r}")
        if self.channels and (self.failure not in ("off", "stuck", "noisy") or self.value):
            what = "has a value" if self.value else f"is {self.failure!r}"
            raise InputError(f"channels: a sensor that {what} has none; expected failure = 'off', 'stuck' or 'noisy'")
        return TimedFault(Timeline(self, context), _effect(self, context), context.number)


def _effect(fault: SensorFault, context: BuildContext) -> Effect:
    """What the fault does to parts."""
    if fault.beams:
        return DeadBeams(fault.beams)
    if fault.failure == "off":
        return ChannelFailure(fault.channels, None, lambda active: _blank)
    if fault.failure == "noisy":
        salt = int(context.streams.open(f"fault sensor {context.number}").integers(0, 2**64, dtype=np.uint64))
        return ChannelFailure(fault.channels, "noisy", lambda active: _noisy(salt, fault.sigma or 0.0))
    if fault.channels:
        return ChannelFailure(fault.channels, "stuck", lambda active: Stuck(len(active)))
    return TileFailure(_spoil(fault, context))


def _spoil(fault: SensorFault, context: BuildContext) -> Spoil:
    """What the failure does to tiles."""
    if fault.failure == "stuck":
        return _filled(OCCUPIED if fault.value == "occupied" else FREE)
    if fault.range is not None:
        return _cut(fault.range, context.lattice)
    if fault.offset is not None:
        return _aside(fault.offset)
    return _garbage([context.streams.open(f"fault sensor {context.number}", i) for i in range(context.swarm)])


def _blank(state: State, robots: Robots, readings: Readings, places: Places) -> Readings:
    return readings.blanked(robots, places)


def _noisy(salt: int, sigma: float) -> Spoil:
    def err(state: State, robots: Robots, readings: Readings, places: Places) -> Readings:
        changed = {}
        for place in places:
            channel, column = tuple(readings.channels)[place], readings.columns[place].copy()
            keys = (state.iteration, robots[:, None], np.arange(max(math.prod(channel.shape), 1)), place)
            drawn = sigma * chance.normal(salt, *keys).reshape(len(robots), *channel.shape)
            given = column[robots]
            measured = (given >= channel.low) & (given <= channel.high)  # mostly False for blank or NaN
            told = np.clip(given + drawn, channel.low, channel.high)
            column[robots] = np.where(measured, np.rint(told) if column.dtype.kind == "i" else told, given)
            changed[channel.name] = column
        return readings.having(changed)

    return err


class Stuck:
    """Readings that stay what they were when the fault began."""

    def __init__(self, robots: int) -> None:
        self._since = np.full(robots, -2)  # the last iteration in which each was stuck
        self._held: dict[int, NDArray[np.generic]] = {}

    def __call__(self, state: State, robots: Robots, readings: Readings, places: Places) -> Readings:
        """The readings with the earlier ones in these columns."""
        changed, names = {}, tuple(readings.channels)
        new = robots[self._since[robots] < state.iteration - 1]
        self._since[robots] = state.iteration
        for place in readings.channels.with_rows(places):
            held = self._held.setdefault(place, readings.columns[place].copy())
            held[new] = readings.columns[place][new]
            column = readings.columns[place].copy()
            column[robots] = held[robots]
            changed[names[place].name] = column
        return readings.having(changed)


def _made_up(readings: Readings, robots: Robots, values: NDArray[np.uint8]) -> Readings:
    """The same with other values of tiles; false ones are trusted like any others."""
    evidence = readings.channels.groups["tiles"][2:]
    return readings.having({"tiles.values": values}).blanked(robots, evidence)


def _filled(value: int) -> Spoil:
    def fill(state: State, robots: Robots, readings: Readings, places: Places) -> Readings:
        values = readings.tiled.values.copy()
        values[robots] = value
        return _made_up(readings, robots, values)

    return fill


def _garbage(streams: list[np.random.Generator]) -> Spoil:
    def draw(state: State, robots: Robots, readings: Readings, places: Places) -> Readings:
        values = readings.tiled.values.copy()
        for robot in robots:
            values[robot] = streams[robot].integers(UNKNOWN, OCCUPIED, values.shape[1:], np.uint8, endpoint=True)
        return _made_up(readings, robots, values)

    return draw


def _cut(reach: float, lattice: Lattice) -> Spoil:
    def cut(state: State, robots: Robots, readings: Readings, places: Places) -> Readings:
        values, origins = readings.tiled.values.copy(), readings.tiled.origins
        within = np.moveaxis(np.indices(values.shape[1:]), 0, -1)  # (rows, columns, 2)
        centres = lattice.centres(origins[robots, None, None] + within)
        apart = centres - state.pose[robots, None, None, :2]
        values[robots] = np.where(np.hypot(apart[..., 0], apart[..., 1]) > reach, UNKNOWN, values[robots])
        return _made_up(readings, robots, values)

    return cut


def _aside(offset: tuple[int, int]) -> Spoil:
    def move(state: State, robots: Robots, readings: Readings, places: Places) -> Readings:
        tiles = readings.tiled
        origins = tiles.origins.copy()
        origins[robots] += np.array(offset, np.int32)
        return _made_up(readings.having({"tiles.origins": origins}), robots, tiles.values)

    return move


class TileFailure(StatelessEffect):
    """Wraps the sensor: its tiles are spoilt."""

    def __init__(self, spoil: Spoil) -> None:
        self._spoil = spoil

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sensor wrapped; a sensor without tiles stays as it is."""
        places = parts.sensor.channels.groups.get("tiles")
        return replace(parts, sensor=FailingSensor(parts.sensor, active, self._spoil, places)) if places else parts


class ChannelFailure(StatelessEffect):
    """Wraps the sensor: some of its channels are spoilt."""

    def __init__(
        self, names: tuple[str, ...] | None, failure: str | None, spoil: Callable[[NDArray[np.bool_]], Spoil]
    ) -> None:
        """`failure` is one that only numbers can have; None: any channel can."""
        self._names, self._failure, self._spoil = names, failure, spoil

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sensor wrapped. Raises InputError for a channel that is not there or cannot fail so."""
        channels = tuple(parts.sensor.channels)
        try:
            named = [place for name in self._names or () for place in parts.sensor.channels.chosen(name)]
        except InputError as problem:
            raise InputError(f"channels: {problem}") from problem
        can = [place for place, one in enumerate(channels) if one.is_number or self._failure is None]
        structure = [name for name in self._names or () if name in parts.sensor.channels.places]
        wrong = [name for name in structure if parts.sensor.channels[name].structure]
        wrong += [channels[place].group or channels[place].name for place in named if place not in can]
        if wrong:
            listed = ", ".join(dict.fromkeys(channels[one].group or channels[one].name for one in can)) or "none"
            what = self._failure or "off"
            raise InputError(f"channels: {wrong[0]!r} cannot be {what}; expected what is measured: {listed}")
        chosen = tuple(named if self._names else can)
        if self._failure is not None and not chosen:
            given = parts.sensor.channels.listed()
            raise InputError(f"failure: none of what these robots measure is a number ({given}); expected another one")
        return replace(parts, sensor=FailingSensor(parts.sensor, active, self._spoil(active), chosen))


@dataclass(frozen=True, slots=True, eq=False)
class FailingSensor:
    """A sensor with some readings spoilt; those of dead robots stay blank."""

    inner: SensorPart
    active: NDArray[np.bool_]  # (n,): a live view
    spoil: Spoil
    places: Places

    @property
    def channels(self) -> Channels:
        """The channels of the wrapped sensor."""
        return self.inner.channels

    def maimed(self, beams: Sequence[int], active: NDArray[np.bool_]) -> FailingSensor:
        """The same around a sensor that lacks beams: they die beneath all failures that spoil tiles."""
        return replace(self, inner=maimed(self.inner, beams, active))

    def sense(self, state: State) -> Readings:
        """The readings, with the failing ones replaced."""
        readings = self.inner.sense(state)
        failing = np.flatnonzero(self.active & state.alive)
        return self.spoil(state, failing, readings, self.places) if len(failing) else readings


class DeadBeams(StatelessEffect):
    """Wraps the ring of beams beneath all failures that spoil its tiles, whichever was installed first."""

    def __init__(self, beams: tuple[int, ...]) -> None:
        self._beams = beams

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sensor wrapped. Raises InputError for a sensor without a ring, or without these beams."""
        return replace(parts, sensor=maimed(parts.sensor, self._beams, active))
