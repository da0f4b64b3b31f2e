"""Floor plans from IFC files (building information models): one storey, cut at the robots' height."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import msgspec
import shapely
from msgspec import Struct

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.scenario.file import World
from swarmsim.world.areas import polygons
from swarmsim.world.shapes import Drawing, Shape

LONGEST: Final = 600.0  # s, time limit of a model; damaged ones may never end
_ROOT: Final = Path(__file__).parents[3]
_CHILD: Final = "import sys; sys.path.append(sys.argv[1]); from swarmsim.world.bim.ifc import answer; answer()"


class _Task(Struct, frozen=True):
    path: str
    world: World


class _Answer(Struct, frozen=True, omit_defaults=True):
    """A drawing on its way between processes, or the error in the file."""

    problem: str = ""
    shapes: list[tuple[bytes, str, str, str]] = []  # fill as WKB, layer, group, where
    page: Box = (0.0, 0.0, 0.0, 0.0)
    unit: str = ""
    notices: tuple[str, ...] = ()


def read(path: Path, world: World) -> Drawing:
    """One storey of an IFC file, cut 0.3 m above it, in metres by the file's unit.

    `world.level` selects the storey, by its name, its number from 0 for the lowest, or its elevation (m); the default
    is the lowest with walls. Walls, stairs, ramps, railings, windows, curtain walls and all else that is built are in
    the layer `walls`, columns in `pillars`, furniture, equipment and lifts in `furniture`; slabs, roofs, coverings,
    footings and spaces are not solid. Doors and other openings between rooms are in the layer `doors`. Those that lead
    out of the building are closed, in `walls`, unless `world.border` is false or the file says that a door is not an
    outer one (IsExternal). A window is as thick as its wall. `group` is the IFC class.

    The library may crash on damaged files, so a separate process does the work. Raises InputError, with the file and
    what would be right.
    """
    if importlib.util.find_spec("ifcopenshell") is None:
        raise InputError(f'world: {path.name} needs ifcopenshell; install it with: pip install "swarmsim-lab[bim]"')
    task = msgspec.msgpack.encode(_Task(str(path), world))
    expected = "expected a building that other programs open"
    try:
        command = [sys.executable, "-P", "-c", _CHILD, str(_ROOT)]
        done = subprocess.run(command, input=task, capture_output=True, timeout=LONGEST, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: is not read after {LONGEST:g} s; {expected}") from None
    if done.returncode != 0:
        raise InputError(f"{path}: ifcopenshell fails on it (exit code {done.returncode}); {expected}")
    answer = msgspec.msgpack.decode(done.stdout, type=_Answer)
    if answer.problem:
        raise InputError(answer.problem)
    shapes = tuple(
        Shape(fill=polygons(shapely.from_wkb(fill)), layer=layer, group=group, where=where)
        for fill, layer, group, where in answer.shapes
    )
    return Drawing(str(path), shapes, answer.page, answer.unit, answer.notices, says_solid=True)


def answer() -> None:
    """Do the work in a separate process: read a task, write an answer."""
    from swarmsim.world.bim.cutting import cut

    out = os.dup(1)
    os.dup2(2, 1)  # keep the library's prints out of the answer
    task = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=_Task)
    try:
        drawing = cut(Path(task.path), task.world)
        shapes = [(shapely.to_wkb(shape.fill), shape.layer, shape.group, shape.where) for shape in drawing.shapes]
        found = _Answer("", shapes, drawing.page, drawing.unit, drawing.notices)
    except InputError as problem:
        found = _Answer(str(problem))
    with os.fdopen(out, "wb") as stream:
        stream.write(msgspec.msgpack.encode(found))
