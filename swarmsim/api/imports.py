"""Turns an unknown floor plan into a runnable scenario, one question at a time."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Required, TypedDict

import shapely
import tomli_w

from swarmsim.api.bare import CELL, bare
from swarmsim.api.figures import save
from swarmsim.core.errors import InputError
from swarmsim.core.scenario import shipped
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import World, decode
from swarmsim.core.scenario.files import write_whole
from swarmsim.engine.inspection import Inspection, inspect
from swarmsim.view import plots
from swarmsim.world import advice, rosmap
from swarmsim.world.areas import joined, polygons
from swarmsim.world.plan import FloorPlan
from swarmsim.world.shapes import Drawing
from swarmsim.world.source import drawing_of, floor_plan, is_map, read_world
from swarmsim.world.unreached import unreached

ROBOTS = 5
COARSE = 1_000_000  # cells of 0.15 m, above which larger ones are proposed
PAPER = 3.0  # m; smaller drawings in mm or cm are sheets of paper
DOOR = 0.9  # m


class Keys(TypedDict, total=False):
    """The keys of [world] from answers."""

    file: Required[str]
    width: float
    level: str
    scale: float
    layers: dict[str, list[str]]
    solid: str
    border: bool
    doors: float
    spawn: list[float]


class Answers(Protocol):
    """Answers questions, and receives findings."""

    def choice(self, question: str, default: bool) -> bool:
        """Yes or no."""
        ...

    def length(self, question: str, key: str) -> float:
        """A number of metres above 0 that the file lacks. Raises InputError if there is no one to ask."""
        ...

    def text(self, question: str, key: str) -> str:
        """A name. Raises InputError if there is no one to ask."""
        ...

    def tell(self, sentence: object) -> None:
        """Pass on a finding."""
        ...


class Defaults:
    """Takes every default."""

    def __init__(self, tell: Callable[[str], None] = lambda sentence: None) -> None:
        """`tell` gets the findings and the defaults taken, a sentence each."""
        self._tell = tell

    def choice(self, question: str, default: bool) -> bool:
        """The default."""
        self.tell(f"{question} {'yes' if default else 'no'}")
        return default

    def length(self, question: str, key: str) -> float:
        """Raises InputError: a length has no default."""
        raise InputError(f"{question} Nothing in the file says so; give it: {key}")

    def text(self, question: str, key: str) -> str:
        """Raises InputError: a name has no default."""
        raise InputError(f"{question} Say it: {key}")

    def tell(self, sentence: object) -> None:
        """Pass a sentence on."""
        self._tell(str(sentence))


@dataclass(frozen=True, slots=True)
class Imported:
    """A scenario made from a floor plan."""

    scenario: Path
    picture: Path  # the file's contents beside the result
    problem: str | None  # why it does not run yet
    seconds: float  # of a run, about


def world_import(
    file: str | Path,
    out: str | Path | None = None,
    *,
    width: float | None = None,
    level: str = "",
    answers: Answers | None = None,
) -> Imported:
    """Make a scenario from any floor plan, with a picture of the result beside it: `swarmsim world import`.

    `out` is the scenario to write (TOML), by default in the current folder and named as `file`. `width` is the page's
    in metres, which is never guessed, and `level` the storey of a file with several. `answers` gets uncertain
    questions and the findings; without it all defaults are taken. Raises InputError, and writes nothing, for an
    unreadable file, a missing width, and a scenario that exists already.
    """
    path, scenario, ask = shipped.found(file, "worlds"), Path(out or f"{Path(file).stem}.toml"), answers or Defaults()
    if scenario.suffix.lower() != ".toml":
        raise InputError(f"{scenario}: expected a name that ends in .toml")
    if scenario.exists():
        raise InputError(f"{scenario}: exists already; name another one: --out NAME.toml")
    keys: Keys = {"file": str(path)}
    if width is not None:
        keys["width"] = width
    if level:
        keys["level"] = level
    drawing = _shown(path, keys, ask)
    _layers(drawing, keys, ask)
    _reading(drawing, keys, ask)
    cell, found = _inspected(keys, ask)
    picture = scenario.with_name(f"{scenario.stem}-import.png")
    _write(scenario, keys, cell, found)
    _draw(picture, drawing, found, path.name)
    seconds = (found.seconds or 0.0) * (found.iterations or 0) * found.scenario.robots.count / ROBOTS
    return Imported(scenario, picture, found.problem, seconds)


def _world(keys: Keys) -> World:
    return convert(keys, World)


def _shown(file: Path, keys: Keys, answers: Answers) -> Drawing | None:
    """The file's contents in metres; None for a map in pixels."""
    if is_map(_world(keys)):
        _map(file, keys, answers)
        return None
    while True:
        try:
            drawing = drawing_of(_world(keys))
            break
        except InputError as problem:
            if "world.level" not in str(problem) or keys.get("level"):
                raise
            answers.tell(problem)
            keys["level"] = answers.text(f"{file.name} has several levels. Which one?", "--level NAME")
    for sentence in (*advice.figures(drawing), *drawing.notices):
        answers.tell(f"{file.name}: {sentence}.")
    left, _, right, _ = drawing.page
    if "width" in keys:
        return drawing
    scale = advice.stated_scale(drawing)
    if drawing.unit in ("mm", "cm", "in", "pt", "pc", "q", "Q") and right - left < PAPER:
        if scale and answers.choice(f"The page is {right - left:.3g} m of paper, and says 1:{scale}. Take that?", True):
            keys["scale"] = float(scale)
            return drawing_of(_world(keys))
    elif drawing.unit:
        answers.tell(f"It is {right - left:.4g} m wide, by its unit: {drawing.unit}.")
        return drawing
    doors = advice.width_by_doors(drawing)
    hint = ""
    if doors is not None:
        least, likely, most, count = doors
        hint = f"If its {count} doors are 0.7 to 1 m wide, it is {least:.3g} to {most:.3g} m; {likely:.3g} is likely. "
    own = f"It is {right - left:.4g} wide in its own units. " if not drawing.unit else ""
    keys["width"] = answers.length(f"{own}{hint}How wide is the page, in metres?", "--width METRES")
    return drawing_of(_world(keys))


def _map(file: Path, keys: Keys, answers: Answers) -> None:
    """Find the size of a map's pixels."""
    try:
        rosmap.read(file, None if "width" not in keys else 1.0)
    except InputError as problem:
        if "how large is a pixel" not in str(problem):
            raise
        keys["width"] = answers.length(f"{file.name} is a picture. How wide is it, in metres?", "--width METRES")


def _layers(drawing: Drawing | None, keys: Keys, answers: Answers) -> None:
    """Ask about layers that would be decoration."""
    taken = []
    none_yet = drawing is not None and not any(group.layer == "walls" for group in advice.groups(drawing))
    for group in advice.decoration(drawing) if drawing is not None else ():
        shapes = "1 shape" if group.shapes == 1 else f"{group.shapes} shapes"
        share = f"`{group.name}` ({shapes}, {100.0 * group.share:.0f} % of what is drawn) is not one of our layers, so"
        if answers.choice(f"{share} robots would drive through it. Is it a wall?", none_yet or group.share >= 0.5):
            taken.append(group.name)
    if taken and drawing is not None:
        walls = [group.name for group in advice.groups(drawing) if group.layer == "walls" and group.name]
        keys["layers"] = {"walls": [*dict.fromkeys([*walls, *taken])]}


def _reading(drawing: Drawing | None, keys: Keys, answers: Answers) -> None:
    """Read the floor plan, and ask about decisions made by rules."""

    def read() -> FloorPlan:
        world = _world(keys)
        return floor_plan(read_world(world, 0.15), world)

    try:
        plan = read()
    except InputError as problem:
        if 'world.solid = "strokes"' not in str(problem):
            raise
        answers.tell(problem)
        keys["solid"] = "strokes" if answers.choice("Take strokes for walls and fills for floor?", True) else "all"
        if keys["solid"] == "all":
            keys["border"] = True
        plan = read()
    for notice in plan.notices:
        told = notice.removeprefix(f"{keys['file']}: ")
        if drawing is None or told not in drawing.notices:
            answers.tell(f"{Path(keys['file']).name}: {told}.")
    if any("its strokes are taken for walls" in notice for notice in plan.notices):
        keys["solid"] = "strokes" if answers.choice("Take strokes for walls and fills for floor?", True) else "all"
    if plan.openings:
        count = f"{len(plan.openings)} closed rooms" if len(plan.openings) > 1 else "a closed room"
        keys["doors"] = DOOR if answers.choice(f"Make doors of {DOOR:g} m for {count}?", True) else 0.0
    elif not is_map(_world(keys)) and "doors" not in keys:
        keys["doors"] = DOOR
        opened = read()
        closed = len(opened.openings)
        asked = f"{closed} closed rooms have" if closed > 1 else "1 closed room has"
        if not closed or not answers.choice(f"{asked} no door. Make doors of {DOOR:g} m?", True):
            del keys["doors"]
    if not plan.border.is_empty:
        keys["border"] = answers.choice("Close the building there with a border?", True)
    if any("another one comes close" in notice for notice in plan.notices):
        keys["spawn"] = _start(plan, answers)


def _start(plan: FloorPlan, answers: Answers) -> list[float]:
    """A square in the free space where robots shall start."""
    free = polygons(shapely.difference(shapely.box(*plan.page), shapely.union(plan.walls, plan.unknown)))
    pieces = sorted(free.geoms, key=lambda piece: -piece.area)[:4]
    taken = next(iter(plan.spawns.values()))
    pieces.sort(key=lambda piece: -piece.intersection(taken).area)
    for piece in pieces:
        circle = shapely.maximum_inscribed_circle(piece, tolerance=0.05)
        (x, y), half = circle.coords[0], 0.7 * circle.length
        where = f"the space of {piece.area:.1f} m2 around ({x:.2f} m, {y:.2f} m)"
        if piece is pieces[-1] or answers.choice(f"Shall robots start in {where}?", True):
            break
    return [round(value, 3) for value in (x - half, y - half, 2.0 * half, 2.0 * half)]


def _inspected(keys: Keys, answers: Answers) -> tuple[float, Inspection]:
    """The building as a swarm finds it, with a reasonable number of cells."""
    world, cell = _world(keys), CELL
    plan = floor_plan(read_world(world, cell), world)
    cells = plan.width * plan.height / cell**2
    if cells > COARSE:
        larger = round(cell * (cells / COARSE) ** 0.5 + 0.05, 1)
        asked = f"{plan.width:.4g} m x {plan.height:.4g} m are {cells:,.0f} cells of {cell:g} m."
        cell = larger if answers.choice(f"{asked} Take cells of {larger:g} m?", True) else cell
    scenario = decode(bare(keys, cell), keys["file"])
    found = inspect(scenario, read_world(scenario.world, cell), keys["file"], 20.0 * scenario.robots.radius)
    for notice in found.notices:
        if notice not in plan.notices:
            answers.tell(f"{notice.replace(keys['file'], Path(keys['file']).name)}.")
    if found.floor is not None and not found.problem:
        rooms = f"{len(found.rooms)} room{'' if len(found.rooms) == 1 else 's'}"
        answers.tell(f"{rooms}, {float(found.floor.sum()) * cell**2:.1f} m2 of floor; 100 % is attainable.")
    return cell, found


def _write(path: Path, keys: Keys, cell: float, found: Inspection) -> None:
    """Write the scenario, with the file's path relative to its folder."""
    file = os.path.relpath(keys["file"], path.parent)
    robots = min(ROBOTS, max(found.seats, 1))
    limit = max(500, 4 * (found.iterations or 1250) * found.scenario.robots.count // robots)
    table = {
        "title": re.sub(r"[_-]+", " ", path.stem),
        "world": {**keys, "file": file},
        "grid": {"cell": cell},
        "robots": {"count": robots},
        "network": {"topology": {"use": "knn", "k": min(2, robots - 1)} if robots > 1 else {"use": "none"}},
        "stop": {"iterations": limit},
    }
    write_whole(path, tomli_w.dumps(table))


def _draw(path: Path, drawing: Drawing | None, found: Inspection, name: str) -> None:
    """Draw the file's contents, and the result."""
    plan, robots = found.arena.plan, found.scenario.robots
    if drawing is None:
        shown = [(plan.unknown, 0.3), (plan.layers["walls"], 1.0)]
    else:
        shown = [
            (area, ink)
            for shape in drawing.shapes
            for area, ink in ((shape.fill, shape.fill_ink), (shape.stroke, shape.stroke_ink))
            if not area.is_empty
        ]
    floor, pockets = None, []
    try:
        spawn = found.arena.area_name(robots.spawn)
        beside = unreached(found.arena, found.arena.reachable(spawn, robots.radius), robots.radius, spawn)
        floor, pockets = beside.home, list(beside.pockets)
    except InputError:  # told already
        free = shapely.get_parts(shapely.difference(shapely.box(*plan.page), joined([plan.walls])))
        floor = max(free, key=lambda piece: piece.area, default=None)
    figure = plots.imported(shown, plan, floor, pockets, f"{name}: {plan.width:.4g} m x {plan.height:.4g} m")
    save({path: figure})
