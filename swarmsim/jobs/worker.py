"""What one robot computes and keeps of a job in pieces, from what it knows that others show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarmsim.core.jobs import Values
from swarmsim.core.processors import OwnProcessor
from swarmsim.jobs.log import Copies, Log
from swarmsim.jobs.plan import JobPlan


@dataclass(slots=True)
class Thread:
    """A piece that the robot computes."""

    step: int
    state: Values
    since: int  # the exchange of its last step
    goal: int  # the step at which it ends
    known: int = 0  # the step that somebody was heard to have reached when it began
    done: float = 0.0  # operations of its next step
    late: int = 0  # exchanges in which its next step could be done but for the processor


@dataclass(slots=True)
class Counts:
    """What it took so far."""

    steps: int = 0
    waited: float = 0.0  # exchanges in which a piece could not go on; with a clock, by which what it read was old
    taken: int = 0  # pieces taken over
    redone: int = 0  # steps that were computed once more, as far as is known
    work: float = 0.0  # floating-point operations


class Worker:
    """Steps of pieces, one in an exchange, as far as the processor does them.

    With `fence = "data"` a step waits for what it reads. Else it takes the newest values, and goes on to the present.
    """

    def __init__(self, plan: JobPlan, processor: OwnProcessor) -> None:
        self._plan, self._processor = plan, processor
        self.threads: dict[int, Thread] = {}
        #: Pieces computed once more from an earlier step, for values that others need.
        self.again: dict[int, Thread] = {}
        self.copies, self.log, self.counts = Copies(), Log(), Counts()

    def begin(
        self, where: dict[int, Thread], piece: int, step: int, state: Values, goal: int, clock: int, known: int = 0
    ) -> None:
        """Compute a piece from a state on; what others were heard to have done of it counts as done once more."""
        state.setflags(write=False)
        where[piece] = Thread(step, state, clock, goal, known)
        self._reached(piece, step, state)

    def _reached(self, piece: int, step: int, state: Values) -> None:
        """Keep what a state shows, and the state itself at the start of a level."""
        if step % self._plan.job.level == 0:
            self.copies.put(piece, step, state)
        if step < self._plan.steps:
            shown = self._plan.shows(piece, state, step)
            for reader in self._plan.readers[piece]:
                self.log.put(piece, step, reader, shown[self._plan.read(piece, reader)])

    def advance(self, clock: int) -> None:
        """Go a step on with each piece whose neighbours are known; with `fence = "clock"` up to the present."""
        threads, fenced = self._in_order(self.threads), self._plan.keys.fence == "data"
        newest = {} if fenced else {piece: self._read_newest(piece, thread) for piece, thread in threads}
        for piece, thread in threads:
            if fenced:
                waited = clock - thread.since - 1 - thread.late
                self._step(piece, thread, self._read(piece, thread.step), clock, waited)
            while not fenced and thread.step < min(clock + 1, thread.goal):
                parts, since = newest[piece]
                if not self._step(piece, thread, parts, clock, thread.step - since):
                    break
        for piece, thread in self._in_order(self.again):
            self._step(piece, thread, self._read(piece, thread.step), clock, clock - thread.since - 1 - thread.late)
            if thread.step >= thread.goal:
                del self.again[piece]

    def _in_order(self, threads: dict[int, Thread]) -> list[tuple[int, Thread]]:
        """By number; on a processor with a rate, what has been begun comes first, and then the earliest step."""
        if not self._processor.timed:
            return sorted(threads.items())
        return sorted(threads.items(), key=lambda one: (one[1].done == 0.0, one[1].step, one[0]))

    def _step(self, piece: int, thread: Thread, parts: list[Values] | None, clock: int, waited: float) -> bool:
        """Do a step if it can be done and the processor comes to its end; whether it did."""
        if thread.step >= thread.goal or parts is None:
            return False
        wanted = self._plan.work[piece] - thread.done
        done = self._processor.take(wanted)
        if done < wanted:
            thread.done, thread.late = thread.done + done, thread.late + 1
            return False
        thread.state = self._plan.stepped(piece, thread.state, parts, thread.step)
        thread.step += 1
        self.counts.steps += 1
        self.counts.redone += thread.step <= thread.known
        self.counts.waited += max(0.0, waited)
        self.counts.work += self._plan.work[piece]
        thread.since, thread.done, thread.late = clock, 0.0, 0
        self._reached(piece, thread.step, thread.state)
        if self._plan.keys.fence == "clock":
            self.log.only_newest()
        return True

    def held(self) -> tuple[int, int]:
        """The bytes of its own pieces, with what they read, and of all others."""
        own, logs, copies = self.own, self.log.sizes(), self.copies.sizes()
        states = sum(one.state.nbytes for threads in (self.threads, self.again) for one in threads.values())
        mine = states + sum(logs.get(one, 0) for one in self.near) + sum(copies.get(one, 0) for one in own)
        return mine, states + sum(logs.values()) + sum(copies.values()) - mine

    @property
    def own(self) -> set[int]:
        """The pieces that it computes."""
        return {*self.threads, *self.again}

    @property
    def near(self) -> set[int]:
        """These, and the pieces that they read."""
        own = self.own
        return own | {joint.piece for piece in own for joint in self._plan.joints[piece]}

    def has(self, piece: int, step: int) -> int:
        """Bit i: what the piece's joint i shows to a step is known."""
        joints = enumerate(self._plan.joints[piece])
        return sum((self.log.get(one.piece, step, piece) is not None) << bit for bit, one in joints)

    def _read(self, piece: int, step: int) -> list[Values] | None:
        """What the piece reads of its joints in a step, if it is all known."""
        parts = []
        for joint in self._plan.joints[piece]:
            values = self.log.get(joint.piece, step, piece)
            if values is None:
                return None
            parts.append(values)
        return parts

    def _read_newest(self, piece: int, thread: Thread) -> tuple[list[Values], float]:
        """What the piece's joints are known to have shown last, and to which step on average.

        What was never heard counts as the mean of its own rim, shown to step -1.
        """
        parts, steps = [], []
        for joint in self._plan.joints[piece]:
            newest = self.log.newest(joint.piece, piece)
            values = None if newest is None else self.log.get(joint.piece, newest, piece)
            if values is None:
                own = self._plan.shows(piece, thread.state, thread.step)
                values = np.broadcast_to(own.mean(axis=0), (len(joint.shown), *own.shape[1:]))
            parts.append(values)
            steps.append(-1 if newest is None else newest)
        return parts, sum(steps) / len(steps) if steps else thread.step
