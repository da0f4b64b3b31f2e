"""Sensor readings and actuator states: columns of numbers, each declared by the part that gives it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, Self

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core import own
from swarmsim.core.errors import InputError, nearest
from swarmsim.core.lattice import Lattice

NAME: Final = r"^[a-z][a-z0-9_]{0,40}(\.[a-z0-9_]{1,20})?$"  # names become tables, keys and attributes
LONGEST: Final = 100_000  # length of a side of one robot's data, and of its axis
Name = Annotated[str, Meta(pattern=NAME)]
Called = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,19}$")]  # the name of a sensor
Word = Annotated[str, Meta(max_length=200)]
COLOUR: Final = "sRGB"  # the unit of colours
Side = Annotated[int, Meta(ge=0, le=LONGEST)]


#: (n, ...): a channel's data, of the declared type.
Column = NDArray[Any]


class Channel(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One column of readings or actuator states: its form per robot, and how faults, frames and recordings treat it.

    `structure` marks columns that index others, such as origins and counts: faults change them only on purpose,
    since kernels use them without checking bounds.
    """

    name: Name
    dtype: Literal["u1", "i4", "f4", "f8", "?"] = "f8"
    shape: Annotated[tuple[Side, ...], Meta(max_length=4)] = ()  # of one robot's data
    unit: Word = ""
    low: float = -math.inf  # bounds, both ends included
    high: float = math.inf
    blank: float | None = None  # without a measurement, or at rest; None: NaN, for integers 0
    missing: float = 0.0  # its substitute for readers that cannot take NaN
    #: Its frame, for robots with pose errors. body: the robot's, never changed. cells: rows and
    #: columns (..., 2), moved by whole cells. world: headings (), places (..., 2) or poses (..., 3), moved rigidly.
    frame: Literal["body", "cells", "world"] = "body"
    structure: bool = False
    table: Word = ""  # its table in recordings; empty: its name
    unrecorded: Word = ""  # why it has none
    axis: Annotated[tuple[float, ...], Meta(max_length=LONGEST)] = ()  # coordinates of its first side, as bearings
    columns: Annotated[tuple[Word, ...], Meta(max_length=100)] = ()  # names along its last side
    group: Word = ""  # name of columns that change together
    count: Word = ""  # channel with the number of used rows of its first side; the rest is blank
    robots: tuple[int, int] | None = None  # first robot that has it, and first after; None: all have it

    @property
    def recorded_as(self) -> str:
        """The name of its table in recordings; empty if it is not recorded."""
        return "" if self.unrecorded else self.table or self.name

    @property
    def empty(self) -> float:
        """The value without a measurement."""
        if self.blank is not None:
            return self.blank
        return math.nan if self.dtype.startswith("f") else 0.0

    @property
    def is_number(self) -> bool:
        """Whether errors can scale it: a quantity that robots read themselves, not a choice between a few values."""
        return self.dtype in ("i4", "f4", "f8") and not (self.structure or self.group)

    @property
    def is_colour(self) -> bool:
        """Whether it is red, green and blue, 0 to 255 each: pictures show an actuator's colour."""
        return (self.dtype, self.shape, self.unit) == ("u1", (3,), COLOUR)

    def called(self, name: str, **changes: str | tuple[int, int]) -> Channel:
        """The same under another name, with its table."""
        table = "" if not self.table else f"{name.rpartition(self.name)[0]}{self.table}{name.rpartition(self.name)[2]}"
        return msgspec.structs.replace(self, name=name, table=table, **changes)

    def prefixed(self, name: str) -> Channel:
        """The same for a named sensor."""
        if not name:
            return self
        group, count = (f"{name}_{one}" if one else "" for one in (self.group, self.count))
        return self.called(f"{name}_{self.name}", group=group, count=count)

    def of_all(self) -> Channel:
        """The same for robots that all have it, without their group's number in its name."""
        suffix = f".{self.name.rpartition('.')[2]}"
        names = {key: getattr(self, key).removesuffix(suffix) for key in ("name", "table", "count")}
        return msgspec.structs.replace(self, robots=None, **names)

    def seen_of(self, ragged: str, most: int) -> Channel:
        """A ragged channel with this one's data in each row, at most `most`."""
        return msgspec.structs.replace(
            self, name=f"{ragged}_{self.name}", shape=(most, *self.shape), blank=self.empty, count=f"{ragged}_count",
            table="", unrecorded="", axis=(),
        )  # fmt: skip

    def blanks(self, robots: int) -> Column:
        """The column (n, ...) of robots that measure nothing."""
        return np.full((robots, *self.shape), self.empty, self.dtype)


def ragged(
    name: str, most: int, columns: tuple[str, ...], unit: str, low: float, high: float
) -> tuple[Channel, Channel]:
    """A channel of up to `most` rows of numbers per robot, and a second channel with their count."""
    count = f"{name}_count"
    return (
        Channel(name, "f8", (most, len(columns)), unit, low, high, columns=columns, count=count),
        Channel(count, "i4", (), "", 0, most, blank=0.0, structure=True),
    )


def tile_channels(shape: tuple[int, int], evidence: bool) -> tuple[Channel, ...]:
    """The columns of tiles of this shape (rows, columns) and, if the sensor gives it, their evidence."""
    log_odds = Channel(
        "tiles.evidence", "f4", shape, "log-odds", group="tiles", unrecorded="it follows from poses, walls and the seed"
    )
    return (
        Channel("tiles.values", "u1", shape, "", 0, 2, 0.0, table="tiles", group="tiles"),
        Channel(
            "tiles.origins", "i4", (2,), "cells", frame="cells", structure=True, table="origins", group="tiles",
            columns=("row", "column"),
        ),
        *([log_odds] if evidence else []),
    )  # fmt: skip


def range_channel(bearings: NDArray[np.float64], reach: float) -> Channel:
    """Beam ranges, by their bearings (b,) in rad. A ring that is off reads inf, where NaN would be clearer."""
    return Channel(
        "ranges", "f8", (len(bearings),), "m", 0.0, reach, math.inf, axis=tuple(bearings.tolist()),
        unrecorded="they follow from poses and walls",
    )  # fmt: skip


FIELD: Final = Channel("field", table="samples", unit="as the field")


class Channels:
    """A sensor's channels, in order; fixed during a run."""

    def __init__(self, *channels: Channel) -> None:
        self._all = channels
        #: Each channel's column.
        self.places: Mapping[str, int] = {channel.name: place for place, channel in enumerate(channels)}
        names = dict.fromkeys(channel.group for channel in channels if channel.group)
        #: The columns of each group.
        self.groups: Mapping[str, tuple[int, ...]] = {
            name: tuple(place for place, channel in enumerate(channels) if channel.group == name) for name in names
        }
        self._axes: dict[str, NDArray[np.float64]] = {}

    def __iter__(self) -> Iterator[Channel]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)

    def __contains__(self, name: object) -> bool:
        """Whether a channel or group of this name exists."""
        return name in self.places or name in self.groups

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Channels) and self._all == other._all

    def __hash__(self) -> int:
        return hash(tuple(self.places))

    def __getitem__(self, name: str) -> Channel:
        """A channel. Raises InputError, which lists the channels, for an unknown one."""
        return self._all[self.place(name)]

    def place(self, name: str) -> int:
        """A channel's column. Raises InputError, which lists the channels, for an unknown one."""
        try:
            return self.places[name]
        except KeyError:
            raise InputError(f"these robots have no channel {name!r}; they have {self.listed()}") from None

    def listed(self) -> str:
        """The available names: groups, and channels in no group."""
        names = dict.fromkeys(channel.group or channel.name for channel in self._all)
        return ", ".join(names) or "nothing"

    def command(self, name: str, value: object, *rows: int) -> Column:
        """A command of one robot, or of `rows` of them, for an actuator with these channels, in the channel's type.

        Raises ValueError, which says what is wrong and lists the channels.
        """
        channel = next((one for one in self._all if one.name == name), None)
        if channel is None:
            raise ValueError(
                f"{own.brief(name)}, which no actuator of these robots takes; {nearest(str(name), self.places)}"
            )
        try:
            return own.kept_as(np.dtype(channel.dtype), value, *rows, *channel.shape)
        except ValueError as problem:
            wanted = f"{np.dtype(channel.dtype)} of shape {(*rows, *channel.shape)}"
            raise ValueError(f"{name}: {problem}; expected {wanted}; actuators take {self.listed()}") from None

    def axis(self, name: str) -> NDArray[np.float64]:
        """The coordinates (b,) of a channel's first side, such as bearings."""
        if name not in self._axes:
            self._axes[name] = np.array(self[name].axis)
        return self._axes[name]

    def of(self, robots: NDArray[np.int64]) -> tuple[Channels, tuple[int, ...]]:
        """The channels of these robots (r,), and each one's column.

        Channels of other robots only are left out; those of a group that contains all of these robots are named as if
        all had them.
        """
        mine: list[Channel] = []
        places: list[int] = []
        for place, channel in enumerate(self):
            first, end = channel.robots or (0, robots.max(initial=0) + 1)
            theirs: NDArray[np.bool_] = (robots >= first) & (robots < end)
            if theirs.any():
                mine.append(channel.of_all() if channel.robots and theirs.all() else channel)
                places.append(place)
        return Channels(*mine), tuple(places)

    def with_rows(self, places: Iterable[int]) -> list[int]:
        """These columns, their counts, and all other columns with the same counts."""
        chosen = {*places}
        counts = {self._all[place].count for place in chosen} - {""}
        return [place for place, one in enumerate(self._all) if place in chosen or {one.name, one.count} & counts]

    def chosen(self, name: str) -> tuple[int, ...]:
        """The columns of a channel or a group."""
        return self.groups[name] if name in self.groups else (self.place(name),)


NOTHING: Final = Channels()  #: of robots without sensors


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """A small window of cells around every robot, aligned with the lattice."""

    values: NDArray[np.uint8]  # (n, rows, columns): UNKNOWN, FREE or OCCUPIED
    origins: NDArray[np.int32]  # (n, 2): row and column of each tile's lower-left cell
    #: (n, rows, columns): each cell's log-odds from the sensor; NaN or None: from the map's model.
    evidence: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """The ranges of every robot's beams."""

    bearings: NDArray[np.float64]  # (b,): rad, counter-clockwise from straight ahead
    ranges: NDArray[np.float64]  # (n, b): m; inf: nothing within reach; NaN: not measured


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """All robots' current sensor readings: a column (n, ...) for each declared channel."""

    channels: Channels = NOTHING
    columns: tuple[Column, ...] = ()

    def __contains__(self, name: object) -> bool:
        """Whether a channel or group of this name exists."""
        return name in self.channels

    def __getitem__(self, name: str) -> Column:
        """The column (n, ...) of a channel. Raises InputError, which lists the channels, for an unknown one."""
        return self.columns[self.channels.place(name)]

    @property
    def tiles(self) -> Tiles | None:
        """The tiles; None if these robots have no sensor for them."""
        places = self.channels.groups.get("tiles")
        return None if places is None else Tiles(*[self.columns[place] for place in places])

    @property
    def tiled(self) -> Tiles:
        """The tiles. Raises InputError if these robots have no sensor for them."""
        return Tiles(*[self.columns[place] for place in self.channels.chosen("tiles")])

    @property
    def beams(self) -> Beams | None:
        """The beams' ranges; None without a sensor for them, or with rings of several kinds."""
        place = self.channels.places.get("ranges")
        return None if place is None else Beams(self.channels.axis("ranges"), self.columns[place])

    @property
    def field(self) -> NDArray[np.float64] | None:
        """The field's value (n,) at each robot, NaN for the dead; None without a field."""
        place = self.channels.places.get("field")
        return None if place is None else self.columns[place]

    @classmethod
    def filled(cls, channels: Channels, columns: Mapping[str, Column], robots: NDArray[np.bool_]) -> Self:
        """These columns (n, ...) by channel for some `robots` (n,); blank for all others and for missing columns."""
        found = [channel.blanks(len(robots)) for channel in channels]
        for channel, column in zip(channels, found, strict=True):
            if channel.name in columns:
                column[robots] = columns[channel.name][robots]
        return cls(channels, tuple(found))

    def named(self) -> dict[str, Column]:
        """All columns by channel."""
        return {channel.name: column for channel, column in zip(self.channels, self.columns, strict=True)}

    def arrays(self) -> tuple[Column, ...]:
        """All columns, in the order of declaration."""
        return self.columns

    def rows(self) -> dict[str, Column]:
        """The recorded columns, by table name."""
        return {
            channel.recorded_as: column
            for channel, column in zip(self.channels, self.columns, strict=True)
            if not channel.unrecorded
        }

    def take(self, robots: NDArray[np.int64]) -> Readings:
        """The readings of these robots (r,), in this order."""
        return Readings(self.channels, tuple([column[robots] for column in self.columns]))

    def having(self, columns: Mapping[str, Column]) -> Readings:
        """The same with other columns for some channels."""
        changed = list(self.columns)
        for name, column in columns.items():
            changed[self.channels.place(name)] = column
        return Readings(self.channels, tuple(changed))

    def joined(self, other: Readings, robots: NDArray[np.bool_]) -> Readings:
        """Rows from another with the same channels where `robots` (n,); all others from this."""
        rows = [robots.reshape(-1, *[1] * (column.ndim - 1)) for column in self.columns]
        columns = zip(rows, other.columns, self.columns, strict=True)
        return Readings(self.channels, tuple([np.where(*three) for three in columns]))

    def blanked(self, robots: NDArray[np.int64] | NDArray[np.bool_], places: tuple[int, ...] | None = None) -> Readings:
        """The same with some robots' readings blanked, (r,) or a mask (n,), in all or some columns.

        A channel is blanked together with its counts and their other columns; all other structure stays.
        """
        channels, changed = tuple(self.channels), list(self.columns)
        counts = {channel.count for channel in channels}
        for place in range(len(changed)) if places is None else self.channels.with_rows(places):
            channel = channels[place]
            if not channel.structure or channel.name in counts:
                changed[place] = changed[place].copy()
                changed[place][robots] = channel.empty
        return Readings(self.channels, tuple(changed))

    def put(self, pose: NDArray[np.float64], believed: NDArray[np.float64], lattice: Lattice) -> Readings:
        """The readings of robots at `pose` (n, 3), moved to their estimated poses `believed` (n, 3).

        Data on map cells moves by whole cells without turning; data in the world moves rigidly.
        """
        if believed is pose:
            return self
        changed = {}
        for channel, column in zip(self.channels, self.columns, strict=True):
            if channel.frame == "cells":
                aside = lattice.cells(believed[:, :2]) - lattice.cells(pose[:, :2])
                changed[channel.name] = (column + _for_each(aside, column)).astype(column.dtype)
            elif channel.frame == "world":
                changed[channel.name] = _turned(column, pose, believed).astype(column.dtype)
        return self.having(changed) if changed else self


def _for_each(rows: Column, column: Column) -> Column:
    """Per-robot data (n, k), shaped to broadcast with a column (n, ..., k)."""
    return rows.reshape(len(rows), *[1] * (column.ndim - 2), rows.shape[-1])


def _turned(
    column: NDArray[np.float64], pose: NDArray[np.float64], believed: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Headings (n,), places (n, ..., 2) or poses (n, ..., 3), turned and moved with their robots."""
    turn = believed[:, 2] - pose[:, 2]
    if column.ndim == 1:
        return np.asarray(column + turn)
    cos, sin = _for_each(np.cos(turn)[:, None], column)[..., 0], _for_each(np.sin(turn)[:, None], column)[..., 0]
    ahead, aside = np.moveaxis(column[..., :2] - _for_each(pose[:, :2], column), -1, 0)
    moved = column.copy()
    moved[..., :2] = np.stack([cos * ahead - sin * aside, sin * ahead + cos * aside], -1)
    moved[..., :2] += _for_each(believed[:, :2], column)
    if column.shape[-1] == 3:
        moved[..., 2] += _for_each(turn[:, None], column)[..., 0]
    return moved
