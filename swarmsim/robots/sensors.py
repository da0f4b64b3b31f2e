"""Rings of infra-red beams that fill each robot's tile, and sensors of fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np
from msgspec import Meta, Struct, convert
from msgspec.structs import force_setattr

from swarmsim.core import chance
from swarmsim.core.context import BuildContext, Field
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Sensor
from swarmsim.core.readings import FIELD, Called, Channels, Readings
from swarmsim.core.state import UNKNOWN, State
from swarmsim.kernels import rays
from swarmsim.robots.rangefinders import RangefinderSensor
from swarmsim.robots.ring import WholeRing, held, radii_of
from swarmsim.robots.suites import Suite, checked

Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]
Bearings = Annotated[tuple[Degrees, ...], Meta(min_length=1, max_length=10_000)]
Share = Annotated[float, Meta(ge=0.0, lt=1.0)]
Error = Annotated[float, Meta(ge=0.0, le=10.0)]
SIX: Final = (0.0, 45.0, 90.0, 180.0, -90.0, -45.0)  # degrees, the bearings of the reference paper's robots

#: The presets' values for keys that a scenario leaves out; docs/sensors.md names the sources.
PRESETS: Final[dict[str, dict[str, Any]]] = {
    "ideal": {},
    "sharp-gp2y0a21": {
        "bearings": SIX, "reach": 0.8, "blind": 0.1, "cone": 5.0, "error_square": 0.072, "step": 0.002,
        "outliers": 0.01,
    },
    "gternal": {"bearings": SIX, "reach": 1.2, "error_share": 0.03, "drop_out": 0.035, "outliers": 0.014},
    "ebot": {
        "bearings": SIX, "reach": 0.8, "blind": 0.1, "cone": 5.0, "error": 0.005, "error_square": 0.072,
        "drop_out": 0.02, "outliers": 0.01,
    },
}  # fmt: skip


class IrRing(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Infra-red beams around the robot, cast against the exact walls.

    Without errors a beam tells free cells from occupied ones for certain. A reading at d errs with the standard
    deviation sqrt(error^2 + (error_share d)^2 + (error_square d^2)^2); the last term is the law of triangulation
    sensors such as Sharp's, whose voltage falls as 1 / d. Then each reading gives each cell's probability of being
    occupied, by Bayes' rule (`kernels.evidence`), for the robot's own map; the tile marks only sufficiently certain
    cells. Numbers that a scenario leaves out are those of the preset.

    `frame` says how the tile lies: along the rows and columns of the map, or turning with the robot, so that its
    columns run ahead; then it is given in the map's cells whose centres it holds.
    """

    gives: ClassVar[dict[str, str]] = {"tiles": "", "ranges": "ranges = true"}

    name: Called | None = None  # of one of several on a robot: its channels are called NAME_tiles and so on
    preset: Literal["ideal", "sharp-gp2y0a21", "gternal", "ebot"] = "ideal"
    tile: tuple[Annotated[int, Meta(ge=1, le=99)], Annotated[int, Meta(ge=1, le=99)]] = (6, 7)  # rows, columns
    frame: Literal["map", "robot"] = "map"  # what the tile's rows and columns follow
    beams: Annotated[int, Meta(ge=1, le=10_000)] | None = None  # evenly round the robot; 72 without bearings
    bearings: Bearings | None = None  # degrees, + is to the left
    reach: Annotated[float, Meta(gt=0.0)] | None = None  # m; 1 by default
    blind: Annotated[float, Meta(ge=0.0)] | None = None  # m, nearer than this nothing is measured
    cone: Annotated[float, Meta(ge=0.0, le=90.0)] | None = None  # degrees; a beam sees the nearest thing in it
    error: Error | None = None  # m, the same at any distance
    error_share: Error | None = None  # of the distance
    error_square: Error | None = None  # 1/m, times the square of the distance
    drop_out: Share | None = None  # of readings that are missing
    outliers: Share | None = None  # of readings that are arbitrary within reach
    step: Error | None = None  # m, to which readings are rounded
    robots: Literal["ignored", "occlude", "occupied"] = "ignored"  # how other robots appear to the beams
    ranges: bool = False  # whether minds also get how far each beam goes

    def __post_init__(self) -> None:
        given = PRESETS[self.preset]
        even = self.beams is not None
        defaults: dict[str, Any] = {"reach": 1.0, **dict.fromkeys(_ERRORS, 0.0), **given}
        if even:
            defaults.pop("bearings", None)
        for key, value in defaults.items():
            if getattr(self, key) is None:
                force_setattr(self, key, value)
        if self.beams is None:
            force_setattr(self, "beams", 72 if self.bearings is None else len(self.bearings))
        elif self.bearings is not None and len(self.bearings) != self.beams:
            raise ValueError("beams and bearings contradict each other; expected one of them")
        whole = self.whole
        if whole.blind >= whole.reach:
            raise ValueError("blind is not below reach; expected the least distance that is measured")

    @property
    def whole(self) -> WholeRing:
        """The same with all its numbers."""
        return convert(self, WholeRing, from_attributes=True)

    @property
    def margin(self) -> int:
        """How many cells a tile reaches beyond the cell of its robot, at most."""
        return max(self.whole.shape)

    @property
    def rays(self) -> tuple[int, float, bool]:
        """The number of beams, their reach in m, and whether it matters beyond the tile."""
        whole = self.whole
        return whole.beams, whole.reach, whole.ranges

    @property
    def surveying(self) -> IrRing:
        """The ring that finds all that can be observed: same reach, no gaps, errors or other robots, unturned."""
        dense = max(72, math.ceil(2.0 * math.pi * self.margin / 0.8))
        ideal = self.bearings is None and not self.whole.errs and self.frame == "map"
        return IrRing(tile=self.tile, reach=self.reach, beams=self.beams if ideal else dense)

    def build(self, context: BuildContext) -> IrRingSensor | RangefinderSensor:
        """The sensor for a swarm among these walls. Raises InputError for even beams with gaps between them."""
        whole, cell = self.whole, context.lattice.cell
        near = min(whole.corner(cell), whole.reach)
        narrowest = 2.0 * math.pi / whole.beams * near
        if whole.bearings is None and narrowest > 0.8 * cell:
            needed = math.ceil(2.0 * math.pi * near / (0.8 * cell))
            raise InputError(
                f"beams: {whole.beams} beams lie {narrowest:.3g} m apart at the tile's corners and would miss "
                f"cells of {cell:g} m; give bearings to a ring with gaps, or at least {needed} are needed"
            )
        return RangefinderSensor(whole, context) if whole.errs else IrRingSensor(whole, context)


_ERRORS: Final = ("blind", "cone", "error", "error_share", "error_square", "drop_out", "outliers", "step")


class IrRingSensor:
    """Senses the tiles of the whole swarm in one call."""

    def __init__(self, whole: WholeRing, context: BuildContext) -> None:
        lattice = context.lattice
        # Look beyond the tile only if ranges are wanted.
        self._reach = whole.reach if whole.ranges else min(whole.reach, whole.corner(lattice.cell))
        side = max(0.5 * self._reach, lattice.cell)
        rows = math.ceil(lattice.rows * lattice.cell / side)
        columns = math.ceil(lattice.columns * lattice.cell / side)
        self._coarse = (lattice.x0, lattice.y0, side, rows, columns)
        self._building = context.building
        self._prepare()
        angles = whole.angles()
        self._ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._working = np.arange(len(angles))
        self._beams = len(angles)
        self._lattice = (lattice.x0, lattice.y0, lattice.cell)
        self._radii = context.robots.each("radius")
        self._whole = whole
        self.channels = whole.channels(evidence=False)

    def without(self, beams: Sequence[int]) -> IrRingSensor:
        """The same sensor with these beams dead, counted from 0 straight ahead. Raises InputError for one not there."""
        left = copy(self)
        kept = ~np.isin(self._working, checked(beams, self._beams))
        left._ring, left._working = self._ring[kept], self._working[kept]
        return left

    def _prepare(self) -> None:
        """Sort the present walls by place."""
        self._walls, self._version = self._building.walls.copy(), self._building.version
        self._near = rays.bins(self._walls, self._reach, *self._coarse)

    def sense(self, state: State) -> Readings:
        """The tiles of all robots, each around its own cell; those of dead robots are all UNKNOWN."""
        whole = self._whole
        if self._version != self._building.version:
            self._prepare()
        values = np.empty((state.robots, *whole.shape), np.uint8)
        origins = np.empty((state.robots, 2), np.int32)
        ranges = np.full((state.robots if whole.ranges else 0, len(self._ring)), np.inf)
        rays.sense(
            state.pose,
            state.alive,
            self._ring,
            self._reach,
            self._walls,
            *self._near,
            self._building.walkers(),
            self._coarse,
            self._lattice,
            radii_of(self._radii, state),
            whole.robots != "ignored",
            whole.robots == "occupied",
            values,
            origins,
            ranges,
        )
        if whole.frame == "robot":
            values[~held(state.pose, origins, whole.tile, whole.shape, self._lattice)] = UNKNOWN
        if not whole.ranges:
            return Readings(self.channels, (values, origins))
        if len(self._working) < self._beams:
            padded = np.full((state.robots, self._beams), np.nan)
            padded[:, self._working] = ranges
            ranges = padded
        return Readings(self.channels, (values, origins, ranges))


class NoSensor(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots that sense only their pose."""

    @property
    def margin(self) -> int:
        return 0

    def build(self, context: BuildContext) -> NullSensor:
        return NullSensor()


class NullSensor:
    """Gives nothing."""

    channels = Channels()

    def sense(self, state: State) -> Readings:
        """No readings."""
        return Readings()


class FieldSensor:
    """Samples a scalar field where each robot is, with normal noise."""

    channels = Channels(FIELD)

    def __init__(self, field: Field, period: float, noise: float, salt: int) -> None:
        """`period` (s) of an iteration; `noise` is the standard deviation, in the field's unit."""
        self._field, self._period, self._noise, self._salt = field, period, noise, salt

    def sense(self, state: State) -> Readings:
        """The field's value where each robot is; NaN for the dead."""
        value = self._field.value(state.iteration * self._period, state.pose[:, :2])
        if self._noise > 0.0:
            value = value + self._noise * chance.normal(self._salt, state.iteration, np.arange(state.robots), 0)
        return Readings(self.channels, (np.where(state.alive, value, np.nan),))


def with_field(sensor: Sensor, context: BuildContext, noise: float) -> Sensor:
    """The sensor, which also samples the context's field, if there is one; `noise` as in FieldSensor."""
    if context.scalar_field is None:
        return sensor
    salt = int(context.streams.open("field noise").integers(0, 2**64, dtype=np.uint64))
    return Suite([sensor, FieldSensor(context.scalar_field, context.period, noise, salt)])
