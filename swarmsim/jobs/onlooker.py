"""What an onlooker sees of a job in pieces: who holds each piece, how old halos are, and where they travel.

Nothing of it goes back to a robot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.jobs import PieceJob, Shared
from swarmsim.core.messages import Broadcast, Inbox
from swarmsim.core.probes import GONE, NOBODY
from swarmsim.core.state import Senses
from swarmsim.jobs.facts.wire import Facts
from swarmsim.jobs.reports import SHOW
from swarmsim.jobs.runtime import UNKNOWN, Lockstep, Parcel
from swarmsim.jobs.sighted import HEARD, Sighted, tables_of

REMEMBERED: Final = 8  # levels of which it is known when a value was made

Steps = NDArray[np.int32]  # (n, p)


class ObservedJob:
    """A job in pieces, looked at after each exchange.

    The age of a halo is the time from the exchange in which somebody first made it to the one in which a step used it,
    less the one exchange that it takes at least. That of a step is the mean over the pieces that it reads; steps done
    once more do not count, since what they read is old for another reason.
    """

    def __init__(self, job: PieceJob, keys: Shared, context: BuildContext) -> None:
        """Raises InputError for a job that cannot be done."""
        #: The job itself.
        self.inner = Lockstep(job, keys, context)
        self.written_by, self.codec = self.inner.written_by, self.inner.codec
        self._plan, self._lattice, self._rounds = self.inner.plan, context.lattice, context.rounds
        #: What it shows.
        self.tables = tables_of(self._plan, context.lattice, context.swarm)
        rows, pieces = len(context.ids), len(self._plan.pieces)
        self._step = np.full((rows, pieces), UNKNOWN, np.int32)
        self._heard: list[dict[tuple[int, int], int]] = [{} for _ in range(rows)]  # newest, by piece and reader
        self._made: list[dict[int, int]] = [{} for _ in range(pieces)]  # exchange in which a step was first reached
        self._holder, self._age = np.full(pieces, NOBODY, np.int32), np.full(pieces, np.nan)
        self._from: list[dict[int, None]] = [{} for _ in range(rows)]
        self._ages, self._aged, self._iteration, self._clock = 0.0, 0, -1, -1

    def say(self, senses: Senses) -> Broadcast[Facts]:
        """Every robot's part in one exchange."""
        if senses.iteration != self._iteration:
            self._iteration, self._clock = senses.iteration, senses.iteration * self._rounds - 1
            self._from = [{} for _ in self._from]
        self._clock += 1
        return self.inner.say(senses)

    def hear(self, senses: Senses, inbox: Inbox[Facts]) -> Parcel:
        """Every robot's part of the answer after an exchange."""
        told = zip(inbox.receivers.tolist(), inbox.senders.tolist(), inbox.content.rows(), strict=True)
        for row, sender, fact in told:
            readers = self._plan.named(fact.key, fact.robot) if fact.kind == SHOW else ()
            for reader in readers if len(fact.value) > len(readers) else ():  # else it is an answer without numbers
                if fact.version > self._heard[row].get((fact.key, reader), UNKNOWN):
                    self._heard[row][fact.key, reader] = fact.version
                    self._from[row][sender] = None
        found = self.inner.hear(senses, inbox)
        self._see(found.step)
        self._hold(np.where(senses.alive[:, None], found.step, NOBODY), found.kept[senses.alive])
        return replace(found, seen=Sighted(self._lattice, *self._seen(), self._ages, self._aged))

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase all that these rows (r,) have of the job."""
        for row in robots.tolist():
            self._heard[row].clear()
        self.inner.reset(robots)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give these rows (r,) the values and copies that the row `source` has, but none of its pieces."""
        self.inner.copy_from(robots, source)

    def _see(self, step: Steps) -> None:
        """Note which steps have been made in an exchange, and the age of what they have read."""
        before, self._step = self._step, step
        changed = np.argwhere(step > before).tolist()
        for row, piece in changed:
            last, now = int(before[row, piece]), int(step[row, piece])
            for one in range(last + 1 if last >= 0 else now, now + 1):
                self._made[piece].setdefault(one, self._clock)
        for row, piece in changed:
            now = int(step[row, piece])
            if before[row, piece] >= 0 and self._made[piece][now] == self._clock:
                self._used(row, piece, now - 1)
        for made in self._made:
            while len(made) > REMEMBERED * self._plan.job.level + 1:
                del made[min(made)]

    def _used(self, row: int, piece: int, step: int) -> None:
        """Note the age of what a step has read: with `fence = "clock"` the newest that the robot knew."""
        found = []
        for joint in self._plan.joints[piece]:
            heard = self._heard[row].get((joint.piece, piece), UNKNOWN)
            newest = max(heard, int(self._step[row, joint.piece]))
            made = self._made[joint.piece].get(step if self._plan.keys.fence == "data" else newest)
            if made is not None:
                found.append(max(self._clock - made - 1, 0))
        if found:
            self._age[piece] = sum(found) / len(found)
            self._ages, self._aged = self._ages + float(self._age[piece]), self._aged + 1

    def _hold(self, step: Steps, kept: Steps) -> None:
        """Who computes each piece: who did so before, while it does, and else the robot that is farthest."""
        pieces = np.arange(step.shape[1])
        still = (self._holder >= 0) & (step[np.maximum(self._holder, 0), pieces] >= 0)
        somebody = step.max(axis=0, initial=NOBODY) >= 0
        nobody = np.where(kept.max(axis=0, initial=NOBODY) >= 0, NOBODY, GONE)
        found = np.where(still, self._holder, np.where(somebody, step.argmax(axis=0), nobody))
        self._holder = found.astype(np.int32)

    def _seen(self) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.int32]]:
        halos = np.full((len(self._from), HEARD), -1, np.int32)
        for row, senders in enumerate(self._from):
            listed = list(senders)[:HEARD]
            halos[row, : len(listed)] = listed
        found = self._holder, self._age.copy(), halos
        for array in found:
            array.setflags(write=False)
        return found
