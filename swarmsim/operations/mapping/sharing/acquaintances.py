"""What a robot remembers of the robots that it has met: where that was, and what it has compared since."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.operations.mapping.sharing.links import Links
from swarmsim.operations.mapping.sharing.places import ASIDE, Transform
from swarmsim.operations.mapping.sharing.registration import Meetings

GROWN: Final = 1.2  # by how much two maps together, or the span of meetings, grow before another comparison


@dataclass(slots=True)
class Acquaintance:
    """What one robot remembers of another that it has met."""

    tried: int  # the iteration of the last comparison of their maps ...
    cells: int = 0  # ... the cells that both knew then, together ...
    span: float = 0.0  # ... and how far apart the meetings were
    met: list[NDArray[np.float64]] = field(default_factory=list)  # places of both, each on its own map, in cells

    def meet(self, both: NDArray[np.float64]) -> bool:
        """Note a meeting (2, 2), unless both are where they last met; whether it was noted."""
        if self.met and np.hypot(*(both - self.met[-1]).T).max() < 1.0:
            return False
        self.met.append(both)
        return True

    def has_grown(self, cells: int, span: float, least: float) -> bool:
        """Whether there is so much more to compare than at the last time; notes how much there is."""
        if cells <= least * self.cells and span <= least * self.span:
            return False
        self.cells, self.span = cells, span
        return True


def meetings(
    hearer: int,
    teller: int,
    known: Mapping[tuple[int, int], Acquaintance],
    links: Links,
    starts: Sequence[Transform],
    within: float,
) -> Meetings:
    """A robot's meetings with another and with those whose frames are linked to it, in the other's frame.

    Robots are given by row and number, `starts` by number. To those who are linked the robot has to be a stranger, or
    the link to it would be tested by itself. Links err a little, which widens the reach of their meetings.
    """
    frames = {teller: Transform(0.0, 0.0, 0.0)}
    linked = links.seen_from(teller)
    if links.robot not in linked:
        frames |= linked
    here, there, reach = [], [], []
    for other, frame in frames.items():
        if (hearer, other) in known:
            both = np.array(known[hearer, other].met).reshape(-1, 2, 2)
            here.append(both[:, 0])
            there.append(frame.apply(starts[other].apply(both[:, 1])))
            reach.append(np.full(len(both), within if other == teller else within + ASIDE))
    return Meetings(np.concatenate(here), np.concatenate(there), np.concatenate(reach))
