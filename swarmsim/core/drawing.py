"""Shapes of pictures, in metres, as arrays for the whole swarm; and the layers that draw them.

Films, windows, pages and viewers all draw the same shapes. Colours are inks: names of a theme's colours (`INKS`), the
colour of a robot (`robot 3`), black or white, whichever is readable on another ink (`on robot 3`), or `#ff8800`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import own

Reals = NDArray[np.float64]
Whole = NDArray[np.integer]
Ink = str
Inks = Ink | Sequence[Ink]  # of all shapes, or of each of them
Unit = Literal["m", "body"]  # metres, or radii of a robot as drawn: small ones are enlarged
Dash = Literal["whole", "dashed", "dotted"]

#: The colours that every theme has.
INKS: Final = (
    "background", "unexplored", "walls", "pillars", "furniture", "unknown", "few", "others", "all", "hot", "floor",
    "seen", "edge", "halo", "text", "muted", "rule", "link", "lost", "curve", "mean", "worst", "mark", "joined",
    "dead", "person",
)  # fmt: skip
_INK: Final = re.compile(rf"(on )?(({'|'.join(INKS)})|robot \d{{1,9}}|#[0-9a-f]{{6}})")
ABOVE: Final = 85.0  # over links and goals, under people and robots
LARGEST: Final = 1e7  # m or radii: limit of sizes and coordinates
SHARPEST: Final = 1.5  # of an edge's width: its largest reach beyond a sharp corner


@dataclass(frozen=True, slots=True, eq=False)
class Circles:
    """Discs or, with a `stroke`, rings of this breadth in the unit of the radius."""

    centre: Reals  # (c, 2): m
    radius: float | Reals  # of all, or (c,)
    ink: Inks = "mark"
    edge: Ink | None = "edge"  # of a thin line around each
    opacity: float = 1.0
    stroke: float = 0.0
    unit: Unit = "m"
    of: Whole | None = None  # (c,): the robot that each belongs to
    rides: bool = False  # whether it moves with its robot
    name: str = ""  # its meaning
    z: float = ABOVE  # greater ones are drawn later
    still: bool = False  # whether it never changes in the run


@dataclass(frozen=True, slots=True, eq=False)
class Polygons:
    """Areas. With `at` they are drawn around these places, turned by `yaw`, in the unit; otherwise in metres."""

    points: Reals  # (p, 2): the corners, area by area
    ends: Whole  # (k,): where each ends among the points
    ink: Inks | None = "mark"  # None: outlines alone
    edge: Inks | None = "edge"
    width: float = 1.3  # of the edge, in pixels of a picture 720 pixels high
    opacity: tuple[float, float] = (1.0, 1.0)  # of ink and edge
    holes: NDArray[np.bool_] | None = None  # (k,): which are holes in those before them
    at: Reals | None = None  # (k, 2): m
    yaw: Reals | None = None  # (k,): rad
    unit: Unit = "m"
    of: Whole | None = None  # (k,)
    rides: bool = False
    name: str = ""
    z: float = ABOVE
    still: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Open lines. An arrow's head lies at the last point or, if that is a robot, at the edge of its disc."""

    points: Reals  # (p, 2): m, line by line
    ends: Whole  # (k,): where each ends among the points
    ink: Inks = "mark"
    casing: Ink | None = "edge"  # on either side
    width: float = 1.5  # in pixels of a picture 720 pixels high
    opacity: float = 1.0
    dash: Dash = "whole"
    arrow: bool = False
    of: Whole | None = None  # (k,)
    on: Whole | None = None  # (p,): the robot whose centre a point moves with, or -1
    name: str = ""
    z: float = ABOVE
    still: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Lines from robots outwards, at the same bearings from straight ahead for all."""

    at: Reals  # (k, 2): m
    yaw: Reals  # (k,): rad
    bearings: Reals  # (b,): rad
    length: Reals  # (k, b): m
    of: Whole  # (k,)
    ink: Inks = "mark"
    width: float = 1.0
    opacity: float = 1.0
    name: str = ""
    z: float = ABOVE
    still: bool = False

    @property
    def tips(self) -> Reals:
        """Their end points (k, b, 2), in m."""
        angles = self.yaw[:, None] + self.bearings
        return np.asarray(self.at[:, None] + self.length[..., None] * np.stack([np.cos(angles), np.sin(angles)], -1))


@dataclass(frozen=True, slots=True, eq=False)
class Texts:
    """Short one-line texts, centred on their places."""

    at: Reals  # (t, 2): m
    texts: Sequence[str]
    size: float = 18.0  # of a line, in pixels of a picture 720 pixels high or, on discs, radii
    ink: Inks = "text"
    unit: Literal["pixel", "body"] = "pixel"
    of: Whole | None = None  # (t,)
    rides: bool = False
    name: str = ""
    z: float = ABOVE
    still: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Coloured cells: 0 is clear; other values blend from one ink to another within each step of the palette."""

    values: NDArray[np.uint8]  # (rows, columns), the lowest row first
    corner: tuple[float, float]  # m: the lower left one
    cell: float  # m: a cell's side
    palette: Sequence[tuple[int, int, Ink, Ink]]  # first and last value, and their inks
    each: bool = False  # whether a selected robot has its own
    name: str = ""
    z: float = ABOVE
    still: bool = False


Mark = Circles | Polygons | Lines | Rays | Texts | Raster
KINDS: Final = (Circles, Polygons, Lines, Rays, Texts, Raster)


class Shown(Protocol):
    """One moment of a recorded run, as layers see it; row i is robot i."""

    @property
    def iteration(self) -> int:
        """The number of past iterations."""
        ...

    @property
    def time(self) -> float:
        """Simulated time in s."""
        ...

    @property
    def pose(self) -> Reals:
        """Poses (n, 3): x, y in m, yaw in rad, between two iterations."""
        ...

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Whether each robot is alive (n,)."""
        ...

    @property
    def radii(self) -> Reals:
        """The true radii (n,) of robots in m."""
        ...

    @property
    def focus(self) -> int | None:
        """The selected robot, if any."""
        ...

    @property
    def chosen(self) -> tuple[int, ...]:
        """The robots whose own data is drawn; empty: all robots', except what would be too much."""
        ...

    def holds(self, name: str) -> bool:
        """Whether the recording has a table of this name."""
        ...

    def recorded(self, name: str, back: int = 0) -> NDArray[np.generic]:
        """A table's row at this moment, or some iterations before, clipped at the first.

        Raises InputError for an unknown table, or one without a row for each iteration.
        """
        ...


class Layer(Protocol):
    """Draws part of a run, at any of its moments."""

    @property
    def name(self) -> str:
        """Its name where layers are listed."""
        ...

    def draw(self, shown: Shown) -> Sequence[Mark]:
        """The shapes of one moment. Moments may come in any order."""
        ...


def ends_of(parts: Iterable[Reals]) -> tuple[Reals, Whole]:
    """Points (p, 2) of several lines or areas as one array, and where each of them ends."""
    listed = [np.asarray(part, np.float64).reshape(-1, 2) for part in parts]
    return np.concatenate([np.empty((0, 2)), *listed]), np.cumsum([len(part) for part in listed], dtype=np.int64)


def each(inks: Inks, count: int) -> Sequence[Ink]:
    """The ink of each shape, for `count` shapes."""
    return [inks] * count if isinstance(inks, str) else inks


def placed(mark: Polygons, radii: Reals, grown: float = 0.0) -> Reals:
    """The corners (p, 2) of areas in m, where robots are drawn with these radii (n,) in m.

    The sides of areas are moved outwards by `grown` m.
    """
    owner = np.repeat(np.arange(len(mark.ends)), np.diff(mark.ends, prepend=0))
    points = np.asarray(mark.points, np.float64)
    if mark.unit == "body" and mark.of is not None:
        points = radii[mark.of][owner, None] * points
    if grown and len(points):
        points = points + grown * _outwards(points, mark.ends)
    if mark.at is None:
        return points
    (x, y), yaw = points.T, np.zeros(len(mark.ends)) if mark.yaw is None else mark.yaw
    cosine, sine = np.cos(yaw)[owner], np.sin(yaw)[owner]
    return np.asarray(mark.at[owner] + np.stack([x * cosine - y * sine, x * sine + y * cosine], axis=1))


def _outwards(points: Reals, ends: Whole) -> Reals:
    """How far (p, 2) each corner moves when the sides of its area move outwards by 1; sharp ones move `SHARPEST`."""
    first = np.concatenate([[0], ends[:-1]])
    first, last = first[ends > first], ends[ends > first] - 1
    after, before = np.arange(len(points)) + 1, np.arange(len(points)) - 1
    after[last], before[first] = first, last
    (x, y), (dx, dy) = points.T, (points[after] - points).T
    left_turning = np.add.reduceat(x * dy - y * dx, first) >= 0.0
    side = np.stack([dy, -dx], axis=1) / np.maximum(np.hypot(dx, dy), 1e-12)[:, None]
    side *= np.repeat(np.where(left_turning, 1.0, -1.0), last - first + 1)[:, None]
    both = side + side[before]
    length = np.maximum(np.hypot(*both.T), 1e-12)[:, None]
    return np.asarray(both / length * np.minimum(2.0 / length, SHARPEST))


def sizes(mark: Circles, radii: Reals) -> Reals:
    """The radii (c,) of circles in m, where robots are drawn with these radii (n,) in m."""
    scale = radii[mark.of] if mark.unit == "body" and mark.of is not None else np.ones(len(mark.centre))
    return np.asarray(scale * mark.radius)


def alike(one: Sequence[Mark], other: Sequence[Mark]) -> bool:
    """Whether shapes are the same, number by number."""
    return len(one) == len(other) and all(
        type(a) is type(b) and all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
        for a, b in zip(one, other, strict=True)
    )


def inks_of(mark: Mark) -> list[Ink]:
    """Every ink that a shape names."""
    if isinstance(mark, Raster):
        return [ink for step in mark.palette for ink in step[2:]]
    given = (mark.ink, getattr(mark, "edge", None), getattr(mark, "casing", None))
    return [ink for inks in given if inks is not None for ink in ([inks] if isinstance(inks, str) else inks)]


def wrong(found: object, robots: int) -> str | None:
    """What is wrong with a layer's shapes for this many robots, or None."""
    if not isinstance(found, list | tuple):
        return f"drew {own.brief(found)}; expected a list of {', '.join(kind.__name__ for kind in KINDS)}"
    for mark in found:
        if not isinstance(mark, KINDS):
            return f"drew {own.brief(mark)}; expected {', '.join(kind.__name__ for kind in KINDS)}"
        try:
            _check(mark, robots)
        except (ValueError, TypeError) as problem:
            return f"drew {type(mark).__name__} whose {problem}"
    return None


def _check(mark: Mark, robots: int) -> None:
    """Raise ValueError, which starts with the field at fault, for a shape that cannot be drawn."""
    count = count_of(mark)
    sides: dict[str, tuple[int | None, ...]] = {
        "centre": (count, 2), "points": (None, 2), "ends": (count,), "holes": (count,), "at": (count, 2),
        "yaw": (count,), "of": (count,), "on": (len(mark.points) if isinstance(mark, Lines) else 0,),
        "bearings": (None,), "length": (count, len(mark.bearings) if isinstance(mark, Rays) else 0),
    }  # fmt: skip
    for field in fields(mark):
        value = getattr(mark, field.name)
        if value is None or (field.name == "radius" and np.ndim(value) == 0):
            continue
        if field.name in sides or field.name == "radius":
            _check_array(field.name, value, sides.get(field.name, (count,)))
    for name in ("of", "on"):
        numbers = getattr(mark, name, None)
        if (
            numbers is not None
            and len(numbers)
            and not (-(name == "on") <= np.min(numbers) <= np.max(numbers) < robots)
        ):
            raise ValueError(f"'{name}' names unknown robots; expected 0 to {robots - 1}")
    _check_size(mark, count)
    if any(not (isinstance(ink, str) and _INK.fullmatch(ink)) for ink in inks_of(mark)):
        odd = next(ink for ink in inks_of(mark) if not (isinstance(ink, str) and _INK.fullmatch(ink)))
        raise ValueError(f"ink is {odd!r}; expected '#rrggbb', 'robot I' or one of {', '.join(INKS)}")


def count_of(mark: Mark) -> int:
    """The number of shapes."""
    match mark:
        case Circles():
            return len(mark.centre)
        case Polygons() | Lines():
            return len(mark.ends)
        case Rays() | Texts():
            return len(mark.at)
    return 0


def _check_array(name: str, value: object, shape: tuple[int | None, ...]) -> None:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"'{name}' is {own.brief(value)}; expected an array")
    if value.ndim != len(shape) or any(side not in (None, has) for side, has in zip(shape, value.shape, strict=True)):
        raise ValueError(
            f"'{name}' is of shape {value.shape}; expected {tuple('any' if s is None else s for s in shape)}"
        )
    kinds = {"holes": "b", "ends": "iu", "of": "iu", "on": "iu"}.get(name, "fiu")
    if value.dtype.kind not in kinds:
        raise ValueError(f"'{name}' is of {value.dtype}; expected {'truth values' if kinds == 'b' else 'numbers'}")
    if kinds == "fiu" and not (np.abs(value) < LARGEST).all():
        raise ValueError(f"'{name}' has numbers that cannot be drawn; expected finite ones below {LARGEST:g}")


def _check_size(mark: Mark, count: int) -> None:
    """Raise ValueError for lengths that do not match, and for invalid sizes and words."""
    if isinstance(mark, Raster):
        _check_array("values", mark.values, (None, None))
        if mark.values.dtype != np.uint8 or not 0.0 < mark.cell < LARGEST or not max(map(abs, mark.corner)) < LARGEST:
            raise ValueError("'values', 'corner' or 'cell' is invalid; expected uint8, a place and a side in m")
        if any(len(step) != 4 or not 0 < step[0] <= step[1] < 256 for step in mark.palette):
            raise ValueError(f"'palette' is {own.brief(mark.palette)}; expected steps of values from 1 to 255")
        return
    given = getattr(mark, "ink", None), getattr(mark, "edge", None)
    if any(inks is not None and not isinstance(inks, str) and len(inks) != count for inks in given):
        raise ValueError(f"'ink' or 'edge' has the wrong length; expected one, or one for each of {count}")
    if isinstance(mark, Texts) and (len(mark.texts) != count or not all(isinstance(text, str) for text in mark.texts)):
        raise ValueError(f"'texts' do not fit; expected {count} texts")
    if isinstance(mark, Polygons | Lines):
        steps = np.diff(mark.ends, prepend=0)
        if (steps < 0).any() or (mark.ends[-1] if count else 0) != len(mark.points):
            raise ValueError(f"'ends' do not rise to {len(mark.points)}, the number of its points")
    if getattr(mark, "unit", "m") == "body" and mark.of is None:
        raise ValueError("'of' is missing; expected the robots whose radii are the unit")
    if getattr(mark, "rides", False) and mark.of is None:
        raise ValueError("'of' is missing; expected the robots that they ride on")
    sizes = [getattr(mark, name, 0.0) for name in ("width", "stroke", "size", "z")]
    sizes += np.ravel(getattr(mark, "opacity", 0.0)).tolist() + np.ravel(getattr(mark, "radius", 0.0)).tolist()
    if not all(isinstance(size, int | float | np.number) and -LARGEST < size < LARGEST for size in sizes):
        raise ValueError("sizes are invalid; expected numbers")
