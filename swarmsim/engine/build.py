"""Scenario in, simulation out: finds the parts, opens the world and the random streams, places the robots."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.adapters.minds import OF_ME
from swarmsim.core.building import Building, Survey
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.lattice import Lattice
from swarmsim.core.lending import lent
from swarmsim.core.own import not_ending
from swarmsim.core.parts import (
    Actuator,
    AnyComputation,
    AnyStrategy,
    AnyTask,
    Observer,
    Parts,
    Schedule,
    Sensor,
)
from swarmsim.core.probes import Row
from swarmsim.core.readings import Channels, Readings
from swarmsim.core.scenario import budget, registry
from swarmsim.core.scenario.file import Scenario, Sensors, World, all_parts, fitted, parts_of, sensors_of
from swarmsim.core.scenario.identity import Code, code_of
from swarmsim.core.scenario.part import Buildable, Part
from swarmsim.core.scenario.robots import Robots
from swarmsim.core.seams import SEAMS
from swarmsim.core.state import Knowledge, Moment, State
from swarmsim.core.streams import Streams
from swarmsim.engine import contracts
from swarmsim.engine.foreign import announced, blamed, built, foreign, installed, margin_of
from swarmsim.engine.guard import HELD, Clock, guarded, held, with_fault
from swarmsim.engine.probing import watching
from swarmsim.engine.simulation import Simulation
from swarmsim.kernels import occupancy
from swarmsim.recording import layout
from swarmsim.recording.probes import Watching
from swarmsim.recording.recorder import Recorder
from swarmsim.robots.localisation import tracked
from swarmsim.robots.sensors import with_field
from swarmsim.robots.suites import MixedSensor, Rig, Suite, TwiceError
from swarmsim.world.arena import Arena
from swarmsim.world.cells import around
from swarmsim.world.plan import FloorPlan
from swarmsim.world.source import floor_plan, read_world
from swarmsim.world.unreached import unreached

P = TypeVar("P")
Asked = dict[str, Part[object]]  # the parts of a scenario, by seam
Equipment = tuple[Sensors, tuple[Part[Actuator], ...]]  # what robots have, of which a world's survey knows

MANY = 20_000  # places from which is looked at once
MOST_MAPPED = 20_000_000_000  # cells of all maps together
LARGE, TRIES = 10_000, 100  # cells of a spawn area that are drawn from one by one, and how often
TINY = 3.0  # m: smaller pages are often drawn at a scale


@contextmanager
def told_to_scale(plan: FloorPlan, world: World) -> Iterator[None]:
    """What is wrong with a tiny floor plan may be its scale: then its InputError says how to tell."""
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
class Run:
    """A simulation at its start, and what its recording needs to know besides."""

    scenario: Scenario
    world: str  # the floor plan's text: SVG or GeoJSON
    arena: Arena
    domain: NDArray[np.bool_]  # (rows, columns): the cells that make 100 % at the start
    simulation: Simulation
    context: BuildContext  # what its parts were built for
    reachable: NDArray[np.bool_]  # (rows, columns): the cells that robots can get to from where they start
    notices: tuple[str, ...]  # how the floor plan was taken, and what of it does not count
    probes: tuple[Watching, ...]
    code: Code  # all that makes it

    def recorder(self, path: Path) -> Recorder:
        """An observer that records the run in a new file."""
        arena, curve = self.arena, self.simulation.parts.task.curve
        parts = self.simulation.parts
        return Recorder(
            path, self.scenario, self.world, arena.lattice, self.domain, arena.occupied, curve,
            not parts.localisation.exact, parts.sensor.channels, self.code.hashes, self.probes, parts.actuator.channels,
        )  # fmt: skip

    def sampled(self, moment: Moment[Knowledge]) -> dict[str, Row]:
        """What the probes sample in an iteration: rows by the names of their tables in a recording."""
        return {name: row for probe in self.probes for name, row in probe.rows(moment).items()}

    def simulate(self, observers: Sequence[Observer] = ()) -> bool:
        """Run to the end; gives whether the task was done before the limit.

        Raises InputError if a body has ended in or beyond a wall, for then nothing that was measured means anything.
        """
        finished = self.simulation.run(observers)
        if astray := self.astray():
            raise InputError(
                f"{self.simulation.name}: physics.substep: robot{'s' if len(astray) > 1 else ''} "
                f"{', '.join(map(str, astray))} ended in or beyond a wall, which physics in sub-steps this long did "
                f"not hold; expected a shorter one"
            )
        return finished

    def astray(self) -> list[int]:
        """The robots whose bodies are in a wall, or where nobody can get to from where they started."""
        parts, arena = self.simulation.parts, self.arena
        if not self.scenario.physics.declares("walled", False):
            return []
        places = self.simulation.state.pose[:, :2]
        cells = arena.lattice.cells(places)
        row, column = cells[:, 0], cells[:, 1]
        inside: NDArray[np.bool_] = (
            (row >= 0) & (row < arena.lattice.rows) & (column >= 0) & (column < arena.lattice.columns)
        )
        near = math.ceil(self.scenario.robots.radius / arena.lattice.cell) + 1  # cells: what is known are their centres
        there = around(self.reachable, near)
        walls = (arena.with_boxes(parts.building.boxes) if parts.building.boxes else arena).solid
        fine: NDArray[np.bool_] = inside & ~shapely.contains_xy(walls, *places.T)
        fine[inside] &= there[row[inside], column[inside]]
        return np.flatnonzero(parts.bodies.solid & ~fine).tolist()


def build(
    scenario: Scenario,
    name: str,
    world: str | None = None,
    strict: bool = False,
    watch: Callable[[Parts], Parts] | None = None,
) -> Run:
    """Make a run from a scenario; `name` is the scenario's file, for messages.

    The floor plan is read from the file that the scenario names unless its text is given as `world`. A `strict` run
    holds our own parts to their contracts too. What `watch` gives takes the place of the parts before any fault wraps
    them.
    Raises InputError for whatever cannot work.
    """
    try:
        with budget.of(scenario.budget), not_ending():
            if world is None:
                world = read_world(scenario.world, scenario.grid.cell)
            return _built(scenario, name, world, strict, watch)
    except InputError as problem:
        raise InputError(f"{name}: {problem}") from problem


def _built(scenario: Scenario, name: str, world: str, strict: bool, watch: Callable[[Parts], Parts] | None) -> Run:
    robots, stop, asked, sensors = scenario.robots, scenario.stop, parts_of(scenario), sensors_of(scenario)
    key = world, scenario.world, scenario.grid.cell, _of_each_kind(robots), (sensors, scenario.actuators)

    def survey(boxes: tuple[Box, ...]) -> Survey:
        with budget.of(scenario.budget):  # also while the run goes on
            return _survey(*key, boxes)

    ground = _open(*key)
    arena = ground.arena
    cells = arena.lattice.rows * arena.lattice.columns
    if robots.count * cells > MOST_MAPPED:
        raise InputError(
            f"grid.cell: {robots.count} robots with maps of {cells} cells each would have more than {MOST_MAPPED} "
            f"cells; expected fewer robots or larger cells"
        )
    robots = msgspec.structs.replace(robots, spawn=arena.area_name(robots.spawn))
    plain = survey(())
    building = Building(plain.walls, plain.occupied, plain.domain, plain.entrance, survey, bounds=arena.plan.page)
    streams = Streams(scenario.seed)
    start = _start(robots, arena.lattice, streams, plain.entrance, arena.name)
    context = BuildContext.of(robots, arena.lattice, scenario.period, streams, building, start)
    clock = Clock()
    if scenario.field:
        field = _make(scenario.field, context)
        context = replace(
            context, scalar_field=field if registry.is_ours(field) else held("field", field, context, clock)
        )
    actuator = _actuators(scenario.actuators, context, strict, clock)
    context = replace(context, actuators=actuator.channels)
    sensor = with_field(
        _sensors(scenario, context, strict, clock), context, float(scenario.field.declares("noise", 0.0))
    )
    context = replace(context, channels=sensor.channels)
    mind, network = scenario.mind, scenario.network
    bodies = _make(scenario.physics, context)
    parts = Parts(
        actuator=actuator,
        sensor=sensor,
        localisation=tracked(_make(scenario.localisation, context), context),
        computation=_make(mind.computation, context),
        strategy=_make(mind.strategy, context),
        topology=_make(network.topology, context),
        channel=_make(network.channel, context),
        motion=_make(scenario.motion, context),
        bodies=bodies,
        task=_make(scenario.task, context),
        building=building,
        schedule=Schedule(bodies.state()),
        lattice=arena.lattice,
    )
    for seam, part in (("strategy", parts.strategy), ("task", parts.task)):
        _check_knowledge(SEAMS[seam].at, part, parts.computation, asked)
    _check_channels(parts, asked)
    _check_names(parts, asked)
    theirs = {one.seam for one in all_parts(scenario) if foreign(one)}
    parts = guarded(
        parts, context, {*(HELD if strict else theirs)} - {"sensor", "actuator"}, theirs, clock
    )  # held already
    parts = parts if watch is None else watch(parts)
    for number, one in enumerate(scenario.faults):
        fault = _make(one, replace(context, number=number), f"faults[{number}]")
        try:
            parts = with_fault(fault, parts, partial(installed, fault, one.use), clock)
            parts = replace(parts, localisation=tracked(parts.localisation, context))
        except InputError as problem:
            raise InputError(f"faults[{number}].{problem}") from problem
    probes = watching(scenario, context, parts, clock)
    used = [foreign(one) for one in all_parts(scenario)]
    files = {file: name for each in used for file, name in each.items()}
    beams, length = max(_beams(one, arena.lattice.cell)[:2] for _, one in sensors)
    budget.begin(budget.running(robots.count, stop.iterations, beams, length))
    simulation = Simulation(
        parts, scenario.period, stop.iterations, stop.when_done, lambda problem: blamed(problem, files), name, clock
    )
    return Run(
        scenario, world, arena, plain.domain, simulation, context, ground.reachable, ground.notices, probes,
        code_of(scenario),
    )  # fmt: skip


def _sensors(scenario: Scenario, context: BuildContext, strict: bool, clock: Clock) -> Sensor:
    """The sensors of a swarm as one; of a mixed swarm, those of its groups. Raises InputError."""
    suites = [_suite(sensors, context, strict, clock) for sensors in fitted(scenario)]
    if len(suites) == 1:
        return suites[0]
    counts = [group.count for group in scenario.robots.groups]
    ends = np.cumsum(counts)
    return MixedSensor(
        [(suite, np.arange(end - n, end)) for suite, end, n in zip(suites, ends.tolist(), counts, strict=True)]
    )


def _suite(sensors: Sensors, context: BuildContext, strict: bool, clock: Clock) -> Sensor:
    """The sensors of the same robots as one. Raises InputError that starts with the place in the scenario."""
    made: list[Sensor] = []
    for number, (place, one) in enumerate(sensors):
        part = _make(one, replace(context, number=number), place)
        wrong = contracts.declared(part.channels, context.swarm) or _wrong_names(part.channels)
        if wrong is not None:
            raise InputError(f"{place}.use: {one.use!r} declares {wrong}")
        if strict or not registry.is_ours(part):
            part = held("sensor", part, context, clock, not registry.is_ours(part))
        made.append(part)
    names = [str(one.declares("name", None) or "") for _, one in sensors]
    try:
        return made[0] if len(made) == 1 and not names[0] else Suite(made, names)
    except TwiceError as problem:
        raise InputError(problem.told([place for place, _ in sensors])) from problem


def _actuators(listed: tuple[Part[Actuator], ...], context: BuildContext, strict: bool, clock: Clock) -> Rig:
    """The actuators of all robots as one. Raises InputError that starts with the place in the scenario."""
    made: list[Actuator] = []
    places = [f"actuators[{number}]" for number in range(len(listed))]
    for number, (place, one) in enumerate(zip(places, listed, strict=True)):
        part = _make(one, replace(context, number=number), place)
        wrong = contracts.acting(part.channels, context.swarm) or _wrong_names(part.channels, "actuator")
        if wrong is not None:
            raise InputError(f"{place}.use: {one.use!r} declares {wrong}")
        if strict or not registry.is_ours(part):
            part = held("actuator", part, context, clock, not registry.is_ours(part))
        made.append(part)
    try:
        return Rig(made, [str(one.declares("name", None) or "") for one in listed])
    except TwiceError as problem:
        raise InputError(problem.told(places)) from problem


def _wrong_names(channels: Channels, seam: str = "sensor") -> str | None:
    """Why a channel cannot be called so, or None: minds find a sensor's under that name, and recordings a table."""
    for channel in channels:
        if channel.name in OF_ME and seam == "sensor":
            return f"{channel.name!r}: a mind finds something else as me.{channel.name}; expected 'my_{channel.name}'"
        table = channel.recorded_as
        wrong = table and (
            layout.wrong_name(table, seam)
            or layout.wrong_form(table, np.empty((1, *channel.shape), channel.dtype), layout.EACH, 1)
        )
        if wrong:
            return f"{channel.name!r}: {wrong}"
    return None


def _check_channels(parts: Parts, asked: Asked) -> None:
    """Raise InputError for a part that needs a channel which no sensor of these robots gives."""
    channels = parts.sensor.channels
    for seam, part in (("computation", parts.computation), ("strategy", parts.strategy), ("task", parts.task)):
        for name in getattr(part, "requires", ()):
            if name in channels:
                continue
            parted = [one.name for one in channels if one.name.partition(".")[0] == name]
            if parted:
                why = f"groups of robots have different ones ({', '.join(parted)}); expected equal sensors"
            else:
                why = f"their sensors give {channels.listed()}; expected {_giving(name)}"
            use = asked[seam].use
            raise InputError(f"{SEAMS[seam].at}.use: {use!r} needs {name!r} from the sensors of robots: {why}")


def _giving(name: str) -> str:
    """The sensors that give a channel, as far as they tell before they are built."""
    known = {use: getattr(kind, "gives", {}) for use, kind in registry.known("sensor").items()}
    found = [f"{use!r}{gives[name] and f' with {gives[name]}'}" for use, gives in known.items() if name in gives]
    return f"the sensor {' or '.join(found)}" if found else "a sensor that gives it"


def _check_knowledge(place: str, part: AnyStrategy | AnyTask, computation: AnyComputation, asked: Asked) -> None:
    """Raise InputError unless the part reads what the computation gives."""
    if not issubclass(computation.knowledge_type, part.requires_knowledge):
        raise InputError(
            f"{place}.use: {asked[place.rpartition('.')[2]].use!r} reads {part.requires_knowledge.__name__}, and "
            f"{asked['computation'].use!r} gives {computation.knowledge_type.__name__}; expected a "
            f"{place.rpartition('.')[2]} and a computation that go together"
        )


def _check_names(parts: Parts, asked: Asked) -> None:
    """Raise InputError for a name under which something is to be recorded, and that is taken, as far as it is known."""
    used = {one.recorded_as: "sensor" for one in parts.sensor.channels if one.recorded_as}  # whose each name is
    for one in parts.actuator.channels:
        if one.recorded_as in used:
            raise InputError(f"actuators: {one.recorded_as!r} is what a sensor gives already; expected another name")
        used |= {one.recorded_as: "actuator"} if one.recorded_as else {}
    for seam, part in (("computation", parts.computation), ("task", parts.task)):
        place = f"{SEAMS[seam].at}.use: {asked[seam].use!r}"
        for name, says, at in announced(seam, part):
            wrong = layout.wrong_name(name, seam)
            if wrong is None and name in used:
                wrong = f"{name!r} is what the {used[name]} gives already; expected such as 'own_{name}'"
            if wrong is not None:
                raise InputError(f"{place} {says}: {wrong}{at}")
            used[name] = seam


@dataclass(frozen=True, slots=True)
class _Explorable:
    arena: Arena
    reachable: NDArray[np.bool_]  # (rows, columns)
    domain: NDArray[np.bool_]  # (rows, columns)
    notices: tuple[str, ...]  # how the floor plan was taken, and what of it does not count


@lru_cache(maxsize=8)
def _open(text: str, world: World, cell: float, robots: Robots, equipment: Equipment) -> _Explorable:
    """The world as these robots can explore it; cached for a study's other runs. Raises InputError."""
    plan = floor_plan(text, world)
    with told_to_scale(plan, world):
        margin = max(margin_of(one) for _, one in equipment[0]) + 1
        arena = Arena.open(plan, cell, margin, world.title)
        budget.begin(budget.opening(arena.occupied.size))
        spawn = arena.area_name(robots.spawn)
        reachable = arena.reachable(spawn, robots.radius)
        beside = unreached(arena, reachable, robots.radius, spawn)
        if world.pockets == "refuse":
            beside.refuse(arena, robots.radius, spawn)
    observed = _observed(equipment, arena, robots, reachable)
    domain = reachable if observed is None else arena.coverage_domain(reachable, observed)
    if not domain.any():
        raise InputError("sensor: robots see no cell from anywhere; expected beams that reach farther than a cell")
    for shared in (reachable, domain):
        shared.flags.writeable = False
    return _Explorable(arena, reachable, domain, (*plan.notices, *beside.notices(arena, robots.radius)))


@lru_cache(maxsize=16)
def _survey(
    text: str, world: World, cell: float, robots: Robots, equipment: Equipment, boxes: tuple[Box, ...]
) -> Survey:
    """What can be explored of the world with boxes standing in it; a room that they cut off is left out."""
    ground = _open(text, world, cell, robots, equipment)
    arena, reachable, domain = ground.arena, ground.reachable, ground.domain
    home = arena.spawn_cells(robots.spawn)
    if boxes:
        arena = arena.with_boxes(boxes)
        reachable = arena.still_reachable(reachable, home, boxes, robots.radius)
        observed = _observed(equipment, arena, robots, reachable)
        domain = reachable if observed is None else arena.coverage_domain(reachable, observed)
    entrance = arena.lattice.centres(np.argwhere(reachable & home))
    for shared in (arena.occupied, domain, entrance):
        shared.flags.writeable = False
    walls = lent(arena.segments)  # kernels get copies, of which others know nothing
    return Survey(walls, arena.occupied, domain, entrance)


def explored(text: str, scenario: Scenario) -> tuple[NDArray[np.bool_], NDArray[np.float64], tuple[str, ...]]:
    """The domain (rows, columns) of a scenario's building, where robots may start (c, 2), in m, and notices.

    Raises InputError for a building in which the robots cannot run.
    """
    equipment = sensors_of(scenario), scenario.actuators
    key = text, scenario.world, scenario.grid.cell, _of_each_kind(scenario.robots), equipment
    with budget.of(scenario.budget):
        found = _survey(*key, ())
        return found.domain, found.entrance, _open(*key).notices


def _of_each_kind(robots: Robots) -> Robots:
    """One robot of each kind: what can be reached and observed depends on no more."""
    groups = tuple(msgspec.structs.replace(group, count=1) for group in robots.groups)
    return msgspec.structs.replace(robots, count=1, groups=groups)


def _walls_alone(arena: Arena) -> Building:
    """The building before anybody has found out what can be explored in it."""

    def survey(boxes: tuple[Box, ...]) -> Survey:
        raise RuntimeError("a building that is being surveyed does not change")

    nothing = np.zeros_like(arena.occupied)
    return Building(arena.segments, arena.occupied, nothing, np.empty((0, 2)), survey)


def _surveying(sensor: Buildable[Sensor], context: BuildContext, place: str) -> Sensor:
    """A sensor that finds out what can be observed. Raises InputError that starts with its place in the scenario."""
    try:
        return sensor.build(context)
    except InputError as problem:
        raise InputError(f"{place}.{problem}") from problem


def _make(part: Part[P], context: BuildContext, place: str = "") -> P:
    """The part, built. Raises InputError that starts with its place in the scenario."""
    try:
        return built(part, context)
    except InputError as problem:
        raise InputError(f"{place or SEAMS[part.seam].at}.{problem}") from problem


def _observed(
    equipment: Equipment, arena: Arena, robots: Robots, reachable: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """The cells (rows, columns) that a robot of any of these sensors can observe; None without tiles."""
    context = BuildContext.of(
        msgspec.structs.replace(robots, groups=(), count=1), arena.lattice, 1.0, Streams(0), _walls_alone(arena)
    )
    context = replace(context, actuators=_actuators(equipment[1], context, False, Clock()).channels)
    found = [_observable(place, one, context, reachable) for place, one in equipment[0]]
    seen = [one for one in found if one is not None]
    return np.asarray(np.logical_or.reduce(seen)) if seen else None


def _observable(
    place: str, part: Part[Sensor], context: BuildContext, reachable: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """The cells (rows, columns) that a robot can observe from the centre of some reachable cell; None without tiles."""
    lattice = context.lattice
    # What robots can see in the end does not depend on gaps between their beams.
    surveying: Buildable[Sensor] | None = part.declares("surveying", None)
    sensor = _make(part, context, place) if surveying is None else _surveying(surveying, context, place)
    if "tiles" not in sensor.channels:
        return None
    if not registry.is_ours(sensor):
        sensor = held("sensor", sensor, context, Clock())
    places = np.argwhere(reachable)
    observed = np.zeros(lattice.shape, np.bool_)
    work = budget.survey(len(places), *_beams(part, lattice.cell))
    for cells in budget.pieces(work, np.array_split(places, -(-len(places) // MANY))):
        pose = np.zeros((len(cells), 3))
        pose[:, :2] = lattice.centres(cells)
        none, alive = np.zeros((len(cells), 2)), np.ones(len(cells), np.bool_)
        rest = Readings.filled(context.actuators, {}, alive)
        tiles = sensor.sense(State(0, pose, np.zeros_like(pose), none, alive, rest)).tiled
        occupancy.note_observed(tiles.values, tiles.origins, observed)
    return observed


def _beams(sensor: Part[Sensor], cell: float) -> tuple[int, float, int]:
    """A sensor's beams, how many cells of side `cell` (m) they reach into its tile, and the tile's cells; about."""
    margin = margin_of(sensor)
    beams, reach, beyond = sensor.declares("rays", (1, math.inf, False))
    return beams, reach / cell if beyond else min(reach / cell, margin), margin**2


def _start(
    robots: Robots, lattice: Lattice, streams: Streams, centres: NDArray[np.float64], world: str
) -> NDArray[np.float64]:
    """Start poses (n, 3): each robot at one of the `centres` (c, 2) of free cells of the spawn area, heading anywhere.

    Every robot draws from its own stream, after those with lower ids have taken their places, so that one
    more robot moves none of the others. Raises InputError if the area holds fewer robots.
    """
    open_ = np.ones(len(centres), np.bool_)
    left, apart = len(centres), 2.0 * robots.radius
    cells, width = lattice.cells(centres), math.ceil(apart / lattice.cell)
    places = np.full(np.array(lattice.shape) + 2 * width, -1)  # which of the centres is in each cell, if any
    places[tuple(cells.T + width)] = np.arange(len(centres))
    pose = np.empty((robots.count, 3))
    for robot in range(robots.count):
        if left == 0:
            raise InputError(
                f"robots.count: spawn area {robots.spawn!r} of {world} holds {robot} robots of radius "
                f"{robots.radius:g} m, not {robots.count}; expected fewer robots or a larger area"
            )
        stream = streams.open("spawn", robot)
        choice = _drawn(stream, open_)
        pose[robot] = *centres[choice], stream.uniform(-np.pi, np.pi)
        row, column = cells[choice]
        beside = places[row : row + 2 * width + 1, column : column + 2 * width + 1]
        beside = beside[beside >= 0]
        beside = beside[np.hypot(*(centres[beside] - centres[choice]).T) < apart]
        left -= int(np.count_nonzero(open_[beside]))
        open_[beside] = False
    return pose


def _drawn(stream: np.random.Generator, open_: NDArray[np.bool_]) -> int:
    """One of the cells that are open, by a draw among all of them, which is independent of how many are.

    A small area is put in random order, of which the first open cell is taken. Of a large one, cells are drawn until
    one is open; only if that takes long it is put in order as well.
    """
    for _ in range(TRIES if len(open_) > LARGE else 0):
        choice = int(stream.integers(len(open_)))
        if open_[choice]:
            return choice
    order = stream.permutation(len(open_))
    return int(order[open_[order]][0])
