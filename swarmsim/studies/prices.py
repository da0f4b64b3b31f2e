"""What a mission costs: its robots, and the time that it takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from swarmsim.core.errors import InputError
from swarmsim.studies.labels import shown
from swarmsim.studies.sizing import Asked
from swarmsim.studies.survival import Interval

EXAMPLE: Final = "expected name=number, as in robot=120,minute=0.5"


@dataclass(frozen=True, slots=True)
class Prices:
    """The price of a mission: robots x (`robot` + extras) + minutes x `minute`.

    The minutes are the mean time until the task is done; a mission that is not done in time is given up then.
    """

    robot: float = 0.0
    minute: float = 0.0
    extras: Mapping[str, float] | None = None  # of each robot, by the value of a varied key

    def least(self, robots: int, extra: float = 0.0) -> float:
        """The price of a mission that takes no time."""
        return robots * (self.robot + extra)

    def of(self, asked: Asked, robots: int, extra: float = 0.0) -> tuple[float, Interval]:
        """The mean price of a mission and its interval, which is that of its mean time."""
        mean, (low, high) = asked.mean()
        fixed = self.least(robots, extra)
        return fixed + self.minute * mean / 60.0, (
            fixed + self.minute * low / 60.0,
            fixed + self.minute * high / 60.0,
        )

    def extra(self, values: Sequence[object]) -> float:
        """What each robot costs more with these values of varied keys."""
        return sum((self.extras or {}).get(str(shown(value)), 0.0) for value in values)


def prices_of(asked: Mapping[str, float] | str, varied: Sequence[object] = ()) -> Prices:
    """Prices by name: `robot`, `minute`, or a value among `varied`. Raises InputError."""
    given = amounts(asked, ("robot", "minute", *(str(shown(value)) for value in varied)), "--price", EXAMPLE)
    return Prices(given.pop("robot", 0.0), given.pop("minute", 0.0), given)


def amounts(asked: Mapping[str, float] | str, known: Sequence[str], option: str, example: str) -> dict[str, float]:
    """Numbers of 0 or more by known names, as a mapping or in words; an error has the `option` and the `example`."""
    given: dict[str, float] = {}
    pairs = asked.items() if isinstance(asked, Mapping) else (one.rpartition("=")[::2] for one in asked.split(","))
    for name, value in pairs:
        try:
            amount = float(value)
        except ValueError:
            amount = -1.0
        if not 0.0 <= amount < 1e15:
            raise InputError(f"{option} {name}={value}: no {option[2:]} of 0 or more; {example}")
        given[name.strip()] = amount
    if unknown := [name for name in given if name not in known]:
        raise InputError(f"{option} {unknown[0]}: unknown; {example}; known: {', '.join(known)}")
    return given
