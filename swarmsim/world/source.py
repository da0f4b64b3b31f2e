"""Where floor plans come from: drawings, maps, polygons, and buildings that are made."""

from __future__ import annotations

import re
import zlib
from functools import lru_cache
from pathlib import Path
from typing import Final

import msgspec
import shapely

from swarmsim.core import registry
from swarmsim.core.errors import InputError
from swarmsim.core.files import LARGEST
from swarmsim.core.parts import Site
from swarmsim.core.scenario import World
from swarmsim.core.streams import Streams
from swarmsim.world import geojson, rosmap
from swarmsim.world.areas import joined, polygons
from swarmsim.world.plan import SOLID_LAYERS, SPAWN_LAYER, UNKNOWN_LAYER, FloorPlan
from swarmsim.world.shapes import Drawing
from swarmsim.world.svg import read_floor_plan

_DECLARED: Final = re.compile(rb"<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)[\"']")
_MARKS: Final = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
_GZIP: Final = b"\x1f\x8b"
_ENDINGS: Final = (".svg", ".geojson", ".json", ".wkt", ".yaml", ".yml", *rosmap.PICTURES)


def read_world(world: World, cell: float) -> str:
    """The text of the floor plan that a scenario's world names: an SVG drawing or, for all else, GeoJSON.

    That text alone, with the rest of `world`, says what `floor_plan` makes of it. `cell` is the side of the lattice's
    cells (m), which says how far the outlines of bitmaps may stray. Raises InputError.
    """
    if world.generate:
        return _made(world, cell)
    path = Path(world.file)
    ending = path.suffix.lower()
    _check(path)
    if ending in (".yaml", ".yml", *rosmap.PICTURES):
        if world.scale is not None:
            raise InputError(f"world.scale: {path} is a map in pixels; expected resolution, or width, in metres")
        resolution = world.resolution
        if world.width is not None:
            picture = path if ending in rosmap.PICTURES else rosmap.image_of(path)
            resolution = world.width / rosmap.columns_of(picture)
        bitmap = rosmap.read(path, resolution)
        if world.width is not None:
            bitmap = rosmap.Bitmap(bitmap.states, resolution or bitmap.resolution, bitmap.origin)
        return geojson.written(bitmap.plan(str(path), cell, world.unknown == "wall"))
    if world.resolution is not None:
        raise InputError(f"world.resolution: {path} has no pixels; expected scale, or width in metres")
    text = _text(path)
    if ending == ".wkt":
        return geojson.written(_plan_of(geojson.read_wkt(text, str(path), world)))
    if text.lstrip().startswith(("{", "[")):
        return geojson.written(_plan_of(geojson.read(text, str(path), world)))
    return text


def _plan_of(drawing: Drawing) -> FloorPlan:
    """The floor plan of a drawing by its layers alone."""
    says = any(shape.layer in SOLID_LAYERS for shape in drawing.shapes)
    layers = {
        layer: joined([s.fill for s in drawing.shapes if (s.layer or ("" if says else "walls")) == layer])
        for layer in (*SOLID_LAYERS, UNKNOWN_LAYER)
    }
    unknown = layers.pop(UNKNOWN_LAYER)
    spawns = {s.spawn: s.fill for s in drawing.shapes if s.layer == SPAWN_LAYER}
    notices = tuple(f"{drawing.name}: {notice}" for notice in drawing.notices)
    return FloorPlan(joined(layers.values()), layers, spawns, drawing.page, unknown, notices)


def floor_plan(text: str, world: World) -> FloorPlan:
    """The floor plan in a text that `read_world` gave, with its spawn areas. Raises InputError."""
    return _floor_plan(text, msgspec.json.encode(world))


@lru_cache(maxsize=4)
def _floor_plan(text: str, place: bytes) -> FloorPlan:
    world = msgspec.json.decode(place, type=World)
    name, scale = world.title, world.scale or 1.0
    bitmap = Path(world.file).suffix.lower() in (".yaml", ".yml", ".wkt", *rosmap.PICTURES)
    across = None if bitmap else world.width
    if text.lstrip().startswith(("{", "[")):
        plan = geojson.plan_from(text, name, 1.0 if bitmap else scale, across, world.layers)
    else:
        plan = read_floor_plan(text, name, scale, across, world.layers)
    walls, spawns = plan.walls, dict(plan.spawns)
    if world.unknown == "wall" and not plan.unknown.is_empty:
        walls = joined([plan.walls, plan.unknown])
    if world.spawn is not None:
        x, y, width, height = world.spawn
        spawns[SPAWN_LAYER] = polygons(shapely.box(x, y, x + width, y + height))
    if not spawns and (free := _largest_free(walls, plan)) is not None:
        spawns[SPAWN_LAYER] = polygons(free)
    return FloorPlan(walls, plan.layers, spawns, plan.page, plan.unknown, plan.notices)


def _largest_free(walls: shapely.MultiPolygon, plan: FloorPlan) -> shapely.Geometry | None:
    """The largest piece of the page that is neither wall nor unknown, one inside of the walls if there is any."""
    page = shapely.box(*plan.page)
    free = shapely.get_parts(polygons(page.difference(shapely.union(walls, plan.unknown))))
    inside = free[~shapely.intersects(free, page.exterior)]
    pieces = inside if len(inside) else free
    return pieces[shapely.area(pieces).argmax()] if len(pieces) else None


def _made(world: World, cell: float) -> str:
    try:
        return str(registry.part("generator", world.generate).build(Site(Streams(world.seed), cell)).draw())
    except InputError as problem:
        raise InputError(f"world.generate.{problem}") from problem


def _check(path: Path) -> None:
    """Raises InputError unless there is a plain file of a bearable size."""
    expected = f"expected a drawing or a map: {', '.join(_ENDINGS[:7])}"
    if not path.exists():
        raise InputError(f"world: {path} cannot be read (no such file); {expected}")
    if not path.is_file():
        raise InputError(f"world: {path} is no plain file; {expected}")
    if path.stat().st_size > LARGEST:
        raise InputError(f"world: {path} is larger than {LARGEST // 1_000_000} MB; {expected}")


def _text(path: Path) -> str:
    """The text of a file in the encoding that its first bytes or its XML declaration name, or else UTF-8."""
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise InputError(f"world: {path} cannot be read ({problem.strerror}); expected a drawing") from problem
    if content.startswith(_GZIP):
        content = _unpacked(content, path)
    declared = _DECLARED.search(content[:200])
    marked = next((encoding for mark, encoding in _MARKS.items() if content.startswith(mark)), None)
    encoding = marked or (declared[1].decode("ascii") if declared else "utf-8")
    try:
        return content.decode(encoding)
    except LookupError:
        raise InputError(
            f"world: {path} declares the encoding {encoding!r}, which nobody knows; save it as UTF-8"
        ) from None
    except UnicodeDecodeError as problem:
        raise InputError(
            f"world: {path} is not {encoding.upper()} text (byte {problem.start}); expected a drawing in the encoding "
            "that it declares"
        ) from None


def _unpacked(content: bytes, path: Path) -> bytes:
    """What is packed in a compressed drawing (SVGZ). Raises InputError if that is broken, or far too much."""
    reader = zlib.decompressobj(wbits=31)
    try:
        plain = reader.decompress(content, LARGEST + 1)
    except zlib.error:
        raise InputError(f"world: {path} is a broken gzip file; expected a whole SVGZ") from None
    if len(plain) > LARGEST:
        raise InputError(f"world: {path} unpacks to more than {LARGEST // 1_000_000} MB; expected a drawing")
    if not reader.eof:
        raise InputError(f"world: {path} is a broken gzip file; expected a whole SVGZ")
    return plain
