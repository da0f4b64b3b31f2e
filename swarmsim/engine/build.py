"""Builds a simulation from a scenario: opens the world, places the robots and assembles the parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.building import Building, Survey
from swarmsim.core.capabilities import LackingError
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.own import not_ending
from swarmsim.core.parts import Fault, Observer, Parts, Schedule
from swarmsim.core.probes import Row
from swarmsim.core.scenario import budget, registry
from swarmsim.core.scenario.file import HALVES, Network, Scenario, all_parts, minds_of
from swarmsim.core.scenario.identity import Code, code_of
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Knowledge, Moment
from swarmsim.core.streams import Streams
from swarmsim.engine import fitting, minds
from swarmsim.engine.equipment import actuators, drives, sensors
from swarmsim.engine.foreign import blamed, foreign, installed, make
from swarmsim.engine.guard import HELD, Clock, guarded, held, with_fault
from swarmsim.engine.jobs import bundled
from swarmsim.engine.placement import start_poses
from swarmsim.engine.probing import watching
from swarmsim.engine.processors import gauges_of
from swarmsim.engine.simulation import Simulation
from swarmsim.engine.survey import Case, beams_of, opened, surveyed
from swarmsim.recording.probes import Watching
from swarmsim.recording.recorder import Recorder
from swarmsim.robots.localisation import tracked
from swarmsim.robots.sensors import with_field
from swarmsim.world.arena import Arena
from swarmsim.world.cells import around
from swarmsim.world.source import read_world


@dataclass(frozen=True, slots=True)
class BuiltRun:
    """A simulation at its start, with all else that its recording needs."""

    scenario: Scenario
    world: str  # the floor plan's text: SVG or GeoJSON
    arena: Arena
    start: Survey  # of the building before anything changes it
    simulation: Simulation
    context: BuildContext  # of its parts
    reachable: NDArray[np.bool_]  # (rows, columns): cells that robots can reach from their starts
    roomy: NDArray[np.bool_]  # these, and cells that bodies fit through to, but not by free cells
    notices: tuple[str, ...]  # how the floor plan was read, and what was left out
    probes: tuple[Watching, ...]
    code: Code  # all behind it

    @property
    def explorable(self) -> NDArray[np.bool_]:
        """The cells (rows, columns) that robots can observe at the start. Raises InputError, as buildings do."""
        return self.start.explore()

    def recorder(self, path: Path, absent: Sequence[str] = ()) -> Recorder:
        """An observer that records the run in a new file, without what is `absent`."""
        arena, curve = self.arena, self.simulation.parts.task.curve
        parts = self.simulation.parts
        return Recorder(
            path, self.scenario, self.world, arena.lattice, self.explorable, arena.occupied, curve,
            not parts.localisation.exact, parts.sensor.channels, self.code.hashes, self.probes, parts.actuator.channels,
            absent,
        )  # fmt: skip

    def sampled(self, moment: Moment[Knowledge]) -> dict[str, Row]:
        """The probes' samples in an iteration: rows by table name."""
        return {name: row for probe in self.probes for name, row in probe.rows(moment).items()}

    def simulate(self, observers: Sequence[Observer] = ()) -> bool:
        """Run to the end; return whether the task was done before the limit.

        Raises InputError if a body has ended in or beyond a wall, since all measurements are then meaningless.
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
        """The robots whose bodies are in a wall, or in a place unreachable from the starts."""
        parts, arena = self.simulation.parts, self.arena
        if not self.scenario.physics.declares("walled", False):
            return []
        places = self.simulation.state.pose[:, :2]
        cells = arena.lattice.cells(places)
        row, column = cells[:, 0], cells[:, 1]
        inside: NDArray[np.bool_] = (
            (row >= 0) & (row < arena.lattice.rows) & (column >= 0) & (column < arena.lattice.columns)
        )
        near = math.ceil(self.scenario.robots.radius / arena.lattice.cell) + 1  # cells, known by their centres
        there = around(self.roomy, near)
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
    carried: Callable[[Part[Fault], Fault], Fault] = lambda part, fault: fault,
) -> BuiltRun:
    """Make a run from a scenario; `name` is the scenario's file, for messages.

    The floor plan is read from the scenario's file unless its text is given as `world`. A `strict` run also checks our
    own parts against their contracts. `watch` may replace the parts before any fault wraps them, and `carried` each
    fault before it is installed.
    Raises InputError for anything that cannot work.
    """
    try:
        with budget.of(scenario.budget), not_ending():
            if world is None:
                world = read_world(scenario.world, scenario.grid.cell)
            return _built(scenario, name, world, strict, watch or (lambda parts: parts), carried)
    except InputError as problem:
        raise InputError(f"{name}: {problem}") from problem


def _built(
    scenario: Scenario,
    name: str,
    world: str,
    strict: bool,
    watch: Callable[[Parts], Parts],
    carried: Callable[[Part[Fault], Fault], Fault],
) -> BuiltRun:
    stop, case, clock = scenario.stop, Case.of(world, scenario), Clock()
    ground = opened(case)
    context = _context(scenario, case)
    start = context.building.found
    parts, context = _parts(scenario, context, strict, clock)
    parts = _with_faults(scenario, context, watch(parts), clock, carried)
    if parts.jobs is not None:
        from swarmsim.jobs.takeovers import Takeovers

        parts.schedule.enter(Takeovers(parts.jobs))
    probes = watching(scenario, context, parts, clock)
    used = [foreign(one) for one in all_parts(scenario)]
    files = {file: name for each in used for file, name in each.items()}
    beams, length = max(beams_of(one, context.lattice.cell)[:2] for _, one in case.sensors)
    budget.begin(budget.running(context.swarm, scenario.limit, beams, length))
    simulation = Simulation(
        parts,
        scenario.period,
        scenario.limit,
        stop.when_done,
        lambda problem: blamed(problem, files),
        name,
        clock,
        scenario.network.exchanges,
    )
    return BuiltRun(
        scenario, world, ground.arena, start, simulation, context, ground.reachable, ground.roomy,
        ground.notices, probes, code_of(scenario),
    )  # fmt: skip


def _context(scenario: Scenario, case: Case) -> BuildContext:
    """The parts' build context: the building at the start, with the robots placed. Raises InputError."""
    arena = opened(case).arena

    def survey(boxes: tuple[Box, ...]) -> Survey:
        with budget.of(scenario.budget):  # also during the run
            found = surveyed(case, boxes)
        return replace(found, explore=budget.of(scenario.budget)(found.explore))

    robots = msgspec.structs.replace(scenario.robots, spawn=arena.area_name(scenario.robots.spawn))
    building = Building(survey(()), survey, bounds=arena.plan.page, lattice=arena.lattice)
    streams = Streams(scenario.seed)
    start = start_poses(robots, arena.lattice, streams, building.entrance, arena.name)
    context = BuildContext.of(robots, arena.lattice, scenario.period, streams, building, start)
    return replace(context, rounds=scenario.network.exchanges)


def _parts(scenario: Scenario, context: BuildContext, strict: bool, clock: Clock) -> tuple[Parts, BuildContext]:
    """The parts, which fit together and are guarded, and their build context. Raises InputError."""
    network = scenario.network
    if scenario.field:
        field = make(scenario.field, context)
        context = replace(
            context, scalar_field=field if registry.is_ours(field) else held("field", field, context, clock)
        )
    actuator = actuators(scenario.actuators, context, strict, clock)
    context = replace(context, actuators=actuator.channels)
    sensor = with_field(
        sensors(scenario, context, strict, clock), context, float(scenario.field.declares("noise", 0.0))
    )
    context = replace(context, channels=sensor.channels, kinematics=drives(scenario, context, strict, clock))
    found = minds.built_for(scenario, context)
    computation, strategy = minds.together(found, scenario, clock, strict)
    computation, jobs = bundled(computation, scenario, context, clock, strict)
    bodies = make(scenario.physics, context)
    parts = Parts(
        actuator=actuator,
        sensor=sensor,
        localisation=tracked(make(scenario.localisation, context), context),
        computation=computation,
        strategy=strategy,
        topology=make(network.topology, context),
        channel=make(network.channel, _on_air(network, context)),
        motion=make(scenario.motion, context),
        bodies=bodies,
        task=make(scenario.task, replace(context, processors=None if jobs is None else jobs.processors)),
        building=context.building,
        schedule=Schedule(bodies.state()),
        lattice=context.lattice,
        gauges=() if jobs is None else gauges_of(jobs.processors),
        jobs=jobs,
    )
    fitting.check(parts, found, scenario.task)
    theirs = {one.seam for one in all_parts(scenario) if foreign(one)}
    inside = {"sensor", "actuator", *(HALVES if len(found) > 1 else ())}  # their inner parts are guarded
    inside |= {"computation"} if jobs is not None else set()
    return guarded(parts, context, {*(HELD if strict else theirs)} - inside, theirs, clock), context


def _on_air(network: Network, context: BuildContext) -> BuildContext:
    """The context of a channel, whose iterations are exchanges."""
    return replace(context, period=context.period / context.rounds, broadcasts=network.charged == "sent")


def _with_faults(
    scenario: Scenario,
    context: BuildContext,
    parts: Parts,
    clock: Clock,
    carried: Callable[[Part[Fault], Fault], Fault],
) -> Parts:
    """The parts with the scenario's faults installed. Raises InputError."""
    for number, one in enumerate(scenario.faults):
        fault = carried(one, make(one, replace(context, number=number), f"faults[{number}]"))
        try:
            parts = with_fault(fault, parts, partial(installed, fault, one.use), clock)
            parts = replace(parts, localisation=tracked(parts.localisation, context))
        except LackingError as problem:
            found = minds_of(scenario)
            whose = repr(found[0].mind.computation.use) if len(found) == 1 else "that of groups with several minds"
            raise InputError(f"faults[{number}].{problem.of(whose)}") from problem
        except InputError as problem:
            raise problem.inside(f"faults[{number}]") from problem
    return parts
