"""Worlds of the Stage simulator: bitmaps and boxes of models, and its robots' places."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, affinity

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import World
from swarmsim.core.scenario.files import content
from swarmsim.world import rosmap
from swarmsim.world.areas import polygons
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.sheets import sheet
from swarmsim.world.simulators.starts import start
from swarmsim.world.tracing import traced
from swarmsim.world.viewport import LARGEST

_EXPECTED: Final = "a world of Stage or Gazebo"
_TOKENS: Final = re.compile(r"""(#[^\n]*|\s+)|"([^"\n]*)"|([()\[\]])|([^\s()\[\]"#]+(?:\[\d+\])?)""")
_DEEPEST: Final = 50  # models or files inside of each other
_MOST: Final = 20_000  # models, with those of definitions
_STRAY: Final = 0.075  # m, how far outlines may stray from pixels: half of a usual cell
_SIZE: Final = (0.1, 0.1)  # m, default size of a model
_FRAME: Final = 0.1  # m, thickness of a model's `boundary`
#: Neither solids nor robots: windows and robots' equipment.
_OTHERS: Final = (
    "window", "ranger", "sensor", "laser", "sonar", "blobfinder", "fiducial", "camera", "actuator", "gripper",
    "bumper", "lightindicator", "block", "speech",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Entity:
    """A model with its keys, those of its definition included."""

    kind: str  # resolved by the definitions: model, position, window, ...
    line: int
    keys: Mapping[str, list[str]] = field(default_factory=dict)
    parts: tuple[_Entity, ...] = ()


def read(path: Path, world: World) -> Drawing:
    """A Stage world: the dark pixels of bitmaps, and boxes.

    Stage fits the box of a bitmap's dark pixels to `size`, x and y separately, with the origin in the middle. The
    robots' places are a spawn area. Only files in the world's folder are included. Raises InputError.
    """
    reader = _StageReader(path)
    reader.file(path, 0)
    solid: list[Shape] = []
    robots: list[tuple[float, float]] = []
    bitmap = lru_cache(maxsize=64)(_bitmap)  # shared by equal models
    for entity, to in _placed(reader.entities, path):
        if entity.kind == "position" or (entity.kind not in ("model", *_OTHERS) and not _is_solid(entity)):
            robots.append((float(to[0, 2]), float(to[1, 2])))
        else:
            solid += _solid(entity, to, path, reader.notices, bitmap)
    if not solid:
        raise InputError(f"{path}: no model in it has a bitmap or is an obstacle; expected {_EXPECTED}")
    bounds = shapely.total_bounds([shape.fill for shape in solid])
    page = (float(bounds[0]), float(bounds[1]), float(bounds[2]), float(bounds[3]))
    shapes = [*solid, *start(robots, solid, page)]
    if len(shapes) > len(solid):
        reader.notices.append(f"the spawn area is where its robots stand ({len(robots)})")
    return sheet(str(path), shapes, world, page, "m", tuple(dict.fromkeys(reader.notices)))


class _StageReader:
    """Reads one world and the files that it includes."""

    def __init__(self, path: Path) -> None:
        self.entities: list[_Entity] = []
        self.notices: list[str] = []
        self._home = path.parent
        self._defined: dict[str, _Entity] = {}
        self._seen: set[Path] = set()
        self._at = 0
        self._tokens: list[tuple[str, int, bool]] = []  # text, line, whether it was in quotes
        self._path = path

    def file(self, path: Path, depth: int) -> None:
        """Add a file's contents. Raises InputError."""
        if depth > _DEEPEST or path.resolve() in self._seen:
            return
        self._seen.add(path.resolve())
        before = self._tokens, self._at, self._path
        try:
            text = content(path, _EXPECTED).decode("utf-8", errors="replace")
            self._tokens, self._at, self._path = list(_tokens(text, path)), 0, path
            while self._at < len(self._tokens):
                self._statement(depth)
        finally:
            self._tokens, self._at, self._path = before

    def _statement(self, depth: int) -> None:
        word, line = self._word()
        if word == "include":
            self._include(self._word()[0], depth)
        elif word == "define":
            name, base = self._word()[0], self._word()[0]
            self._take("(")
            self._defined[name] = self._body(base, line, 1)
        elif self._next() == "(":
            self._take("(")
            self.entities.append(self._body(word, line, 1))
        else:
            self._value()

    def _include(self, named: str, depth: int) -> None:
        file = self._path.parent / named
        try:
            inside = file.resolve().is_relative_to(self._home.resolve()) and file.is_file()
        except (OSError, ValueError):
            inside = False
        if inside:
            self.file(file, depth + 1)
        else:
            self.notices.append(f"it includes {named}, which is not in its folder; what that defines is not known")

    def _body(self, kind: str, line: int, depth: int) -> _Entity:
        """The contents of parentheses, on top of the definition of `kind`."""
        if depth > _DEEPEST:
            raise InputError(f"{self._path}: line {line}: models nested deeper than {_DEEPEST}; expected {_EXPECTED}")
        base = self._defined.get(kind) or _Entity(kind, line)
        keys, parts = dict(base.keys), list(base.parts)
        while self._next() != ")":
            word, at = self._word()
            if self._next() == "(":
                self._take("(")
                parts.append(self._body(word, at, depth + 1))
            else:
                keys[word] = self._value()
        self._take(")")
        return _Entity(base.kind, line, keys, tuple(parts))

    def _value(self) -> list[str]:
        if self._next() != "[":
            return [self._word()[0]]
        self._take("[")
        values = []
        while self._next() != "]":
            values.append(self._word()[0])
        self._take("]")
        return values

    def _next(self) -> str:
        """The next mark, or an empty string for a word. Raises InputError at the end of the file."""
        if self._at >= len(self._tokens):
            line = self._tokens[-1][1] if self._tokens else 1
            raise InputError(f"{self._path}: line {line}: it ends in the middle; expected {_EXPECTED}")
        text, _, quoted = self._tokens[self._at]
        return text if text in "()[]" and not quoted else ""

    def _take(self, mark: str) -> None:
        if self._next() != mark:
            raise InputError(f"{self._path}: line {self._tokens[self._at][1]}: expected {mark!r}, as in {_EXPECTED}")
        self._at += 1

    def _word(self) -> tuple[str, int]:
        if self._next():
            text, line, _ = self._tokens[self._at]
            raise InputError(f"{self._path}: line {line}: {text!r} where a word should be; expected {_EXPECTED}")
        text, line, _ = self._tokens[self._at]
        self._at += 1
        return text, line


def _tokens(text: str, path: Path) -> Iterator[tuple[str, int, bool]]:
    line, at = 1, 0
    while at < len(text):
        found = _TOKENS.match(text, at)
        if found is None:
            raise InputError(f"{path}: line {line}: a quotation mark without its second; expected {_EXPECTED}")
        blank, quoted, mark, word = found.groups()
        if blank is None:
            yield (quoted if quoted is not None else mark or word), line, quoted is not None
        line += found[0].count("\n")
        at = found.end()


def _placed(entities: list[_Entity], path: Path) -> Iterator[tuple[_Entity, NDArray[np.float64]]]:
    """Models, also nested ones, each with the transform from its own coordinates to the world's."""
    waiting, count = [(entity, np.eye(3)) for entity in reversed(entities)], 0
    while waiting:
        entity, above = waiting.pop()
        count += 1
        if count > _MOST:
            raise InputError(f"{path}: more than {_MOST} models; expected {_EXPECTED}")
        if entity.kind in _OTHERS:
            continue
        own = above @ _pose(entity, "pose", path)
        yield entity, own
        if entity.kind != "position":
            waiting.extend((part, own) for part in reversed(entity.parts))


def _is_solid(entity: _Entity) -> bool:
    return "bitmap" in entity.keys or any(part.kind == "block" for part in entity.parts)


def _solid(
    entity: _Entity,
    to: NDArray[np.float64],
    path: Path,
    notices: list[str],
    bitmap: Callable[[Path, float, float], MultiPolygon],
) -> list[Shape]:
    """The solid part of a model."""
    where = f"line {entity.line}"
    # Stage's own map.inc gives floor plans obstacle_return 0: its robots see these walls, and drive around them.
    ghost = entity.keys.get("ranger_return", entity.keys.get("laser_return", [""])) in (["-1"], ["0"])
    if ghost if "bitmap" in entity.keys else entity.keys.get("obstacle_return") == ["0"]:
        return []
    width, height = (_numbers(entity, "size", path) or _SIZE)[:2]
    if not (0.0 < width <= LARGEST and 0.0 < height <= LARGEST):
        raise InputError(f"{path}: {where}: size is out of range; expected metres, as in size [16 16 1]")
    if "bitmap" in entity.keys:
        image, told = rosmap.picture(" ".join(entity.keys["bitmap"]), path.parent)
        notices.extend(told)
        area = bitmap(image, width, height)
    else:
        area = _blocks(entity, width, height, path)
    if entity.keys.get("boundary") == ["1"]:
        outer = shapely.box(-0.5 * width - _FRAME, -0.5 * height - _FRAME, 0.5 * width + _FRAME, 0.5 * height + _FRAME)
        inner = shapely.box(-0.5 * width, -0.5 * height, 0.5 * width, 0.5 * height)
        area = polygons(shapely.union_all([area, outer.difference(inner)]))
    to = to @ _pose(entity, "origin", path)
    moved = affinity.affine_transform(area, [to[0, 0], to[0, 1], to[1, 0], to[1, 1], to[0, 2], to[1, 2]])
    group = " ".join(entity.keys.get("name", [entity.kind]))
    return [Shape(polygons(moved), layer="walls", group=group, where=where)]


def _bitmap(image: Path, width: float, height: float) -> MultiPolygon:
    """The dark pixels of a picture, with their box fitted to that size around the origin."""
    mask = rosmap.dark(image)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        raise InputError(f"{image}: no pixel in it is dark; expected black walls on white")
    mask = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    across, along = width / mask.shape[1], height / mask.shape[0]
    tolerance = min(1.5, _STRAY / max(across, along))
    shape = traced(mask, tolerance if tolerance > 0.5 else 0.0)
    return affinity.affine_transform(shape, [across, 0.0, 0.0, along, -0.5 * width, -0.5 * height])


def _blocks(entity: _Entity, width: float, height: float, path: Path) -> MultiPolygon:
    """The blocks of a model, fitted to its size together, or a box."""
    blocks = []
    for part in (part for part in entity.parts if part.kind == "block"):
        corners = [_numbers(part, f"point[{k}]", path) for k in range(len(part.keys))]
        ring = [corner[:2] for corner in corners if corner is not None and len(corner) >= 2]
        if len(ring) >= 3:
            blocks.append(shapely.make_valid(shapely.Polygon(ring)))
    area = polygons(shapely.union_all(blocks))
    if area.is_empty:
        return MultiPolygon([shapely.box(-0.5 * width, -0.5 * height, 0.5 * width, 0.5 * height)])
    left, low, right, high = area.bounds
    moved = affinity.translate(area, -0.5 * (left + right), -0.5 * (low + high))
    return affinity.scale(moved, width / (right - left), height / (high - low), origin=(0.0, 0.0))


def _pose(entity: _Entity, key: str, path: Path) -> NDArray[np.float64]:
    """The transform from a model's coordinates to the surrounding ones; headings are in degrees."""
    numbers = _numbers(entity, key, path) or (0.0, 0.0, 0.0)
    x, y, turn = numbers[0], numbers[1], math.radians(numbers[-1])
    if max(abs(x), abs(y)) > LARGEST:
        raise InputError(f"{path}: line {entity.line}: {key} lies farther than {LARGEST:g} m from the origin")
    cos, sin = math.cos(turn), math.sin(turn)
    return np.array([[cos, -sin, x], [sin, cos, y], [0.0, 0.0, 1.0]])


def _numbers(entity: _Entity, key: str, path: Path) -> tuple[float, ...] | None:
    """The numbers of a key, at least two; None without the key."""
    if key not in entity.keys:
        return None
    try:
        numbers = tuple(map(float, entity.keys[key]))
    except ValueError:
        numbers = ()
    least = 2 if key == "size" or key.startswith("point") else 3
    if len(numbers) < least or not all(map(math.isfinite, numbers)):
        raise InputError(
            f"{path}: line {entity.line}: {key} is not a list of numbers; expected such as {key} [1 2 0 90]"
        )
    return numbers
