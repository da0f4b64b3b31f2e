"""The levels of a building in one file, and the wanted one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from swarmsim.core.errors import InputError

_RANGE: Final = re.compile(r"(-?\d+(?:\.\d+)?)\s*-\s*(-?\d+(?:\.\d+)?)")
_TALLEST: Final = 200  # levels in one range
_LISTED: Final = 20  # levels in one message


def levels_of(properties: Mapping[str, object]) -> frozenset[str]:
    """The levels of a feature, as in OSM (`level`, `repeat_on`: 0;1 or 0-3) or IMDF (`level_id`)."""
    level = properties.get("level_id")
    if isinstance(level, str):
        return frozenset([level])
    return frozenset().union(*(_listed(properties.get(key)) for key in ("level", "repeat_on")))


def _listed(value: object) -> list[str]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [f"{value:g}"]
    found = []
    for part in re.split("[;,]", value) if isinstance(value, str) else ():
        ends = _RANGE.fullmatch(part.strip())
        if ends is not None and 0.0 <= float(ends[2]) - float(ends[1]) <= _TALLEST:
            first = float(ends[1])
            found += [f"{first + step:g}" for step in range(int(float(ends[2]) - first) + 1)]
        elif part.strip():
            found.append(_plain(part))
    return found


def chosen(
    wanted: str, rooms: Mapping[str, int], names: Mapping[str, Sequence[str]], name: str, notices: list[str]
) -> frozenset[str]:
    """The user's choice among the levels with `rooms`; `names` are their other names.

    It may be left out if there is only one. Several of the same name, as in two buildings, all count. Raises InputError
    with the list of levels.
    """
    if not rooms and wanted:
        raise InputError(f"{name}: world.level: {wanted!r}, but nothing in it says its level; leave it out")
    found = [level for level in rooms if _plain(wanted) in map(_plain, [level, *names.get(level, ())])]
    if wanted and not found:
        raise InputError(f"{name}: world.level: no level {wanted!r}; expected {_told(rooms, names)}")
    if not wanted and len(rooms) > 1:
        raise InputError(f"{name}: it has {len(rooms)} levels; expected world.level = {_told(rooms, names)}")
    if len(found) > 1:
        notices.append(f"{len(found)} levels are called {wanted!r}: {', '.join(found)}; all of them are read")
    return frozenset(found or rooms)


def _plain(text: str) -> str:
    """A name in one case, and a number in one form: 1, 1.0 and +1 are the same level."""
    try:
        return f"{float(text):g}"
    except ValueError:
        return text.strip().casefold()


def _told(rooms: Mapping[str, int], names: Mapping[str, Sequence[str]]) -> str:
    def order(level: str) -> tuple[float, str]:
        numbers = [float(one) for one in (*names.get(level, ()), level) if re.fullmatch(r"-?\d+(\.\d+)?", one)]
        return (numbers[0] if numbers else 1e9), level

    told = []
    for level in sorted(rooms, key=order):
        called = list(dict.fromkeys(names.get(level, ()))) or [level]
        also = f"{', '.join(called[1:])}, " if called[1:] else ""
        told.append(f'"{called[0]}" ({also}{rooms[level]} rooms)')
    more = f" and {len(told) - _LISTED} more" if len(told) > _LISTED else ""
    return f"one of {', '.join(told[:_LISTED])}{more}"
