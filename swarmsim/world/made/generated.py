"""Generated buildings: rooms, an office, a maze, a cave, a field of obstacles; another one for every seed."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy import ndimage

from swarmsim.core.context import WorldContext
from swarmsim.core.errors import InputError
from swarmsim.world.made.wall_grid import GeneratedPlan, WallGrid, cut_door, open_between, strip

Metres = Annotated[float, Meta(gt=0.0, le=1000.0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
DRAWS: Final = 200  # of obstacles, before giving up on too many


class Rooms(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A building cut into rooms, again and again; every wall has a door, and some have a second one.

    Rooms are cut as in binary space partitioning (Fuchs, Kedem and Naylor 1980).
    """

    width: Metres = 15.0  # m, outside
    height: Metres = 9.0  # m, outside
    room: Metres = 2.1  # m, the least side of a room
    door: Metres = 0.6  # m
    wall: Metres = 0.15  # m, thickness
    loops: Share = 0.3  # of walls that have a second door

    def build(self, site: WorldContext) -> GeneratedPlan:
        """The building. Raises InputError for sizes that contradict each other."""
        grid = WallGrid(self, site)
        room, door, wall = (grid.count(key, getattr(self, key)) for key in ("room", "door", "wall"))
        if door + 2 > room:
            raise InputError(f"door: {self.door:g} m does not fit into walls of {self.room:g} m; expected it narrower")
        solid = grid.framed(wall)
        waiting = [(wall, wall, grid.rows - wall, grid.columns - wall)]
        cuts = []
        while waiting:
            low, left, high, right = waiting.pop()
            down, across = high - low, right - left
            along = 0 if (down > across if down != across else grid.random.random() < 0.5) else 1
            size = (down, across)[along]
            if size < 2 * room + wall:
                along, size = 1 - along, (down, across)[1 - along]
            if size < 2 * room + wall:
                continue
            at = (low, left)[along] + int(grid.random.integers(room, size - room - wall + 1))
            span = (left, right) if along == 0 else (low, high)
            strip(solid, along, at, wall, span)[:] = True
            cuts.append((along, at, span))
            box = [low, left, high, right]
            first, second = box.copy(), box.copy()
            first[2 + along], second[along] = at, at + wall
            waiting += [(first[0], first[1], first[2], first[3]), (second[0], second[1], second[2], second[3])]
        for along, at, span in cuts:
            for _ in range(1 + (grid.random.random() < self.loops)):
                cut_door(solid, along, at, wall, span, door, grid.random)
        return grid.drawn(solid)


class Office(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Corridors across the building with rooms on both sides, each with a door to its corridor."""

    width: Metres = 18.0  # m, outside
    height: Metres = 10.5  # m, outside
    corridor: Metres = 1.2  # m, width
    room: Metres = 2.4  # m, about the side of a room
    door: Metres = 0.6  # m
    wall: Metres = 0.15  # m, thickness

    def build(self, site: WorldContext) -> GeneratedPlan:
        """The building. Raises InputError for sizes that contradict each other."""
        grid = WallGrid(self, site)
        corridor, room, door, wall = (
            grid.count(key, getattr(self, key)) for key in ("corridor", "room", "door", "wall")
        )
        if door + 2 > room:
            raise InputError(f"door: {self.door:g} m does not fit into walls of {self.room:g} m; expected it narrower")
        solid = grid.framed(wall)
        deep = grid.rows - 2 * wall
        count = max(1, round((deep + wall) / (2 * room + corridor + 3 * wall)))
        if deep < count * (corridor + 2 * wall + 2 * (door + 2)) + (count - 1) * wall:
            raise InputError(f"height: {self.height:g} m has no room for a corridor with rooms; expected more")
        spine = grid.columns - wall - corridor, grid.columns - wall  # a passage that joins the corridors
        edges: list[int] = (
            np.linspace(wall, grid.rows, count + 1).round().astype(int).tolist()
        )  # each block ends with a wall
        corridors = []
        for low, high in pairwise(edges):
            top = high - wall
            first = low + (top - low - corridor) // 2
            corridors.append((first, first + corridor))
            right = spine[0] - wall if count > 1 else grid.columns - wall
            for base, ceiling, at in (
                (low, first - wall, first - wall),
                (first + corridor + wall, top, first + corridor),
            ):
                strip(solid, 0, at, wall, (wall, right))[:] = True
                left = wall
                while left < right:
                    size = int(grid.random.integers(max(door + 2, room * 3 // 4), room * 5 // 4 + 1))
                    end = right if right - left - size < door + 2 + wall else left + size
                    strip(solid, 1, end, wall, (base, ceiling))[:] = True
                    cut_door(solid, 0, at, wall, (left, end), door, grid.random)
                    left = end + wall
            if count > 1:
                solid[low:top, right : right + wall] = True
                solid[first : first + corridor, right : right + wall] = False
                if high < grid.rows:
                    solid[top:high, :] = True
                    solid[top:high, spine[0] : spine[1]] = False
        start = np.zeros_like(solid)
        middle = corridors[len(corridors) // 2]
        start[middle[0] : middle[1], wall : max(wall + 1, grid.columns // 2)] = True
        return grid.drawn(solid, start & ~solid)


class Maze(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Passages with one way between any two places, more where some walls are left out.

    The recursive backtracker makes it: a depth-first search with random turns.
    """

    width: Metres = 9.15  # m, outside; rounded down to whole passages
    height: Metres = 6.15  # m, outside; rounded down in the same way
    passage: Metres = 0.6  # m, width
    wall: Metres = 0.15  # m, thickness
    loops: Share = 0.1  # of the walls that could be left out

    def build(self, site: WorldContext) -> GeneratedPlan:
        """The building. Raises InputError for a size without two passages each way."""
        grid = WallGrid(self, site)
        passage, wall = (grid.count(key, getattr(self, key)) for key in ("passage", "wall"))
        pitch = passage + wall
        down, across = (grid.rows - wall) // pitch, (grid.columns - wall) // pitch
        if down < 2 or across < 2:
            raise InputError(f"width: fewer than two passages of {self.passage:g} m each way; expected it larger")
        solid = np.ones((down * pitch + wall, across * pitch + wall), np.bool_)
        places = [(row, column) for row in range(down) for column in range(across)]
        for row, column in places:
            low, left = wall + row * pitch, wall + column * pitch
            solid[low : low + passage, left : left + passage] = False
        visited = np.zeros((down, across), np.bool_)
        way = [(int(grid.random.integers(down)), int(grid.random.integers(across)))]
        visited[way[0]] = True
        while way:
            row, column = way[-1]
            ahead = [
                (row + dr, column + dc)
                for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0))
                if 0 <= row + dr < down and 0 <= column + dc < across and not visited[row + dr, column + dc]
            ]
            if not ahead:
                way.pop()
                continue
            chosen = ahead[int(grid.random.integers(len(ahead)))]
            visited[chosen] = True
            open_between(solid, way[-1], chosen, wall, passage)
            way.append(chosen)
        for row, column in places:
            for other in ((row, column + 1), (row + 1, column)):
                if other[0] < down and other[1] < across and grid.random.random() < self.loops:
                    open_between(solid, (row, column), other, wall, passage)
        start = np.zeros_like(solid)
        start[: solid.shape[0] // 3, : solid.shape[1] // 3] = True
        return grid.drawn(solid, start & ~solid)


class Cave(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Halls and passages with bent walls, from noise smoothed by a majority vote among neighbours.

    That is the cellular automaton of Johnson, Yannakakis and Togelius (2010).
    """

    width: Metres = 15.0  # m, outside
    height: Metres = 10.5  # m, outside
    filled: Annotated[float, Meta(ge=0.2, le=0.6)] = 0.44  # share of the noise that is rock
    grain: Metres = 0.45  # m, side of the noise's squares
    steps: Annotated[int, Meta(ge=1, le=20)] = 4  # rounds of the vote

    def build(self, site: WorldContext) -> GeneratedPlan:
        """The building. Raises InputError if no hall is left in it."""
        grid = WallGrid(self, site)
        grain = grid.count("grain", self.grain)
        shape = -(-grid.rows // grain), -(-grid.columns // grain)
        rock = grid.random.random(shape) < self.filled
        around = np.ones((3, 3), np.int64)
        for _ in range(self.steps):
            rock[[0, -1]] = rock[:, [0, -1]] = True
            rock = ndimage.convolve(rock.astype(np.int64), around, mode="constant", cval=1) >= 5
        rock[[0, -1]] = rock[:, [0, -1]] = True
        fine: NDArray[np.bool_] = (
            ndimage.zoom(rock.astype(np.float64), grain, order=1, mode="nearest", grid_mode=True) > 0.5
        )
        wall = fine[: grid.rows, : grid.columns].copy()
        wall[:2] = wall[-2:] = wall[:, :2] = wall[:, -2:] = True
        # Space too narrow for a disc three cells wide is rock, so that robots see every wall.
        free: NDArray[np.bool_] = ndimage.binary_opening(~wall, np.ones((3, 3), np.bool_))
        pieces: NDArray[np.int32]
        count: int
        pieces, count = ndimage.label(free)
        if not count:
            raise InputError("filled: rock alone is left; expected less of it, or a larger building")
        largest = int(np.bincount(pieces.ravel())[1:].argmax()) + 1
        return grid.drawn(pieces != largest)


class Obstacles(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A hall with square obstacles at random places of a coarse grid; robots start in its lower left corner.

    Space cut off from that corner is solid too. If that is more than a tenth of the free squares, the obstacles are
    drawn again.
    """

    width: Metres = 9.3  # m, outside
    height: Metres = 9.3  # m, outside
    block: Metres = 0.45  # m, side of an obstacle
    filled: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.3  # share of the grid's squares with an obstacle
    wall: Metres = 0.15  # m, thickness

    def build(self, site: WorldContext) -> GeneratedPlan:
        """The building. Raises InputError for a size without two squares each way."""
        grid = WallGrid(self, site)
        block, wall = (grid.count(key, getattr(self, key)) for key in ("block", "wall"))
        down, across = (grid.rows - 2 * wall) // block, (grid.columns - 2 * wall) // block
        if down < 2 or across < 2:
            raise InputError(f"width: fewer than two squares of {self.block:g} m each way; expected it larger")
        pieces: NDArray[np.int32]
        for _ in range(DRAWS):
            taken = np.zeros((down, across), np.bool_)
            taken.flat[grid.random.permutation(taken.size)[: round(self.filled * taken.size)]] = True
            taken[:2, :2] = False
            pieces, _ = ndimage.label(~taken)
            floor: NDArray[np.bool_] = pieces == pieces[0, 0]
            if np.count_nonzero(floor) >= 0.9 * np.count_nonzero(~taken):
                break
        else:
            raise InputError(f"filled: {self.filled:g} of all squares cut the hall into pieces; expected fewer")
        solid = np.ones((down * block + 2 * wall, across * block + 2 * wall), np.bool_)
        solid[wall:-wall, wall:-wall] = np.kron(~floor, np.ones((block, block), np.bool_))
        start = np.zeros_like(solid)
        start[wall : wall + 2 * block, wall : wall + 2 * block] = True
        return grid.drawn(solid, start)
