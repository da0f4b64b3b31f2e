"""Links of robots that hear what arrives: the world learns from them who has heard whom."""

from __future__ import annotations

from collections import Counter
from typing import Final, Protocol, final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.capabilities import PLACING
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Delivery
from swarmsim.core.parts import Links
from swarmsim.core.scenario.file import Scenario
from swarmsim.core.state import State
from swarmsim.fleet.remote import RemoteMinds
from swarmsim.fleet.terms import LATE

_WHERE: Final = "with --links real robots hear what arrives; expected --links simulated"


class Overheard(Protocol):
    """The robots of a fleet, as far as they tell whom they have heard."""

    @property
    def heard(self) -> list[tuple[int, int, int]]:
        """Receiver, sender and iteration sent, sorted."""
        ...


@final
class RealLinks:
    """Topology and channel of a swarm at once: what its robots tell that they have heard."""

    def __init__(self, minds: RemoteMinds) -> None:
        """The end of the world's comes later, before the first iteration."""
        self._minds = minds
        self.crew: Overheard | None = None
        #: Letters heard whose sender has not told the world in time what it said, and which no recording holds.
        self.counts = Counter[str]()

    def links(self, state: State) -> Links:
        """Who has heard whom in this iteration."""
        pairs = sorted({(receiver, sender) for receiver, sender, _ in self._letters(state)})
        return np.array(pairs, np.int32).reshape(-1, 2)

    def deliver(self, state: State, links: Links, sizes: NDArray[np.int32]) -> Delivery:
        """What they have heard."""
        found = [(*one, len(self._minds.frame(*one[1:]))) for one in self._letters(state)]
        return Delivery(np.array(found, np.int32).reshape(-1, 4), (), max(state.iteration - LATE, 0))

    def _letters(self, state: State) -> list[tuple[int, int, int]]:
        """Receiver, sender and iteration sent of all letters heard that the world knows too."""
        heard = [] if self.crew is None else [one for one in self.crew.heard if state.alive[one[0]]]
        known = [one for one in heard if self._minds.frame(*one[1:])]
        self.counts["unknown to the world"] += len(heard) - len(known)
        return known


def nearest_of(scenario: Scenario, minds: RemoteMinds) -> int:
    """How many of those that it hears a robot listens to; 0: all. Raises InputError for what real links cannot have."""
    network = scenario.network
    for number, one in enumerate(scenario.faults):
        failure = one.declares("failure", "")
        if one.use == "radio" or failure == "spoof":
            raise InputError(f"faults[{number}]: {one.use} {failure} acts on simulated links alone; {_WHERE}")
    if network.channel.use != "perfect":
        raise InputError(f"network.channel.use: {network.channel.use!r} is simulated; {_WHERE}")
    nearest = network.topology.declares("k", 0)
    if nearest:
        PLACING.needed(minds, "network.topology.k", "--links simulated")
    return nearest
