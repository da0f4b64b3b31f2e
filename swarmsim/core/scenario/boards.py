"""Real processors: their numbers, for scenarios that name them."""

from __future__ import annotations

from typing import Final

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.scenario.files import Table

#: Each processor's operations a second, bytes and J an operation.
#: docs/computing-processors.md names the data sheets and the assumptions.
BOARDS: Final[dict[str, Table]] = {
    "atmega328": {"rate": 2e5, "memory": 2048.0, "energy": 2.5e-7},
    "esp32": {"rate": 6e7, "memory": 327680.0, "energy": 3.7e-9},
    "stm32f407": {"rate": 4.2e7, "memory": 196608.0, "energy": 6.8e-9},
    "pi-zero-2": {"rate": 5e8, "memory": 4e8, "energy": 2e-9},
}


def with_board(robots: Table, place: str) -> Table:
    """A table of robots whose `processor` has the numbers of the one that it names. Raises InputError."""
    given = robots.get("processor")
    if not isinstance(given, dict) or "use" not in given:
        return robots
    use = given["use"]
    if not isinstance(use, str) or use not in BOARDS:
        raise InputError(f"{place}.processor.use: no processor is called {use!r}; {nearest(str(use), BOARDS)}")
    return {**robots, "processor": {**BOARDS[use], **given}}
