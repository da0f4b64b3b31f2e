"""Inspects a building for a swarm: its size, rooms, doors and pockets, and whether all of it can be mapped."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.errors import InputError
from swarmsim.core.scenario import budget
from swarmsim.core.scenario.file import Scenario, sensors_of
from swarmsim.engine.build import build
from swarmsim.engine.foreign import margin_of
from swarmsim.engine.survey import Case, opened, surveyed, told_to_scale
from swarmsim.world.arena import Arena
from swarmsim.world.cells import rim
from swarmsim.world.rooms import Doorway, Room, rooms_and_doors
from swarmsim.world.source import floor_plan

TICKS: Final = 20  # timed iterations
MOST_SEATS: Final = 1000  # robots placed to find the spawn area's capacity


@dataclass(frozen=True, slots=True)
class Pocket:
    """A piece of free space that robots cannot enter."""

    place: tuple[float, float]  # m: one of its cells
    cells: int


@dataclass(frozen=True, slots=True)
class Inspection:
    """The findings about a building; unknown ones are None, and `problem` says why."""

    arena: Arena
    scenario: Scenario
    floor: NDArray[np.bool_] | None  # (rows, columns): free cells around the spawn area
    domain: NDArray[np.bool_] | None  # (rows, columns): the cells that make 100 %
    rooms: list[Room]
    doors: list[Doorway]  # the narrowest first
    pockets: list[Pocket]  # the largest first
    seats: int  # the spawn area's capacity in robots, MOST_SEATS at most
    seconds: float | None  # of one iteration
    notices: tuple[str, ...]  # how the floor plan was taken, and what of it does not count
    problem: str | None  # why and where no run is possible

    @property
    def iterations(self) -> int | None:
        """About how many iterations a run takes: cells per robot times the time to cross one."""
        if self.domain is None:
            return None
        robots, cell = self.scenario.robots, self.arena.lattice.cell
        each = max(1.0, cell / (robots.speed * self.scenario.period))
        return round(each * int(self.domain.sum()) / robots.count)

    @property
    def memory(self) -> float:
        """About how many bytes a run's maps take, with what robots keep for their ways."""
        each = self.scenario.mind.computation.declares("cell_bytes", 0)
        return float(each * self.arena.occupied.size * self.scenario.robots.count)


def inspect(scenario: Scenario, text: str, name: str, widest: float) -> Inspection:
    """Inspect the building in `text` for a scenario's robots; doors are up to `widest` (m) wide.

    `name` is the scenario's in messages. Raises InputError for an unreadable building.
    """
    margin = max(margin_of(sensor) for _, sensor in sensors_of(scenario))
    plan = floor_plan(text, scenario.world)
    arena = Arena.open(plan, scenario.grid.cell, margin + 1, scenario.world.title)
    floor = domain = seconds = problem = None
    rooms: list[Room] = []
    doors: list[Doorway] = []
    seats = 0
    notices = plan.notices
    try:
        with told_to_scale(plan, scenario.world):
            floor = arena.floor(scenario.robots.spawn)
        rooms, doors = rooms_and_doors(floor, arena.lattice, arena.solid, widest)
        case = Case.of(text, scenario)
        with budget.of(scenario.budget):
            notices, found = opened(case).notices, surveyed(case, ())
            domain = found.explore()
        seats = _seats(found.entrance, scenario.robots.radius, scenario.grid.cell)
        seconds = _seconds(scenario, text, name)
    except InputError as wrong:
        problem = str(wrong)
        for known in (f"{name}: ", f"{scenario.world.title}: ", "100 % is unattainable: "):
            problem = problem.removeprefix(known)
    reached = floor if domain is None else domain
    return Inspection(
        arena, scenario, floor, domain, rooms, doors, _pockets(arena, reached), seats, seconds, notices, problem
    )  # fmt: skip


def _pockets(arena: Arena, reached: NDArray[np.bool_] | None) -> list[Pocket]:
    """The unreached pieces of free space inside the walls, not open to the outside."""
    left = ~arena.occupied if reached is None else ~arena.occupied & ~reached
    pieces: NDArray[np.int32]
    count: int
    pieces, count = ndimage.label(left)
    if not count:
        return []
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    outside = np.unique(pieces[rim(np.ones_like(left))])
    inner = np.setdiff1d(np.arange(1, count + 1), outside)
    order = inner[np.argsort(-sizes[inner], kind="stable")]
    first: list[tuple[slice, slice]] = ndimage.find_objects(pieces)
    pockets = []
    for piece in order:
        part = first[piece - 1]
        row, column = np.argwhere(pieces[part] == piece)[0]
        x, y = arena.lattice.centres(np.array([part[0].start + row, part[1].start + column]))
        pockets.append(Pocket((float(x), float(y)), int(sizes[piece])))
    return pockets


def _seats(entrance: NDArray[np.float64], radius: float, cell: float) -> int:
    """How many robots fit into the spawn area, placed one by one in the order of its cells."""
    near = max(1, int(np.pi * (2.0 * radius / cell) ** 2))
    entrance = entrance[: 2 * MOST_SEATS * near]  # more than the most robots can take up
    open_ = np.ones(len(entrance), np.bool_)
    count = 0
    while open_.any() and count < MOST_SEATS:
        chosen = entrance[open_.argmax()]
        open_ &= np.hypot(*(entrance - chosen).T) >= 2.0 * radius
        count += 1
    return count


def _seconds(scenario: Scenario, text: str, name: str) -> float:
    """Seconds per iteration here, measured over a run's first ones."""
    calm = msgspec.structs.replace(scenario, faults=())
    simulation = build(calm, name, text).simulation
    simulation.tick()
    begun = time.perf_counter()
    for _ in range(TICKS):
        if not simulation.over:
            simulation.tick()
    return (time.perf_counter() - begun) / TICKS


def free_area(arena: Arena, floor: NDArray[np.bool_]) -> float:
    """The area (m2) of floor between walls, including parts of cells beside walls."""
    left, right, low, high = arena.lattice.extent
    free = shapely.get_parts(shapely.box(left, low, right, high).difference(arena.solid))
    start = shapely.points(arena.lattice.centres(np.argwhere(floor)[0]))
    return float(sum(piece.area for piece in free if piece.intersects(start)))
