"""Which sensors robots have: one or several, the same for all of them or others for a group."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, NamedTuple

from msgspec import UNSET, UnsetType

from swarmsim.core.errors import InputError
from swarmsim.core.files import Table

if TYPE_CHECKING:
    from swarmsim.core.robots import Group
    from swarmsim.core.scenario import Scenario

_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,19}")


class Fitted(NamedTuple):
    """One sensor of some robots."""

    place: str  # in the scenario
    name: str  # what its channels are called by, where two are alike; mostly none
    table: Table  # of the part, without its name


def named(table: Table) -> tuple[str, Table]:
    """What a sensor of a list is called, and its table without that. Raises InputError."""
    name = table.get("name", "")
    if name and not (isinstance(name, str) and _NAME.fullmatch(name)):
        raise InputError(f"name: {name!r}; expected a short word of small letters, digits and _, as in 'second'")
    return name, {key: value for key, value in table.items() if key != "name"}


def _of(owner: Scenario | Group, place: str, *, has_one: bool) -> tuple[Fitted, ...]:
    """The sensors that a table gives its robots; `has_one` says that there is one if none is named."""
    more: tuple[Table, ...] | UnsetType = owner.sensors
    listed = () if more is UNSET else more
    fitted = [Fitted(f"{place}sensors[{i}]", *named(table)) for i, table in enumerate(listed)]
    if owner.sensor or (has_one and not listed):
        fitted.insert(0, Fitted(f"{place}sensor", "", owner.sensor))
    return tuple(fitted)


def sensors_of(scenario: Scenario) -> list[tuple[Fitted, ...]]:
    """The sensors of each group of robots; one list alone if none has any of its own.

    `[sensor]` and all of `[[sensors]]`; without either, one sensor. A group that has its own has no others.
    """
    all_have = _of(scenario, "", has_one=True)
    groups = scenario.robots.groups
    own = [_of(group, f"robots[{i}].", has_one=False) for i, group in enumerate(groups)]
    return [mine or all_have for mine in own] if any(own) else [all_have]
