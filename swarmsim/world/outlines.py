"""The outlines of SVG shapes, with chords in place of curves."""

from __future__ import annotations

import math
import re
from typing import Protocol

import numpy as np
import svgelements
from numpy.typing import NDArray

from swarmsim.world.elements import NUMBER, Element, ElementError, numbers, quoted
from swarmsim.world.viewport import Page

FLATNESS = 1e-3  #: m, the largest distance between a curve and the chords that replace it
SHAPES = frozenset({"path", "rect", "circle", "ellipse", "polygon", "polyline", "line"})  #: tags that have outlines
Points = NDArray[np.float64]  # (n, 2): x, y
Outlines = list[tuple[Points, bool]]  # each with whether it closes itself

_PATH_TOKENS = re.compile(rf"{NUMBER}|[MmZzLlHhVvCcSsQqTtAa]|[\s,]+")
_NUMBER = re.compile(NUMBER)
_STEP = re.compile(r"([MmLlHhVvZz])([^MmLlHhVvZz]*)")
_STRAIGHT = re.compile(r"\s*[Mm][MmLlHhVvZz0-9eE+\-.\s,]*")
_MOST_CHORDS = 10_000  # of one curve; more are needed only beyond the largest coordinate


class _Point(Protocol):
    x: float
    y: float


class _Segment(Protocol):
    """A segment of a path in svgelements."""

    end: _Point

    def npoint(self, positions: Points) -> Points:
        """The points (n, 2) at positions (n,) from 0 to 1."""


def outlines(element: Element, page: Page, flatness: float) -> Outlines:
    """The outlines of a shape in its own user units, with chords at most `flatness` away from its curves.

    A shape without an extent has none.
    """
    match element.tag:
        case "path":
            data = element.attributes.get("d", "")
            return _straight(data) if _is_straight(data) else _flattened(_segments(data), flatness)
        case "polygon" | "polyline":
            values = numbers(element.attributes.get("points", ""), "points")
            if len(values) % 2:
                raise ElementError(f"points has {len(values)} numbers; it should have two for each point")
            return [(np.array(values).reshape(-1, 2), element.tag == "polygon")] if len(values) > 2 else []
        case "line":
            x1, y1, x2, y2 = (page.length(element, key) for key in ("x1", "y1", "x2", "y2"))
            return [(np.array([[x1, y1], [x2, y2]]), False)]
        case "circle" | "ellipse":
            centre = page.length(element, "cx"), page.length(element, "cy")
            radii = [page.extent(element, key) for key in (("r", "r") if element.tag == "circle" else ("rx", "ry"))]
            if 0.0 in radii:
                return []
            curve = svgelements.Ellipse(*centre, *radii)
        case _:
            corner = page.length(element, "x"), page.length(element, "y")
            size = page.extent(element, "width"), page.extent(element, "height")
            if 0.0 in size:
                return []
            given = [key for key in ("rx", "ry") if element.attributes.get(key, "auto") != "auto"]
            radii = [page.length(element, key) for key in given] * (3 - len(given)) or [0.0, 0.0]
            if min(radii) < 0.0:
                raise ElementError("rx or ry is negative; a radius should be 0 or larger")
            if 0.0 in radii:
                (x, y), (width, height) = corner, size
                corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
                return [(np.array(corners), True)]
            curve = svgelements.Rect(*corner, *size, *radii)
    return _flattened(curve.segments(), flatness)


def _is_straight(data: str) -> bool:
    """Whether path data is free of curves and errors."""
    return _STRAIGHT.fullmatch(data) is not None and not _PATH_TOKENS.sub("", data)


def _straight(data: str) -> Outlines:
    """The outlines of path data without curves; most floor plans have thousands."""
    drawn: list[tuple[list[tuple[float, float]], bool]] = []
    points: list[tuple[float, float]] = []
    x = y = 0.0
    for match in _STEP.finditer(data):
        letter = match[1]
        values = [float(value) for value in _NUMBER.findall(match[2])]
        command, relative = letter.upper(), letter.islower()
        if command == "Z":
            if values:
                raise ElementError(f"d is {quoted(data)}, in which a command has too few or too many numbers")
            drawn.append((points, True))
            points = points[:1]
            x, y = points[0] if points else (0.0, 0.0)
            continue
        pair = command in "ML"
        if not values:
            raise ElementError("d has a command with too few numbers")
        if pair and len(values) % 2:
            raise ElementError(f"d is {quoted(data)}, in which a command has too few or too many numbers")
        if not points and command != "M":
            raise ElementError(f"d is {quoted(data)}; it should start with M and a point")
        for at in range(0, len(values), 2 if pair else 1):
            value = values[at]
            if command == "H":
                x = x + value if relative else value
            elif command == "V":
                y = y + value if relative else value
            else:
                other = values[at + 1]
                x, y = (x + value, y + other) if relative else (value, other)
            if command == "M" and at == 0:
                drawn.append((points, False))
                points = []
            points.append((x, y))
    drawn.append((points, False))
    found = [(np.array(corners), closed) for corners, closed in drawn if len(corners) > 1]
    if not all(np.isfinite(corners).all() for corners, _ in found):
        raise ElementError("d has a number that is too large")
    return found


def _segments(data: str) -> list[_Segment]:
    """The segments of path data, none of "none".

    svgelements silently drops what it cannot read, so check for that first.
    """
    data = "" if data.strip() == "none" else data
    left = _PATH_TOKENS.sub("", data)
    if left:
        raise ElementError(f"d has {quoted(left[0])}, which is not a path command; only MLHVCSQTAZ and numbers are")
    try:
        segments = list(svgelements.Path(data))
    except Exception as error:  # svgelements has no exception type of its own
        raise ElementError(f"d is {quoted(data)}, in which a command has too few or too many numbers") from error
    if segments and not isinstance(segments[0], svgelements.Move):
        raise ElementError(f"d is {quoted(data)}; it should start with M and a point")
    return segments


def _flattened(segments: list[_Segment], flatness: float) -> Outlines:
    """The outlines that `segments` draw, without those that are a single point."""
    drawn: list[tuple[list[Points], bool]] = []
    points: list[Points] = []
    for segment in segments:
        if isinstance(segment, (svgelements.Move, svgelements.Close)):
            closed = isinstance(segment, svgelements.Close)
            drawn.append((points, closed))
            points = points[:1] if closed else [_corner(segment.end)]
        else:
            points.extend(_chords(segment, flatness))
    drawn.append((points, False))
    return [(np.array(points), closed) for points, closed in drawn if len(points) > 1]


def _corner(point: _Point) -> Points:
    """A point of svgelements as an array of two finite numbers."""
    try:
        corner = np.array([float(point.x), float(point.y)])
    except (AttributeError, TypeError):
        raise ElementError("d has a command with too few numbers") from None
    if not np.isfinite(corner).all():
        raise ElementError("d has a number that is too large")
    return corner


def _chords(segment: _Segment, flatness: float) -> list[Points]:
    """The ends of the chords of one segment; a start is the end of the segment before."""
    if isinstance(segment, svgelements.Arc) and segment.sweep and segment.rx and segment.ry:
        # An ellipse is a stretched circle, and its chords stray at most as far as those of the larger circle.
        pieces = abs(float(segment.sweep)) / chord_angle(max(segment.rx, segment.ry), flatness)
    elif isinstance(segment, (svgelements.QuadraticBezier, svgelements.CubicBezier)):
        corners = np.array([_corner(corner) for corner in segment])
        degree = len(corners) - 1
        bend = degree * (degree - 1) * np.linalg.norm(np.diff(corners, 2, axis=0), axis=1).max()
        pieces = math.sqrt(bend / (8.0 * flatness))  # a chord strays by at most bend dt^2 / 8
    else:
        return [_corner(segment.end)]
    if not math.isfinite(pieces):
        raise ElementError("d has a number that is too large")
    count = max(1, min(math.ceil(pieces), _MOST_CHORDS))
    return list(segment.npoint(np.linspace(0.0, 1.0, count + 1))[1:])


def chord_angle(radius: float, flatness: float) -> float:
    """The angle of an arc of `radius`, a quarter at most, that strays `flatness` from its chord."""
    return max(4.0 * math.asin(math.sqrt(min(0.5 * flatness / radius, 0.5 - math.sqrt(0.125)))), 1e-9)
