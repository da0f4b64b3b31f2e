"""The storeys of a building in an IFC file, and the scenario's choice."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

from swarmsim.core.errors import InputError
from swarmsim.world.bim.entities import Model

_SAME = 0.01  # m, elevations this close are the same


@dataclass(frozen=True, slots=True)
class Storey:
    """One storey."""

    id: int  # in the file
    name: str  # empty if it has none
    elevation: float  # m, as stated in the file
    height: float  # m, in the file's coordinates
    walls: int  # in it
    doors: int

    def __str__(self) -> str:
        """Its name in messages."""
        return f"{self.name!r} at {self.elevation:.2f} m" if self.name else f"the one at {self.elevation:.2f} m"


def storeys(model: Model, metre: float, walls: Sequence[int], doors: Sequence[int]) -> list[Storey]:
    """The storeys of a model, the lowest first; `metre` is its unit, walls and doors are their storeys' ids."""
    from ifcopenshell.util.placement import get_local_placement

    found = model.by_type("IfcBuildingStorey")
    said = [None if one.Elevation is None else float(one.Elevation) * metre for one in found]
    placed = [
        None if one.ObjectPlacement is None else float(get_local_placement(one.ObjectPlacement)[2][3]) * metre
        for one in found
    ]
    if len(set(placed)) == 1 and len(set(said)) > 1:  # from programs that place everything in the building itself
        placed = said
    storeys = []
    for one, elevation, place in zip(found, said, placed, strict=True):
        height = place if place is not None else elevation or 0.0
        name = str(one.Name or one.LongName or "").strip()
        called = height if elevation is None else elevation
        storeys.append(Storey(one.id(), name, called, height, walls.count(one.id()), doors.count(one.id())))
    return sorted(storeys, key=lambda storey: (storey.height, storey.id))


def chosen(storeys: Sequence[Storey], level: str, name: str) -> tuple[Storey, list[str]]:
    """The storey of `level`: a name, a number from 0 for the lowest, or an elevation; and a notice.

    Without a level, the lowest with walls and doors, or else with walls: foundations have only walls. Raises
    InputError, with the file's `name`, if there is none.
    """
    wanted = level.strip().casefold()
    if not wanted:
        with_walls = [one for one in storeys if one.walls] or list(storeys)
        storey = next((one for one in with_walls if one.doors), with_walls[0])
        others = [one for one in storeys if one is not storey]
        return storey, [f"taken is the storey {storey}; others, for world.level: {_listed(others)}"] if others else []
    named = [one for one in storeys if one.name.casefold() == wanted]
    if len(named) > 1:
        numbers = " or ".join(str(number) for number, one in enumerate(storeys) if one in named)
        raise InputError(f'{name}: world.level: {len(named)} storeys are called "{level}"; say the number, {numbers}')
    if not named and wanted.isdecimal() and int(wanted) < len(storeys):
        named = [storeys[int(wanted)]]
    if not named:
        with contextlib.suppress(ValueError):
            height = float(wanted.removesuffix("m"))
            named = [one for one in storeys if abs(one.elevation - height) <= _SAME]
    if len(named) != 1:
        raise InputError(f'{name}: world.level: no storey is called "{level}"; it has {_listed(storeys)}')
    return named[0], []


def _listed(storeys: Sequence[Storey]) -> str:
    return ", ".join(map(str, storeys[:12])) + (f" and {len(storeys) - 12} more" if len(storeys) > 12 else "")
