"""The parts of a recording that a replay page needs: packed numbers, plain words."""

from __future__ import annotations

import json
import zlib
from base64 import b64encode
from dataclasses import asdict

import numpy as np
import tomli_w
from numpy.typing import NDArray

from swarmsim.core.scenario.file import table_of
from swarmsim.recording.reader import Recording, Summary
from swarmsim.view.layers.jobs import job_layers
from swarmsim.view.page.tracks import MILLI, Tracks
from swarmsim.view.panel import clock
from swarmsim.view.scene import Scene
from swarmsim.view.theme import ROBOTS, THEMES

MARKS = ("", "fault", "removed", "late", "joined")


def payload(recording: Recording) -> dict[str, str]:
    """The run as two texts for a page: `words` (JSON) and `numbers` (base64 of deflated arrays)."""
    scene = Scene(recording)
    tracks = Tracks(scene)
    arrays = {**_arrays(recording, scene), **tracks.arrays}
    blob = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays.values())
    words = {
        **_words(recording, scene),
        "tracks": tracks.words,
        "scales": [layer.scale for layer in job_layers(scene) if layer.scale],
        "texts": tracks.texts,
        "inks": {name: [theme.ink(ink) for ink in tracks.inks] for name, theme in THEMES.items()},
        "arrays": [[name, array.dtype.str[1:], list(array.shape)] for name, array in arrays.items()],
    }
    # "</script" would end the page's script wherever it stands, and "<!--<script" would let it go on for ever.
    text = json.dumps(words, separators=(",", ":")).replace("<", "\\u003c")
    return {"words": text, "numbers": b64encode(zlib.compress(blob, 9)).decode()}


def _arrays(recording: Recording, scene: Scene) -> dict[str, NDArray[np.generic]]:
    rows = range(recording.iterations)
    pose = np.rint(MILLI * recording["pose"]).astype(np.int32)
    marks = np.array([[MARKS.index(mark) for mark in scene.marks_at(row)] for row in rows], np.uint8)
    arrays: dict[str, NDArray[np.generic]] = {
        "pose": np.diff(pose, axis=0, prepend=np.zeros_like(pose[:1])),
        "alive": recording["alive"].astype(np.uint8),
        "marks": marks,
        "told": np.array([scene.messages(row) for row in rows], np.uint32),
        "curve": recording[scene.curve.name].astype(np.float32),
    }
    if scene.curve.robots is not None:
        arrays["each"] = recording.rows(scene.curve.robots, scene.robots).astype(np.float32)
    return arrays


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
        "curve": {
            "name": name,
            "unit": unit,
            "scale": curve.scale,
            "limits": scene.limits,
            "digits": _digits(curve.format),
        },
        "marks": MARKS,
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
    """A measure's text; the curve's measure is in its unit."""
    curve = scene.curve
    unit = curve.label.partition(", ")[2]
    return f"{curve.scale * value:{curve.format}} {unit}".rstrip() if name == curve.name else f"{value:.4g}"


def _digits(how: str) -> int:
    """The decimal places of a format such as .1f; three for others."""
    return int(how[1]) if how[:1] == "." and how[-1:] == "f" else 3
