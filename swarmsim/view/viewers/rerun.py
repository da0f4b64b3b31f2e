"""A recording as .rrd, which the Rerun viewer opens."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.drawing import (
    Circles,
    Inks,
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
from swarmsim.recording.columns import shown
from swarmsim.recording.reader import Recording
from swarmsim.view.layers import LayerStack
from swarmsim.view.scene import Scene
from swarmsim.view.theme import DARK, Colour
from swarmsim.view.viewers.cells import coloured

THIN = 0.01  # m: half the breadth of lines


def write_rrd(recording: Recording, out: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Write a run to `out`, on the timelines `iteration` and `time` (simulated).

    world/LAYER/NAME has what each layer draws, in the colours of the dark theme, whenever it changes, as in
    world/links/mutual and world/map/known. Besides `curve`, `messages`, `events` and, in readings/CHANNEL, what
    robots' sensors gave but tiles, which the map shows. Y points down in Rerun's 2D views, so all y are turned over.
    Raises InputError where rerun-sdk is not installed.
    """
    try:
        import rerun as rr
    except ImportError as problem:
        raise InputError("--rerun needs rerun-sdk; install it with: pip install 'swarmsim-lab[rerun]'") from problem
    scene = Scene(recording)
    stream = rr.RecordingStream("swarmsim", recording_id=recording.digest())
    log = stream.binary_stream()  # a file of the SDK's own tells of a full disk in lines of a log and a RuntimeError
    layers = LayerStack(scene)
    before: dict[str, Mark] = {}
    for row in range(recording.iterations):
        shot = scene.at(row)
        stream.set_time("iteration", sequence=row)
        stream.set_time("time", duration=row * scene.period)
        now: dict[str, Mark] = {}
        for layer in layers.all:
            for mark in layer.draw(shot) if row == 0 else (one for one in layer.draw(shot) if not one.still):
                path = f"world/{layer.name}/{(mark.name or 'shapes').replace(' ', '-')}"
                now[f"{path}-{len(now)}" if path in now else path] = mark
        for path in sorted(before.keys() - now.keys()):
            stream.log(path, rr.Clear(recursive=False))
        for path, mark in now.items():
            if path not in before or not alike([mark], [before[path]]):
                stream.log(path, _archetype(rr, mark, scene.radii), static=mark.still)
        before = {path: mark for path, mark in now.items() if not mark.still}
        for channel in shown(recording):
            rows = recording[channel.recorded_as][row]
            entry = rr.Tensor(rows) if channel.shape else rr.Scalars(rows.astype(np.float64))
            stream.log(f"readings/{channel.name}", entry)
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


def _archetype(rr: ModuleType, mark: Mark, radii: Reals) -> object:
    """Shapes as Rerun draws them in the plane: areas only as outlines, for it has no others."""
    match mark:
        case Circles() if not mark.stroke:
            return rr.Points2D(
                _turned(mark.centre), radii=sizes(mark, radii), colors=_colours(mark.ink, len(mark.centre))
            )
        case Circles():
            around = np.linspace(0.0, 2.0 * np.pi, 25)
            turned = np.stack([np.cos(around), np.sin(around)], axis=1)
            hoops = mark.centre[:, None] + sizes(mark, radii)[:, None, None] * turned
            return rr.LineStrips2D(_turned(hoops), colors=_colours(mark.ink, len(hoops)), radii=THIN)
        case Polygons():
            corners = [
                np.concatenate([ring, ring[:1]]) for ring in np.split(_turned(placed(mark, radii)), mark.ends[:-1])
            ]
            inks = _colours(mark.ink or mark.edge or "edge", len(corners))
            return rr.LineStrips2D(corners if len(mark.ends) else [], colors=inks, radii=THIN, draw_order=mark.z)
        case Lines():
            lines = np.split(_turned(mark.points), mark.ends[:-1]) if len(mark.ends) else []
            return rr.LineStrips2D(lines, colors=_colours(mark.ink, len(lines)), radii=THIN, draw_order=mark.z)
        case Rays():
            tips = _turned(mark.tips).reshape(-1, 2)
            starts = np.repeat(_turned(mark.at), len(mark.bearings), axis=0)
            inks = [colour for colour in _colours(mark.ink, len(mark.at)) for _ in mark.bearings]
            return rr.LineStrips2D(np.stack([starts, tips], axis=1), colors=inks, radii=THIN, draw_order=mark.z)
        case Texts():
            return rr.Points2D(
                _turned(mark.at), labels=list(mark.texts), colors=_colours(mark.ink, len(mark.at)), radii=THIN
            )
        case Raster():
            rows, columns = mark.values.shape
            pixels = np.ascontiguousarray(coloured(mark, DARK)[::-1])  # pictures begin at the top
            shape = rr.components.ImageFormat(width=columns, height=rows, color_model="RGBA", channel_datatype="U8")
            place = (mark.corner[0], -mark.corner[1] - rows * mark.cell, 0.0)
            return rr.GridMap(data=pixels.tobytes(), format=shape, cell_size=mark.cell, translation=place)


def _colours(inks: Inks, count: int) -> list[Colour]:
    return [DARK.ink(ink) for ink in each(inks, count)]


def _turned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (..., 2) with y downwards."""
    return points * (1.0, -1.0)
