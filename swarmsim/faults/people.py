"""People who walk among the robots, and never into them."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.parts import Parts
from swarmsim.kernels import scratch, search, walk

_TRIES = 8  # destinations that a person tries before resting


class People(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Discs that walk between random places of the floor, on shortest ways, throughout the run.

    They see robots and each other, and wait while one is in their way. Beams end at them, so that maps show
    occupied cells where they were; the truth is the building without them.
    """

    count: Annotated[int, Meta(ge=1, le=1000)] = 1  # how many people walk about
    radius: Annotated[float, Meta(gt=0.0)] = 0.2  # m
    speed: Annotated[float, Meta(gt=0.0)] = 0.3  # m/s
    patience: Annotated[float, Meta(gt=0.0)] = 5.0  # s without a step before a person tries another place

    def build(self, context: BuildContext) -> Visit:
        return Visit(self, context)


class Visit:
    """Puts people into the building."""

    def __init__(self, people: People, context: BuildContext) -> None:
        self._people, self._context = people, context

    def install(self, parts: Parts) -> Parts:
        """The same parts, with people in their building. Raises InputError if it has no room for them."""
        parts.building.admit(Walkers(self._people, self._context, parts))
        return parts


class Walkers:
    """A crowd that walks through cells that no wall touches."""

    def __init__(self, people: People, context: BuildContext, parts: Parts) -> None:
        self._people, self._building, self._lattice = people, parts.building, context.lattice
        self._radius, self._speed = context.robots.radius, context.robots.speed
        count, cells = people.count, context.lattice.rows * context.lattice.columns
        self._streams = [context.streams.open(f"fault {context.number} people", person) for person in range(count)]
        self._scratch = scratch.working_memory(cells)
        self._path = np.zeros(cells, np.int32)
        self._cells = [np.zeros(0, np.int64)] * count  # of each person's way, row-major ...
        self._ways = np.zeros((count, 1, 2))  # ... and their centres, in m
        self._counts, self._cursor = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._waited = np.zeros(count)  # s
        self._rests = np.zeros(count, np.bool_)
        self._velocity = np.zeros((count, 2))
        under = search.footprint(people.radius / context.lattice.cell)
        x0, y0, cell = context.lattice.x0, context.lattice.y0, context.lattice.cell
        self._rules = search.Rules(x0, y0, cell, under, 0, 8, True, 1, 1)
        self._look_around()
        floor = parts.building.explorable & ~parts.building.occupied
        self._places = np.flatnonzero(floor & self._standable(under))
        self.discs: NDArray[np.float64] = np.zeros((0, 3))  # x, y, radius in m; a live view
        self._enter(parts)
        # The cells, row-major, at the two ends of each person's present leg: the one to retreat to, the one ahead.
        here = (context.lattice.cells(self.discs[:, :2]) * (context.lattice.columns, 1)).sum(axis=1)
        self._leg = np.stack([here, here], axis=1)

    def _look_around(self) -> None:
        """Take over the present building."""
        occupied = self._building.occupied[None]
        never = np.zeros(occupied.shape, np.int32)
        log_odds = np.where(occupied, np.float32(1.0), np.float32(-1.0))
        self._maps = search.Maps(log_odds, np.ones_like(occupied), never, never)
        self._version = self._building.version

    def _standable(self, under: NDArray[np.int32]) -> NDArray[np.bool_]:
        """The cells (rows, columns) in whose centre a person touches no occupied cell."""
        reach = int(np.abs(under).max())
        rows, columns = self._lattice.shape
        wide = np.pad(self._building.occupied, reach)
        blocked = [wide[reach + r : reach + r + rows, reach + c : reach + c + columns] for r, c in under]
        return np.asarray(~np.logical_or.reduce(blocked))

    def _enter(self, parts: Parts) -> None:
        """Put all people on free places. Raises InputError if there are too few."""
        people, robots = self._people, parts.bodies.state().pose[parts.bodies.solid]
        bodies = np.column_stack([robots[:, :2], np.full(len(robots), self._radius)])
        bodies = np.concatenate([bodies, parts.building.walkers()])
        for person, stream in enumerate(self._streams):
            centres = self._centres(self._places)
            apart = np.hypot(*(centres[:, None] - bodies[:, :2]).transpose(2, 0, 1)) - bodies[:, 2]
            free = centres[(apart > people.radius + self._lattice.cell).all(axis=1)]
            if len(free) == 0:
                raise InputError(
                    f"count: the floor has room for {person} people of radius {people.radius:g} m at the start, not "
                    f"{people.count}; expected fewer or thinner ones"
                )
            bodies = np.concatenate([bodies, [[*free[stream.integers(len(free))], people.radius]]])
        self.discs = bodies[-people.count :].copy()

    def _centres(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """The centres (k, 2) of cells (k,) given by their row-major index."""
        return self._lattice.centres(np.stack(np.divmod(cells, self._lattice.columns), axis=-1))

    def walk(self, pose: NDArray[np.float64], solid: NDArray[np.bool_], dt: float) -> NDArray[np.float64]:
        """Move all people by one sub-step; gives the velocities."""
        if self._version != self._building.version:
            self._look_around()
            self._waited[:] = np.inf
        arrived = (self._cursor >= self._counts) & ~self._rests
        for person in np.flatnonzero((self._waited >= self._people.patience) | arrived):
            self._set_off(int(person))
        walk.walk(
            self.discs,
            self._ways,
            self._counts,
            self._cursor,
            self._waited,
            self._people.speed,
            pose,
            solid,
            self._radius,
            self._speed * dt,  # how much nearer a robot may come in the same time
            dt,
            self._velocity,
        )
        return self._velocity

    def _set_off(self, person: int) -> None:
        """Plan a way to a random place, or rest if there is none.

        It starts with a retreat to where the present leg began, away from the obstacle.
        """
        cursor, cells = self._cursor[person], self._cells[person]
        if cursor > 0:
            self._leg[person] = cells[cursor - 1], cells[min(cursor, len(cells) - 1)]
        else:
            self._leg[person] = self._leg[person, ::-1]
        here, steps = int(self._leg[person, 0]), 0
        for goal in self._streams[person].choice(self._places, _TRIES):
            steps = search.a_star(self._maps, 0, 1, self._rules, here, int(goal), self._scratch, self._path)
            if steps > 1:
                break
        self._rests[person] = steps <= 1
        self._cells[person] = self._path[: steps * (steps > 1)].astype(np.int64)
        way = self._centres(self._cells[person])
        if len(way) > self._ways.shape[1]:
            self._ways = np.pad(self._ways, ((0, 0), (0, len(way) - self._ways.shape[1]), (0, 0)))
        self._ways[person, : len(way)] = way
        self._counts[person], self._cursor[person], self._waited[person] = len(way), 0, 0.0
