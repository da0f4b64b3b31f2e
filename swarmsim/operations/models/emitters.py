"""What gives off the field: sources that start, stop and move."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Domain, Values
from swarmsim.operations.models.faces import Faces, Whole

#: From numbers of cells (c,) and the two ends of a time in s: what is given off meanwhile on average, (c,) in unit/s.
Forcing = Callable[[Whole, float, float], Values]


class Emitter(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A source in one cell, from one moment to another; it may move, and gives off nothing while it is in a wall."""

    x: float  # m, when it begins
    y: float  # m
    strength: float = 1.0  # unit m^2/s: the field's integral grows by so much in a second; a sink is negative
    begin: Annotated[float, Meta(ge=0.0)] = 0.0  # s
    end: float | None = None  # s; none: it never stops
    velocity: tuple[float, float] = (0.0, 0.0)  # m/s

    def places(self, begin: float, end: float, cell: float) -> tuple[NDArray[np.float64], float]:
        """Where (p, 2) it is between two times, at even intervals of less than a cell, and for how long (s) in all."""
        first, last = max(begin, self.begin), min(end, math.inf if self.end is None else self.end)
        if last <= first:
            return np.empty((0, 2)), 0.0
        many = 1 + int(math.hypot(*self.velocity) * (last - first) / cell)
        times = first - self.begin + (np.arange(many) + 0.5) / many * (last - first)
        return np.array([self.x, self.y]) + times[:, None] * self.velocity, last - first

    def place(self, time: float) -> tuple[float, float]:
        """Where it is at a time (s); before it begins or after its end, where it will begin or has ended."""
        since = min(max(time - self.begin, 0.0), math.inf if self.end is None else self.end - self.begin)
        return self.x + since * self.velocity[0], self.y + since * self.velocity[1]


class Hidden(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A source at a random place, another one for each seed."""

    strength: float = 1.0  # unit m^2/s
    begin: Annotated[float, Meta(ge=0.0)] = 0.0  # s
    end: float | None = None  # s; none: it never stops
    within: tuple[float, float, float, float] | None = None  # m: left, lower, right, upper; default: the whole floor

    def drawn(self, domain: Domain, dice: np.random.Generator) -> Emitter:
        """The source. Raises InputError, which starts with the key, without a free cell within the limits."""
        if self.end is not None and self.end <= self.begin:
            raise InputError(f"end: {self.end:g} s; expected a time after it begins, {self.begin:g} s")
        places = domain.lattice.centres(np.argwhere(domain.free))
        left, low, right, high = self.within or (-math.inf, -math.inf, math.inf, math.inf)
        places = places[((places >= (left, low)) & (places <= (right, high))).all(axis=1)]
        if len(places) == 0:
            raise InputError(f"within: {list(self.within or ())} holds no free cell; expected some of the floor")
        half = 0.5 * domain.lattice.cell
        x, y = places[dice.integers(len(places))] + dice.uniform(-half, half, 2)
        return Emitter(x=float(x), y=float(y), strength=self.strength, begin=self.begin, end=self.end)


class Emission:
    """The sum of some emitters on the cells of a domain."""

    def __init__(self, emitters: Sequence[Emitter], faces: Faces) -> None:
        """Raises InputError, which starts with the key, for a start in a wall, or an end before the beginning."""
        self._emitters, self._faces = emitters, faces
        for number, one in enumerate(emitters):
            if one.end is not None and one.end <= one.begin:
                raise InputError(
                    f"sources[{number}].end: {one.end:g} s; expected a time after it begins, {one.begin:g} s"
                )
            if self._cells(np.array([[one.x, one.y]]))[0] < 0:
                raise InputError(
                    f"sources[{number}].x: {one.x:g} m, {one.y:g} m is not on the floor; expected a free place"
                )

    def __call__(self, cells: Whole, begin: float, end: float) -> Values:
        """See `Forcing`."""
        lattice = self._faces.domain.lattice
        found = np.zeros(self._faces.count)
        for one in self._emitters:
            places, lasts = one.places(begin, end, lattice.cell)
            at = self._cells(places)
            share = one.strength / lattice.cell**2 * lasts / (end - begin) / max(len(at), 1)
            np.add.at(found, at[at >= 0], share)
        return found[cells]

    def _cells(self, places: NDArray[np.float64]) -> Whole:
        """The numbers (p,) of the cells at places (p, 2); -1 for those in walls."""
        row, column = self._faces.domain.lattice.cells_within(places).T
        return np.where(row < 0, -1, self._faces.number[row, column])
