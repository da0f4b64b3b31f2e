"""Sources of floor plans: drawings, maps, polygons, and generated buildings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely
from shapely import MultiPolygon

from swarmsim.core.context import WorldContext
from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.file import World
from swarmsim.core.scenario.files import LARGEST
from swarmsim.core.streams import Streams
from swarmsim.world import geojson, svg
from swarmsim.world.areas import joined, polygons, united
from swarmsim.world.arena import place_in, spot
from swarmsim.world.endings import MAPS, PICTURES
from swarmsim.world.floor import FIELD, check_outside, floor_of
from swarmsim.world.plan import SPAWN_LAYER, FloorPlan
from swarmsim.world.reading import plan_of
from swarmsim.world.shapes import Drawing
from swarmsim.world.texts import check_file, text_of

if TYPE_CHECKING:
    from swarmsim.world.rosmap import Bitmap

Read = Callable[[Path, World], Drawing]


def _by(reader: str) -> Read:
    """A reader whose libraries are imported when a file needs them."""

    def read(path: Path, world: World) -> Drawing:
        drawing: Drawing = import_module(f"swarmsim.world.{reader}").read(path, world)
        return drawing

    return read


def _simulators(path: Path, world: World) -> Drawing:
    """The drawing in a world of Gazebo or Stage, which end in the same letters."""
    from swarmsim.world.simulators import sdf, stage

    return (sdf.read if sdf.holds(path) else stage.read)(path, world)


#: The readers by file ending, apart from maps in pixels and texts that are floor plans already.
_READERS: Final[dict[str, Read]] = {
    ".dxf": _by("cad.dxf"),
    ".ifc": _by("bim.ifc"),
    ".imdf": _by("indoor.imdf"),
    ".osm": _by("indoor.osm"),
    ".sdf": _by("simulators.sdf"),
    ".world": _simulators,
    ".wkt": lambda path, world: geojson.read_wkt(text_of(path), str(path), world),
    ".zip": _by("indoor.imdf"),
}
_MODEL: Final = 1_000_000_000  # bytes of a building's model; one storey of it is kept
_EXPECTED: Final = (
    "a drawing (.svg, .dxf), a map (.yaml, .pgm, .png), polygons (.geojson, .wkt), a building model (.ifc), an indoor "
    "map (.osm, .imdf) or a simulator's world (.world, .sdf)"
)


def read_world(world: World, cell: float) -> str:
    """The text of the floor plan of a scenario's world: an SVG drawing or, for all else, GeoJSON.

    `floor_plan` depends only on that text and the rest of `world`. `cell` is the side of the lattice's cells (m), which
    limits how far the outlines of bitmaps may stray. Raises InputError.
    """
    if world.generate:
        return _made(world, cell)
    path = Path(world.file)
    ending = path.suffix.lower()
    if ending in MAPS:
        return geojson.written(_bitmap(world).plan(str(path), cell, world.unknown == "wall"))
    if ending not in _READERS and not path.is_dir():
        _check(world)
        text = text_of(path)
        whole = geojson.is_ours(text) and world.scale is None and world.width is None and not world.named
        if whole or not _is_json(text):
            return text
    return geojson.written(plan_of(drawing_of(world), world))


def drawing_of(world: World) -> Drawing:
    """The drawing in a world's file, unless that is a map in pixels. Raises InputError."""
    path = Path(world.file)
    _check(world)
    reader = _READERS.get(".imdf" if path.is_dir() else path.suffix.lower())
    if reader is not None:
        return reader(path, world)
    text = text_of(path)
    return (geojson.read if _is_json(text) else svg.read)(text, str(path), world)


def is_map(world: World) -> bool:
    """Whether a world is a map in pixels."""
    return Path(world.file).suffix.lower() in MAPS


def _is_json(text: str) -> bool:
    return text.lstrip().startswith(("{", "["))


def _check(world: World) -> None:
    """Raise InputError unless the world's file is readable, and its keys suit its type."""
    path = Path(world.file)
    if is_map(world):
        if world.scale is not None:
            raise InputError(f"world.scale: {path} is a map in pixels; expected resolution, or width, in metres")
    elif world.resolution is not None:
        raise InputError(f"world.resolution: {path} has no pixels; expected scale, or width in metres")
    if not (path.is_dir() and any(path.glob("*.geojson"))):  # the folder of an indoor map
        check_file(path, _EXPECTED, _MODEL if path.suffix.lower() == ".ifc" else LARGEST)


def _bitmap(world: World) -> Bitmap:
    """The map in pixels that a world names."""
    from swarmsim.world import rosmap

    path = Path(world.file)
    _check(world)
    if world.width is None:
        return rosmap.read(path, world.resolution)
    picture = path if path.suffix.lower() in PICTURES else rosmap.image_of(path)
    resolution = world.width / rosmap.columns_of(picture)
    return replace(rosmap.read(path, resolution), resolution=resolution)


def floor_plan(text: str, world: World) -> FloorPlan:
    """The floor plan in a text of `read_world`, with its spawn areas. Raises InputError."""
    return _floor_plan(text, world)


@lru_cache(maxsize=4)
def _floor_plan(text: str, world: World) -> FloorPlan:
    if _is_json(text):
        scaled = is_map(world) or Path(world.file).suffix.lower() in _READERS
        scale, across = (1.0, None) if scaled else (world.scale or 1.0, world.width)
        plan = geojson.plan_from(text, world.title, scale, across, world.named)
        if world.unknown == "wall" and not plan.unknown.is_empty and not geojson.is_ours(text) and not scaled:
            plan = replace(plan, walls=joined([plan.walls, plan.unknown]))
    else:
        plan = plan_of(svg.read(text, world.title, world), world)
    return _with_floor(plan, world)


def _with_floor(plan: FloorPlan, world: World) -> FloorPlan:
    """The plan with a spawn area, and a border if its floor runs off.

    A map is known on all of its page, a drawing only on its extent.

    Raises InputError if the floor lies around the building.
    """
    spawns = dict(plan.spawns)
    if world.spawn is not None:
        x, y, width, height = world.spawn
        spawns[SPAWN_LAYER] = polygons(shapely.box(x, y, x + width, y + height))
    measured = is_map(world)
    drawn = MultiPolygon(list(shapely.get_parts([*plan.layers.values()])))
    extent = shapely.total_bounds([plan.walls, *spawns.values()])
    left, low, right, high = plan.page if measured or np.isnan(extent).any() else map(float, extent)
    inside = left, low, right, high
    beside = MultiPolygon() if world.unknown == "wall" else plan.unknown
    held = list(spawns.values()) or [area for area in (plan.painted,) if not area.is_empty]
    floor = floor_of(plan.walls, drawn, inside, held, beside)
    if inside != plan.page and (floor is None or floor.share > FIELD):  # obstacles on an open page
        inside = plan.page
        floor = floor_of(plan.walls, drawn, inside, held, beside)
    if floor is None:
        return replace(plan, spawns=spawns)
    notices = list(plan.notices)
    border = MultiPolygon()
    if floor.opening is not None and world.border is not False:
        if world.border is None and not measured and plan.guessed:
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
                f"{floor.piece.area:.1f} m2, but another one comes close; say which by world.spawn"
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
        return str(world.generate.build(WorldContext(Streams(world.seed), cell)).draw())
    except InputError as problem:
        raise InputError(f"world.generate.{problem}") from problem
