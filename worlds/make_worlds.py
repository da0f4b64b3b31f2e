"""Draws the buildings of this folder besides the basilica, the room and the arena; run it from here.

Usage: python make_worlds.py [NAME ...]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from shapely import MultiPolygon, affinity

from swarmsim.core.parts import WorldContext
from swarmsim.core.streams import Streams
from swarmsim.world import drawing, geojson
from swarmsim.world.areas import polygons
from swarmsim.world.made.generated import Cave, Maze, Office, Rooms
from swarmsim.world.made.wall_grid import GeneratedPlan
from swarmsim.world.plan import FloorPlan

CELL = 0.15  # m; everything lies on multiples of it
Box = tuple[float, float, float, float]  # left, lower, right, upper in m


def plan(
    size: tuple[float, float],
    walls: list[Box],
    doors: list[Box],
    spawns: dict[str, list[Box]],
    pillars: list[shapely.Geometry] = (),
    furniture: list[Box] = (),
) -> FloorPlan:
    """A floor plan with walls, out of which doors are cut."""
    solid = shapely.difference(
        shapely.union_all([shapely.box(*box) for box in walls]), shapely.union_all([shapely.box(*box) for box in doors])
    )
    layers = {
        "walls": polygons(solid),
        "pillars": polygons(shapely.union_all(list(pillars))),
        "furniture": polygons(shapely.union_all([shapely.box(*box) for box in furniture])),
    }
    areas = {name: polygons(shapely.union_all([shapely.box(*box) for box in boxes])) for name, boxes in spawns.items()}
    return FloorPlan(polygons(shapely.union_all(list(layers.values()))), layers, areas, (0.0, 0.0, *size))


def frame(width: float, height: float, thick: float) -> list[Box]:
    """The outer walls of a rectangle."""
    return [
        (0.0, 0.0, width, thick),
        (0.0, height - thick, width, height),
        (0.0, 0.0, thick, height),
        (width - thick, 0.0, width, height),
    ]


def house() -> FloorPlan:
    """A house of 12 m by 9 m: hall, living room with kitchen, two bedrooms, study and bath."""
    walls = [
        *frame(12.0, 9.0, 0.3),
        (4.8, 0.3, 4.95, 8.7),  # west of the hall
        (6.6, 0.3, 6.75, 8.7),  # east of it
        (0.3, 4.8, 4.8, 4.95),
        (6.75, 3.0, 11.7, 3.15),
        (6.75, 5.85, 11.7, 6.0),
        (9.0, 0.3, 9.15, 3.0),
    ]
    doors = [
        (4.8, 2.1, 4.95, 3.0),
        (4.8, 6.6, 4.95, 7.5),
        (6.6, 1.2, 6.75, 2.1),
        (6.6, 4.05, 6.75, 4.95),
        (6.6, 6.9, 6.75, 7.8),
        (9.0, 1.5, 9.15, 2.4),
        (1.8, 4.8, 3.0, 4.95),
    ]
    furniture = [
        (0.9, 0.9, 2.7, 1.5),
        (1.2, 2.4, 2.1, 3.6),
        (0.3, 7.8, 3.6, 8.7),
        (1.5, 6.0, 2.7, 6.9),
        (9.9, 6.6, 11.7, 8.1),
        (9.9, 3.6, 11.7, 5.1),
        (7.5, 0.3, 8.4, 0.75),
        (10.8, 0.3, 11.7, 1.8),
    ]
    return plan((12.0, 9.0), walls, doors, {"hall": [(5.1, 0.6, 6.45, 4.5)]}, furniture=furniture)


def warehouse() -> FloorPlan:
    """A hall of 24 m by 15 m with rows of shelves, an office and a loading bay."""
    shelves = [
        (left, low, left + 3.6, low + 0.9) for low in np.arange(2.1, 11.5, 2.4) for left in np.arange(2.4, 15.0, 4.8)
    ]
    walls = [*frame(24.0, 15.0, 0.3), (18.0, 9.6, 23.7, 9.75), (18.0, 9.75, 18.15, 14.7)]
    doors = [(20.1, 9.6, 21.3, 9.75), (18.0, 12.0, 18.15, 12.9)]
    pallets = [(19.5, 1.5, 20.7, 2.7), (21.6, 1.5, 22.8, 2.7), (19.5, 3.9, 20.7, 5.1), (21.6, 6.3, 22.8, 7.5)]
    desks = [(19.2, 13.8, 20.7, 14.7), (22.8, 11.1, 23.7, 12.6)]
    bay = {"bay": [(18.0, 3.0, 19.2, 9.0)]}
    return plan((24.0, 15.0), walls, doors, bay, furniture=[*shelves, *pallets, *desks])


def church() -> FloorPlan:
    """A church of 100 m by 54 m: nave and aisles, transept, choir with an apse, and chapels."""
    solid = [
        shapely.box(3.0, 15.0, 82.5, 39.0),
        shapely.box(51.0, 0.0, 69.0, 54.0),
        shapely.Point(82.5, 27.0).buffer(12.0),
    ]
    hollow = [
        shapely.box(4.5, 16.5, 82.5, 37.5),
        shapely.box(52.5, 1.5, 67.5, 52.5),
        shapely.Point(82.5, 27.0).buffer(10.5),
    ]
    shell = shapely.difference(shapely.union_all(solid), shapely.union_all(hollow))
    screens = [shapely.box(51.0, 12.0, 57.0, 12.6), shapely.box(63.0, 12.0, 69.0, 12.6)]
    screens += [shapely.box(51.0, 41.4, 57.0, 42.0), shapely.box(63.0, 41.4, 69.0, 42.0)]
    screens += [shapely.box(72.0, 16.5, 72.6, 24.0), shapely.box(72.0, 30.0, 72.6, 37.5)]
    walls = polygons(shapely.union_all([shell, *screens]))
    rows = [(x, y) for x in np.arange(10.5, 50.0, 6.0) for y in (22.5, 31.5)]
    rows += [(x, y) for x in (54.0, 66.0) for y in (22.5, 31.5)]
    pillars = polygons(shapely.union_all([shapely.Point(x, y).buffer(0.9) for x, y in rows]))
    altar = polygons(shapely.union_all([shapely.box(81.0, 25.2, 83.1, 28.8), shapely.box(40.5, 26.1, 42.3, 27.9)]))
    layers = {"walls": walls, "pillars": pillars, "furniture": altar}
    west = {"west": polygons(shapely.box(5.1, 24.0, 9.0, 30.0))}
    return FloorPlan(polygons(shapely.union_all(list(layers.values()))), layers, west, (0.0, 0.0, 97.5, 54.0))


def floors() -> FloorPlan:
    """Three floors of a building, side by side, joined by the two flights of their staircase."""
    parts, spawns, at = [], {}, 0.0
    for number in range(3):
        rooms = _made(Rooms(width=12.0, height=9.0, loops=0.5).build(WorldContext(Streams(number + 1), CELL)))
        parts.append(affinity.translate(rooms.walls, at, 0.0))
        if number == 0:
            spawns = {"ground": polygons(affinity.translate(rooms.spawns["spawn"], at, 0.0))}
        at += 12.0 + 3.0
    solid = shapely.union_all(parts)
    for left in (12.0, 27.0):  # the stairs between two floors: a passage with a bend
        flight = shapely.box(left - 0.3, 3.0, left + 3.3, 6.0)
        way = shapely.union_all(
            [
                shapely.box(left - 0.9, 3.3, left + 1.8, 4.2),
                shapely.box(left + 0.9, 3.3, left + 1.8, 5.7),
                shapely.box(left + 0.9, 4.8, left + 3.9, 5.7),
            ]
        )
        solid = shapely.difference(shapely.union(solid, flight), way)
    walls = polygons(solid)
    layers = {"walls": walls, "pillars": MultiPolygon(), "furniture": MultiPolygon()}
    return FloorPlan(walls, layers, spawns, (0.0, 0.0, 42.0, 9.0))


def _made(drawn: GeneratedPlan) -> FloorPlan:
    return geojson.plan_from(drawn.draw(), "made")


def _generated(kind: Callable[..., object], seed: int, **keys: float) -> Callable[[], FloorPlan]:
    def make() -> FloorPlan:
        return _made(kind(**keys).build(WorldContext(Streams(seed), CELL)))

    return make


WORLDS = {
    "house": (house, "A house of 12 m by 9 m"),
    "warehouse": (warehouse, "A warehouse of 24 m by 15 m"),
    "church": (church, "A church 95 m long"),
    "floors": (floors, "Three floors of a building, side by side"),
    "office": (_generated(Office, 4, width=21.0, height=10.5), "An office floor"),
    "maze": (_generated(Maze, 2), "A maze"),
    "cave": (_generated(Cave, 2), "A cave"),
}


def main(names: list[str]) -> None:
    """Write the drawings."""
    for name in names or WORLDS:
        make, title = WORLDS[name]
        path = Path(__file__).with_name(f"{name}.svg")
        path.write_text(drawing.drawn(make(), title), encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main(sys.argv[1:])
