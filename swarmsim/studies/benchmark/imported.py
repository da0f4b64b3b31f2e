"""A set of tasks from others' maps, in the form of the shipped one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
import shapely
import tomli_w
from shapely import MultiPolygon

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.decoding import read_struct
from swarmsim.core.scenario.file import Scenario, World, decode, without_none
from swarmsim.core.scenario.files import Table, write_whole
from swarmsim.core.scenario.toml import read_toml
from swarmsim.core.state import FREE, OCCUPIED
from swarmsim.engine.inspection import inspect
from swarmsim.studies.benchmark.listed import lines_of
from swarmsim.studies.benchmark.sets import SET, WORLDS, SetFile, SetWorld, digest_of
from swarmsim.world import geojson, rosmap
from swarmsim.world.areas import polygons
from swarmsim.world.endings import PICTURES
from swarmsim.world.plan import SPAWN_LAYER, FloorPlan
from swarmsim.world.source import floor_plan, read_world

KIND: Final = "imported"
FOLDER: Final = "worlds"  # of the set
START: Final = 3.0  # m2, room for some fifty robots to start
RADII: Final = (1.0, 1.5, 2.0, 3.0, 5.0)  # m, about the place where they do
FIFTH: Final = 5  # in every so many-th world something goes wrong, as in the shipped set


@dataclass(frozen=True, slots=True)
class Pictures:
    """How pictures are read."""

    width: float | None = None  # m, of every map
    resolution: float | None = None  # m, a pixel of a picture without a YAML file
    floor: int | None = None  # the darkest level that is floor, in pictures without a YAML file; None: map_server's


@dataclass(frozen=True, slots=True)
class ImportedSet:
    """A set that was written."""

    folder: Path
    worlds: tuple[str, ...]
    left_out: dict[str, str]  # maps that no swarm can explore or that cannot be read: why, by file


def imported(
    source: Path, out: Path, model: Path, how: Pictures, limit: int | None, robots: Sequence[int]
) -> ImportedSet:
    """Write the maps in `source` as a set into the new folder `out`, with the regimes and robots of the set `model`.

    Each map becomes a floor plan in metres whose robots start in a roomy place of its floor. `how` says how
    pictures are read, `limit` replaces the iterations after which a run is not finished, `robots`
    the counts. Raises InputError without a map that can be used.
    """
    if (out / SET).exists():
        raise InputError(f"--out {out}: there is a set already; expected a new folder")
    files = maps_in(source)
    about = read_struct(model / SET, "a set of benchmark tasks", SetFile)
    base = read_toml(model / about.scenario, "the scenario of a set")
    if limit is not None:
        base["stop"] = {"iterations": limit}
    name = _named(source.resolve().name)
    about = msgspec.structs.replace(
        about, name=name, edition=1, title=f"Exploration of {source.resolve().name}", kinds={}, commitment="",
        sealed="", counts=tuple(robots) or about.counts,
    )  # fmt: skip
    plans, left_out = dict[str, FloorPlan](), dict[str, str]()
    for file in files:
        try:
            plans[_unlike(_named(file.stem), plans)] = started(file, how, base)
        except InputError as problem:
            left_out[str(file)] = str(problem).removeprefix(f"{file}: ")
    if not plans:
        first = next(iter(left_out.items()))
        raise InputError(f"{source}: none of its {len(files)} maps can be used; {first[0]}: {first[1]}")
    _write(out, about, base, plans)
    return ImportedSet(out, tuple(plans), left_out)


def maps_in(folder: Path) -> list[Path]:
    """The maps in a folder and its folders: YAML files, and pictures that none of these names. Raises InputError."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with maps: map_server's YAML files, PNG or PGM")
    pairs, named = [], set[Path]()
    for file in sorted((*folder.rglob("*.yaml"), *folder.rglob("*.yml"))):
        try:
            named.add(rosmap.image_of(file).resolve())
        except InputError:
            continue  # some other YAML file
        pairs.append(file)
    pictures = [file for file in sorted(folder.rglob("*")) if file.suffix.lower() in PICTURES]
    found = [*pairs, *(file for file in pictures if file.resolve() not in named)]
    if not found:
        raise InputError(f"{folder}: no map in it; expected map_server's YAML files, PNG or PGM")
    return found


def started(file: Path, how: Pictures, base: Table) -> FloorPlan:
    """A map as a floor plan with a start area, if all of it can be explored. Raises InputError."""
    bare = file.suffix.lower() in PICTURES
    world = World(file=str(file), width=how.width, resolution=how.resolution if bare else None)
    cell = _scenario(base, file).grid.cell
    text = read_world(world, cell) if how.floor is None or not bare else _by_level(file, how, cell)
    plan = floor_plan(text, world)
    floor = plan.spawns[SPAWN_LAYER]
    plan = replace(plan, spawns={SPAWN_LAYER: start_in(floor), "floor": floor}, notices=())
    scenario = _scenario(base, file.with_suffix(".geojson"))
    found = inspect(scenario, geojson.written(plan), str(file), 20.0 * scenario.robots.radius)
    if found.problem:
        raise InputError(f"{file}: {found.problem}")
    return plan


def start_in(floor: MultiPolygon) -> MultiPolygon:
    """The connected floor about its roomiest place, within the least of RADII that gives START of floor."""
    piece = max(floor.geoms, key=lambda one: one.area)
    centre = shapely.maximum_inscribed_circle(piece, tolerance=0.1).coords[0]
    found = floor
    for radius in RADII:
        near = polygons(shapely.intersection(piece, shapely.Point(centre).buffer(radius)))
        found = MultiPolygon([min(near.geoms, key=lambda one: one.distance(shapely.Point(centre)))])
        if found.area >= START:
            break
    return found


def _by_level(file: Path, how: Pictures, cell: float) -> str:
    """The floor plan of a picture whose pixels from a level on are floor."""
    walls = rosmap.dark(file, (how.floor or 0) - 1)
    side = how.resolution if how.width is None else how.width / walls.shape[1]
    if side is None:
        raise InputError(f"{file}: how large is a pixel? Expected --resolution or --width, in metres")
    states = np.where(walls, OCCUPIED, FREE).astype(np.uint8)
    return geojson.written(rosmap.Bitmap(states, side, (0.0, 0.0, 0.0)).plan(str(file), cell, True))


def _scenario(base: Table, file: Path) -> Scenario:
    return decode({**base, "world": {"file": str(file)}}, str(file), file.parent)


def _write(out: Path, about: SetFile, base: Table, plans: dict[str, FloorPlan]) -> None:
    write_whole(out / about.scenario, tomli_w.dumps(base))
    for name, plan in plans.items():
        write_whole(out / FOLDER / f"{name}.geojson", geojson.written(plan))
    regimes = list(about.regimes)
    worlds = []
    for number, name in enumerate(plans):
        file = f"{FOLDER}/{name}.geojson"
        worlds.append(
            SetWorld(
                world=name, kind=KIND, part="public", regime=regimes[number % len(regimes)],
                struck=about.struck is not None and number % FIFTH == 0, seed=None, file=file,
                digest=digest_of(out, about, {"file": file}, name),
            )
        )  # fmt: skip
    write_whole(out / WORLDS, lines_of(worlds, SetWorld))
    write_whole(out / SET, tomli_w.dumps(without_none(msgspec.to_builtins(about))))  # last: now it is a set


def _named(text: str) -> str:
    """A text as a name of the set: small letters, digits and hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:50] or "map"


def _unlike(name: str, taken: Iterable[str]) -> str:
    """The name, with a number if it is taken."""
    found, number = name, 2
    while found in set(taken):
        found, number = f"{name}-{number}", number + 1
    return found
