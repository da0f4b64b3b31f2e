"""Computation and strategy of robots whose minds are elsewhere: what a world's process has in the place of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import groups, reports
from swarmsim.core.errors import InputError
from swarmsim.core.messages import Broadcast, Inbox, MessageBatch
from swarmsim.core.parts import AnyStrategy, Fault, Parts
from swarmsim.core.reports import Report
from swarmsim.core.robot import Deed, Sensed
from swarmsim.core.scenario.part import Part
from swarmsim.core.state import Intents, Knowledge, Senses, State
from swarmsim.faults.delegate import ComputationDelegate
from swarmsim.faults.effect import StatelessEffect, TimedFault
from swarmsim.fleet.wire import Ears


class Answering(Protocol):
    """The robots, wherever they are, in step with the world."""

    def sense(self, sensed: Sequence[Sensed]) -> list[bytes]:
        """What each robot says, as a frame, once it has sensed; empty for nothing."""
        ...

    def hear(self, ears: Sequence[Ears]) -> list[Deed]:
        """What each robot does, once it has heard."""
        ...


class RemoteMinds(ComputationDelegate):
    """The computation of robots elsewhere: it passes on what they sense and hear, and puts their reports together.

    The wrapped computation of all robots never computes: it keeps what they report. Faults wrap this one as any other;
    a frame that a fault has changed is told to those who hear it, in the place of the one on the air.
    """

    def __init__(self, parts: Parts) -> None:
        """For the minds of these parts. Raises InputError for a swarm whose robots cannot be processes of their own."""
        super().__init__(parts.computation)
        if parts.jobs is not None:
            raise InputError("jobs: robots in processes of their own do not compute jobs; expected none")
        reports.check_reports(parts.computation)
        #: The strategy beside it.
        self.strategy = RemoteStrategy(self, parts.strategy)
        #: The robots. They have to be there before the first iteration.
        self.crew: Answering | None = None
        self._frames: dict[tuple[int, int], bytes] = {}  # by sender and iteration, while they may be under way
        self._forgets: set[int] = set()
        self._faults: list[InMinds] = []
        self._deeds: list[Deed] = []

    @property
    def deeds(self) -> Sequence[Deed]:
        """What each robot did last."""
        return self._deeds

    def carries(self, part: Part[Fault], fault: Fault) -> Fault:
        """The same fault or, if it is the minds' own, one that robots are told of in the world's iterations."""
        if not isinstance(fault, TimedFault) or not part.declares("of_mind", False):
            return fault
        self._faults.append(InMinds(self, fault, part.declares("failure", "") == "reboot"))
        return TimedFault(fault.course, self._faults[-1], fault.number)

    def say(self, senses: Senses) -> Broadcast[MessageBatch]:
        """What the robots say, once they have sensed."""
        crew, now = self._there(), senses.iteration
        decided = None if senses.decided is self.strategy.given else senses.decided
        told = [self._sensed(senses, row, decided) for row in range(len(senses.alive))]
        self._forgets.clear()
        frames = crew.sense(told)
        self._frames |= {(robot, now): frame for robot, frame in enumerate(frames) if frame}
        items = [self._inner.codec.unpack(frame)[2] if frame else None for frame in frames]
        there = [one for one in items if one is not None]
        content = type(there[0]).joined(there) if there else self._inner.say(senses).content.take(np.empty(0, np.int64))
        ends = np.cumsum([0 if one is None else len(one) for one in items], dtype=np.int64)
        sizes = np.array([len(frame) for frame in frames], np.int32)
        return Broadcast(content, ends, sizes, one_each=bool((np.diff(ends, prepend=0) == 1).all()))

    def _there(self) -> Answering:
        if self.crew is None:
            raise RuntimeError("an iteration before the robots are there")
        return self.crew

    def _sensed(self, senses: Senses, row: int, decided: Intents | None) -> Sensed:
        readings = tuple(column[row] for column in senses.readings.columns)
        last = None if decided is None else _row(decided, row)
        return Sensed(
            senses.iteration, bool(senses.alive[row]), senses.pose[row], senses.velocity[row], readings, last,
            row in self._forgets, tuple(one.number for one in self._faults if one.active[row]),
        )  # fmt: skip

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> Knowledge:
        """What the robots report, once they have heard."""
        ends = np.searchsorted(inbox.receivers, np.arange(len(senses.alive) + 1)).tolist()
        ears = [
            self._ears(senses, inbox.oldest, row, inbox.take(np.arange(ends[row], ends[row + 1])))
            for row in range(len(senses.alive))
        ]
        self._deeds = self._there().hear(ears)
        deaf = np.array([deed.iteration < senses.iteration for deed in self._deeds])  # they have heard nothing yet
        for one in self._faults:
            deaf |= one.active & one.blank
        if deaf.any():
            inbox = inbox.take(np.flatnonzero(~deaf[inbox.receivers]))
        for key in [key for key in self._frames if key[1] < min(inbox.oldest, senses.iteration)]:
            del self._frames[key]
        return reports.adopt(self._inner, [deed.report for deed in self._deeds], inbox)

    def _ears(self, senses: Senses, oldest: int, row: int, heard: Inbox[MessageBatch]) -> Ears:
        """The letters that reach a robot, with the frames of those that are not as they were said."""
        dates = np.stack([heard.senders, heard.sent], axis=1).reshape(-1, 2)
        new = np.ones(len(dates), np.bool_)
        new[1:] = (dates[1:] != dates[:-1]).any(axis=1)
        letters, firsts = dates[new].astype(np.int32), [*np.flatnonzero(new).tolist(), len(dates)]
        frames = []
        for number, (sender, sent) in enumerate(letters.tolist()):
            items = heard.content.take(np.arange(firsts[number], firsts[number + 1]))
            frame = self._inner.codec.pack(sender, sent, items)
            frames.append(b"" if frame == self._frames.get((sender, sent)) else frame)
        return Ears(senses.iteration, bool(senses.alive[row]), oldest, letters, tuple(frames))

    def combined(self, row: int, before: Report, came: Sequence[Report]) -> Report:
        """One report for those of a robot that came in an iteration."""
        return reports.combined(self._inner, row, before, came)

    def frame(self, sender: int, sent: int) -> bytes:
        """A frame that may still be under way; empty for one that is not."""
        return self._frames.get((sender, sent), b"")

    def reset(self, robots: NDArray[np.int64]) -> None:
        """The robots (r,) forget all that they know, before they sense next."""
        self._forgets |= set(robots.tolist())
        self._inner.reset(robots)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Not possible: knowledge stays in its robot's process. Raises InputError."""
        raise InputError(
            f"faults: robots {robots.tolist()} would begin with the knowledge of robot {source}, which is in a process "
            "of its own; expected an empty memory"
        )


class InMinds(StatelessEffect):
    """The effect of a fault that robots have in their own minds: the world only says who has it."""

    def __init__(self, minds: RemoteMinds, planned: TimedFault, blank: bool) -> None:
        """Robots with a `blank` mind begin with an empty memory, and take nothing in."""
        self._minds, self._planned, self.blank = minds, planned, blank
        #: Its place in the scenario.
        self.number = planned.number
        #: Which robots have it (n,): a live view.
        self.active = planned.course.active

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The same parts. Raises InputError for minds that cannot have the fault."""
        self._planned.effect.wrap(parts, active)
        return parts

    def begin(self, robots: NDArray[np.int64], state: State) -> None:
        """They forget, if the fault says so."""
        if self.blank:
            self._minds.reset(robots)


class RemoteStrategy:
    """What the robots have decided."""

    def __init__(self, minds: RemoteMinds, inner: AnyStrategy) -> None:
        self._minds, self._inner = minds, inner
        #: What it gave last.
        self.given: Intents | None = None

    @property
    def requires_knowledge(self) -> type[Knowledge]:
        """The knowledge that the robots' strategy reads."""
        return self._inner.requires_knowledge

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: Knowledge) -> Intents:
        """The intents of all robots."""
        self.given = groups.merged([deed.intents for deed in self._minds.deeds])
        return self.given


def _row(intents: Intents, row: int) -> Intents:
    """One robot's intents."""
    columns = {one.name: getattr(intents, one.name) for one in fields(intents) if one.name != "commands"}
    commands = {name: column[[row]] for name, column in intents.commands.items()}
    return replace(
        intents, commands=commands,
        **{name: column[[row]] for name, column in columns.items() if column is not None},
    )  # fmt: skip
