"""Events of jobs in pieces: a piece is taken over, or lost."""

from __future__ import annotations

from collections.abc import Sequence

from swarmsim.core.events import Event, PieceLost, PieceTaken
from swarmsim.core.parts import Exchanges, Tick
from swarmsim.core.probes import GONE
from swarmsim.jobs.runtime import Parcel


class Takeovers:
    """Tells at the start of each iteration what happened to pieces in the one before."""

    def __init__(self, jobs: Exchanges) -> None:
        self._jobs = jobs
        self._had: dict[tuple[str, int], int] = {}  # who held each piece last
        self._lost: set[tuple[str, int]] = set()

    def advance(self, now: Tick) -> Sequence[Event]:
        """What is new. A piece that nobody had yet, as before late robots come, is not lost."""
        found = list[Event]()
        for one in self._jobs.told if now.iteration else ():
            seen = one.knowledge.seen if isinstance(one.knowledge, Parcel) else None
            holders = [] if seen is None else seen.holder.tolist()
            for piece, holder in enumerate(holders):
                key = one.name, piece
                before = self._had.get(key)
                if holder >= 0:
                    self._lost.discard(key)
                    self._had[key] = holder
                    if before not in (None, holder):
                        found.append(PieceTaken(now.iteration, one.name, piece, (holder, before)))
                elif holder == GONE and before is not None and key not in self._lost:
                    self._lost.add(key)
                    found.append(PieceLost(now.iteration, one.name, piece))
        return found
