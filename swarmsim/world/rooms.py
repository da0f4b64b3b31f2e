"""The rooms of a floor and the doors between them, found by the floor's width."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from swarmsim.core.lattice import Lattice
from swarmsim.world.cells import Cells, spread

_FINE = 1e-3  # m, precision of a door's width
_MOST = 400  # doors measured exactly; beyond it, widths come from the cells
_THING = 2.0  # widest doors; a free-standing thing up to this length separates no rooms (specks, tables, racks)
_APART = 0.2  # of the widest door; closer pieces are one thing, like those of a wall in pieces on a map


@dataclass(frozen=True, slots=True)
class Room:
    """A piece of floor with doors around it."""

    place: tuple[float, float]  # m: where it is widest
    area: float  # m2


@dataclass(frozen=True, slots=True)
class Doorway:
    """A narrow place between two rooms."""

    rooms: tuple[int, int]  # indices among the rooms
    place: tuple[float, float]  # m: its middle
    width: float  # m, of the widest disc that passes


def rooms_and_doors(
    floor: Cells, lattice: Lattice, walls: BaseGeometry, widest: float
) -> tuple[list[Room], list[Doorway]]:
    """The rooms of `floor` (rows, columns), the largest first, and the doors between them, at most `widest` (m) wide.

    A room grows from the places in which a disc of that diameter fits, to where it meets the next one: cells belong to
    the nearest of these places on foot. Two meet in a door, whose width is that of the widest disc that passes. A thing
    that stands free in a room and is at most two such discs long separates no rooms: the disc passes through it.
    """
    reach: NDArray[np.float64] = ndimage.distance_transform_edt(floor) * lattice.cell
    open_: NDArray[np.bool_] = floor | _things(floor, reach, lattice.cell, widest)
    seeds: NDArray[np.int32]
    count: int
    seeds, count = ndimage.label(ndimage.distance_transform_edt(open_) * lattice.cell >= 0.5 * widest, np.ones((3, 3)))
    if not count:
        return [], []
    labels = spread(open_, seeds)
    numbers = np.arange(1, count + 1)
    sizes: NDArray[np.float64] = ndimage.sum_labels(floor, labels, numbers)
    order = np.argsort(-sizes, kind="stable")
    middles = np.array(ndimage.maximum_position(reach, labels, numbers))
    places = lattice.centres(middles)[order]
    rooms = [Room((x, y), float(size) * lattice.cell**2) for (x, y), size in zip(places, sizes[order], strict=True)]
    rank = np.zeros(count + 1, np.int64)
    rank[order + 1] = np.arange(count)
    shapely.prepare(walls)
    return rooms, _doors(labels, reach, rank, lattice, walls, widest)


def _things(floor: Cells, reach: NDArray[np.float64], cell: float, widest: float) -> Cells:
    """Small free-standing things; `reach` is the distance (m) of the floor's cells from all else."""
    things: NDArray[np.int32]
    count: int
    things, count = ndimage.label(reach < 0.5 * _APART * widest, np.ones((3, 3)))
    boxes: list[tuple[slice, slice]] = ndimage.find_objects(np.where(floor, 0, things), count)
    small = np.zeros(count + 1, np.bool_)
    small[1:] = [max(part.stop - part.start for part in box) * cell <= _THING * widest for box in boxes]
    for edge in (things[0], things[-1], things[:, 0], things[:, -1]):
        small[edge] = False
    return np.asarray(small[things] & ~floor)


def _doors(
    labels: NDArray[np.int32],
    reach: NDArray[np.float64],
    rank: NDArray[np.int64],
    lattice: Lattice,
    walls: BaseGeometry,
    widest: float,
) -> list[Doorway]:
    """The doors where rooms meet: every piece of the border between two of them."""
    rim = np.zeros(labels.shape, np.bool_)
    pairs: dict[tuple[int, int], list[NDArray[np.int64]]] = {}
    for axis in (0, 1):
        first, second = (np.moveaxis(labels, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        at = np.argwhere((first != second) & (first > 0) & (second > 0))
        cells = at if axis == 0 else at[:, ::-1]
        rim[tuple(cells.T)] = True
        near, far = first[tuple(at.T)], second[tuple(at.T)]
        keys = np.column_stack([np.minimum(near, far), np.maximum(near, far)])
        for key in np.unique(keys, axis=0):
            pairs.setdefault((int(key[0]), int(key[1])), []).append(cells[(keys == key).all(axis=1)])
    doors: list[Doorway] = []
    pieces: NDArray[np.int32]
    pieces, _ = ndimage.label(rim, np.ones((3, 3)))
    for (one, other), found in sorted(pairs.items()):
        cells = np.unique(np.concatenate(found), axis=0)
        which = pieces[tuple(cells.T)]
        for piece in np.unique(which):
            own: NDArray[np.int64] = cells[which == piece]
            middle = own[reach[tuple(own.T)].argmax()]
            if not reach[tuple(middle)]:  # all of it lies within a thing
                continue
            x, y = lattice.centres(middle)
            width = 2.0 * float(shapely.distance(walls, shapely.Point(x, y)))
            if len(doors) < _MOST:
                width = _width((x, y), (one, other), labels, lattice, walls, widest, width)
            doors.append(Doorway((int(rank[one]), int(rank[other])), (float(x), float(y)), width))
    return sorted(doors, key=lambda door: door.width)


def _width(
    place: tuple[float, float],
    rooms: tuple[int, int],
    labels: NDArray[np.int32],
    lattice: Lattice,
    walls: BaseGeometry,
    widest: float,
    about: float,
) -> float:
    """The width (m) of the widest disc that passes a door, by bisection; `about` if rooms bend around it."""
    x, y = place
    side = 1.5 * widest
    left, right, low, high = lattice.extent
    near = shapely.box(max(x - side, left), max(y - side, low), min(x + side, right), min(y + side, high))
    around = shapely.difference(near, shapely.intersection(walls, near))
    cores = shapely.get_parts(shapely.buffer(around, -0.5 * widest))
    owners = labels[tuple(lattice.cells(shapely.get_coordinates(shapely.point_on_surface(cores))).T)]
    first, second = (shapely.union_all(cores[owners == room]) for room in rooms)
    if first.is_empty or second.is_empty:
        return about
    least, most = 0.0, widest
    while most - least > _FINE:
        middle = 0.5 * (least + most)
        parts = shapely.get_parts(shapely.buffer(around, -0.5 * middle))
        passes = shapely.intersects(parts, first) & shapely.intersects(parts, second)
        least, most = (middle, most) if passes.any() else (least, middle)
    return 0.5 * (least + most)
