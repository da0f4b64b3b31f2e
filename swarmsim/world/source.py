"""Where floor plans come from: drawings, maps, polygons, and buildings that are made."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
import shapely
from shapely import MultiPolygon

from swarmsim.core import registry
from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.files import LARGEST, check_plain, content
from swarmsim.core.parts import Site
from swarmsim.core.scenario import World
from swarmsim.core.streams import Streams
from swarmsim.world import geojson, rosmap, svg
from swarmsim.world.areas import joined, polygons, united
from swarmsim.world.arena import place_in, spot
from swarmsim.world.floor import FIELD, check_outside, floor_of
from swarmsim.world.plan import SPAWN_LAYER, FloorPlan
from swarmsim.world.reading import plan_of

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
            bitmap = replace(bitmap, resolution=resolution or bitmap.resolution)
        return geojson.written(bitmap.plan(str(path), cell, world.unknown == "wall"))
    if world.resolution is not None:
        raise InputError(f"world.resolution: {path} has no pixels; expected scale, or width in metres")
    text = _text(path)
    if ending == ".wkt":
        return geojson.written(plan_of(geojson.read_wkt(text, str(path), world), world))
    whole = geojson.is_ours(text) and world.scale is None and world.width is None and not world.layers
    if text.lstrip().startswith(("{", "[")) and not whole:
        return geojson.written(plan_of(geojson.read(text, str(path), world), world))
    return text


def floor_plan(text: str, world: World) -> FloorPlan:
    """The floor plan in a text that `read_world` gave, with its spawn areas. Raises InputError."""
    return _floor_plan(text, msgspec.json.encode(world))


@lru_cache(maxsize=4)
def _floor_plan(text: str, place: bytes) -> FloorPlan:
    world = msgspec.json.decode(place, type=World)
    name, scale = world.title, world.scale or 1.0
    bitmap = Path(world.file).suffix.lower() in (".yaml", ".yml", ".wkt", *rosmap.PICTURES)
    across = None if bitmap else world.width
    says_solid = True
    if text.lstrip().startswith(("{", "[")):
        plan = geojson.plan_from(text, name, 1.0 if bitmap else scale, across, world.layers)
        if world.unknown == "wall" and not plan.unknown.is_empty and not bitmap:
            plan = replace(plan, walls=joined([plan.walls, plan.unknown]))
    else:
        drawing = svg.read(text, name, world)
        plan, says_solid = plan_of(drawing, world), drawing.says_solid
    return _with_floor(plan, world, measured=bitmap, says_solid=says_solid)


def _with_floor(plan: FloorPlan, world: World, *, measured: bool, says_solid: bool) -> FloorPlan:
    """The plan with a spawn area, and a border if its floor runs off; all of the page of a `measured` one is known.

    Raises InputError if the floor lies around the building.
    """
    spawns = dict(plan.spawns)
    if world.spawn is not None:
        x, y, width, height = world.spawn
        spawns[SPAWN_LAYER] = polygons(shapely.box(x, y, x + width, y + height))
    drawn = shapely.multipolygons(shapely.get_parts([*plan.layers.values()]))
    extent = shapely.total_bounds([plan.walls, *spawns.values()])
    left, low, right, high = plan.page if measured or np.isnan(extent).any() else map(float, extent)
    inside = left, low, right, high
    beside = MultiPolygon() if world.unknown == "wall" else plan.unknown
    floor = floor_of(plan.walls, drawn, inside, list(spawns.values()), beside)
    if inside != plan.page and (floor is None or floor.share > FIELD):  # obstacles on an open page
        inside = plan.page
        floor = floor_of(plan.walls, drawn, inside, list(spawns.values()), beside)
    if floor is None:
        return replace(plan, spawns=spawns)
    notices = list(plan.notices)
    border = MultiPolygon()
    if floor.opening is not None and world.border is not False:
        if world.border is None and not measured and not says_solid:
            check_outside(drawn, floor, world.title)
        border = floor.border
        notices.append(
            f"{world.title}: the floor runs off at {spot(*floor.opening)}, and a border closes it there; "
            "world.border = false keeps it open"
        )
    if not spawns:
        spawns[SPAWN_LAYER] = polygons(floor.piece)
        if not floor.sure:
            notices.append(
                f"{world.title}: the floor is taken to be the space at {place_in(floor.piece)}, "
                f"{floor.piece.area:.3g} m2, but another one comes close; say which by world.spawn"
            )
    walls = plan.walls
    if world.pockets == "fill":
        walls = _filled(walls, floor.piece, inside)
    return replace(plan, walls=walls, spawns=spawns, border=border, notices=tuple(notices))


def _filled(walls: MultiPolygon, floor: shapely.Polygon, inside: Box) -> MultiPolygon:
    """The walls and all closed spaces but the floor."""
    free = shapely.get_parts(polygons(shapely.difference(shapely.box(*inside), walls)))
    box = shapely.box(*inside)
    pockets = free[~shapely.intersects(free, box.exterior) & ~shapely.intersects(free, floor.representative_point())]
    return united([walls, *pockets])


def _made(world: World, cell: float) -> str:
    try:
        return str(registry.part("generator", world.generate).build(Site(Streams(world.seed), cell)).draw())
    except InputError as problem:
        raise InputError(f"world.generate.{problem}") from problem


def _check(path: Path) -> None:
    """Raises InputError unless there is a plain file of a bearable size."""
    expected = f"a drawing or a map: {', '.join(_ENDINGS[:7])}"
    if not path.exists():
        raise InputError(f"world: {path} cannot be read (no such file); expected {expected}")
    if path.is_dir():
        raise InputError(f"world: {path} is a folder, no plain file; expected {expected}")
    try:
        check_plain(path, expected)
    except InputError as problem:
        raise InputError(f"world: {problem}") from problem


def _text(path: Path) -> str:
    """The text of a file in the encoding that its first bytes or its XML declaration name, or else UTF-8."""
    try:
        packed = content(path, "a drawing")
    except InputError as problem:
        raise InputError(f"world: {problem}") from problem
    plain = _unpacked(packed, path) if packed.startswith(_GZIP) else packed
    declared = _DECLARED.search(plain[:200])
    marked = next((encoding for mark, encoding in _MARKS.items() if plain.startswith(mark)), None)
    encoding = marked or (declared[1].decode("ascii") if declared else "utf-8")
    try:
        return plain.decode(encoding)
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
