"""A recording as MCAP with Foxglove's schemas, which Foxglove and Lichtblick open.

Importing this raises InputError where foxglove-sdk is not installed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.drawing import (
    Circles,
    Ink,
    Lines,
    Mark,
    Polygons,
    Raster,
    Rays,
    Reals,
    Texts,
    alike,
    each,
    placed,
    sizes,
)
from swarmsim.core.errors import InputError
from swarmsim.recording.columns import plain, shown
from swarmsim.recording.reader import Recording
from swarmsim.view.layers import LayerStack
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.theme import DARK
from swarmsim.view.viewers.cells import table

try:
    import foxglove
    from foxglove import channels
    from foxglove import messages as fm
    from foxglove.mcap import MCAPWriteOptions
except ImportError as problem:
    raise InputError("--mcap needs foxglove-sdk; install it with: pip install 'swarmsim-lab[mcap]'") from problem

WORLD = "world"
OWN_MAPS = 10  # iterations from one map of a single robot to the next
HEIGHT = 1000.0  # z of a shape at a height of 1 m, so that later ones lie above the others
CHUNK = 1 << 22  # bytes packed together: each of many grids is much like the one before
THIN = 1e-3  # m: the height of discs


def write_mcap(recording: Recording, out: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Write a run to `out`; time is simulated time, from 0 on.

    /tf has a frame for each robot in `world`, /poses all poses, /numbers the task's curve and the counts of messages,
    /events what happened, and /readings/CHANNEL what each robot's sensors gave, but for tiles, which maps show: numbers
    in lists, null for nothing. /LAYER has what each layer draws, in the colours of the dark theme: what stands still
    once, in /LAYER/still. Both are written when they change. Rasters are grids, as in
    /map/known: for each cell its value and its colour. Each robot's
    own map is in /robot_I/map/own, every tenth iteration.
    """
    scene = Scene(recording)
    context = foxglove.Context()
    options = MCAPWriteOptions(chunk_size=CHUNK, compression_level=9)
    with foxglove.open_mcap(out, context=context, allow_overwrite=True, writer_options=options):
        frames = channels.FrameTransformsChannel("/tf", context=context)
        poses = channels.PosesInFrameChannel("/poses", context=context)
        drawn, layers = _Topics(context, scene), LayerStack(scene)
        events = channels.LogChannel("/events", context=context)
        numbers = foxglove.Channel("/numbers", context=context)
        measured = {one: foxglove.Channel(f"/readings/{one.name}", context=context) for one in shown(recording)}
        for row in range(recording.iterations):
            shot = scene.at(row)
            now = round(1e9 * row * scene.period)
            stamp = fm.Timestamp(now // 1_000_000_000, now % 1_000_000_000)
            frames.log(_frames(stamp, shot.pose), log_time=now)
            placed = [_pose(*pose) for pose in shot.pose.tolist()]
            poses.log(fm.PosesInFrame(timestamp=stamp, frame_id=WORLD, poses=placed), log_time=now)
            for layer in layers.all:
                drawn.log(layer.name, layer.draw(shot), stamp, row)
            heard, lost = scene.messages(row)
            value = float(scene.curve.scale * scene.curves.union[row])
            numbers.log({scene.curve.name: value, "heard": heard, "lost": lost}, log_time=now)
            for channel, topic in measured.items():
                rows = recording[channel.recorded_as][row]
                topic.log({"unit": channel.unit, "robots": plain(rows)}, log_time=now)
            if scene.has_maps and (row % OWN_MAPS == 0 or row == recording.iterations - 1):
                for robot in range(scene.robots):
                    marks = layers.draw(replace(shot, focus=robot), Style())
                    drawn.log(f"robot_{robot}/map", [mark for mark in marks if mark.name == "own"], stamp, row)
            for note in scene.notes:
                if note.iteration == row:
                    told = fm.Log(timestamp=stamp, level=fm.LogLevel.Info, message=note.words, name="swarmsim")
                    events.log(told, log_time=now)
            if progress is not None:
                progress(row + 1, recording.iterations)


def _pose(x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> fm.Pose:
    return fm.Pose(position=fm.Vector3(x=x, y=y, z=z), orientation=_turn(yaw))


def _turn(yaw: float) -> fm.Quaternion:
    return fm.Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * yaw), w=math.cos(0.5 * yaw))


def _frames(stamp: fm.Timestamp, poses: NDArray[np.float64]) -> fm.FrameTransforms:
    return fm.FrameTransforms(
        transforms=[
            fm.FrameTransform(
                timestamp=stamp, parent_frame_id=WORLD, child_frame_id=f"robot_{robot}",
                translation=fm.Vector3(x=x, y=y, z=0.0), rotation=_turn(yaw),
            )
            for robot, (x, y, yaw) in enumerate(poses.tolist())
        ]
    )  # fmt: skip


class _Topics:
    """The topics of layers, each made at its first shape."""

    def __init__(self, context: foxglove.Context, scene: Scene) -> None:
        self._context, self._radii = context, scene.radii
        self._scenes: dict[str, channels.SceneUpdateChannel] = {}
        self._grids: dict[str, channels.GridChannel] = {}
        self._last: dict[str, list[Mark]] = {}  # what each topic holds

    def log(self, layer: str, marks: Sequence[Mark], stamp: fm.Timestamp, row: int) -> None:
        """Write a layer's shapes in an iteration."""
        now = 1_000_000_000 * stamp.sec + (stamp.nsec or 0)
        shapes: dict[str, list[Mark]] = {}
        for mark in marks:
            if isinstance(mark, Raster):
                topic = f"/{layer}/{mark.name}" if mark.name else f"/{layer}"
                if self._is_new(topic, [mark]):
                    grid = self._grids.setdefault(topic, channels.GridChannel(topic, context=self._context))
                    grid.log(_grid(stamp, mark), log_time=now)
            elif not mark.still:
                shapes.setdefault(f"/{layer}", []).append(mark)
            elif row == 0:
                shapes.setdefault(f"/{layer}/still", []).append(mark)
        for topic in (f"/{layer}/still", f"/{layer}")[row > 0 :]:
            if not self._is_new(topic, shapes.get(topic, [])):
                continue
            scene = self._scenes.setdefault(topic, channels.SceneUpdateChannel(topic, context=self._context))
            entity = _entity(stamp, topic, shapes.get(topic, []), self._radii)
            scene.log(fm.SceneUpdate(entities=[entity]), log_time=now)

    def _is_new(self, topic: str, marks: list[Mark]) -> bool:
        """Whether the shapes have changed."""
        if alike(marks, self._last.get(topic, [])):
            return False
        self._last[topic] = marks
        return True


def _grid(stamp: fm.Timestamp, raster: Raster) -> fm.Grid:
    """Five bytes a cell: its value, and its colour."""
    rows = np.column_stack([np.arange(256, dtype=np.uint8), table(raster, DARK)])
    data = rows.view("V5").ravel()[raster.values]
    kind = fm.PackedElementFieldNumericType.Uint8
    return fm.Grid(
        timestamp=stamp, frame_id=WORLD, pose=_pose(*raster.corner), column_count=raster.values.shape[1],
        cell_size=fm.Vector2(x=raster.cell, y=raster.cell), row_stride=5 * raster.values.shape[1], cell_stride=5,
        fields=[
            fm.PackedElementField(name=name, offset=offset, type=kind)
            for offset, name in enumerate(("value", "red", "green", "blue", "alpha"))
        ],
        data=data.tobytes(),
    )  # fmt: skip


def _entity(stamp: fm.Timestamp, topic: str, marks: Sequence[Mark], radii: Reals) -> fm.SceneEntity:
    """The shapes, stacked in the order of their `z`."""
    cylinders, lines, triangles, texts = [], [], [], []
    for mark in marks:
        z = mark.z / HEIGHT
        match mark:
            case Circles() if mark.stroke:
                around = np.linspace(0.0, 2.0 * np.pi, 25)
                turned = np.stack([np.cos(around), np.sin(around)], axis=1)
                rings = mark.centre[:, None] + sizes(mark, radii)[:, None, None] * turned
                lines += _lines(list(rings), each(mark.ink, len(rings)), z, mark.opacity)
            case Circles():
                discs = zip(
                    mark.centre.tolist(), sizes(mark, radii).tolist(), each(mark.ink, len(mark.centre)), strict=True
                )
                cylinders += [
                    fm.CylinderPrimitive(
                        pose=_pose(x, y, z=z), size=fm.Vector3(x=2 * size, y=2 * size, z=THIN), bottom_scale=1.0,
                        top_scale=1.0, color=_colour(ink, mark.opacity),
                    )
                    for (x, y), size, ink in discs
                ]  # fmt: skip
            case Polygons():
                corners = np.split(placed(mark, radii), mark.ends[:-1])
                if mark.ink is not None and mark.holes is None:
                    triangles += _areas(corners, each(mark.ink, len(corners)), z, mark.opacity[0])
                outline = mark.edge if mark.holes is None else mark.edge or mark.ink
                if outline is not None:
                    closed = [np.concatenate([ring, ring[:1]]) for ring in corners]
                    lines += _lines(closed, each(outline, len(closed)), z, mark.opacity[1])
            case Lines():
                pieces = np.split(mark.points, mark.ends[:-1])
                lines += _lines(pieces, each(mark.ink, len(pieces)), z, mark.opacity)
            case Rays():
                pieces = [
                    np.stack([start, tip]) for start, tips in zip(mark.at, mark.tips, strict=True) for tip in tips
                ]
                of_rays = [ink for ink in each(mark.ink, len(mark.at)) for _ in mark.bearings]
                lines += _lines(pieces, of_rays, z, mark.opacity)
            case Texts():
                inks = each(mark.ink, len(mark.at))
                texts += [
                    fm.TextPrimitive(pose=_pose(x, y, z=z), billboard=True, font_size=14.0, scale_invariant=True,
                                     color=_colour(ink), text=text)
                    for (x, y), ink, text in zip(mark.at.tolist(), inks, mark.texts, strict=True)
                ]  # fmt: skip
    return fm.SceneEntity(
        timestamp=stamp, frame_id=WORLD, id=topic, cylinders=cylinders, lines=lines, triangles=triangles, texts=texts
    )


def _lines(pieces: Sequence[Reals], inks: Sequence[Ink], z: float, opacity: float) -> list[fm.LinePrimitive]:
    """Open lines: one list of pieces per ink."""
    ends: dict[Ink, list[fm.Point3]] = {}
    for points, ink in zip(pieces, inks, strict=True):
        corners = [fm.Point3(x=x, y=y, z=z) for x, y in points.tolist()]
        ends.setdefault(ink, []).extend(corner for pair in pairwise(corners) for corner in pair)
    kind = fm.LinePrimitiveLineType.LineList
    return [
        fm.LinePrimitive(type=kind, thickness=2.0, scale_invariant=True, color=_colour(ink, opacity), points=points)
        for ink, points in ends.items()
    ]


def _areas(rings: Sequence[Reals], inks: Sequence[Ink], z: float, opacity: float) -> list[fm.TriangleListPrimitive]:
    """Areas that are star-shaped around their centres, as triangles around these."""
    corners: dict[Ink, list[fm.Point3]] = {}
    for ring, ink in zip(rings, inks, strict=True):
        places = ring.tolist()
        x, y = (sum(side) / len(places) for side in zip(*places, strict=True))
        around = [fm.Point3(x=a, y=b, z=z) for a, b in places]
        for pair in pairwise([*around, around[0]]):
            corners.setdefault(ink, []).extend((fm.Point3(x=x, y=y, z=z), *pair))
    return [fm.TriangleListPrimitive(points=points, color=_colour(ink, opacity)) for ink, points in corners.items()]


@lru_cache(maxsize=1024)
def _colour(ink: Ink, opacity: float = 1.0) -> fm.Color:
    red, green, blue = (part / 255.0 for part in DARK.ink(ink))
    return fm.Color(r=red, g=green, b=blue, a=opacity)
