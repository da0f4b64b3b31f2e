"""A recording as MCAP with Foxglove's schemas, which Foxglove and Lichtblick open.

Importing this raises InputError where foxglove-sdk is not installed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.recording.columns import plain, shown
from swarmsim.recording.reader import Recording
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.theme import DARK, Colour, colour_of
from swarmsim.view.viewers.cells import CELLS, UNKNOWN_CELL

try:
    import foxglove
    from foxglove import channels
    from foxglove import messages as fm
except ImportError as problem:
    raise InputError("--mcap needs foxglove-sdk; install it with: pip install 'swarmsim-lab[mcap]'") from problem

WORLD = "world"
OWN_MAPS = 10  # iterations from one map of a single robot to the next


def write_mcap(recording: Recording, out: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Write a run to `out`; time is simulated time, from 0 on.

    /tf has a frame for each robot in `world`, /poses all poses, /walls and /robots what is solid, /links who heard
    (white) and did not hear (red) whom, /map the collective map, /robot_I/map each robot's own map every tenth
    iteration, /numbers the task's curve and the counts of messages, /events what happened, and /readings/CHANNEL what
    each robot's sensors gave, but for tiles, which maps show: numbers in lists, null for nothing.
    """
    scene = Scene(recording)
    context = foxglove.Context()
    with foxglove.open_mcap(out, context=context, allow_overwrite=True):
        walls, robots, links = (
            channels.SceneUpdateChannel(f"/{n}", context=context) for n in ("walls", "robots", "links")
        )
        frames = channels.FrameTransformsChannel("/tf", context=context)
        poses = channels.PosesInFrameChannel("/poses", context=context)
        union = channels.GridChannel("/map", context=context)
        own = [channels.GridChannel(f"/robot_{robot}/map", context=context) for robot in range(scene.robots)]
        events = channels.LogChannel("/events", context=context)
        numbers = foxglove.Channel("/numbers", context=context)
        measured = {one: foxglove.Channel(f"/readings/{one.name}", context=context) for one in shown(recording)}
        walls.log(fm.SceneUpdate(entities=[_walls(scene)]), log_time=0)
        robots.log(fm.SceneUpdate(entities=[_body(scene, robot) for robot in range(scene.robots)]), log_time=0)
        for row in range(recording.iterations):
            shot = scene.at(row)
            now = round(1e9 * row * scene.period)
            stamp = fm.Timestamp(now // 1_000_000_000, now % 1_000_000_000)
            frames.log(_frames(stamp, shot.pose), log_time=now)
            placed = [_pose(*pose) for pose in shot.pose.tolist()]
            poses.log(fm.PosesInFrame(timestamp=stamp, frame_id=WORLD, poses=placed), log_time=now)
            links.log(fm.SceneUpdate(entities=[_links(stamp, shot)]), log_time=now)
            heard, lost = scene.messages(row)
            value = float(scene.curve.scale * scene.curves.union[row])
            numbers.log({scene.curve.name: value, "heard": heard, "lost": lost}, log_time=now)
            for channel, topic in measured.items():
                rows = recording[channel.recorded_as][row]
                topic.log({"unit": channel.unit, "robots": plain(rows)}, log_time=now)
            if scene.has_maps:
                union.log(_grid(stamp, scene, scene.cells(row)), log_time=now)
                for robot in range(scene.robots) if row % OWN_MAPS == 0 or row == recording.iterations - 1 else ():
                    own[robot].log(_grid(stamp, scene, scene.own_cells(robot, row)), log_time=now)
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


def _grid(stamp: fm.Timestamp, scene: Scene, cells: NDArray[np.uint8]) -> fm.Grid:
    lattice = scene.lattice
    data = np.full(cells.shape, UNKNOWN_CELL, np.uint8)
    for state, value in CELLS.items():
        data[cells == state] = value
    return fm.Grid(
        timestamp=stamp, frame_id=WORLD, pose=_pose(lattice.x0, lattice.y0), column_count=lattice.columns,
        cell_size=fm.Vector2(x=lattice.cell, y=lattice.cell), row_stride=lattice.columns, cell_stride=1,
        fields=[fm.PackedElementField(name="occupancy", offset=0, type=fm.PackedElementFieldNumericType.Uint8)],
        data=data.tobytes(),
    )  # fmt: skip


def _walls(scene: Scene) -> fm.SceneEntity:
    rings = [
        ring for layer in scene.layers.values() for part in layer.geoms for ring in (part.exterior, *part.interiors)
    ]
    lines = [
        fm.LinePrimitive(
            type=fm.LinePrimitiveLineType.LineStrip, thickness=0.03, color=_colour((140, 148, 160)),
            points=[fm.Point3(x=x, y=y, z=0.0) for x, y in shapely.get_coordinates(ring).tolist()],
        )
        for ring in rings
    ]  # fmt: skip
    return fm.SceneEntity(frame_id=WORLD, id="walls", lines=lines)


def _body(scene: Scene, robot: int) -> fm.SceneEntity:
    radius = float(scene.radii[robot])
    cylinder = fm.CylinderPrimitive(
        pose=_pose(0.0, 0.0, z=radius), size=fm.Vector3(x=2 * radius, y=2 * radius, z=2 * radius), bottom_scale=1.0,
        top_scale=1.0, color=_colour(colour_of(robot)),
    )  # fmt: skip
    return fm.SceneEntity(frame_id=f"robot_{robot}", id=f"robot_{robot}", frame_locked=True, cylinders=[cylinder])


def _links(stamp: fm.Timestamp, shot: Frame) -> fm.SceneEntity:
    """Messages as lines from sender to receiver: one list of those heard, one of those lost."""
    both = [shot.mutual, shot.mutual[:, ::-1], shot.one_way]
    lines = [
        fm.LinePrimitive(
            type=fm.LinePrimitiveLineType.LineList, thickness=0.02, color=_colour(colour),
            points=[
                fm.Point3(x=float(shot.pose[robot, 0]), y=float(shot.pose[robot, 1]), z=0.1)
                for receiver, sender in pairs.tolist() for robot in (sender, receiver)
            ],
        )
        for pairs, colour in ((np.concatenate(both), DARK.link), (shot.lost, DARK.lost))
    ]  # fmt: skip
    return fm.SceneEntity(timestamp=stamp, frame_id=WORLD, id="links", lines=lines)


def _colour(colour: Colour) -> fm.Color:
    red, green, blue = (part / 255.0 for part in colour)
    return fm.Color(r=red, g=green, b=blue, a=1.0)
