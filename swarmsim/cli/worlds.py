"""The verbs of buildings: check, preview, convert, generate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmsim.api.bare import CELL
from swarmsim.cli import fleets, imports
from swarmsim.cli.printing import for_print

if TYPE_CHECKING:
    from swarmsim.engine.inspection import Inspection

app = typer.Typer(
    help="Check, draw, convert and make buildings.\n\nExample: swarmsim world check basilica",
    no_args_is_help=True,
    rich_markup_mode=None,
)

app.command("import")(imports.import_)
app.command("serve")(fleets.serve)

UNATTAINABLE = 2  # exit code: 100 % cannot be reached
SHOWN = 12  # rooms, doors and pockets in a table

Source = Annotated[
    Path, typer.Argument(metavar="WORLD", help="A drawing, a map, polygons; or a scenario (TOML) with its world.")
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set a key of the scenario, as in world.scale=0.01."),
]
Door = Annotated[
    float | None, typer.Option(metavar="METRES", help="The widest door; by default ten times the robot's diameter.")
]


@app.command()
def check(
    world: Source,
    set_: Set = None,
    door: Door = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")] = False,
) -> None:
    """Describe a building for a swarm, and check whether all of it can be mapped.

    Exit code 0: it can; 2: it cannot; the output names reason and place.

    Example: swarmsim world check plan.svg --set world.width=24 --set robots.radius=0.1
    """
    from swarmsim.api.worlds import world_check
    from swarmsim.cli.tables import print_table

    found = world_check(world, overrides=set_, door=door)
    if as_json:
        print(json.dumps(_plain(found), indent=2))
    else:
        for notice in found.notices:
            print(f"notice: {notice}")
        print_table(f"{found.scenario.world.title}", ["measure", "value"], _lines(found))
        diameter = 2.0 * found.scenario.robots.radius
        if found.rooms:
            rows = [
                [str(i), f"{r.area:.2f}", _at(r.place), str(sum(i in d.rooms for d in found.doors))]
                for i, r in enumerate(found.rooms[:SHOWN])
            ]
            print_table(f"rooms: {len(found.rooms)}", ["room", "area, m2", "place, m", "doors"], rows)
        if found.doors:
            rows = [
                ["{} - {}".format(*d.rooms), f"{d.width:.2f}", f"{d.width / diameter:.1f}", _at(d.place)]
                for d in found.doors[:SHOWN]
            ]
            head = ["rooms", "width, m", "robot diameters", "place, m"]
            print_table(f"doors: {len(found.doors)}, the narrowest first", head, rows)
        if found.pockets:
            rows = [[str(pocket.cells), _at(pocket.place)] for pocket in found.pockets[:SHOWN]]
            print_table(f"unreachable pockets: {len(found.pockets)}", ["cells", "place, m"], rows)
    if found.problem:
        print(f"100 % is unattainable: {found.problem}")
        raise typer.Exit(UNATTAINABLE)
    if not as_json:
        print("100 % is attainable.")


@app.command()
@for_print
def preview(
    world: Source,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Picture to write: .png, .svg or .pdf.")],
    set_: Set = None,
    door: Door = None,
) -> None:
    """Draw a building for a swarm: grid, domain, spawn areas, doors, and problems.

    Example: swarmsim world preview basilica basilica.png
    """
    from swarmsim.api.worlds import world_preview

    print(world_preview(world, out, overrides=set_, door=door))


@app.command()
def convert(
    world: Source,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File to write: .svg, .geojson, .yaml or .json.")],
    set_: Set = None,
    cell: Annotated[
        float | None, typer.Option(metavar="METRES", help="Side of a pixel of a map; by default the scenario's cell.")
    ] = None,
) -> None:
    """Write a building as a drawing (SVG), polygons (GeoJSON), or a map: map_server's YAML and PGM, or OccupancyGrid.

    Example: swarmsim world convert basilica basilica.yaml --cell 0.05
    """
    from swarmsim.api.worlds import world_convert

    converted = world_convert(world, out, overrides=set_, cell=cell)
    for notice in converted.notices:
        print(f"notice: {notice}")
    for path in converted.files:
        print(path)


@app.command()
def generate(
    kind: Annotated[str, typer.Argument(help="Generator: rooms, office, maze, cave, or a custom one.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="File to write: .svg or .geojson.")],
    seed: Annotated[int, typer.Option(help="Another seed makes another building.")] = 1,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A key of the generator, as in width=20.")
    ] = None,
    cell: Annotated[float, typer.Option(metavar="METRES", help="Side of its cells.")] = CELL,
) -> None:
    """Make a building.

    A scenario can generate it itself: world = {generate = {use = "rooms"}, seed = 1}.

    Example: swarmsim world generate office office.svg --seed 3 --set width=24
    """
    from swarmsim.api.worlds import world_generate

    print(world_generate(kind, out, seed=seed, overrides=set_, cell=cell))


def _lines(found: Inspection) -> list[list[str]]:
    from swarmsim.engine.inspection import MOST_SEATS, free_area

    plan, lattice, robots = found.arena.plan, found.arena.lattice, found.scenario.robots
    lines = [
        ["page, m", f"{plan.width:g} x {plan.height:g}"],
        ["cells", f"{lattice.rows} x {lattice.columns} of {lattice.cell:g} m"],
        ["walls, m2", f"{plan.walls.area:.2f}"],
    ]
    if found.floor is not None:
        lines.append(["free area, m2", f"{free_area(found.arena, found.floor):.2f}"])
    if found.domain is not None:
        lines.append(["cells that make 100 %", str(int(found.domain.sum()))])
    lines.append(["robots", f"{robots.count} of {2.0 * robots.radius:g} m diameter"])
    if found.seats:
        seats = f"{MOST_SEATS} or more" if found.seats == MOST_SEATS else str(found.seats)
        lines.append([f"robots that spawn area {found.arena.area_name(robots.spawn)!r} holds", seats])
    if found.seconds is not None and found.iterations is not None:
        time = found.seconds * found.iterations
        lines.append(["run, about", f"{found.iterations} iterations, {time:.1f} s"])
    lines.append(["memory of the maps, about", f"{found.memory / 1e6:.0f} MB"])
    return lines


def _plain(found: Inspection) -> dict[str, object]:
    """The findings, for JSON."""
    from swarmsim.engine.inspection import free_area

    plan, lattice = found.arena.plan, found.arena.lattice
    return {
        "world": found.scenario.world.title,
        "page": list(plan.page),
        "cell": lattice.cell,
        "rows": lattice.rows,
        "columns": lattice.columns,
        "walls_area": plan.walls.area,
        "free_area": None if found.floor is None else free_area(found.arena, found.floor),
        "domain_cells": None if found.domain is None else int(found.domain.sum()),
        "rooms": [{"area": room.area, "place": list(room.place)} for room in found.rooms],
        "doors": [{"rooms": list(d.rooms), "width": d.width, "place": list(d.place)} for d in found.doors],
        "pockets": [{"cells": pocket.cells, "place": list(pocket.place)} for pocket in found.pockets],
        "robots_placed": found.seats,
        "iterations_about": found.iterations,
        "seconds_each": found.seconds,
        "memory_about": found.memory,
        "notices": list(found.notices),
        "problem": found.problem,
    }


def _at(place: tuple[float, float]) -> str:
    return f"({place[0]:.2f}, {place[1]:.2f})"
