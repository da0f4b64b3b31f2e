"""What has to hold in any run, found without code of the package: shapely for walls and beams, a ledger for letters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from random import Random
from typing import Any

import numpy as np
import shapely
from conftest import worded
from generated.buildings import solid_of
from generated.letters import Ledger, Taps
from generated.scenarios import Scenario

from swarmsim.core.state import Moment
from swarmsim.engine.build import BuiltRun

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
LOOKS = 16  # robots whose beams are cast again, of all robots and iterations of a run
NEAR = 1e-5  # m: so far, rounding decides
CLIPPED = 0.2  # cells: a beam with a shorter way through a cell says nothing about it
FASTEST = 3.0  # times a wheel's top speed: who is faster, without a push, was given energy by a collision
OUT = {"removed", "crashed", "late", "battery empty"}  # events after which a robot is dead ...
BACK = {"returned", "repaired", "joined"}  # ... and after which it is alive
ERRORS = ("blind", "cone", "error", "error_share", "error_square", "drop_out", "outliers", "step")
#: Why a robot may know a cell that nobody has sensed, by what a scenario has.
BELIEVED = {
    "byzantine": "liars tell of cells that they have made up",
}


class Witness:
    """A probe that holds a run to all of it, iteration by iteration."""

    def __init__(self, scenario: Scenario, run: BuiltRun) -> None:
        parts = run.simulation.parts
        self._senses, taps = _Senses(parts), Taps()
        run.simulation.parts = replace(taps.on(parts), sensor=self._senses)
        self._run, self._robots = run, run.scenario.robots.count
        solid = scenario.solid if scenario.solid is not None else solid_of(run.world)
        self._matter = _Matter(solid)
        self._radii = np.array([one.radius for one in _each(run)])
        self._dice = Random(scenario.number)
        self.ledger = Ledger(run, taps)
        self.checks: list[Callable[[Moment], None]] = [
            self._numbers, self._bodies, _Lives(run).check, self.ledger.check,
            _Truth(run, self._matter).check, _Beams(run, self._matter, self._senses, self._dice).check,
        ]  # fmt: skip
        if "coverage" in run.scenario.task.table["use"]:
            self.checks.append(_Count(run).check)
        self._kinds = {fault.use for fault in run.scenario.faults}

    def sample(self, moment: Moment) -> None:
        """Check one iteration."""
        for check in self.checks:
            try:
                check(moment)
            except AssertionError as problem:
                raise AssertionError(f"iteration {moment.state.iteration}: {problem}") from problem

    def _numbers(self, moment: Moment) -> None:
        """Nothing is NaN that may not be, and no robot is faster than wheels make."""
        state, scenario = moment.state, self._run.scenario
        for name in ("pose", "velocity", "wheels"):
            assert np.isfinite(getattr(state, name)).all(), f"{name} is not finite"
        assert 0.0 <= moment.measured.progress <= 1.0, "progress is no share"
        if scenario.physics.use == "pymunk" and not self._kinds & {"push", "people"}:
            pace = np.hypot(*state.velocity[:, :2].T)
            assert pace.max() <= FASTEST * scenario.robots.speed, f"a robot at {pace.max()} m/s"

    def _bodies(self, moment: Moment) -> None:
        """No body is in a wall, in a box or in another one."""
        if self._run.scenario.physics.use != "pymunk":
            return  # points go through everything
        hard = bool(self._kinds & {"push", "people"}) or self._robots > 5
        deep, tight = (0.5, 0.7) if hard else (0.1, 0.95)
        solid = self._run.simulation.parts.bodies.solid
        centres, radii = moment.state.pose[solid, :2], self._radii[solid]
        matter = self._matter.now(moment.building.boxes)
        reaches = radii - shapely.distance(matter, shapely.points(centres))
        assert (reaches <= deep * radii).all(), f"bodies reach {reaches.max():.4f} m into walls"
        apart = np.hypot(*(centres[:, None] - centres).transpose(2, 0, 1)) / np.add.outer(radii, radii)
        assert (apart[~np.eye(len(centres), dtype=bool)] >= tight).all(), "two bodies are in one place"


def _each(run: BuiltRun) -> list[Any]:
    """What each robot is made of."""
    robots = run.scenario.robots
    return [group for group in robots.groups for _ in range(group.count)] or [robots] * robots.count


class _Senses:
    """Keeps what the sensor gives, before anybody believes anything, and who walked about then."""

    def __init__(self, parts: Any) -> None:
        self._inner, self._building, self.channels = parts.sensor, parts.building, parts.sensor.channels

    def sense(self, state: Any) -> Any:
        self.people = self._building.walkers().copy()
        self.readings = self._inner.sense(state)
        return self.readings


class _Matter:
    """What is solid: the walls, and the boxes of the moment."""

    def __init__(self, walls: shapely.Geometry) -> None:
        self._walls = walls
        self.now, self.edges = cache(self._with), cache(self._edges)

    def _with(self, boxes: tuple[Any, ...]) -> shapely.Geometry:
        found = shapely.union_all([self._walls, *(shapely.box(*box) for box in boxes)])
        shapely.prepare(found)
        return found

    def _edges(self, boxes: tuple[Any, ...]) -> shapely.STRtree:
        lines, which = shapely.get_coordinates(shapely.get_parts(shapely.boundary(self.now(boxes))), return_index=True)
        pairs = np.stack([lines[:-1], lines[1:]], axis=1)[which[:-1] == which[1:]]
        return shapely.STRtree(shapely.linestrings(pairs))


class _Truth:
    """A cell is occupied if anything solid covers any of it."""

    def __init__(self, run: BuiltRun, matter: _Matter) -> None:
        self._lattice, self._matter, self._version = run.arena.lattice, matter, -1

    def check(self, moment: Moment) -> None:
        building, lattice = moment.building, self._lattice
        if building.version == self._version:
            return
        self._version = building.version
        row, column = np.indices(lattice.shape)
        x, y = lattice.x0 + column * lattice.cell, lattice.y0 + row * lattice.cell
        cells = shapely.box(x, y, x + lattice.cell, y + lattice.cell)
        matter, covered = self._matter.now(building.boxes), np.zeros(lattice.shape)
        near = shapely.intersects(matter, cells)
        covered[near] = shapely.area(shapely.intersection(cells[near], matter)) / lattice.cell**2
        wrong = building.occupied & (covered < 1e-9) | ~building.occupied & (covered > 1e-5)
        assert not wrong.any(), f"cells {np.argwhere(wrong)[:3].tolist()} are not what walls make of them"


class _Beams:
    """Beams end where shapely says, and show the cells that they cross or end in, and no others."""

    def __init__(self, run: BuiltRun, matter: _Matter, senses: _Senses, dice: Random) -> None:
        scenario = run.scenario
        self._lattice, self._matter, self._senses = run.arena.lattice, matter, senses
        self._robots = _each(run)
        self._tables = [(getattr(one, "sensor", None) or scenario.sensor).table for one in self._robots]
        moments = scenario.stop.iterations * scenario.robots.count
        self._often, self._dice = LOOKS / moments, dice
        self._fail = any(fault.use == "sensor" for fault in scenario.faults)

    def check(self, moment: Moment) -> None:
        for robot in np.flatnonzero(moment.state.alive).tolist():
            if self._tables[robot]["use"] == "ir-ring" and not self._fail and self._dice.random() < self._often:
                self._look(robot, moment)

    def _look(self, robot: int, moment: Moment) -> None:
        ring, readings = self._tables[robot], self._senses.readings
        x, y, yaw = moment.state.pose[robot]
        if self._matter.now(moment.building.boxes).intersects(shapely.Point(x, y)):
            return  # only points get into walls
        bearings = ring.get("bearings") or [360.0 / ring["beams"] * beam for beam in range(ring["beams"])]
        angles = yaw + np.radians(bearings)
        cast = self._caster(robot, ring, moment)
        ways, sure = cast(angles)
        if readings.beams is not None:
            self._ranges(readings.beams.ranges[robot], angles, ways, ring, cast)
        if not any(ring.get(key) for key in ERRORS):
            self._tile(robot, ring, angles, ways, sure, moment)

    def _caster(self, robot: int, ring: Any, moment: Moment) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """How far beams (b,) go in m, inf beyond reach, and whether what stops them counts as occupied."""
        (x, y), reach = moment.state.pose[robot, :2], ring["reach"]
        edges, origin = self._matter.edges(moment.building.boxes), shapely.Point(x, y)
        others = [
            (*moment.state.pose[other, :2], self._robots[other].radius)
            for other in np.flatnonzero(moment.state.alive)
            if other != robot and ring["robots"] != "ignored"
        ]

        def cast(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            ahead = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            ends = (x, y) + reach * ahead
            rays = shapely.linestrings(np.stack([np.broadcast_to((x, y), ends.shape), ends], axis=1))
            beam, edge = edges.query(rays, predicate="intersects")
            walls = np.full(len(rays), np.inf)
            np.minimum.at(
                walls, beam, shapely.distance(origin, shapely.intersection(rays[beam], edges.geometries[edge]))
            )
            people = _to_discs((x, y), ahead, self._senses.people)
            robots = _to_discs((x, y), ahead, np.array(others).reshape(-1, 3))
            ways = np.minimum(np.minimum(walls, people), robots)
            occupied = (robots > np.minimum(walls, people)) | (ring["robots"] == "occupied")
            return np.where(ways <= reach, ways, np.inf), occupied

        return cast

    def _ranges(self, measured: np.ndarray, angles: np.ndarray, ways: np.ndarray, ring: Any, cast: Any) -> None:
        """Ranges are as far as beams go, give or take what the sensor errs; at corners, as a beam beside it."""
        if ring.get("outliers"):
            return
        low = high = ways
        if any(ring.get(key) for key in ERRORS) or not np.allclose(measured, ways, rtol=0.0, atol=NEAR):
            aside = math.radians(ring.get("cone") or 0.0) / 2.0 + 1e-6
            beside = np.array([cast(angles + share * aside)[0] for share in np.linspace(-1.0, 1.0, 9)])
            low = np.minimum(beside.min(axis=0), ways)
            high = ways if ring.get("cone") else np.maximum(beside.max(axis=0), ways)
        reach, blind = ring["reach"], ring.get("blind") or 0.0

        def error(way: np.ndarray) -> np.ndarray:
            way = np.minimum(way, reach)
            parts = (
                ring.get("error") or 0.0,
                (ring.get("error_share") or 0.0) * way,
                (ring.get("error_square") or 0.0) * way**2,
            )
            return 7.0 * np.sqrt(sum(part**2 for part in parts)) + (ring.get("step") or 0.0) + NEAR

        none, far = np.isnan(measured), np.isinf(measured)
        near = low - error(low) <= blind
        may_lack = near | bool(ring.get("drop_out")) | (ring["robots"] == "occlude")
        assert may_lack[none].all(), "a range is missing"
        assert (high[far] + error(high)[far] >= reach).all(), "a beam went through a wall"
        there = ~none & ~far
        fits = (measured >= low - error(low)) & (measured <= high + error(high))
        wrong = np.flatnonzero(there & ~fits)
        assert not len(wrong), (
            f"beam {wrong[:1]} went {measured[wrong[:1]]} m for {low[wrong[:1]]} to {high[wrong[:1]]} m"
        )

    def _tile(self, robot: int, ring: Any, angles: Any, ways: Any, sure: Any, moment: Moment) -> None:
        """Free is what a beam has crossed, occupied where one has ended, and unknown all else."""
        tiles, lattice = self._senses.readings.tiles, self._lattice
        x, y, yaw = moment.state.pose[robot]
        ahead = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        values = tiles.values[robot].reshape(-1)
        row, column = (index.reshape(-1) for index in np.indices(tiles.values.shape[1:]))
        low = np.stack([column + tiles.origins[robot, 1], row + tiles.origins[robot, 0]], axis=1) * lattice.cell
        low += (lattice.x0, lattice.y0)
        inside = self._in_tile(ring, low + 0.5 * lattice.cell, (x, y, yaw))
        enters, leaves = _crossings((x, y), ahead, low, lattice.cell)  # (c, b) in m
        stopped = np.isfinite(ways)
        length = np.where(stopped, ways, ring["reach"])
        within = np.minimum(leaves, length) - np.maximum(enters, 0.0)
        needed, crosses = CLIPPED * lattice.cell, leaves >= np.maximum(enters, 0.0)
        starts = enters <= 0.0
        through = (leaves <= length - NEAR) | ~stopped
        is_free = (crosses & through & (within >= needed + NEAR)).any(axis=1)
        may_be_free = (crosses & ((leaves <= length + NEAR) | ~stopped) & ((within >= needed - NEAR) | (starts))).any(
            axis=1
        )
        ends = (x, y) + length[:, None] * ahead + NEAR * ahead
        counted = stopped & sure
        depth = np.minimum(ends - low[:, None], low[:, None] + lattice.cell - ends).min(
            axis=2
        )  # (c, b) inside of cells
        grid = (ends - (lattice.x0, lattice.y0)) / lattice.cell
        at_corner = (np.abs(grid - grid.round()) * lattice.cell < 3.0 * NEAR).all(axis=1)  # of four cells
        is_full = (counted & ~at_corner & (depth > 0.2 * NEAR) & self._solid(ends, moment)).any(axis=1)
        may_be_full = (counted & (depth > -3.0 * NEAR)).any(axis=1)
        for wrong, what in (
            ((values == FREE) & ~may_be_free, "free, and no beam crossed it"),
            ((values == OCCUPIED) & ~may_be_full, "occupied, and no beam ended in it"),
            ((values == UNKNOWN) & inside & (is_free | is_full), "unknown, and beams showed it"),
            ((values == FREE) & inside & is_full, "free, and a beam ended in it"),
            ((values != UNKNOWN) & ~inside, "known, and not in the tile"),
        ):
            cells = (low[wrong] + 0.5 * lattice.cell).round(3).tolist()
            assert not wrong.any(), f"robot {robot} at ({x:.3f}, {y:.3f}) calls cells at {cells} {what}"

    def _solid(self, points: np.ndarray, moment: Moment) -> np.ndarray:
        """Whether points (b, 2) are in walls; where people and robots are it does not matter."""
        return shapely.contains_xy(self._matter.now(moment.building.boxes), *points.T)

    def _in_tile(self, ring: Any, centres: np.ndarray, pose: Any) -> np.ndarray:
        """Which cells (c,) with these centres (c, 2) belong to a robot's tile."""
        (x, y, yaw), lattice, tile = pose, self._lattice, ring["tile"]
        if ring.get("frame") == "robot":
            away = centres - (x, y)
            aside = np.stack([away @ (-math.sin(yaw), math.cos(yaw)), away @ (math.cos(yaw), math.sin(yaw))], axis=1)
            return (np.abs(aside) <= 0.5 * np.array(tile) * lattice.cell + 1e-9).all(axis=1)
        found = np.ones(len(centres), bool)
        for axis, (place, start, size) in enumerate(((x, lattice.x0, tile[1]), (y, lattice.y0, tile[0]))):
            at = (place - start) / lattice.cell
            first = math.floor(at if size % 2 else at + 0.5) - size // 2
            index = np.floor((centres[:, axis] - start) / lattice.cell)
            found &= (index >= first) & (index < first + size)
        return found


def _to_discs(place: Any, ahead: np.ndarray, discs: np.ndarray) -> np.ndarray:
    """How far beams (b, 2) from a place go until they meet a disc (d, 3), in m; inf for none."""
    away = discs[:, :2] - place
    along = ahead @ away.T  # (b, d)
    under = along**2 - (away**2).sum(axis=1) + discs[:, 2] ** 2
    met = (under >= 0.0) & (along >= 0.0)
    ways = np.where(met, np.maximum(along - np.sqrt(np.where(met, under, 0.0)), 0.0), np.inf)
    return ways.min(axis=1, initial=np.inf)


def _crossings(place: Any, ahead: np.ndarray, low: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Where beams (b, 2) from a place enter and leave squares (c, 2) of a side (c, b), in m; not those that miss them.

    Those leave before they enter.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (low[:, None] - place) / ahead
        last = (low[:, None] + side - place) / ahead
    return np.fmin(first, last).max(axis=2), np.fmax(first, last).min(axis=2)


class _Lives:
    """The live are those whom no event has taken out and none brought back since."""

    def __init__(self, run: BuiltRun) -> None:
        self._scenario, self._out = run.scenario, set[int]()

    def check(self, moment: Moment) -> None:
        for event in worded(moment.events, self._scenario):
            if event.kind in OUT:
                self._out.add(event.robot)
            elif event.kind in BACK:
                self._out.remove(event.robot)
        dead = np.flatnonzero(~moment.state.alive).tolist()
        assert set(dead) == self._out, f"robots {dead} are dead, and by events {sorted(self._out)}"


class _Count:
    """No more of the domain is covered than robots that lived have sensed, and all of it where nothing is forgotten.

    Maps that nobody can put together do not count as one, and robots that compare them still are not done.
    """

    def __init__(self, run: BuiltRun) -> None:
        scenario, shape = run.scenario, run.arena.lattice.shape
        self._sensed, self._put = np.zeros((2, *shape), bool)
        self._exact = True
        self._senses = run.simulation.parts.sensor
        kinds = {fault.use for fault in scenario.faults} | {scenario.mind.computation.table["sharing"]["use"]}
        self._excused = [BELIEVED[kind] for kind in BELIEVED if kind in kinds]
        keeps = not any(
            fault.declares("map", "") == "lost" or fault.declares("failure", "") == "reboot"
            for fault in scenario.faults
        )
        self._keeps = keeps and not scenario.mind.computation.table.get("decay")
        self._share = scenario.task.table["share"]

    def check(self, moment: Moment) -> None:
        # What was sensed counts where it is and where its robot puts it, which is the same for those that know.
        alive = np.flatnonzero(moment.state.alive).tolist()
        self._mark((self._sensed, self._put), moment.readings.tiles, alive)
        self._mark((self._sensed,), self._senses.readings.tiles, alive)
        domain, covered = moment.building.explorable, moment.measured.values["coverage"]
        sensed, put = (np.count_nonzero(one & domain) / np.count_nonzero(domain) for one in (self._sensed, self._put))
        if not self._excused:
            assert covered <= sensed + 1e-12, f"{covered:.4%} are covered, and {sensed:.4%} sensed"
        self._exact &= moment.readings.tiles.origins is self._senses.readings.tiles.origins
        frames = moment.knowledge.frames
        together = frames is None or (self._exact and frames.known.all(axis=1).any())
        if together and self._keeps and not self._excused:
            assert abs(covered - put) < 1e-12, f"{covered:.4%} are covered, and {put:.4%} sensed"
        waits = frames is not None and any(
            frames.places[hearer, teller] > 0 and not frames.known[hearer, teller]
            for hearer, teller in moment.links.tolist()
        )
        done = covered >= self._share and not waits
        assert moment.measured.finished == done, "finished, or not, against what is covered and frames known"

    def _mark(self, masks: Iterable[np.ndarray], tiles: Any, robots: list[int]) -> None:
        """Mark the cells that these robots' tiles show."""
        for robot in robots:
            places = np.argwhere(tiles.values[robot] != UNKNOWN) + tiles.origins[robot]
            row, column = places[((places >= 0) & (places < self._sensed.shape)).all(axis=1)].T
            for mask in masks:
                mask[row, column] = True
