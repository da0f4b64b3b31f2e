"""A recording as .rrd, which the Rerun viewer opens."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.state import UNKNOWN
from swarmsim.recording.reader import Recording
from swarmsim.view.scene import Scene
from swarmsim.view.theme import DARK, colour_of
from swarmsim.view.viewers.cells import CELLS, UNKNOWN_CELL


def write_rrd(recording: Recording, out: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Write a run to `out`, on the timelines `iteration` and `time` (simulated).

    world/walls, world/robots (with headings), world/links, world/lost, world/map (an occupancy grid), `curve`,
    `messages` and `events`. Y points down in Rerun's 2D views, so all y are turned over.
    Raises InputError where rerun-sdk is not installed.
    """
    try:
        import rerun as rr
    except ImportError as problem:
        raise InputError("--rerun needs rerun-sdk; install it with: pip install 'swarmsim-lab[rerun]'") from problem
    scene, lattice = Scene(recording), recording.lattice
    stream = rr.RecordingStream("swarmsim", recording_id=recording.digest())
    log = stream.binary_stream()  # a file of the SDK's own tells of a full disk in lines of a log and a RuntimeError
    solid = [part for layer in scene.layers.values() for part in layer.geoms]
    rings = [_turned(shapely.get_coordinates(ring)) for part in solid for ring in (part.exterior, *part.interiors)]
    stream.log("world/walls", rr.LineStrips2D(rings, colors=(140, 148, 160), radii=0.02), static=True)
    colours, ids = [colour_of(robot) for robot in range(scene.robots)], [str(robot) for robot in range(scene.robots)]
    origin = (lattice.x0, -lattice.y0 - lattice.rows * lattice.cell, 0.0)
    shape = rr.components.ImageFormat(
        width=lattice.columns, height=lattice.rows, color_model="L", channel_datatype="U8"
    )
    for row in range(recording.iterations):
        shot = scene.at(row)
        stream.set_time("iteration", sequence=row)
        stream.set_time("time", duration=row * scene.period)
        places = _turned(shot.pose[:, :2])
        ahead = np.column_stack([np.cos(shot.pose[:, 2]), -np.sin(shot.pose[:, 2])])
        stream.log("world/robots", rr.Points2D(places, radii=scene.radii, colors=colours, labels=ids))
        stream.log(
            "world/headings", rr.Arrows2D(vectors=2.5 * scene.radii[:, None] * ahead, origins=places, colors=colours)
        )
        heard = np.concatenate([shot.mutual, shot.mutual[:, ::-1], shot.one_way])
        for name, pairs, colour in (("links", heard, DARK.link), ("lost", shot.lost, DARK.lost)):
            stream.log(f"world/{name}", rr.LineStrips2D(places[pairs[:, ::-1]], colors=colour, radii=0.01))
        if scene.has_maps:
            cells = scene.cells(row)
            grid = np.full(cells.shape, UNKNOWN_CELL, np.uint8)
            for state, value in CELLS.items():
                assert state != UNKNOWN
                grid[cells == state] = value
            colormap = rr.components.Colormap.RvizMap
            data = np.ascontiguousarray(grid[::-1]).tobytes()  # pictures begin at the top
            stream.log("world/map", rr.GridMap(data=data, format=shape, cell_size=lattice.cell, translation=origin,
                                               colormap=colormap))  # fmt: skip
        told, missed = scene.messages(row)
        stream.log("curve", rr.Scalars(float(scene.curve.scale * scene.curves.union[row])))
        stream.log("messages", rr.Scalars([told, missed]))
        for note in scene.notes:
            if note.iteration == row:
                stream.log("events", rr.TextLog(note.words))
        if progress is not None:
            progress(row + 1, recording.iterations)
    stream.disconnect()
    out.write_bytes(log.read() or b"")


def _turned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (p, 2) with y downwards."""
    return points * (1.0, -1.0)
