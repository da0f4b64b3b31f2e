"""Rooms of a floor and the doors between them: what parts rooms, and what only stands in them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from swarmsim.core.lattice import Lattice
from swarmsim.world.rooms import rooms_and_doors

CELL, WIDEST = 0.1, 1.1  # m
Cells = NDArray[np.bool_]


def halls() -> Cells:
    """Two halls of 6 m x 6 m with a door of 0.9 m between them."""
    floor = np.zeros((62, 124), np.bool_)
    floor[1:-1, 1:-1] = True
    floor[:, 61:63] = False
    floor[25:34, 61:63] = True
    return floor


def counts(floor: Cells) -> tuple[int, int]:
    boxes = [shapely.box(x * CELL, y * CELL, (x + 1) * CELL, (y + 1) * CELL) for y, x in np.argwhere(~floor)]
    walls = MultiPolygon(list(shapely.get_parts(shapely.union_all(boxes))))
    rooms, doors = rooms_and_doors(floor, Lattice(0.0, 0.0, CELL, *floor.shape), walls, WIDEST)
    assert sum(room.area for room in rooms) == pytest.approx(floor.sum() * CELL**2)
    return len(rooms), len(doors)


def specks(floor: Cells) -> None:
    for row, column in np.random.default_rng(2).integers(4, 58, (40, 2)):
        floor[row, column] = False


def table(floor: Cells) -> None:
    rows, columns = np.indices(floor.shape)
    floor[np.hypot(rows - 15, columns - 15) < 8] = False


def rack(floor: Cells) -> None:
    floor[8:28, 8:16] = False


def pillars(floor: Cells) -> None:
    for row in range(6, 60, 12):
        floor[row : row + 4, 80:84] = False


@pytest.mark.parametrize("thing", [lambda floor: None, specks, table, rack, pillars])
def test_what_stands_free_parts_no_rooms(thing: Callable[[Cells], None]) -> None:
    floor = halls()
    thing(floor)
    assert counts(floor) == (2, 1)


def test_a_free_standing_wall_parts_a_hall() -> None:
    floor = halls()
    floor[10:52, 30:32] = False  # 4.2 m, with ways of 0.9 m around its ends
    assert counts(floor) == (3, 3)


def test_a_wall_that_a_map_has_in_pieces_parts_a_hall() -> None:
    floor = halls()
    for start in range(10, 52, 6):
        floor[start : start + 5, 30:32] = False
    rooms, doors = counts(floor)
    assert rooms == 3
    assert doors >= 3


def test_a_pillar_in_a_door_leaves_it_one_door() -> None:
    floor = halls()
    floor[29:30, 61:63] = False
    assert counts(floor) == (2, 1)
