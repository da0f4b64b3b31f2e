"""What a replay page needs of a recording: numbers packed small, words as they are."""

from __future__ import annotations

import json
import zlib
from base64 import b64encode
from dataclasses import asdict

import numpy as np
import shapely
import tomli_w
from numpy.typing import NDArray

from swarmsim.core.events import BoxGone, BoxStands
from swarmsim.core.scenario.file import table_of
from swarmsim.recording.reader import Recording, Summary
from swarmsim.view.panel import clock
from swarmsim.view.scene import Scene
from swarmsim.view.theme import ROBOTS, THEMES

MILLI = 1000.0  # poses are kept in mm and mrad
MARKS = ("", "fault", "removed", "late", "joined")
MOST_BEAMS = 4_000_000  # ends of beams; a page with more would be too large
STEPS = 255  # of a beam's reach


def payload(recording: Recording) -> dict[str, str]:
    """The run as two texts that fit into a page: `words` (JSON) and `numbers` (base64 of deflated arrays)."""
    scene = Scene(recording)
    arrays = _arrays(recording, scene)
    blob = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays.values())
    words = {
        **_words(recording, scene),
        "arrays": [[name, array.dtype.str[1:], list(array.shape)] for name, array in arrays.items()],
    }
    # "</script" would end the page's script wherever it stands, and "<!--<script" would let it go on for ever.
    text = json.dumps(words, separators=(",", ":")).replace("<", "\\u003c")
    return {"words": text, "numbers": b64encode(zlib.compress(blob, 9)).decode()}


def _arrays(recording: Recording, scene: Scene) -> dict[str, NDArray[np.generic]]:
    rows = range(recording.iterations)
    pose = np.rint(MILLI * recording["pose"]).astype(np.int32)
    marks = np.array([[MARKS.index(mark) for mark in scene.marks_at(row)] for row in rows], np.uint8)
    letters = recording["letters"]
    arrays: dict[str, NDArray[np.generic]] = {
        "pose": np.diff(pose, axis=0, prepend=np.zeros_like(pose[:1])),
        "alive": recording["alive"].astype(np.uint8),
        "marks": marks,
        "letters": letters[:, [0, 1, 4]].astype(np.uint16),
        "letters_end": recording["letters_end"].astype(np.uint32),
        "curve": recording[scene.curve.name].astype(np.float32),
        "paths": recording["paths"].astype(np.uint32),
        "waypoints": recording["waypoints"].astype(np.float32),
    }
    if scene.has_maps:
        changes = recording["changes"]
        arrays |= {
            "changed_robot": changes[:, 0].astype(np.uint16),
            "changed_cell": changes[:, 1].astype(np.uint32),
            "changed_state": changes[:, 2].astype(np.uint8),
            "changes_end": recording["changes_end"].astype(np.uint32),
        }
    if scene.curve.robots is not None:
        arrays["each"] = recording.rows(scene.curve.robots, scene.robots).astype(np.float32)
    if "origins" in recording:
        arrays["origins"] = recording["origins"].astype(np.int16)
    if scene.has_headings:
        arrays["heading"] = recording.rows("heading", scene.robots).astype(np.float32)
    for name in ("goals", "people", "believed"):
        if name in recording:
            arrays[name] = recording[name].astype(np.int16 if name == "goals" else np.float32)
    beams = _beams(recording, scene)
    if beams is not None:
        arrays["beams"] = beams
    return arrays


def _beams(recording: Recording, scene: Scene) -> NDArray[np.uint8] | None:
    """How far each beam goes (iterations, n, b), in steps of its reach; None without rings or for too many."""
    shots = (scene.at(row) for row in range(recording.iterations))
    first = scene.at(0)
    counts = {len(scene.beams(robot, first)) for robot in range(scene.robots)}
    if len(counts) > 1 or not min(counts) or recording.iterations * scene.robots * max(counts) > MOST_BEAMS:
        return None
    reach = np.array([scene.beam_reach(robot) for robot in range(scene.robots)])
    lengths = [[scene.beams(robot, shot) for robot in range(scene.robots)] for shot in shots]
    return np.asarray(np.rint(STEPS * np.array(lengths) / reach[:, None]).astype(np.uint8))


def _words(recording: Recording, scene: Scene) -> dict[str, object]:
    summary, lattice, curve = recording.summary(), recording.lattice, recording.curve
    name, _, unit = curve.label.partition(", ")
    themes = {name: asdict(theme) for name, theme in THEMES.items()}
    return {
        "title": scene.title,
        "period": scene.period,
        "iterations": recording.iterations,
        "robots": scene.robots,
        "radii": scene.radii.tolist(),
        "bounds": scene.bounds,
        "lattice": [lattice.x0, lattice.y0, lattice.cell, lattice.rows, lattice.columns],
        "tile": list(scene.tile),
        "layers": {name: [_rings(part) for part in shape.geoms] for name, shape in scene.layers.items()},
        "floor": [_ring(part.exterior) for part in scene.footprint],
        "curve": {
            "name": name,
            "unit": unit,
            "scale": curve.scale,
            "limits": scene.limits,
            "digits": _digits(curve.format),
        },
        "fates": recording.fates,
        "marks": MARKS,
        "boxes": _boxes(recording),
        "bearings": scene.bearings,
        "reaches": [scene.beam_reach(robot) for robot in range(scene.robots)],
        "notes": [[note.iteration, note.words] for note in scene.notes],
        "colours": ROBOTS,
        "themes": themes,
        "summary": _summary(summary, scene),
        "scenario": tomli_w.dumps(table_of(recording.scenario)),
        "provenance": {"digest": summary["digest"], "seed": summary["seed"], **summary["versions"]},
    }


def _summary(summary: Summary, scene: Scene) -> dict[str, str]:
    lost = ", ".join(f"{reason} {count}" for reason, count in summary["lost"].items() if count)
    reached = ", ".join(f"{share} at {at}" for share, at in summary["reached"].items() if at is not None)
    return {
        "status": f"{summary['status']} after {summary['iterations']} iterations",
        "simulated time": clock(summary["iterations"] * scene.period),
        **{name.replace("_", " "): _worded(name, value, scene) for name, value in summary["measures"].items()},
        "reached": reached or "-",
        "robots alive": f"{summary['alive']} of {summary['robots']}",
        "network": scene.topology,
        "messages heard": f"{summary['messages']}, {summary['bytes']} bytes",
        "messages lost": lost or "none",
    }


def _worded(name: str, value: float, scene: Scene) -> str:
    """A measure; that of the curve in its unit."""
    curve = scene.curve
    unit = curve.label.partition(", ")[2]
    return f"{curve.scale * value:{curve.format}} {unit}".rstrip() if name == curve.name else f"{value:.4g}"


def _boxes(recording: Recording) -> list[tuple[list[float], int, int]]:
    """Each box with its first iteration and the one in which it is gone: [box, from, to]."""
    boxes: list[tuple[list[float], int, int]] = []
    for event in recording.events():
        if isinstance(event, BoxStands):
            boxes.append((list(event.box), event.iteration, recording.iterations + 1))
        elif isinstance(event, BoxGone):
            stands = enumerate(boxes)
            at = next(at for at, (box, _, end) in stands if box == list(event.box) and end > event.iteration)
            boxes[at] = (*boxes[at][:2], event.iteration)
    return boxes


def _rings(part: shapely.Polygon) -> list[list[float]]:
    return [_ring(ring) for ring in (part.exterior, *part.interiors)]


def _ring(ring: shapely.LinearRing) -> list[float]:
    numbers: list[float] = np.round(shapely.get_coordinates(ring), 3).ravel().tolist()
    return numbers


def _digits(how: str) -> int:
    """The decimal places of a format such as .1f; of others, three."""
    return int(how[1]) if how[:1] == "." and how[-1:] == "f" else 3
