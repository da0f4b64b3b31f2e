"""Buildings in which one place looks like another, and some ordinary ones, as grids of cells and as files.

Of `EQUAL` buildings parts cannot be told apart by their walls: rooms along a corridor, niches of a comb, a grid of
rooms, and buildings that are the same when turned by half or mirrored. Every seed gives other sizes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN
from swarmsim.world.areas import polygons
from swarmsim.world.geojson import written
from swarmsim.world.plan import FloorPlan

CELL = 0.15  # m
Solid = NDArray[np.bool_]


def hotel(random: np.random.Generator) -> Solid:
    """A corridor with two rows of nine equal rooms, doors in the same place."""
    room, deep, wide, door = random.integers(9, 13), random.integers(10, 14), random.integers(7, 10), 4
    at = int(random.integers(1, room - door))
    solid = walls(2 * deep + wide + 4, 9 * (room + 1) + 1)
    for row in (deep + 1, deep + wide + 2):
        solid[row] = True
    for k in range(9):
        left = 1 + k * (room + 1)
        solid[1 : deep + 1, left + room] = solid[deep + wide + 3 : -1, left + room] = True
        for row in (deep + 1, deep + wide + 2):
            solid[row, left + at : left + at + door] = False
    return solid


def comb(random: np.random.Generator) -> Solid:
    """A corridor with equal niches on one side."""
    niche, deep, wide, thick = random.integers(4, 8), random.integers(4, 9), random.integers(7, 10), 2
    solid = walls(deep + wide + 2, 11 * (niche + thick) + thick + 2)
    solid[1 : deep + 1, 1:-1] = True
    for k in range(11):
        left = 1 + thick + k * (niche + thick)
        solid[1 : deep + 1, left : left + niche] = False
    return solid


def cells(random: np.random.Generator) -> Solid:
    """A grid of equal rooms, each with a door in every wall to the next."""
    room, door = int(random.integers(9, 13)), 4
    solid = walls(3 * (room + 1) + 1, 5 * (room + 1) + 1)
    solid[:: room + 1] = solid[:, :: room + 1] = True
    low = (room - door) // 2 + 1
    for k in range(3):
        solid[k * (room + 1) + low : k * (room + 1) + low + door, room + 1 : -1 : room + 1] = False
    for k in range(5):
        solid[room + 1 : -1 : room + 1, k * (room + 1) + low : k * (room + 1) + low + door] = False
    return solid


def half_turn(random: np.random.Generator) -> Solid:
    """A building that is the same when turned by half: its rooms are equal in pairs."""
    half = rooms(random)
    return joined(half, half[::-1, ::-1])


def mirror(random: np.random.Generator) -> Solid:
    """A building whose east is its west, mirrored."""
    half = rooms(random)
    return joined(half, half[:, ::-1])


def joined(west: Solid, east: Solid) -> Solid:
    """Two halves with a door between them, midway."""
    solid = np.concatenate([west, east[:, 1:]], axis=1)
    middle, high = west.shape[1] - 1, solid.shape[0] // 2
    solid[high - 2 : high + 3, middle - 2 : middle + 3] = False
    return solid


def rooms(random: np.random.Generator) -> Solid:
    """Rooms of different sizes and a block of furniture, with doors: 37 x 41 cells."""
    solid = walls(37, 41)
    across, up = int(random.integers(14, 26)), int(random.integers(13, 23))
    solid[:, across] = solid[up, :across] = True
    other = int(random.integers(10, 26))
    solid[other, across:] = True
    for column in (slice(2, across - 6), slice(across + 2, 34)):
        left = int(random.integers(column.start, column.stop))
        solid[up if column.start == 2 else other, left : left + 4] = False
    for low, high in ((2, min(up, other) - 5), (max(up, other) + 1, 31)):
        row = int(random.integers(low, max(high, low + 1)))
        solid[row : row + 4, across] = False
    for _ in range(3):
        row, column = int(random.integers(3, 31)), int(random.integers(3, 35))
        if not solid[row - 2 : row + 5, column - 2 : column + 5].any():
            solid[row : row + 2, column : column + 3] = True
    return solid


def court(random: np.random.Generator) -> Solid:
    """A corridor around a court, with a few pilasters."""
    rows, columns, wide = (int(random.integers(*span)) for span in ((40, 50), (50, 65), (8, 11)))
    solid = walls(rows, columns)
    solid[wide:-wide, wide:-wide] = True
    for _ in range(9):
        at, side = int(random.integers(4, columns - 6)), bool(random.integers(2))
        solid[1:3, at : at + 2] |= side
        solid[-3:-1, at : at + 2] |= not side
    for _ in range(5):
        at = int(random.integers(4, rows - 6))
        solid[at : at + 2, 1:3] = True
    return solid


def pillars(random: np.random.Generator) -> Solid:
    """A hall with pillars here and there."""
    solid = walls(int(random.integers(45, 55)), int(random.integers(60, 75)))
    for _ in range(26):
        row, column = (int(random.integers(4, side - 6)) for side in solid.shape)
        solid[row : row + int(random.integers(2, 4)), column : column + int(random.integers(2, 4))] = True
    return solid


def walls(rows: int, columns: int) -> Solid:
    """The outer walls."""
    solid = np.zeros((int(rows), int(columns)), np.bool_)
    solid[[0, -1]] = solid[:, [0, -1]] = True
    return solid


EQUAL: dict[str, Callable[[np.random.Generator], Solid]] = {
    "hotel": hotel, "comb": comb, "half-turn": half_turn, "mirror": mirror, "cells": cells,
}  # fmt: skip
ORDINARY: dict[str, Callable[[np.random.Generator], Solid]] = {"court": court, "pillars": pillars}


def drawn(kind: str, seed: int) -> Solid:
    """One building."""
    return {**EQUAL, **ORDINARY}[kind](np.random.default_rng([seed, *kind.encode()]))


def truth(solid: Solid) -> NDArray[np.uint8]:
    """The complete map: free cells, and the walls beside them."""
    free = ~solid
    beside = np.zeros_like(solid)
    beside[1:] |= free[:-1]
    beside[:-1] |= free[1:]
    beside[:, 1:] |= free[:, :-1]
    beside[:, :-1] |= free[:, 1:]
    return np.where(free, FREE, np.where(beside, OCCUPIED, UNKNOWN)).astype(np.uint8)


def write(kind: str, seed: int, folder: Path) -> Path:
    """The building as a file of the folder; robots start on its left."""
    solid = drawn(kind, seed)
    rows, columns = solid.shape
    row, column = np.nonzero(solid)
    boxes = shapely.box(CELL * column, CELL * row, CELL * (column + 1), CELL * (row + 1))
    shape = polygons(shapely.union_all(boxes))
    start = polygons(shapely.difference(shapely.box(0.0, 0.0, 0.6 * columns * CELL, rows * CELL), shape))
    path = folder / f"{kind}-{seed}.geojson"
    page = (0.0, 0.0, columns * CELL, rows * CELL)
    path.write_text(written(FloorPlan(shape, {"walls": shape}, {"start": start}, page)))
    return path
