"""Parts and values that are named on the command line, and the links that are opened with them."""

from __future__ import annotations

from collections.abc import Sequence

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import set_key
from swarmsim.core.scenario.files import Table
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.transport import RobotLink, Transport


def table_of(keys: Sequence[str], option: str, **given: object) -> Table:
    """The table of KEY=VALUE, which came by this option, beside what is `given`. Raises InputError."""
    table: Table = dict(given)
    try:
        for one in keys:
            set_key(table, one)
    except InputError as problem:
        raise InputError(str(problem).replace("--set", option, 1)) from problem
    return table


def opened(transport: str, address: str, robot: int, keys: Sequence[str] = ()) -> RobotLink:
    """A link of a transport by its name, with `keys` of its own as KEY=VALUE. Raises InputError."""
    part: Part[Transport] = Part("transport", table_of(keys, "--link", use=transport))
    try:
        return part.build(None).open(address, robot)
    except InputError as problem:
        option = "--link " if keys and "use:" not in str(problem) else "--transport "
        plain = "transport " in str(problem).partition(":")[0]
        raise InputError(str(problem) if plain else f"{option}{problem}") from problem
