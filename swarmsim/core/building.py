"""What stands where: walls, boxes, people, and what of it all can be explored."""

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
    """Discs that walk about among the robots."""

    discs: NDArray[np.float64]  # (p, 3): x, y, radius in m, where they are; a live view

    def walk(self, pose: NDArray[np.float64], solid: NDArray[np.bool_], dt: float) -> NDArray[np.float64]:
        """Let `discs` move for one sub-step of `dt` (s); gives the velocities (p, 2), reused by the next call.

        They never step towards a robot that they would touch: robots are at `pose` (n, 3) if they are `solid` (n,).
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What stands where for one set of boxes, and what of it robots can explore."""

    walls: Walls
    occupied: NDArray[np.bool_]  # (rows, columns): the truth, without crowds
    entrance: NDArray[np.float64]  # (c, 2): x, y in m of the cells of the spawn area in which a robot can stand
    explore: Callable[[], NDArray[np.bool_]]  # finds out what can be explored (rows, columns); raises InputError


@dataclass(slots=True, eq=False)
class Building:
    """What stands where at this moment; parts that prepare anything from it do so again when `version` rises.

    Faults alone change it, by `rebuild` and `admit`. Parts of robots may know its walls and crowds through what they
    measure only.
    """

    found: Survey  # of this moment
    survey: Callable[[tuple[Box, ...]], Survey]
    version: int = 0
    bounds: Box = ANYWHERE  # of the floor plan's page: left, lower, right, upper in m
    boxes: tuple[Box, ...] = ()  # what stands in it besides its plan
    crowds: list[Crowd] = field(default_factory=list)
    lattice: Lattice = NOWHERE  # of the cells above

    @property
    def walls(self) -> Walls:
        """All walls, those of boxes among them."""
        return self.found.walls

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """The truth (rows, columns): which cells anything but crowds stands in."""
        return self.found.occupied

    @property
    def entrance(self) -> NDArray[np.float64]:
        """The centres (c, 2), x and y in m, of the cells of the spawn area in which a robot can stand."""
        return self.found.entrance

    @property
    def explorable(self) -> NDArray[np.bool_]:
        """The cells (rows, columns) that robots can find out about: free ones and the walls beside these.

        It takes a while to look from everywhere, so that is done once somebody asks. Raises InputError for robots that
        see nothing.
        """
        return self.found.explore()

    def rebuild(self, boxes: tuple[Box, ...]) -> None:
        """Let these boxes, and no others, stand in the building besides its plan.

        No body may be where a box will be. Raises InputError for a box that `check` refuses and for boxes that leave
        robots no place to stand.
        """
        for box in boxes:
            self.check(box)
        self.found, self.boxes = self.survey(tuple(sorted(boxes))), boxes
        self.version += 1

    def admit(self, crowd: Crowd) -> None:
        """Let a crowd walk about in the building from now on."""
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
        """Where the discs (p, 3) of all crowds are: x, y, radius in m."""
        return np.concatenate([crowd.discs for crowd in self.crowds]) if self.crowds else np.empty((0, 3))


def _edges(box: Box) -> str:
    return "[{:g}, {:g}, {:g}, {:g}]".format(*box)
