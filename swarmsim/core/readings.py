"""What robots measure, and what their actuators do: columns of numbers, each declared by the part that gives it."""

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
LONGEST: Final = 100_000  # of a side of what a channel gives for one robot, and of its axis
Name = Annotated[str, Meta(pattern=NAME)]
Called = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,19}$")]  # the name of a sensor
Word = Annotated[str, Meta(max_length=200)]
COLOUR: Final = "sRGB"  # the unit of colours
Side = Annotated[int, Meta(ge=0, le=LONGEST)]


#: (n, ...): what a channel gives. Its type is the one declared.
Column = NDArray[Any]


class Channel(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One column of readings or of what an actuator does: what it holds of each robot, and how it is to be treated.

    `structure` is what other columns are read by, such as origins and counts: no fault changes it but on purpose,
    since kernels use it without looking at its bounds.
    """

    name: Name
    dtype: Literal["u1", "i4", "f4", "f8", "?"] = "f8"
    shape: Annotated[tuple[Side, ...], Meta(max_length=4)] = ()  # of what one robot measures
    unit: Word = ""
    low: float = -math.inf  # what is measured lies within, both ends included
    high: float = math.inf
    blank: float | None = None  # where nothing is measured, or an actuator rests; None: NaN, in whole numbers 0
    missing: float = 0.0  # what stands in its place for those who cannot take NaN
    #: What it is relative to, when robots err about their poses. body: the robot, it stays as it is. cells: rows and
    #: columns (..., 2), moved by whole cells. world: headings (), places (..., 2) or poses (..., 3), moved rigidly.
    frame: Literal["body", "cells", "world"] = "body"
    structure: bool = False
    table: Word = ""  # its table in recordings; none: its name
    unrecorded: Word = ""  # why it has none
    axis: Annotated[tuple[float, ...], Meta(max_length=LONGEST)] = ()  # coordinates of its first side, as bearings
    columns: Annotated[tuple[Word, ...], Meta(max_length=100)] = ()  # what its last side holds
    group: Word = ""  # of columns that change together
    count: Word = ""  # the channel that tells how many rows of its first side each robot uses, the rest is blank
    robots: tuple[int, int] | None = None  # the first that has it, and the first after them; None: all have it

    @property
    def recorded_as(self) -> str:
        """The name of its table in recordings; none if it is not recorded."""
        return "" if self.unrecorded else self.table or self.name

    @property
    def empty(self) -> float:
        """What stands where nothing is measured."""
        if self.blank is not None:
            return self.blank
        return math.nan if self.dtype.startswith("f") else 0.0

    @property
    def is_number(self) -> bool:
        """Whether it can be somewhat larger: what robots read themselves, and no choice between a few values."""
        return self.dtype in ("i4", "f4", "f8") and not (self.structure or self.group)

    @property
    def is_colour(self) -> bool:
        """Whether it is red, green and blue, 0 to 255 each: pictures show it, of an actuator."""
        return (self.dtype, self.shape, self.unit) == ("u1", (3,), COLOUR)

    def called(self, name: str, **changes: str | tuple[int, int]) -> Channel:
        """The same under another name, with its table."""
        table = "" if not self.table else f"{name.rpartition(self.name)[0]}{self.table}{name.rpartition(self.name)[2]}"
        return msgspec.structs.replace(self, name=name, table=table, **changes)

    def prefixed(self, name: str) -> Channel:
        """The same as a sensor gives it that has a name."""
        if not name:
            return self
        group, count = (f"{name}_{one}" if one else "" for one in (self.group, self.count))
        return self.called(f"{name}_{self.name}", group=group, count=count)

    def of_all(self) -> Channel:
        """The same for robots that all have it, without the number of their group in its name."""
        suffix = f".{self.name.rpartition('.')[2]}"
        names = {key: getattr(self, key).removesuffix(suffix) for key in ("name", "table", "count")}
        return msgspec.structs.replace(self, robots=None, **names)

    def seen_of(self, ragged: str, most: int) -> Channel:
        """A channel that tells it of each robot in the rows of a ragged one, which has so many at most."""
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
    """A channel of up to `most` rows of numbers for each robot, of which a second channel tells how many there are."""
    count = f"{name}_count"
    return (
        Channel(name, "f8", (most, len(columns)), unit, low, high, columns=columns, count=count),
        Channel(count, "i4", (), "", 0, most, blank=0.0, structure=True),
    )


def tile_channels(shape: tuple[int, int], evidence: bool) -> tuple[Channel, ...]:
    """The columns of tiles of this shape (rows, columns) and, if the sensor tells it, what they are worth."""
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
    """How far beams go, by their bearings (b,) in rad. NaN would say better that a ring is off; inf is what it says."""
    return Channel(
        "ranges", "f8", (len(bearings),), "m", 0.0, reach, math.inf, axis=tuple(bearings.tolist()),
        unrecorded="they follow from poses and walls",
    )  # fmt: skip


FIELD: Final = Channel("field", table="samples", unit="as the field")


class Channels:
    """What a sensor gives, in its order; it does not change during a run."""

    def __init__(self, *channels: Channel) -> None:
        self._all = channels
        #: Which column each channel is.
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
        """Whether there is a channel, or a group, of this name."""
        return name in self.places or name in self.groups

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Channels) and self._all == other._all

    def __hash__(self) -> int:
        return hash(tuple(self.places))

    def __getitem__(self, name: str) -> Channel:
        """A channel. Raises InputError, which says what there is, for one that there is not."""
        return self._all[self.place(name)]

    def place(self, name: str) -> int:
        """Which column a channel is. Raises InputError, which says what there is, for one that there is not."""
        try:
            return self.places[name]
        except KeyError:
            raise InputError(f"these robots have no channel {name!r}; they have {self.listed()}") from None

    def listed(self) -> str:
        """The names of what can be asked for: groups, and the channels that are in none."""
        names = dict.fromkeys(channel.group or channel.name for channel in self._all)
        return ", ".join(names) or "nothing"

    def command(self, name: str, value: object, *rows: int) -> Column:
        """What a robot, or so many `rows`, decides for an actuator with these channels, in the channel's type.

        Raises ValueError, which says what is wrong and what there is.
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
        """The coordinates (b,) of the first side of what a channel gives, such as bearings."""
        if name not in self._axes:
            self._axes[name] = np.array(self[name].axis)
        return self._axes[name]

    def of(self, robots: NDArray[np.int64]) -> tuple[Channels, tuple[int, ...]]:
        """What robots of these numbers (r,) have, and which column each of that is.

        What other robots alone have is left out; what a group has whose robots all of these are, is called as if
        everybody had it.
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
        """These columns, what their rows are counted by, and all others that are counted by the same."""
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
    #: (n, rows, columns): the log-odds that the sensor itself gives each cell; NaN or None: those of the map's model.
    evidence: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """How far every robot's beams reach before they end."""

    bearings: NDArray[np.float64]  # (b,): rad, counter-clockwise from straight ahead
    ranges: NDArray[np.float64]  # (n, b): m; infinite where nothing is within reach, NaN where nothing was measured


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """What the sensors of every robot measure now: a column (n, ...) for each channel that they declare."""

    channels: Channels = NOTHING
    columns: tuple[Column, ...] = ()

    def __contains__(self, name: object) -> bool:
        """Whether there is a channel, or a group, of this name."""
        return name in self.channels

    def __getitem__(self, name: str) -> Column:
        """The column (n, ...) of a channel. Raises InputError, which says what there is, for one that there is not."""
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
        """How far beams go; None if these robots have no sensor that tells it, or rings of several kinds."""
        place = self.channels.places.get("ranges")
        return None if place is None else Beams(self.channels.axis("ranges"), self.columns[place])

    @property
    def field(self) -> NDArray[np.float64] | None:
        """The field's value (n,) where each robot is, NaN for the dead; None without a field."""
        place = self.channels.places.get("field")
        return None if place is None else self.columns[place]

    @classmethod
    def filled(cls, channels: Channels, columns: Mapping[str, Column], robots: NDArray[np.bool_]) -> Self:
        """These columns (n, ...) by channel for some `robots` (n,); blank for all others, and where none is given."""
        found = [channel.blanks(len(robots)) for channel in channels]
        for channel, column in zip(channels, found, strict=True):
            if channel.name in columns:
                column[robots] = columns[channel.name][robots]
        return cls(channels, tuple(found))

    def named(self) -> dict[str, Column]:
        """All columns by channel."""
        return {channel.name: column for channel, column in zip(self.channels, self.columns, strict=True)}

    def arrays(self) -> tuple[Column, ...]:
        """All that was measured, in the order of its declaration."""
        return self.columns

    def rows(self) -> dict[str, Column]:
        """What is recorded of it, by the name of its table."""
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
        """The rows of another's where `robots` (n,), which gives the same channels; all else of this."""
        rows = [robots.reshape(-1, *[1] * (column.ndim - 1)) for column in self.columns]
        columns = zip(rows, other.columns, self.columns, strict=True)
        return Readings(self.channels, tuple([np.where(*three) for three in columns]))

    def blanked(self, robots: NDArray[np.int64] | NDArray[np.bool_], places: tuple[int, ...] | None = None) -> Readings:
        """The same with nothing measured by some robots, (r,) or a mask (n,), in all or some columns.

        With a channel goes what its rows are counted by, and what else is told of these; all other structure stays.
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
        """The readings of robots at `pose` (n, 3), put where these robots are `believed` to be.

        What lies on the cells of maps moves by whole cells and is not turned, what lies in the world rigidly.
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
    """Something of each robot (n, k) beside all that a column (n, ..., k) holds of it."""
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
