"""The world's effects on robots: wind, fog, the warmth of the day and coarse positions; and a picture of it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from msgspec import Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext, Field, WorldContext
from swarmsim.core.drawing import Circles, Mark, Shown
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Motion, Sensor
from swarmsim.core.probes import ProbeTable, Sampled
from swarmsim.core.readings import Channel, Channels, Readings
from swarmsim.core.state import Knowledge, Moment, State
from swarmsim.recording.reader import Recording
from swarmsim.robots.particles import Particles, PointBodies
from swarmsim.robots.sensors import IrRing


class Greenhouse(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An empty hall of glass."""

    side: float = 4.0  # m

    def build(self, site: WorldContext) -> Greenhouse:
        return self

    def draw(self) -> str:
        side, inner = self.side, self.side - 0.2
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {side} {side}"><g id="walls">'
            f'<path fill-rule="evenodd" d="M0 0H{side}V{side}H0Z M0.2 0.2V{inner}H{inner}V0.2Z"/></g></svg>'
        )


class Wind(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots without bodies, carried by a wind."""

    speed: float = 0.02  # m/s
    direction: float = 0.0  # rad, counter-clockwise from the x axis

    def build(self, context: BuildContext) -> Blown:
        carried = context.period * self.speed * np.array([np.cos(self.direction), np.sin(self.direction)])
        return Blown(Particles(substeps=4).build(context), carried)


class Blown:
    """Particles, moved by the wind in every iteration."""

    def __init__(self, inner: PointBodies, carried: NDArray[np.float64]) -> None:
        self._inner, self._carried = inner, carried
        self.state, self.place, self.push = inner.state, inner.place, inner.push
        self.remove, self.crash, self.retire = inner.remove, inner.crash, inner.retire

    @property
    def solid(self) -> NDArray[np.bool_]:
        """The robots with bodies in the world: as for particles."""
        return self._inner.solid

    def drive(self, motion: Motion, period: float) -> State:
        """Drive as particles, then drift downwind."""
        self._inner.drive(motion, period)
        self._inner.carry(self._carried)
        return self.state()


class Fog(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ring of infra-red beams; robots left of a line are in fog and see nothing."""

    x: float = 0.0  # m, of the line
    reach: float = 1.0  # m, of the beams

    def build(self, context: BuildContext) -> Foggy:
        return Foggy(IrRing(reach=self.reach).build(context), self.x)


class Foggy:
    """A sensor that is blind in places."""

    def __init__(self, inner: Sensor, x: float) -> None:
        self._inner, self._x, self.channels = inner, x, inner.channels

    def sense(self, state: State) -> Readings:
        """The readings, blank for robots in the fog."""
        readings = self._inner.sense(state)
        return readings.blanked(state.pose[:, 0] < self._x)


class Horn(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A fog horn that robots sound up to a limit."""

    loudest: float = 1.0

    def build(self, context: BuildContext) -> Blower:
        """The actuator."""
        return Blower(self.loudest)


class Blower:
    """One loudness per robot."""

    def __init__(self, loudest: float) -> None:
        self.channels = Channels(Channel("horn", low=0.0, high=loudest, blank=0.0))

    def act(self, commands: Readings, state: State) -> Readings:
        """Sound it, limited to the maximum."""
        return Readings(self.channels, (commands["horn"].clip(0.0, self.channels["horn"].high),))


class Day(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A temperature that falls from left to right, and varies with the time of day."""

    warmest: float = 25.0  # degrees Celsius, at noon at the left edge
    gradient: float = 0.5  # degrees per m
    length: float = 86_400.0  # s, of a day
    noise: float = 0.0  # degrees, standard deviation of a sample

    def build(self, context: BuildContext) -> Day:
        """The parameters are the field."""
        return self

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The temperatures (k,) at a time (s) and points (k, 2)."""
        lower = 5.0 * (1.0 - np.cos(2.0 * np.pi * time / self.length))
        warmth: NDArray[np.float64] = self.warmest - self.gradient * points[:, 0] - lower
        return warmth


class Rounded(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots know their positions rounded to a multiple."""

    to: float = 0.01  # m

    def build(self, context: BuildContext) -> Rounded:
        """The parameters are the localisation."""
        return self

    def locate(self, state: State) -> NDArray[np.float64]:
        pose = state.pose.copy()
        pose[:, :2] = np.round(pose[:, :2] / self.to) * self.to
        return pose


class Thermometers(Sampled, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The temperature at each robot, and the average."""

    name: str = "warmth"

    def build(self, context: BuildContext) -> Thermometer:
        if context.scalar_field is None:
            raise InputError("use: 'thermometers' measures a field; expected one, such as field.use = 'day'")
        return Thermometer(context.scalar_field, context.period)


class Thermometer:
    """Reads the true field, which robots measure with noise."""

    tables = (
        ProbeTable("there", shape=("robots",), unit="degrees", meaning="at each robot"),
        ProbeTable("mean", unit="degrees", meaning="mean over robots"),
    )

    def __init__(self, field: Field, period: float) -> None:
        self._field, self._period = field, period

    def sample(self, moment: Moment[Knowledge]) -> dict[str, object]:
        """The field's values at the robots' places at the start of the iteration."""
        there = self._field.value(moment.state.iteration * self._period, moment.state.pose[:, :2])
        return {"there": there, "mean": there.mean()}


def halos(shown: Shown, *, radius: float = 0.3) -> list[Mark]:
    """A faint disc around each robot."""
    return [Circles(shown.pose[:, :2], radius, "hot", None, opacity=0.3)]


def climate(recording: Recording, *, probe: str = "warmth") -> Figure:
    """How warm it was where robots were, over the samples of a probe that records `there` and `mean`."""
    figure = Figure()
    axes = figure.subplots()
    axes.plot(recording[f"{probe}.there"], color="0.7")
    axes.plot(recording[f"{probe}.mean"], color="tab:red")
    axes.set(xlabel="samples", ylabel="warmth, degrees")
    return figure
