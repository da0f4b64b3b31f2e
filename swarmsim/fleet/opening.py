"""Opens a link of a transport that is named on the command line."""

from __future__ import annotations

from collections.abc import Sequence

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import set_key
from swarmsim.core.scenario.files import Table
from swarmsim.core.scenario.part import Part
from swarmsim.fleet.transport import RobotLink, Transport


def opened(transport: str, address: str, robot: int, keys: Sequence[str] = ()) -> RobotLink:
    """A link of a transport by its name, with `keys` of its own as KEY=VALUE. Raises InputError."""
    table: Table = {"use": transport}
    try:
        for one in keys:
            set_key(table, one)
    except InputError as problem:
        raise InputError(str(problem).replace("--set", "--link", 1)) from problem
    part: Part[Transport] = Part("transport", table)
    try:
        return part.build(None).open(address, robot)
    except InputError as problem:
        option = "--link " if keys and "use:" not in str(problem) else "--transport "
        plain = "transport " in str(problem).partition(":")[0]
        raise InputError(str(problem) if plain else f"{option}{problem}") from problem
