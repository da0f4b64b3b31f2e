"""The building: walls, boxes, people, and its explorable part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.events import Box
from swarmsim.core.lattice import Lattice

Walls = NDArray[np.float64]  # (s, 4): x1, y1, x2, y2 in m, the solid side on the left

ANYWHERE: Final[Box] = (-np.inf, -np.inf, np.inf, np.inf)
NOWHERE: Final = Lattice(0.0, 0.0, 1.0, 0, 0)


class Crowd(Protocol):
    """Discs that walk among the robots."""

    discs: NDArray[np.float64]  # (p, 3): x, y, radius in m, where they are; a live view

    def walk(self, pose: NDArray[np.float64], solid: NDArray[np.bool_], dt: float) -> NDArray[np.float64]:
        """Move `discs` for one sub-step of `dt` (s) and return the velocities (p, 2), reused by the next call.

        They never step into a robot; `solid` (n,) robots stand at `pose` (n, 3).
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """The building with one set of boxes, and its explorable part."""

    walls: Walls
    occupied: NDArray[np.bool_]  # (rows, columns): the truth, without crowds
    entrance: NDArray[np.float64]  # (c, 2): x, y in m of spawn cells in which a robot fits
    explore: Callable[[], NDArray[np.bool_]]  # computes what can be explored (rows, columns); raises InputError


@dataclass(slots=True, eq=False)
class Building:
    """The building at this moment; parts that derive data from it must do so again when `version` rises.

    Only faults change it, by `rebuild` and `admit`. Parts of robots may know its walls and crowds only through
    measurements.
    """

    found: Survey  # of this moment
    survey: Callable[[tuple[Box, ...]], Survey]
    version: int = 0
    bounds: Box = ANYWHERE  # of the floor plan's page: left, lower, right, upper in m
    boxes: tuple[Box, ...] = ()  # boxes added to the plan
    crowds: list[Crowd] = field(default_factory=list)
    lattice: Lattice = NOWHERE  # of the cells above

    @property
    def walls(self) -> Walls:
        """All walls, including those of boxes."""
        return self.found.walls

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """The true occupancy (rows, columns), without crowds."""
        return self.found.occupied

    @property
    def entrance(self) -> NDArray[np.float64]:
        """The centres (c, 2), x and y in m, of the spawn cells in which a robot fits."""
        return self.found.entrance

    @property
    def explorable(self) -> NDArray[np.bool_]:
        """The cells (rows, columns) that robots can observe: free ones and the walls beside them.

        Computed at the first call, since it takes a while. Raises InputError for robots that see nothing.
        """
        return self.found.explore()

    def rebuild(self, boxes: tuple[Box, ...]) -> None:
        """Replace all boxes in the building by these.

        The boxes' places must be free of bodies. Raises InputError for a box that `check` refuses and for boxes that
        leave robots no place to stand.
        """
        for box in boxes:
            self.check(box)
        self.found, self.boxes = self.survey(tuple(sorted(boxes))), boxes
        self.version += 1

    def admit(self, crowd: Crowd) -> None:
        """Add a crowd to the building from now on."""
        self.crowds.append(crowd)
        self.version += 1

    def check(self, box: Box, key: str = "box") -> None:
        """Raise InputError, which starts with `key`, unless a box has a size and lies on the page of the plan."""
        left, low, right, high = box
        if not (left < right and low < high):
            raise InputError(f"{key}: {_edges(box)} has no size; expected [left, lower, right, upper] in m")
        page = self.bounds
        if left < page[0] or low < page[1] or right > page[2] or high > page[3]:
            raise InputError(f"{key}: {_edges(box)} reaches out of the page; expected it within {_edges(page)}")

    def walkers(self) -> NDArray[np.float64]:
        """The discs (p, 3) of all crowds: x, y, radius in m."""
        return np.concatenate([crowd.discs for crowd in self.crowds]) if self.crowds else np.empty((0, 3))


def _edges(box: Box) -> str:
    return "[{:g}, {:g}, {:g}, {:g}]".format(*box)
