"""All that layers draw during a run, packed small: for each kind of shapes the changes of each column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.drawing import Ink, Lines, Mark, Polygons, Raster, Rays, count_of, inks_of
from swarmsim.view.layers import LayerStack
from swarmsim.view.scene import Frame, Scene

Array = NDArray[np.generic]
MILLI: Final = 1000.0  # places are kept in mm, angles in mrad, lengths in cm
WORD: Final = 8  # bytes
MOST_RAYS: Final = 4_000_000  # in the whole run; a page with more would be too large


class Track(NamedTuple):
    """One kind of shapes of a layer: its constants in words, and its columns row by row."""

    words: dict[str, object]
    states: dict[str, list[tuple[int, Array]]]  # by column: from which row on it is what
    cells: list[tuple[int, Array, Array]]  # of a raster: in which row which of them become what
    before: dict[str, Array]  # of a raster: its values


class Tracks:
    """The shapes of a run, as the `arrays` and `words` that a page needs."""

    def __init__(self, scene: Scene) -> None:
        self._tracks: dict[object, Track] = {}
        self.inks: list[Ink] = []
        self.texts: list[str] = []
        # By the addresses of two rasters: where they differ, and the rasters, whose addresses are not given away then.
        self._compared: dict[tuple[int, int], tuple[NDArray[np.int64], Array, Array]] = {}
        layers, everybody = LayerStack(scene), tuple(range(scene.robots))
        refused: set[str] = set()
        for row in range(scene.iterations):
            self._compared.clear()
            shot = scene.at(row, None, everybody)
            drawn: set[object] = set()
            for layer in layers.all:
                marks = [] if layer.name in refused else layer.draw(shot)
                rays = sum(mark.length.size for mark in marks if isinstance(mark, Rays))
                if rays * scene.iterations > MOST_RAYS:
                    refused.add(layer.name)
                    continue
                drawn |= self._take(row, layer.name, _joined(marks), shot, None)
                for robot in everybody if any(isinstance(mark, Raster) and mark.each for mark in marks) else ():
                    own = [mark for mark in layer.draw(replace(shot, focus=robot)) if isinstance(mark, Raster)]
                    drawn |= self._take(row, layer.name, own, shot, robot)
            for key in self._tracks.keys() - drawn:
                _note(self._tracks[key].states.setdefault("count", []), row, np.zeros(1, np.uint16))
        self.arrays: dict[str, Array] = {}
        self.words = [self._packed(number, track) for number, track in enumerate(self._sorted())]

    def _sorted(self) -> list[Track]:
        return sorted(self._tracks.values(), key=lambda track: float(str(track.words["z"])))

    def _take(self, row: int, layer: str, marks: Sequence[Mark], shot: Frame, robot: int | None) -> set[object]:
        """Record the shapes of one moment; gives the keys of their tracks."""
        seen: set[object] = set()
        for mark in marks:
            words, columns = self._parted(mark, shot)
            words |= {"layer": layer, "kind": type(mark).__name__, "robot": robot}
            key: object = repr(words)
            while key in seen:
                key = (key,)
            seen.add(key)
            track = self._tracks.setdefault(key, Track(words, {}, [], {}))
            if isinstance(mark, Raster):
                places = self._changed(track, mark.values)
                if len(places):
                    track.cells.append((row, places, mark.values.ravel()[places]))
            for name, column in columns.items():
                _note(track.states.setdefault(name, []), row, column)
        return seen

    def _changed(self, track: Track, values: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Which cells of a raster are others than before; robots often share one that nobody can write to."""
        before = track.before.get("values")
        if before is None:
            before = np.zeros(values.shape, values.dtype)
        if not values.flags.writeable:
            track.before["values"] = values
            pair = id(before), id(values)
            if pair not in self._compared:
                self._compared[pair] = _differing(values.ravel(), before.ravel()), before, values
            return self._compared[pair][0]
        places = _differing(values.ravel(), before.ravel())
        track.before["values"] = before = before if before.flags.writeable else before.copy()
        before.ravel()[places] = values.ravel()[places]
        return places

    def _parted(self, mark: Mark, shot: Frame) -> tuple[dict[str, object], dict[str, Array]]:
        """The words common to all shapes, and the columns with a number for each."""
        words: dict[str, object] = {}
        columns: dict[str, Array] = {}
        self.inks += [ink for ink in dict.fromkeys(inks_of(mark)) if ink not in self.inks]
        for field in fields(mark):
            value = getattr(mark, field.name)
            if field.name == "values":
                words["shape"] = list(value.shape)
            elif isinstance(value, np.ndarray):
                columns[field.name] = _whole(field.name, value)
            elif field.name in ("ink", "edge") and value is not None and not isinstance(value, str):
                columns[field.name] = np.array([self.inks.index(ink) for ink in value], np.uint16)
            elif field.name in ("ink", "edge", "casing"):
                words[field.name] = None if value is None else self.inks.index(value)
            elif field.name == "texts":
                self.texts += [text for text in dict.fromkeys(value) if text not in self.texts]
                columns["texts"] = np.array([self.texts.index(text) for text in value], np.uint32)
            elif field.name == "palette":
                words[field.name] = [[*step[:2], *map(self.inks.index, step[2:])] for step in value]
            else:
                words[field.name] = list(value) if isinstance(value, tuple | list) else value
        _ride(mark, shot, words, columns)
        count = 1 if isinstance(mark, Raster) else count_of(mark)
        return words, {**columns, "count": np.array([count], np.uint16)}

    def _packed(self, number: int, track: Track) -> dict[str, object]:
        """The track in words, with the names of its columns' arrays."""
        columns: dict[str, object] = {}
        for name, states in track.states.items():
            stem = f"{number}.{name}"
            starts, values = np.array([start for start, _ in states], np.uint32), [value for _, value in states]
            sizes = np.array([value.size for value in values], np.uint32)
            delta = len(set(sizes.tolist())) == 1 and len(values) > 1 and values[0].dtype.kind in "iu"
            flat = np.stack(values).astype(np.int32) if delta else np.concatenate([value.ravel() for value in values])
            if delta:
                first = flat.reshape(len(values), -1)
                flat = np.diff(first, axis=0, prepend=np.zeros_like(first[:1]))
            ends = self._kept(f"{stem}.ends", np.cumsum(sizes).astype(np.uint32))
            columns[name] = [self._kept(f"{stem}.starts", starts), ends, self._kept(stem, _smallest(flat)), int(delta)]
        if track.cells:
            columns["values"] = self._changes(f"{number}.values", track.cells)
        return {**track.words, "columns": columns}

    def _changes(self, stem: str, cells: list[tuple[int, Array, Array]]) -> list[object]:
        """Changed cells with their new values; a moment's places are stored as differences."""
        steps = np.concatenate([np.diff(np.asarray(places, np.int64), prepend=0) for _, places, _ in cells])
        ends = np.cumsum([len(places) for _, places, _ in cells]).astype(np.uint32)
        starts = np.array([row for row, _, _ in cells], np.uint32)
        to = np.concatenate([values for _, _, values in cells])
        kept = (("starts", starts), ("ends", ends), ("cells", _smallest(steps)), ("to", to))
        return [self._kept(f"{stem}.{name}", array) for name, array in kept]

    def _kept(self, name: str, array: Array) -> str:
        """The name of this array; equal ones are kept once."""
        for other, kept in self.arrays.items():
            if kept.dtype == array.dtype and kept.shape == array.shape and np.array_equal(kept, array):
                return other
        self.arrays[name] = array
        return name


def _joined(marks: Sequence[Mark]) -> list[Mark]:
    """The same shapes with consecutive robots' rays merged if their bearings are equal."""
    rays = [mark for mark in marks if isinstance(mark, Rays)]
    if len(rays) < 2 or any(not np.array_equal(mark.bearings, rays[0].bearings) for mark in rays):
        return list(marks)
    places = {name: np.concatenate([getattr(mark, name) for mark in rays]) for name in ("at", "yaw", "length", "of")}
    return [*(mark for mark in marks if not isinstance(mark, Rays)), replace(rays[0], **places)]  # type: ignore[arg-type]


def _ride(mark: Mark, shot: Frame, words: dict[str, object], columns: dict[str, Array]) -> None:
    """Leave out the places of shapes that move with robots: a page has the poses."""
    if isinstance(mark, Rays) or getattr(mark, "rides", False):
        words["rides"] = True
        columns.pop("at", None)
        columns.pop("centre", None)
        yaw, of = getattr(mark, "yaw", None), getattr(mark, "of", None)
        words["turns"] = yaw is not None and of is not None and np.array_equal(yaw, shot.pose[of, 2])
        if words["turns"]:
            del columns["yaw"]
    if isinstance(mark, Lines) and mark.on is not None:
        columns["points"] = np.where(mark.on[:, None] >= 0, 0, columns["points"])
    if isinstance(mark, Polygons | Lines):
        sizes = mark.ends.astype(np.uint16)
        sizes[1:] -= sizes[:-1].copy()  # what goes over the largest number comes back
        columns["ends"] = sizes


def _whole(name: str, value: Array) -> Array:
    """The column in whole numbers: mm, mrad, cm, thousandths."""
    if value.dtype.kind == "f":
        return np.rint(np.asarray(value, np.float64) * (100.0 if name == "length" else MILLI)).astype(np.int32)
    return value.astype(np.int32)


def _smallest(array: Array) -> Array:
    """The same numbers in the smallest type that holds them."""
    low, high = (int(array.min()), int(array.max())) if array.size else (0, 0)
    kinds = (np.uint8, np.uint16, np.uint32) if low >= 0 else (np.int16, np.int32)
    kind = next(kind for kind in kinds if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max)
    return array.astype(kind)


def _note(states: list[tuple[int, Array]], row: int, column: Array) -> None:
    """Record a column's state if it has changed."""
    if not states or states[-1][1].shape != column.shape or not np.array_equal(states[-1][1], column):
        states.append((row, column.copy()))


def _differing(new: Array, before: Array) -> NDArray[np.int64]:
    """Where two rasters (n,) of bytes differ; words of them are compared first, as most are equal."""
    whole = new.size - new.size % WORD
    words = np.flatnonzero(new[:whole].view(np.uint64) != before[:whole].view(np.uint64))
    places = np.concatenate([(words[:, None] * WORD + np.arange(WORD)).ravel(), np.arange(whole, new.size)])
    found: NDArray[np.int64] = places[new[places] != before[places]]
    return found
