"""Buildings: inspection, pictures, conversion and generation."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from swarmsim.api.bare import CELL, bare
from swarmsim.api.figures import save
from swarmsim.api.overrides import Overrides, told_apart
from swarmsim.api.runs import scenario_of
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import shipped
from swarmsim.core.scenario.file import Scenario, World, assign, decode, set_key
from swarmsim.core.scenario.files import Table
from swarmsim.engine.inspection import Inspection, inspect
from swarmsim.world import drawing, geojson, rosmap
from swarmsim.world.plan import FloorPlan
from swarmsim.world.rasters import rasterised
from swarmsim.world.source import floor_plan, is_map, read_world

MAPS: Final = (".yaml", ".yml", ".json")
_PLACE: Final = re.compile(r"\((-?[0-9.]+) m, (-?[0-9.]+) m\)")


@dataclass(frozen=True, slots=True)
class Converted:
    """A building in another format."""

    files: tuple[Path, ...]  # written
    notices: tuple[str, ...]  # how the floor plan was read


def world_check(world: str | Path, *, overrides: Overrides | None = None, door: float | None = None) -> Inspection:
    """Inspect a building for a swarm, and whether all of it can be mapped: `swarmsim world check`.

    `world` is a drawing, a map, polygons or a scenario (TOML) with its world; `overrides` are values at dotted keys of
    the scenario, as in {"world.scale": 0.01}; doors are up to `door` metres wide, by default ten times the robot's
    diameter. If it cannot all be mapped, `problem` says why. Raises InputError for an unreadable building.
    """
    scenario = _scenario(Path(world), overrides)
    widest = 20.0 * scenario.robots.radius if door is None else door
    if widest <= 0.0:
        raise InputError(f"--door {widest:g}: expected a width in metres, larger than 0")
    return inspect(scenario, read_world(scenario.world, scenario.grid.cell), str(world), widest)


def world_preview(
    world: str | Path, out: str | Path, *, overrides: Overrides | None = None, door: float | None = None
) -> Path:
    """Draw a building as a swarm finds it, into a .png, .svg or .pdf, and return its path: `swarmsim world preview`.

    The picture has grid, domain, spawn areas, doors, and problems. Other parameters and errors are those of
    `world_check`.
    """
    path = Path(out)
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"{path}: expected a name that ends in .png, .svg or .pdf")
    found = world_check(world, overrides=overrides, door=door)
    plan = found.arena.plan
    title = f"{found.scenario.world.title}: {plan.width:g} m x {plan.height:g} m"
    if found.problem:
        title += f"\n100 % is unattainable: {found.problem}"
    from swarmsim.view import plots

    figure = plots.building(
        plan,
        found.arena.lattice,
        found.domain,
        [(*door.place, door.width) for door in found.doors],
        [pocket.place for pocket in found.pockets if pocket.cells > 1],
        [(float(x), float(y)) for x, y in _PLACE.findall(found.problem or "")],
        2.0 * found.scenario.robots.radius,
        title,
    )
    return save({path: figure})[0]


def world_convert(
    world: str | Path, out: str | Path, *, overrides: Overrides | None = None, cell: float | None = None
) -> Converted:
    """Write a building as a drawing, polygons or a map: `swarmsim world convert`.

    The name of `out` says which: .svg, .geojson, .yaml (map_server's, with a .pgm) or .json (OccupancyGrid). `cell` is
    the side of a map's pixel in metres, by default the scenario's cell. `world` and `overrides` are those of
    `world_check`. Raises InputError for what cannot be read or written.
    """
    path, scenario = Path(out), _scenario(Path(world), overrides)
    if path.suffix.lower() not in (*MAPS, ".svg", ".geojson"):
        raise InputError(f"{path}: expected a name that ends in .svg, .geojson, .yaml (map_server) or .json")
    side = cell if cell is not None else _pixel(scenario.world) or scenario.grid.cell
    if side <= 0.0:
        raise InputError(f"--cell {side:g}: expected a length in metres, larger than 0")
    plan = floor_plan(read_world(scenario.world, side), scenario.world)
    if path.suffix.lower() in MAPS:
        written = rosmap.write(path, *rasterised(plan, side, scenario.world.title))
    else:
        written = rosmap.save({path: _text(plan, path, scenario.world.title).encode()})
    return Converted(tuple(written), plan.notices)


def world_generate(
    kind: str,
    out: str | Path,
    *,
    seed: int = 1,
    overrides: Overrides | None = None,
    cell: float = CELL,
) -> Path:
    """Generate a building, write it as .svg or .geojson, and return its path: `swarmsim world generate`.

    `kind` is rooms, office, maze, cave, obstacles or a custom generator; another `seed` makes another building;
    `overrides` are keys of the generator, as in {"width": 20}; `cell` is the side of its cells in metres, `out` the
    file. Raises InputError for invalid keys and a place that cannot be written.
    """
    path = Path(out)
    if path.suffix.lower() not in (".svg", ".geojson"):
        raise InputError(f"{path}: expected a name that ends in .svg or .geojson")
    table = _with({"use": kind}, overrides)
    scenario = decode(bare({"generate": table, "seed": seed}, cell), kind)
    plan = floor_plan(read_world(scenario.world, cell), scenario.world)
    (written,) = rosmap.save({path: _text(plan, path, f"{kind}, seed {seed}").encode()})
    return written


def _text(plan: FloorPlan, path: Path, title: str) -> str:
    return drawing.drawn(plan, title) if path.suffix.lower() == ".svg" else geojson.written(plan)


def _scenario(path: Path, overrides: Overrides | None) -> Scenario:
    """The scenario in a TOML file, or a bare one for a world."""
    path = shipped.found(path, "worlds")
    if path.suffix.lower() == ".toml":
        return scenario_of(path, None, overrides)
    return decode(_with(bare({"file": str(path)}), overrides), str(path))


def _with(table: Table, overrides: Overrides | None) -> Table:
    texts, changes = told_apart(overrides)
    for text in texts:
        set_key(table, text)
    for key, value in changes.items():
        assign(table, key, value)
    return table


def _pixel(world: World) -> float | None:
    """The side of a map's pixel in m; None for other worlds."""
    if world.width is not None or not is_map(world):
        return None
    return rosmap.read(Path(world.file), world.resolution).resolution
