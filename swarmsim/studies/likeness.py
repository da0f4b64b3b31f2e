"""Differences between compared runs that make their numbers hard to compare."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import msgspec

from swarmsim.core.scenario.file import Scenario
from swarmsim.core.scenario.part import plain

MOST: Final = 4  # names that a notice lists


@dataclass(frozen=True, slots=True)
class Side:
    """A run or a condition, and the text of its floor plan."""

    name: str
    scenario: Scenario
    world: str
    code: Mapping[str, str] = field(default_factory=dict)  # a hash of each piece of code; empty if unknown


def notices(sides: Sequence[Side]) -> list[str]:
    """A sentence for each unwanted difference in building, task, cells or period, with values and names.

    Networks, minds, robots, faults and seeds may differ: comparisons are about them.
    """
    worlds = _worlds(sides)
    rows = [
        {
            "world": world,
            **{f"task.{key}": value for key, value in side.scenario.task.table.items()},
            "grid.cell": side.scenario.grid.cell,
            "period": side.scenario.period,
        }
        for side, world in zip(sides, worlds, strict=True)
    ]
    told = []
    for key in dict.fromkeys(key for row in rows for key in row):
        groups: dict[str, list[str]] = {}
        for side, row in zip(sides, rows, strict=True):
            groups.setdefault(_shown(row.get(key)), []).append(side.name)
        if len(groups) > 1:
            values = _listed((f"{value} ({_listed(names)})" for value, names in groups.items()), "; ")
            told.append(f"these differ in {key}, so their numbers are hard to compare: {values}")
    return [*told, *_code(sides)]


def _code(sides: Sequence[Side]) -> Iterator[str]:
    """A sentence for each piece of code that all have but in different versions."""
    for name in dict.fromkeys(name for side in sides for name in side.code):
        groups: dict[str, list[str]] = {}
        for side in sides:
            if name in side.code:
                groups.setdefault(side.code[name][:8], []).append(side.name)
        if len(groups) > 1:
            values = _listed((f"{found} ({_listed(names)})" for found, names in groups.items()), "; ")
            yield f"these were made by different code of {name}: {values}"


def _worlds(sides: Sequence[Side]) -> list[str]:
    """The name of each side's building; different buildings with the same name get a hash."""
    hashes = []
    for side in sides:
        described = {**msgspec.structs.asdict(side.scenario.world), "file": "", "text": side.world}
        hashes.append(hashlib.blake2b(msgspec.json.encode(described, enc_hook=plain), digest_size=3).hexdigest())
    names: dict[str, str] = {}
    for side, found in zip(sides, hashes, strict=True):
        title = side.scenario.world.title
        names.setdefault(found, f"{title}, drawing {found}" if title in names.values() else title)
    return [names[found] for found in hashes]


def _shown(value: object) -> str:
    return value if isinstance(value, str) else "none" if value is None else msgspec.json.encode(value).decode()


def _listed(words: Iterable[str], between: str = ", ") -> str:
    every = list(words)
    more = [f"{len(every) - MOST} more"] if len(every) > MOST else []
    return between.join(every[:MOST] + more)
