"""Scenario in, simulation out: finds the parts, opens the world and the random streams, places the robots."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.bodies import DifferentialDrive
from swarmsim.core.errors import InputError
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Sensor, Setting
from swarmsim.core.scenario import Scenario
from swarmsim.core.state import UNKNOWN, State
from swarmsim.core.streams import Streams
from swarmsim.simulation import Parts, Simulation
from swarmsim.world.arena import Arena
from swarmsim.world.svg import read_floor_plan


@dataclass(frozen=True, slots=True)
class Run:
    """A simulation at its start, and what its recording needs to know besides."""

    scenario: Scenario
    world: str  # the floor plan's SVG text
    arena: Arena
    domain: NDArray[np.bool_]  # (rows, columns): the cells that make 100 %
    simulation: Simulation


def build(scenario: Scenario, name: str, world: str | None = None) -> Run:
    """Make a run from a scenario; `name` is the scenario's file, for messages.

    The floor plan is read from the file that the scenario names unless its text is given as `world`.
    Raises InputError for whatever cannot work.
    """
    if world is None:
        world = _read(Path(scenario.world.file), name)
    robots, stop = scenario.robots, scenario.stop
    plan = read_floor_plan(world, scenario.world.file, scenario.world.scale)
    margin = max(scenario.sensor.get("tile", (1, 1))) + 1
    arena = Arena.open(plan, scenario.grid.cell, margin, scenario.world.file)
    reachable = arena.reachable(robots.spawn, robots.radius)
    setting = Setting(robots, arena.lattice, scenario.period, Streams(scenario.seed))

    def make(seam: str, place: str, *more: Any) -> Any:
        try:
            return scenario.part(seam).build(setting, *more)
        except InputError as problem:
            raise InputError(f"{name}: {place}.{problem}") from problem

    sensor = make("sensor", "sensor", arena.segments)
    domain = arena.coverage_domain(reachable, _observable(sensor, arena.lattice, reachable))
    pose = _place(setting, arena, reachable, name)
    bodies = DifferentialDrive(robots, scenario.physics, arena.segments, pose)
    parts = Parts(
        sensor=sensor,
        topology=make("topology", "network.topology", arena.segments),
        channel=make("channel", "network.channel", arena.segments),
        behaviour=make("behaviour", "behaviour"),
        motion=make("motion", "motion"),
        bodies=bodies,
    )
    simulation = Simulation(parts, domain, bodies.state(), scenario.period, stop.coverage, stop.iterations)
    return Run(scenario, world, arena, domain, simulation)


def _read(path: Path, name: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as problem:
        raise InputError(
            f"{name}: world: {path} cannot be read ({problem.strerror}); expected an SVG file"
        ) from problem
    except UnicodeDecodeError as problem:
        raise InputError(f"{name}: world: {path} is not UTF-8 text; expected an SVG file") from problem


def _observable(sensor: Sensor, lattice: Lattice, reachable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells (rows, columns) that a robot can observe from the centre of some reachable cell."""
    cells = np.argwhere(reachable)
    pose = np.zeros((len(cells), 3))
    pose[:, :2] = lattice.centres(cells)
    none = np.zeros((len(cells), 2))
    tiles = sensor.sense(State(0, pose, np.zeros_like(pose), none, np.ones(len(cells), np.bool_)))
    which, row, column = np.nonzero(tiles.values != UNKNOWN)
    observed = np.zeros(lattice.shape, np.bool_)
    observed[tiles.origins[which, 0] + row, tiles.origins[which, 1] + column] = True
    return observed


def _place(setting: Setting, arena: Arena, reachable: NDArray[np.bool_], name: str) -> NDArray[np.float64]:
    """Start poses (n, 3): each robot at the centre of a free cell of the spawn area, heading anywhere.

    Every robot draws from its own stream, after those with lower ids have taken their places, so that one
    more robot moves none of the others. Raises InputError if the area holds fewer robots.
    """
    robots = setting.robots
    cells = np.argwhere(reachable & arena.spawn_cells(robots.spawn))
    centres = setting.lattice.centres(cells)
    open_ = np.ones(len(centres), np.bool_)
    pose = np.empty((robots.count, 3))
    for robot in range(robots.count):
        if not open_.any():
            raise InputError(
                f"{name}: robots.count: spawn area {robots.spawn!r} of {arena.name} holds {robot} robots of radius "
                f"{robots.radius:g} m, not {robots.count}; expected fewer robots or a larger area"
            )
        stream = setting.streams.open("spawn", robot)
        # Drawing among all cells until one is open keeps the draw independent of who else is there.
        order = stream.permutation(len(centres))
        choice = order[open_[order]][0]
        pose[robot] = *centres[choice], stream.uniform(-np.pi, np.pi)
        open_ &= np.hypot(*(centres - centres[choice]).T) >= 2.0 * robots.radius
    return pose
