"""The seam of methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Protocol

from swarmsim.core.jobs import Values
from swarmsim.core.seams import Seam

if TYPE_CHECKING:  # the seams' users need no scipy
    from swarmsim.operations.methods.problem import Patch, Problem


class Solver(Protocol):
    """Steps the fields of one piece; it keeps nothing between calls, so equal arguments give equal bits."""

    @property
    def work(self) -> float:
        """Floating-point operations of a step."""
        ...

    def start(self, fields: Values, /) -> Values:
        """The state from the fields (c, k)."""
        ...

    def shows(self, state: Values, step: int, /) -> Values:
        """The values (r, k) of its rim, for others' step."""
        ...

    def step(self, state: Values, around: Values, step: int, /) -> Values:
        """The state after a step, from the values (h, k) of its halo."""
        ...

    def fields(self, state: Values, /) -> Values:
        """The fields (c, k) of a state."""
        ...


class Scheme(Protocol):
    """A method for equations in pieces."""

    @property
    def halo(self) -> int:
        """How many cells beyond its own a piece reads."""
        ...

    @property
    def exchanges(self) -> int:
        """Steps of a piece, each with an exchange of halos, that take the field on by one step in time."""
        ...

    @property
    def level(self) -> int:
        """Steps of a piece between copies of its state, a multiple of `exchanges`."""
        ...

    def solvers(self, problem: Problem, patches: Sequence[Patch], /) -> Sequence[Solver]:
        """A solver for each piece of the domain. Raises InputError, which starts with the key at fault."""
        ...


SEAM: Final = Seam("method", (), Scheme)
