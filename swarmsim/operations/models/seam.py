"""The seam of models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol

from swarmsim.core.jobs import Domain
from swarmsim.core.seams import Seam

if TYPE_CHECKING:  # the seams' users need no scipy
    from swarmsim.operations.models.equations import Equations


class Equation(Protocol):
    """An equation of the environment."""

    def on(self, domain: Domain, /) -> Equations:
        """The equation on the cells of a domain. Raises InputError, which starts with the key at fault."""
        ...


SEAM: Final = Seam("model", (), Equation)
