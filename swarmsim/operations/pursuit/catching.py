"""The task of pursuit: the share of evaders caught."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy.spatial import distance

from swarmsim.core.adapters.forms import Last
from swarmsim.core.context import BuildContext
from swarmsim.core.parts import Curve, Summary
from swarmsim.core.state import Done, Knowledge, Measured


class Caught(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Every live evader, and one at least, has been caught: a live pursuer has been within reach of it."""

    within: Annotated[float, Meta(gt=0.0)] = 0.2  # m, centre to centre
    pursuers: str = "pursuers"  # a group of robots
    evaders: str = "evaders"  # another one

    def build(self, context: BuildContext) -> CatchingTask:
        """The task. Raises InputError if there are no such groups."""
        pursuers = context.robots.group(self.pursuers, "pursuers")
        return CatchingTask(self.within, pursuers, context.robots.group(self.evaders, "evaders"))


class CatchingTask:
    """Remembers which evaders have been caught."""

    requires_knowledge: type[Knowledge] = Knowledge  # type: ignore[type-abstract]  # any kind will do
    curve: Final = Curve("caught", "evaders caught, %", 100.0, high=100.0, format=".0f")

    def __init__(self, within: float, pursuers: NDArray[np.int64], evaders: NDArray[np.int64]) -> None:
        self._within, self._pursuers, self._evaders = within, pursuers, evaders
        self._caught = np.zeros(len(evaders), np.bool_)

    def measure(self, done: Done[Knowledge]) -> Measured:
        """The share of evaders that have been caught so far."""
        state = done.state
        pursuers, alive = self._pursuers[state.alive[self._pursuers]], state.alive[self._evaders]
        apart = distance.cdist(state.pose[self._evaders, :2], state.pose[pursuers, :2])
        self._caught |= alive & (apart <= self._within).any(axis=1)
        share = float(self._caught.mean())
        return Measured({"caught": share}, {}, share, share > 0.0 and bool((self._caught | ~alive).all()))

    def summaries(self) -> Sequence[Summary[Knowledge]]:
        """The last share."""
        return (Last(),)
