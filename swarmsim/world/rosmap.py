"""Maps of ROS: map_server's YAML and image, in and out, and the values of an OccupancyGrid."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Annotated, Final, Literal

import numpy as np
import yaml
from msgspec import Meta, Struct, field
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from shapely import MultiPolygon, affinity

from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.lattice import Lattice
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.files import check_plain
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.world.endings import PICTURES
from swarmsim.world.plan import FloorPlan
from swarmsim.world.tracing import traced
from swarmsim.world.viewport import LARGEST

MOST_PIXELS: Final = 64_000_000  # of an image, at a few bytes each
_LEVELS: Final = {UNKNOWN: 205, FREE: 254, OCCUPIED: 0}  # of the pixels that map_server's saver writes
_OCCUPIED, _FREE = 0.65, 0.196  # the thresholds it writes; 205 is p = 0.19608, just unknown
_DARK: Final = 127  # the lightest level of a wall in a picture without thresholds
_BROKEN: Final = (OSError, ValueError, SyntaxError, IndexError, TypeError, OverflowError, MemoryError)  # of Pillow
_DECIMALS: Final = 9  # of an origin in m, so that it does not read -13.399999999999999
_VALUES: Final = {UNKNOWN: -1, FREE: 0, OCCUPIED: 100}  # of nav_msgs/OccupancyGrid

Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class MapFile(Struct, frozen=True, kw_only=True):
    """The YAML file of a map_server pair; other programs' keys are ignored.

    `origin` is the pose (m, m, rad) of the lower left pixel's corner.
    """

    image: str
    resolution: Annotated[float, Meta(gt=0.0, le=LARGEST)]  # m, one pixel
    origin: Annotated[list[float], Meta(min_length=2, max_length=3)] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    negate: bool | Annotated[int, Meta(ge=0, le=1)] = 0
    occupied_thresh: Share = _OCCUPIED
    free_thresh: Share = _FREE
    mode: Literal["trinary", "scale", "raw"] = "trinary"


@dataclass(frozen=True, slots=True)
class Bitmap:
    """A map in pixels."""

    states: NDArray[np.uint8]  # (rows, columns): UNKNOWN, FREE or OCCUPIED; row 0 lies at the bottom
    resolution: float  # m, one pixel
    origin: tuple[float, float, float]  # m, m, rad: the pose of the lower left pixel's corner
    notices: tuple[str, ...] = ()  # deviations from the file's claims, in sentences without its name

    def plan(self, name: str, cell: float, unknown_is_wall: bool) -> FloorPlan:
        """The floor plan; its outlines stray from the pixels' by half a cell and 1.5 pixels at most.

        Pixels at least as large as cells are kept exactly. All solids are traced at once, with unknown pixels if they
        count as walls, so that no seams lie between them.
        """
        rows, columns = self.states.shape
        tolerance = min(1.5, 0.5 * cell / self.resolution) if self.resolution < 0.999 * cell else 0.0
        x, y, yaw = self.origin
        cos, sin = self.resolution * math.cos(yaw), self.resolution * math.sin(yaw)

        def outlined(pixels: NDArray[np.bool_]) -> MultiPolygon:
            shape = traced(pixels, tolerance)
            return MultiPolygon(affinity.affine_transform(shape, [cos, -sin, sin, cos, x, y]))

        corners = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) @ [[cos, sin], [-sin, cos]] + (x, y)
        (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
        if max(map(abs, (left, low, right, high))) > LARGEST:
            raise InputError(f"{name}: a corner lies farther than {LARGEST:g} m from the origin; is the origin right?")
        page = (float(left), float(low), float(right), float(high))
        walls, unknown = outlined(self.states == OCCUPIED), outlined(self.states == UNKNOWN)
        solid = outlined(self.states != FREE) if unknown_is_wall and not unknown.is_empty else walls
        layers = {"walls": walls, "pillars": MultiPolygon(), "furniture": MultiPolygon()}
        return FloorPlan(solid, layers, {}, page, unknown, tuple(f"{name}: {notice}" for notice in self.notices))


def read(path: Path, resolution: float | None = None) -> Bitmap:
    """A map_server pair, by its YAML file, or a picture with pixels `resolution` (m) wide.

    A picture without a resolution needs a YAML file of its name beside it. Dark pixels are walls. Raises InputError.
    """
    notices: tuple[str, ...] = ()
    if path.suffix.lower() in PICTURES:
        beside = next((one for end in (".yaml", ".yml") if (one := path.with_suffix(end)).is_file()), None)
        if resolution is not None:
            about = MapFile(image=path.name, resolution=resolution)
        elif beside is not None:
            about = _about(beside)
        else:
            raise InputError(
                f"{path}: how large is a pixel? Expected world = {{file = {path.name!r}, resolution = METRES}}, its "
                f"width in metres, or the file {path.with_suffix('.yaml').name} beside it"
            )
        image = path
    else:
        about = _about(path)
        image, notices = picture(about.image, path.parent)
    x, y, yaw = (*about.origin, 0.0)[:3]
    levels = _grey(image, about.mode)
    states = _states(levels, about)
    notices += _unknown_as_floor(levels, states, about)
    return Bitmap(states, about.resolution, (x, y, yaw), notices)


def image_of(path: Path) -> Path:
    """The image that a map_server YAML file names. Raises InputError."""
    return picture(_about(path).image, path.parent)[0]


def picture(named: str, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """The picture named by a file in `folder`, and a notice if it is found beside the file instead."""
    image = folder / named
    beside = folder / PureWindowsPath(named).name  # handles both kinds of slashes
    if image == beside or _is_file(image) or not _is_file(beside):
        return image, ()
    return beside, (f"it names the picture {named}, which is not here; {beside.name} beside it was taken",)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name that is too long, or holds a null character
        return False


def dark(path: Path, most: int = _DARK) -> NDArray[np.bool_]:
    """The pixels (rows, columns) up to a level of a picture's first channel, from the bottom up. Raises InputError."""
    with _opened(path) as opened:
        try:
            return np.asarray(np.asarray(opened.convert("RGB"))[::-1, :, 0] <= most)
        except _BROKEN as problem:
            raise InputError(f"{path}: a broken image; expected a whole PNG or PGM") from problem


def columns_of(path: Path) -> int:
    """The width of a picture in pixels. Raises InputError."""
    with _opened(path) as picture:
        return picture.width


def _about(path: Path) -> MapFile:
    """The contents of a YAML file. Messages never repeat its text."""
    try:
        check_plain(path, "the YAML file of a map_server pair", 1_000_000)
        table = yaml.safe_load(path.read_text(encoding="utf-8-sig"))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror}); expected a map_server YAML file") from problem
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as problem:
        mark = getattr(problem, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        raise InputError(f"{path}: {where}not YAML; expected a map_server YAML file") from None
    if not isinstance(table, dict):
        raise InputError(f"{path}: no keys in it; expected image, resolution and origin of a map_server pair")
    known = {key: table[key] for key in MapFile.__struct_fields__ if key in table}
    for key in ("resolution", "occupied_thresh", "free_thresh"):
        if isinstance(known.get(key), str):  # YAML 1.1 takes 5e-2 for a string
            known[key] = _number(known[key])
    try:
        about = convert(known, MapFile)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem
    if not all(map(math.isfinite, about.origin)):
        raise InputError(f"{path}: origin: not finite; expected [x, y, yaw]")
    if about.free_thresh > about.occupied_thresh:
        raise InputError(f"{path}: free_thresh: above occupied_thresh; expected it below")
    return about


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _opened(path: Path) -> Image.Image:
    """A picture of acceptable size, not decoded yet. Raises InputError."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected an image: PGM or PNG")
    check_plain(path, "an image: PGM or PNG", None)
    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None  # ours is checked below
    try:
        picture = Image.open(path)
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, TypeError, OverflowError) as problem:
        raise InputError(f"{path}: no image that can be read; expected PGM or PNG") from problem
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    if picture.width * picture.height > MOST_PIXELS:
        picture.close()
        raise InputError(
            f"{path}: {picture.width} x {picture.height} pixels; expected at most {MOST_PIXELS}, so scale it down"
        )
    if not picture.width * picture.height:
        raise InputError(f"{path}: {picture.width} x {picture.height} pixels; expected a picture with some")
    return picture


def _grey(path: Path, mode: str) -> NDArray[np.float32]:
    """Grey levels (rows, columns), 0 to 1, from the bottom up; NaN for transparent pixels."""
    with _opened(path) as picture:
        return _levels(picture, path, mode)


def _levels(picture: Image.Image, path: Path, mode: str) -> NDArray[np.float32]:
    try:
        picture.load()
        transparent = None
        if picture.mode in ("LA", "RGBA", "PA") or "transparency" in picture.info:
            rgba = np.asarray(picture.convert("RGBA"))
            transparent = rgba[..., 3] < 255
            levels = rgba[..., :3].mean(axis=2, dtype=np.float32) / np.float32(255.0)
        elif picture.mode in ("I", "I;16", "I;16B", "F"):
            levels = np.asarray(picture, np.float32)
            top = 65535.0 if picture.mode != "F" or levels.max(initial=0.0) > 1.0 else 1.0
            levels = np.clip(levels / np.float32(top), 0.0, 1.0)
        elif picture.mode in ("1", "L"):
            levels = np.asarray(picture.convert("L"), np.float32) / np.float32(255.0)
        else:
            levels = np.asarray(picture.convert("RGB")).mean(axis=2, dtype=np.float32) / np.float32(255.0)
    except _BROKEN as problem:
        raise InputError(f"{path}: a broken image; expected a whole PGM or PNG") from problem
    if transparent is not None and mode == "scale":
        levels[transparent] = np.nan
    return np.asarray(levels[::-1])


def _states(grey: NDArray[np.float32], about: MapFile) -> NDArray[np.uint8]:
    """The states of grey levels; between the thresholds they are unknown."""
    if about.mode == "raw":
        occupied = np.where(np.round(grey * 255.0) <= 100.0, np.round(grey * 255.0) / 100.0, np.nan)
    else:
        occupied = grey if about.negate else 1.0 - grey
    states = np.full(grey.shape, UNKNOWN, np.uint8)
    with np.errstate(invalid="ignore"):
        # In single precision 1 - 205 / 255 is above the threshold 0.196 and stays unknown, as it has to; so does 0.65.
        states[occupied > np.float32(about.occupied_thresh)] = OCCUPIED
        states[occupied < np.float32(about.free_thresh)] = FREE
        if about.mode == "raw":
            states[occupied >= np.float32(about.occupied_thresh)] = OCCUPIED
            states[occupied <= np.float32(about.free_thresh)] = FREE
    return states


def _unknown_as_floor(grey: NDArray[np.float32], states: NDArray[np.uint8], about: MapFile) -> tuple[str, ...]:
    """A notice if the thresholds turn map_server's grey for unknown into floor."""
    saved = np.rint(grey * 255.0) == _LEVELS[UNKNOWN]
    share = float(np.mean(saved & (states == FREE)))
    if about.mode == "raw" or share == 0.0 or about.free_thresh <= _FREE:
        return ()
    return (
        f"{100.0 * share:.3g} % of its pixels are grey {_LEVELS[UNKNOWN]}, as map_server writes what it does not know; "
        f"by free_thresh {about.free_thresh:g} they are floor, by {_FREE} they would be unknown",
    )


def write(path: Path, states: NDArray[np.uint8], lattice: Lattice) -> tuple[Path, ...]:
    """Write cells (rows, columns) as map_server's YAML at `path` and a PGM beside it, or in JSON as an OccupancyGrid.

    The JSON has the message's `info` and `data`: row-major from the lower left, 0 free, 100 occupied, -1 unknown.
    Gives the files. Raises InputError for another ending, or if writing fails.
    """
    ending = path.suffix.lower()
    x0, y0 = round(lattice.x0, _DECIMALS), round(lattice.y0, _DECIMALS)
    if ending == ".json":
        position = {"x": x0, "y": y0, "z": 0.0}
        pose = {"position": position, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
        info = {"resolution": lattice.cell, "width": lattice.columns, "height": lattice.rows, "origin": pose}
        return save({path: json.dumps({"info": info, "data": occupancy(states).tolist()}).encode()})
    if ending not in (".yaml", ".yml"):
        raise InputError(f"{path}: expected a name that ends in .yaml (map_server) or .json (OccupancyGrid)")
    image = path.with_suffix(".pgm")
    levels = np.zeros(3, np.uint8)
    for state, level in _LEVELS.items():
        levels[state] = level
    pgm = f"P5\n{lattice.columns} {lattice.rows}\n255\n".encode() + levels[states[::-1]].tobytes()
    lines = {
        "image": image.name, "mode": "trinary", "resolution": lattice.cell,
        "origin": [x0, y0, 0.0], "negate": 0, "occupied_thresh": _OCCUPIED, "free_thresh": _FREE,
    }  # fmt: skip
    text = "".join(f"{key}: {json.dumps(value)}\n" for key, value in lines.items())
    return save({image: pgm, path: text.encode()})


def occupancy(states: NDArray[np.uint8]) -> NDArray[np.int8]:
    """The data of a nav_msgs/OccupancyGrid: row-major from the lower left, 0 free, 100 occupied, -1 unknown."""
    values = np.zeros(3, np.int8)
    for state, value in _VALUES.items():
        values[state] = value
    return np.asarray(values[states].reshape(-1))


def save(files: dict[Path, bytes]) -> tuple[Path, ...]:
    """Write files whole, and give their paths. Raises InputError."""
    for path, content in files.items():
        part = path.with_name(path.name + ".part")
        try:
            part.write_bytes(content)
            part.replace(path)
        except OSError as problem:
            part.unlink(missing_ok=True)
            raise unwritten(path, problem, "a folder that exists and is writable") from problem
    return tuple(files)
