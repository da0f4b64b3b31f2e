"""Worlds of the Gazebo simulator (SDF): boxes, cylinders and spheres that a robot on the floor can hit."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import World
from swarmsim.core.scenario.files import content
from swarmsim.world.areas import polygons
from swarmsim.world.markup import Node, parsed
from swarmsim.world.problems import Problems
from swarmsim.world.shapes import Drawing, Shape
from swarmsim.world.sheets import sheet
from swarmsim.world.simulators.starts import start
from swarmsim.world.viewport import LARGEST

LOW, HIGH = 0.05, 0.3  #: m above the ground, between which a robot is

_EXPECTED: Final = "a world of Gazebo (SDF)"
_ROUND: Final = 64  # corners of a cylinder
_HARMLESS: Final = ("sun", "ground_plane")  # models that nearly every world includes
_TURNING: Final = ("revolute", "continuous", "revolute2")  # joints; a robot has two or more of them
_NAMED: Final = 8  # names in a notice
Pose = NDArray[np.float64]  # (4, 4), from a thing's own coordinates to the surrounding ones


def holds(path: Path) -> bool:
    """Whether a `.world` file is Gazebo's, in XML, and not Stage's. Raises InputError."""
    return content(path, "a world of Stage or Gazebo").lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def read(path: Path, world: World) -> Drawing:
    """A Gazebo world at the height of a robot: its collisions that are boxes, cylinders, spheres.

    A notice names meshes and included models, whose files are missing. Models with wheels are robots, and their places
    are the spawn area. Raises InputError with all errors, each with its line.
    """
    root, name = parsed(path, "sdf", _EXPECTED), str(path)
    scene = next((child for child in root if child.tag == "world"), root)
    reader = _SdfReader(Problems(name), {model.get("name"): model for model in scene.iterfind("state/model")})
    reader.models(scene, np.eye(4))
    reader.problems.complain()
    if not reader.shapes:
        missing = f"; {reader.notices()[0]}" if reader.notices() else ""
        raise InputError(f"{name}: no box or cylinder in it is {LOW:g} to {HIGH:g} m above the ground{missing}")
    left, low, right, high = (float(side) for side in shapely.total_bounds([shape.fill for shape in reader.shapes]))
    page = (left, low, right, high)
    shapes = [*reader.shapes, *start(reader.robots, reader.shapes, page)]
    return sheet(name, shapes, world, page, "m", reader.notices())


class _SdfReader:
    """Walks through the models of a world."""

    def __init__(self, problems: Problems, states: dict[str | None, Node]) -> None:
        self.problems = problems
        self.shapes: list[Shape] = []
        self.robots: list[tuple[float, float]] = []
        self._states = states  # where models were when the world was saved, by name
        self._missing: Counter[str] = Counter()  # included models
        self._unread: Counter[str] = Counter()  # models with meshes and the like
        self._seen: Counter[str] = Counter()  # models without collisions

    def notices(self) -> list[str]:
        """On ignored contents."""
        told = []
        for names, what in (
            (self._missing, "models of other files are not there and not read"),
            (self._unread, "collisions are meshes or the like and not read"),
            (self._seen, "models have no collision and stop no robot"),
        ):
            if names:
                more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
                told.append(f"{what}: {', '.join(list(names)[:_NAMED])}{more}")
        if self.robots:
            told.append(f"models with wheels are robots, and the spawn area is where they stand ({len(self.robots)})")
        return told

    def models(self, parent: Node, to: Pose) -> None:
        """Read the models in an element; `to` leads from its coordinates to the world's."""
        waiting = [(parent, to, True)]
        while waiting:
            element, above, outermost = waiting.pop()
            for include in element.iterchildren("include"):
                uri = (include.findtext("uri") or "").strip()
                called = uri.removeprefix("model://").strip("/")
                if called not in _HARMLESS:
                    self._missing[called] += 1
            for model in element.iterchildren("model"):
                pose = model.find("pose")
                if pose is not None and pose.get("relative_to", "world") not in ("", "world", "__model__"):
                    self.problems.add(f"line {pose.sourceline}: a model relative to another one is not understood")
                saved = self._states.get(model.get("name")) if outermost else None
                own = above @ self._pose(model if saved is None or saved.find("pose") is None else saved)
                joints = [joint for joint in model.iterchildren("joint") if joint.get("type") in _TURNING]
                if len(joints) > 1 and (model.findtext("static") or "").strip() not in ("true", "1"):
                    self.robots.append((float(own[0, 3]), float(own[1, 3])))
                    continue
                self._links(model, own)
                waiting.append((model, own, False))

    def _links(self, model: Node, to: Pose) -> None:
        name = model.get("name") or "model"
        frames = {one.get("name"): one for one in model.iterchildren("link", "frame")}
        found = False
        for link in model.iterchildren("link"):
            for collision in link.iterchildren("collision"):
                found = True
                self._collision(collision, to @ self._in_model(collision, frames, link), name)
        if not found and next(model.iterchildren("link"), None) is not None:
            self._seen[name] += 1

    def _in_model(self, element: Node | None, frames: dict[str | None, Node], parent: Node | None = None) -> Pose:
        """The pose of a collision, link or frame in its model, by the frames that it is relative to."""
        pose, seen = np.eye(4), 0
        while element is not None:
            given = element.find("pose")
            frame = "" if given is None else given.get("relative_to") or given.get("frame") or ""
            frame = frame or (element.get("attached_to") or "" if element.tag == "frame" else "")
            seen += 1
            if seen > len(frames) + 2 or (frame not in ("", "world", "__model__") and frame not in frames):
                self.problems.add(f"line {element.sourceline}: <{element.tag}> is relative to {frame!r}, no link of it")
                return pose
            pose = self._pose(element) @ pose
            element, parent = frames.get(frame, parent if not frame else None), None
        return pose

    def _collision(self, collision: Node, to: Pose, name: str) -> None:
        where = f"line {collision.sourceline}"
        for kind in collision.iterfind("geometry/*"):
            area = MultiPolygon()
            if kind.tag == "box":
                size = self._numbers(kind, "size", 3)
                if size is not None:
                    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * size
                    area = _section(corners, to)
            elif kind.tag == "cylinder":
                radius, length = self._numbers(kind, "radius", 1), self._numbers(kind, "length", 1)
                if radius is not None and length is not None:
                    turn = 2.0 * math.pi * (np.arange(_ROUND) + 0.5) / _ROUND
                    ring = np.stack([radius[0] * np.cos(turn), radius[0] * np.sin(turn)], 1)
                    ends = [np.column_stack([ring, np.full(_ROUND, end * length[0])]) for end in (-0.5, 0.5)]
                    area = _section(np.concatenate(ends), to)
            elif kind.tag == "sphere":
                radius = self._numbers(kind, "radius", 1)
                if radius is not None:
                    area = _ball(to[:3, 3], float(radius[0]))
            elif kind.tag not in ("plane", "empty"):
                self._unread[name] += 1
            if not area.is_empty and np.abs(area.bounds).max() > LARGEST:
                self.problems.add(f"{where}: a collision lies farther than {LARGEST:g} m from the origin")
            elif not area.is_empty:
                self.shapes.append(Shape(area, layer="walls", group=name, where=where))

    def _numbers(self, element: Node, key: str, count: int) -> NDArray[np.float64] | None:
        """The given number of lengths in a child element; notes an error otherwise."""
        numbers = _floats(element.findtext(key))
        if numbers is None or len(numbers) != count or not all(0.0 < number <= LARGEST for number in numbers):
            what = "a length" if count == 1 else f"{count} lengths"
            self.problems.add(f"line {element.sourceline}: <{element.tag}> without a {key}; expected {what} in m")
            return None
        return np.array(numbers)

    def _pose(self, element: Node) -> Pose:
        """An element's <pose>: x, y, z in m, roll, pitch, yaw in rad, or in degrees if it says so."""
        pose = element.find("pose")
        if pose is None:
            return np.eye(4)
        numbers = _floats(pose.text or "")
        if numbers is None or len(numbers) not in (0, 6) or (numbers and np.abs(numbers).max() > LARGEST):
            self.problems.add(f"line {pose.sourceline}: <pose> is not six numbers: x y z roll pitch yaw")
            return np.eye(4)
        if not numbers:
            return np.eye(4)
        angles = np.radians(numbers[3:]) if pose.get("degrees") in ("true", "1") else np.array(numbers[3:])
        return _matrix(np.array(numbers[:3]), angles)


def _floats(text: str | None) -> list[float] | None:
    try:
        numbers = [float(part) for part in (text or "").split()]
    except ValueError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None


def _matrix(place: NDArray[np.float64], angles: NDArray[np.float64]) -> Pose:
    """A pose by roll, pitch and yaw about fixed axes, in this order."""
    cosines: list[float] = np.cos(angles).tolist()
    sines: list[float] = np.sin(angles).tolist()
    (cr, cp, cy), (sr, sp, sy) = cosines, sines
    found = np.eye(4)
    found[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    found[:3, 3] = place
    return found


def _section(corners: NDArray[np.float64], to: Pose) -> MultiPolygon:
    """The area of a convex body between LOW and HIGH, seen from above."""
    points = corners @ to[:3, :3].T + to[:3, 3]
    heights = points[:, 2]
    if heights.max() <= LOW or heights.min() >= HIGH:
        return MultiPolygon()
    flat = [points[(heights >= LOW) & (heights <= HIGH), :2]]
    for level in (LOW, HIGH):
        # The convex hull of all cuts of all lines between corners is the cut of the body.
        below, above = points[heights < level], points[heights > level]
        if len(below) and len(above):
            share = (level - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
            cuts = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
            flat.append(cuts.reshape(-1, 2))
    return polygons(shapely.LineString(np.concatenate(flat)).convex_hull)


def _ball(centre: NDArray[np.float64], radius: float) -> MultiPolygon:
    """The same for a ball."""
    nearest = float(np.clip(centre[2], LOW, HIGH))
    square = radius**2 - (centre[2] - nearest) ** 2
    if square <= 0.0:
        return MultiPolygon()
    return polygons(shapely.Point(centre[:2]).buffer(math.sqrt(square), quad_segs=_ROUND // 4))
