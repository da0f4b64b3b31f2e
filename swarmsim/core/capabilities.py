"""Optional capabilities of a computation, for faults and others."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, Protocol, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.messages import C, MessageBatch

_ABSENT: Final = object()

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Lie(Generic[C]):
    """One kind of lie in messages."""

    #: The same message items, with those under a mask (t,) turned into lies; the pair of numbers is the lie's `offset`.
    told: Callable[[C, NDArray[np.bool_], tuple[int, int]], C]
    offset: str = ""  # meaning of its key `offset`, as in "[rows, columns]"; empty: no such key


class Falsifiable(Protocol[C]):
    """A computation that can falsify its messages."""

    @property
    def lies(self) -> Mapping[str, Lie[C]]:
        """The kinds of lies, by name."""
        ...


class Quantified(Protocol):
    """A computation that tells how much each robot knows."""

    def amounts(self) -> NDArray[np.int64]:
        """How much each robot knows (n,), in any unit; used to find the robot that knows most."""
        ...


class Charted(Protocol):
    """Knowledge that tells robots where they can go."""

    def terrain(self, robot: int) -> NDArray[np.uint8]:
        """A robot's value for each cell of the lattice (rows, columns): UNKNOWN, FREE or OCCUPIED."""
        ...


class Placing(Protocol):
    """A computation whose messages tell where their senders are."""

    def places(self, items: Any, sender: int) -> NDArray[np.float64]:  # noqa: ANN401 - its own messages
        """Where the sender of a message says that it was (p, 2): x, y in m, the newest last; empty if it does not."""
        ...


class LackingError(InputError):
    """A computation lacks a capability; `about` adds which computation to the message."""

    def __init__(self, wanted: str, does: str, verbs: list[str], expected: str) -> None:
        self._wanted, self._does, self._verbs = wanted, does, ", ".join(map(repr, verbs))
        self._expected = f"; expected {expected}" if expected else ""
        super().__init__(self.of("these robots' computation"))

    def of(self, whose: str) -> str:
        """The message about this computation."""
        what = f"{self._wanted} needs a computation that {self._does}"
        return f"{what}; {whose} does not: it has no {self._verbs}{self._expected}"


@dataclass(frozen=True, slots=True)
class Capability(Generic[T]):
    """An optional capability of a part; wrappers pass it on."""

    protocol: type  # T
    does: str  # what it does, in words

    def of(self, part: object) -> T | None:
        """The part itself if it has the capability."""
        return part if self._is_of(part) else None

    def needed(self, part: object, wanted: str, expected: str = "") -> T:
        """The part itself. Raises LackingError if it lacks the capability.

        The message starts with what `wanted` it, such as "map: 'copied'", and ends with the `expected` alternative.
        """
        found = self.of(part)
        if found is None:
            raise LackingError(wanted, self.does, lacking(self.protocol, part), expected)
        return found

    def _is_of(self, part: object) -> TypeGuard[T]:
        return not lacking(self.protocol, part)


FALSIFIABLE: Final[Capability[Falsifiable[MessageBatch]]] = Capability(
    Falsifiable, "says how its messages can be false"
)
QUANTIFIED: Final[Capability[Quantified]] = Capability(Quantified, "tells how much each robot knows")
CHARTED: Final[Capability[Charted]] = Capability(Charted, "tells robots which cells are free")


def verbs_of(protocol: type) -> tuple[str, ...]:
    """The methods and properties of a Protocol, in order."""
    found: dict[str, None] = {}
    for kind in reversed(protocol.__mro__):
        if getattr(kind, "_is_protocol", False):
            names = (*inspect.get_annotations(kind), *vars(kind))
            found |= dict.fromkeys(name for name in names if not name.startswith("_"))
    return tuple(found)


def lacking(protocol: type, part: object) -> list[str]:
    """What a part lacks of a Protocol. Properties are not evaluated, since their values may not exist yet."""
    return [
        verb
        for verb in verbs_of(protocol)
        if inspect.getattr_static(part, verb, _ABSENT) is _ABSENT and getattr(part, verb, _ABSENT) is _ABSENT
    ]


PLACING: Final[Capability[Placing]] = Capability(Placing, "tells in its messages where robots are")
