"""Real robots: their numbers, for scenarios that name them."""

from __future__ import annotations

import difflib
from typing import Final

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.boards import with_board
from swarmsim.core.scenario.files import Table

PLAIN: Final = "paper"  # the default robot
_EIGHT: Final = [0, 45, 90, 135, 180, -135, -90, -45]

#: Each robot's numbers in SI units; a sensor on the rim reaches its radius farther from the centre.
#: docs/robots.md names the data sheets and the assumptions.
PLATFORMS: Final[dict[str, Table]] = {
    "paper": {},
    "e-puck": {
        "radius": 0.035, "wheel_base": 0.053, "speed": 0.13, "acceleration": 0.4, "mass": 0.15,
        "sensor": {
            "bearings": [-17, -49, -90, -150, 150, 90, 49, 17], "reach": 0.105, "blind": 0.036, "cone": 15.0,
            "error_share": 0.04,
        },
    },
    "kilobot": {
        "radius": 0.0165, "wheel_base": 0.0255, "speed": 0.01, "acceleration": 0.1, "mass": 0.016, "traction": 0.5,
        "sensor": {"use": "none"},
    },
    "turtlebot3-burger": {
        "radius": 0.105, "wheel_base": 0.16, "speed": 0.22, "acceleration": 2.5, "mass": 1.0,
        "sensor": {"beams": 360, "reach": 3.5, "blind": 0.12, "error": 0.01, "error_share": 0.035, "tile": [45, 45]},
    },
    "thymio": {
        "radius": 0.08, "wheel_base": 0.0935, "speed": 0.14, "acceleration": 0.5, "mass": 0.27,
        "sensor": {
            "bearings": [40, 20, 0, -20, -40, 160, -160], "reach": 0.2, "blind": 0.081, "cone": 10.0,
            "error_share": 0.05,
        },
    },
    "khepera-iv": {
        "radius": 0.0704, "wheel_base": 0.1054, "speed": 0.813, "acceleration": 1.0, "mass": 0.54,
        "sensor": {"bearings": _EIGHT, "reach": 0.32, "blind": 0.0724, "cone": 15.0, "error_share": 0.05},
    },
    "gternal": {
        "radius": 0.055, "wheel_base": 0.105, "speed": 0.2, "acceleration": 1.0, "mass": 0.3,
        "sensor": {"preset": "gternal"},
    },
}  # fmt: skip


def with_platforms(table: Table) -> Table:
    """The table of a scenario with the numbers of the robots that it names, where it gives none itself.

    A list of `[[robots]]`, or `robots.groups`, becomes one table with groups. A platform's sensor is used
    where the scenario has no sensor, or one without `use`. Raises InputError, which starts with the key.
    """
    robots = table.get("robots")
    if isinstance(robots, dict) and isinstance(robots.get("groups"), list) and robots["groups"]:
        mixed = _mixed(robots["groups"], bool(table.get("sensor")))
        count = robots.get("count", mixed.get("count"))
        if count != mixed.get("count", count):
            raise InputError(
                f"robots.count: is {count}, but robots.groups has {mixed['count']} robots; expected the same number"
            )
        whole = with_board({"count": 1, **mixed, **robots, "groups": mixed["groups"]}, "robots")
        return {**table, "robots": whole}
    if isinstance(robots, dict):
        filled, sensor = _filled(robots, "robots")
        own = table.get("sensor", {})
        if sensor and isinstance(own, dict) and not {"use", "preset", "beams", "bearings"} & own.keys():
            table = {**table, "sensor": {**sensor, **own}}
        return {**table, "robots": filled}
    if isinstance(robots, list):
        return {**table, "robots": {"count": 1, **_mixed(robots, bool(table.get("sensor")))}}
    return table


def _filled(robots: Table, place: str) -> tuple[Table, Table]:
    """A table of robots with its platform's numbers, and that platform's sensor."""
    use = robots.get("use", PLAIN)
    if not isinstance(use, str) or use not in PLATFORMS:
        near = difflib.get_close_matches(str(use), PLATFORMS, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(f"{place}.use: no robot is called {use!r}; {hint}Known: {', '.join(PLATFORMS)}")
    numbers = {key: value for key, value in PLATFORMS[use].items() if key != "sensor"}
    sensor = PLATFORMS[use].get("sensor")
    return with_board({**numbers, **robots}, place), dict(sensor) if isinstance(sensor, dict) else {}


def _mixed(groups: list[object], has_sensor: bool) -> Table:
    """One table for groups of robots; each has its platform's sensor unless it, or the scenario, has another.

    It has their number if every group gives its own.
    """
    found, spawns = [], []
    for number, group in enumerate(groups):
        if not isinstance(group, dict):
            raise InputError(f"robots[{number}]: {group!r} is no table; expected a group of robots")
        filled, sensor = _filled(group, f"robots[{number}]")
        if "spawn" in filled:
            spawns.append(filled.pop("spawn"))
        if sensor and not has_sensor:
            filled.setdefault("sensor", sensor)
        own = filled.pop("sensor", {})
        found.append({**filled, **({} if own == {} else {"sensor": own})})
    if not found:
        raise InputError("robots: no group in it; expected one or more")
    if any(spawn != spawns[0] for spawn in spawns):
        raise InputError("robots: groups start in one spawn area; expected the same for all of them")
    whole: Table = {"groups": found, **({"spawn": spawns[0]} if spawns else {})}
    counts = [count for one in found if isinstance(count := one.get("count"), int) and not isinstance(count, bool)]
    if len(counts) == len(found):
        whole["count"] = sum(counts)
    for key, default in (("radius", 0.055), ("speed", 0.15)):
        values = [value for one in found if isinstance(value := one.get(key, default), int | float)]
        if len(values) == len(found):
            whole[key] = max(values)
    return whole
