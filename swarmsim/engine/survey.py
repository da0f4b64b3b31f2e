"""Surveys which parts of a building robots can reach, and what they can observe from there."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import Final, NoReturn, Self

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from swarmsim.core.building import Building, Survey
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError, PlacedError
from swarmsim.core.events import Box
from swarmsim.core.lending import lent
from swarmsim.core.parts import Actuator, Sensor
from swarmsim.core.readings import Readings, Tiles
from swarmsim.core.scenario import budget, registry
from swarmsim.core.scenario.file import Scenario, Sensors, World, sensors_of
from swarmsim.core.scenario.part import Buildable, Part
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.state import State
from swarmsim.core.streams import Streams
from swarmsim.engine.equipment import actuators
from swarmsim.engine.foreign import make, margin_of
from swarmsim.engine.guard import Clock, held
from swarmsim.kernels import occupancy
from swarmsim.world.arena import Arena
from swarmsim.world.plan import FloorPlan
from swarmsim.world.source import floor_plan
from swarmsim.world.unreached import unreached

MANY: Final = 20_000  # places surveyed at once
FEW: Final = 3  # of its neighbours, in rows and columns, the first place to look from
TINY: Final = 3.0  # m: smaller pages are often drawn to scale


@contextmanager
def told_to_scale(plan: FloorPlan, world: World) -> Iterator[None]:
    """Adds a hint about scale to errors from very small floor plans."""
    try:
        yield
    except InputError as problem:
        if max(plan.width, plan.height) >= TINY or not world.file:
            raise
        raise InputError(
            f"{problem}; the page is {plan.width:g} m x {plan.height:g} m: if it is drawn at a scale, say so: "
            f"world = {{file = {world.file!r}, scale = 100}}, or width = METRES"
        ) from problem


@dataclass(frozen=True, slots=True)
class Case:
    """All that a survey depends on."""

    text: str  # of the floor plan: SVG or GeoJSON
    world: World
    cell: float  # m
    robots: Robots  # one of each kind, which suffices
    sensors: Sensors
    actuators: tuple[Part[Actuator], ...]

    @classmethod
    def of(cls, text: str, scenario: Scenario) -> Self:
        """The building in a text, for a scenario's robots."""
        robots = scenario.robots
        groups = tuple(msgspec.structs.replace(group, count=1, mind=UNSET) for group in robots.groups)
        alone = msgspec.structs.replace(robots, count=1, groups=groups)
        return cls(text, scenario.world, scenario.grid.cell, alone, sensors_of(scenario), scenario.actuators)


@dataclass(frozen=True, slots=True)
class OpenGround:
    """A building without added boxes."""

    arena: Arena
    reachable: NDArray[np.bool_]  # (rows, columns): the cells that robots can get to from where they start
    roomy: NDArray[np.bool_]  # these, and cells that bodies fit through to, but not by free cells
    notices: tuple[str, ...]  # how the floor plan was taken, and what of it does not count


@lru_cache(maxsize=8)
def opened(case: Case) -> OpenGround:
    """The building as these robots can move in it; cached for a study's other runs. Raises InputError."""
    world, robots = case.world, case.robots
    plan = floor_plan(case.text, world)
    with told_to_scale(plan, world):
        margin = max(margin_of(one) for _, one in case.sensors) + 1
        arena = Arena.open(plan, case.cell, margin, world.title)
        budget.begin(budget.opening(arena.occupied.size))
        spawn = arena.area_name(robots.spawn)
        reachable = arena.reachable(spawn, robots.radius)
        beside = unreached(arena, reachable, robots.radius, spawn)
        if world.pockets == "refuse":
            beside.refuse(arena, robots.radius, spawn)
    roomy = reachable.copy()
    roomy[tuple(arena.lattice.cells(beside.coarse).T)] = True
    reachable.flags.writeable = roomy.flags.writeable = False
    return OpenGround(arena, reachable, roomy, (*plan.notices, *beside.notices(arena, robots.radius)))


@lru_cache(maxsize=16)
def surveyed(case: Case, boxes: tuple[Box, ...]) -> Survey:
    """The building with these boxes in place, without rooms that they cut off. Raises InputError."""
    ground, robots = opened(case), case.robots
    arena, reachable = ground.arena, ground.reachable
    home = arena.spawn_cells(robots.spawn)
    if boxes:
        arena = arena.with_boxes(boxes)
        reachable = arena.still_reachable(reachable, home, boxes, robots.radius)
    entrance = arena.lattice.centres(np.argwhere(reachable & home))
    for shared in (arena.occupied, entrance):
        shared.flags.writeable = False
    walls = lent(arena.segments)  # kernels get private copies
    return Survey(walls, arena.occupied, entrance, cache(partial(_explorable, case, arena, reachable)))


def _explorable(case: Case, arena: Arena, reachable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells that robots can observe from the `reachable` ones; without tiles, just these."""
    found = reachable
    alone = msgspec.structs.replace(case.robots, groups=(), count=1)
    context = BuildContext.of(alone, arena.lattice, 1.0, Streams(0), _walls_alone(arena))
    try:
        context = replace(context, actuators=actuators(case.actuators, context, False, Clock()).channels)
        seen = [_observable(place, one, context, reachable) for place, one in case.sensors]
        observed = [one for one in seen if one is not None]
        if observed:
            found = arena.explorable(reachable, np.asarray(np.logical_or.reduce(observed)))
    except InputError as problem:
        raise PlacedError(str(problem)) from problem
    if not found.any():
        raise PlacedError("sensor: robots see no cell from anywhere; expected beams that reach farther than a cell")
    found.flags.writeable = False
    return found


def _walls_alone(arena: Arena) -> Building:
    """The building before its explorable part is known."""

    def survey(boxes: tuple[Box, ...]) -> NoReturn:
        raise RuntimeError("a building that is being surveyed does not change")

    nothing = np.zeros_like(arena.occupied)
    return Building(Survey(arena.segments, arena.occupied, np.empty((0, 2)), lambda: nothing), survey)


def _surveying(sensor: Buildable[Sensor], context: BuildContext, place: str) -> Sensor:
    """A sensor that surveys what can be observed. Raises InputError that starts with its place in the scenario."""
    try:
        return sensor.build(context)
    except InputError as problem:
        raise InputError(f"{place}.{problem}") from problem


def _observable(
    place: str, part: Part[Sensor], context: BuildContext, reachable: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """The cells (rows, columns) observable from the centre of some reachable cell; None without tiles."""
    sensor = surveyor(place, part, context)
    if sensor is None:
        return None
    places = np.argwhere(reachable)
    observed = np.zeros(context.lattice.shape, np.bool_)
    work = budget.survey(len(places), *beams_of(part, context.lattice.cell))
    alike = part.declares("surveying", None) is not None  # it sees the same from a place at any time
    if alike:  # a few places observe most cells, and the others add nothing then
        few = (places % FEW == 0).all(axis=1)
        places = np.concatenate([places[few], places[~few]])
    window: NDArray[np.int64] | None = None
    for cells in budget.pieces(work, np.array_split(places, -(-len(places) // MANY))):
        new = cells if window is None else cells[~_known(observed, cells, window)]
        if not len(new):
            continue
        tiles = tiles_from(sensor, context, context.lattice.centres(new))
        occupancy.note_observed(tiles.values, tiles.origins, observed)
        if alike:
            first = tiles.origins[0] - new[0]
            window = np.array([first - 1, first + tiles.values.shape[1:] + 1])  # of even tiles, rounding shifts some
    return observed


def _known(observed: NDArray[np.bool_], cells: NDArray[np.int64], window: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each of `cells` (k, 2) has all of its `window` observed.

    The rows of the window (2, 2) are its first row and column and those behind its last, from the cell.
    """
    (top, left), (bottom, right) = (np.clip(cells + side, 0, observed.shape).T for side in window)
    rows = observed[top.min() : bottom.max()].astype(np.int32)
    total = np.pad(rows.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    top, bottom = top - top.min(), bottom - top.min()
    seen = total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
    return np.asarray(seen == (bottom - top) * (right - left))


def surveyor(place: str, part: Part[Sensor], context: BuildContext) -> Sensor | None:
    """A sensor that tells what can be observed in the long run; None without tiles.

    `place` is the sensor's in the scenario. Raises InputError, which starts with it.
    """
    # In the long run, gaps between beams do not limit what robots see.
    surveying: Buildable[Sensor] | None = part.declares("surveying", None)
    sensor = make(part, context, place) if surveying is None else _surveying(surveying, context, place)
    if "tiles" not in sensor.channels:
        return None
    return sensor if registry.is_ours(sensor) else held("sensor", sensor, context, Clock())


def tiles_from(sensor: Sensor, context: BuildContext, points: NDArray[np.float64]) -> Tiles:
    """What a sensor with tiles observes from points (k, 2): x, y in m; its robot heads along x."""
    alive = np.ones(len(points), np.bool_)
    pose = np.zeros((len(points), 3))
    pose[:, :2] = points
    rest = Readings.filled(context.actuators, {}, alive)
    return sensor.sense(State(0, pose, np.zeros_like(pose), np.zeros((len(points), 2)), alive, rest)).tiled


def beams_of(sensor: Part[Sensor], cell: float) -> tuple[int, float, int]:
    """About: a sensor's beams, how many cells of side `cell` (m) they cross in its tile, and the tile's cells."""
    margin = margin_of(sensor)
    beams, reach, beyond = sensor.declares("rays", (1, math.inf, False))
    return beams, reach / cell if beyond else min(reach / cell, margin), margin**2
