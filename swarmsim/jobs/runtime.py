"""A job in pieces as a swarm does it: fixed pieces, in lockstep by data.

What a piece is after a step is a function of the piece and the step alone. So loss, delay, repetition and two robots
with one piece do no harm: whoever computes a value, and whenever, it has the same bits. This is message logging with
uncoordinated checkpoints (Johnson and Zwaenepoel 1987), over a network in which messages are relayed.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import PieceJob, Shared, Values
from swarmsim.core.messages import HEADER, Broadcast, Inbox
from swarmsim.core.probes import Row
from swarmsim.core.processors import OwnProcessor, Processors
from swarmsim.core.state import Knowledge, Record, Senses
from swarmsim.jobs.items import CLAIM, FORMS, KEEP, SHOW, STATE, Item, ItemCodec, Items
from swarmsim.jobs.peer import Peer
from swarmsim.jobs.plan import JobPlan
from swarmsim.jobs.sighted import Sighted

UNKNOWN = -1  #: the step of a piece that a robot does not have


@dataclass(frozen=True, slots=True, eq=False)
class Parcel(Knowledge):
    """What robots have of a job in pieces; all arrays are read-only."""

    plan: JobPlan
    states: tuple[dict[int, tuple[int, Values]], ...]  # of each robot: the step and state of each piece it computes
    ended: tuple[dict[int, Values], ...]  # of each robot: last states, of pieces computed or kept
    step: NDArray[np.int32]  # (n, p): the step of each piece that the robot computes; UNKNOWN for others
    kept: NDArray[np.int32]  # (n, p): the step of the newest state that the robot keeps; UNKNOWN for none
    silent: NDArray[np.int32]  # (n,): iterations since the robot heard anybody
    counts: NDArray[np.float64]  # (n, 5): steps, exchanges waited, pieces taken over, steps redone, operations
    seen: Sighted | None = None  # by who looks at all robots

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """All numbers, and all states one after another."""
        states = [state.ravel() for of_robot in self.states for _, (_, state) in sorted(of_robot.items())]
        return self.step, self.kept, self.silent, self.counts, np.concatenate([np.empty(0), *states])

    def record(self) -> Record:
        """What robots compute and keep, and what it took."""
        name, counts = self.plan.keys.name, self.counts
        return Record(
            {
                f"{name}_step": self.step, f"{name}_kept": self.kept, f"{name}_silent": self.silent,
                f"{name}_steps": counts[:, 0], f"{name}_waited": counts[:, 1], f"{name}_taken": counts[:, 2],
                f"{name}_redone": counts[:, 3], f"{name}_work": counts[:, 4],
            }
        )  # fmt: skip

    def sample(self, alive: NDArray[np.bool_]) -> dict[str, Row]:
        """A row of each table that the job shows, if it was looked at."""
        return {} if self.seen is None else self.seen.rows(self.plan, self.progress(alive), self.states)

    def of(self, robot: int) -> SimpleNamespace:
        """The answers of the pieces that a robot computes, as they are, by piece."""
        job, pieces = self.plan.job, self.plan.pieces
        return SimpleNamespace(
            pieces={piece: job.answer(pieces[piece], state) for piece, (_, state) in self.states[robot].items()}
        )

    def progress(self, alive: NDArray[np.bool_]) -> NDArray[np.int32]:
        """The step (p,) that each piece has reached somewhere among living robots; UNKNOWN if it is lost."""
        best = np.maximum(self.step, self.kept)[alive]
        return np.asarray(best.max(axis=0, initial=UNKNOWN), np.int32)

    def answers(self, alive: NDArray[np.bool_]) -> dict[int, Values]:
        """The answers (c,) of the pieces whose last state a living robot has."""
        found: dict[int, Values] = {}
        for robot in np.flatnonzero(alive).tolist():
            for piece, state in self.ended[robot].items():
                if piece not in found:
                    found[piece] = self.plan.job.answer(self.plan.pieces[piece], state)
        return found


class Lockstep:
    """A job in pieces, for some robots or all: the peers of a network that share it."""

    def __init__(self, job: PieceJob, keys: Shared, context: BuildContext) -> None:
        """Raises InputError for a job that cannot be done."""
        #: The class named in messages about broken contracts.
        self.written_by = type(job)
        self._plan, self._context = JobPlan.of(job, keys, context), context
        self._rounds = context.rounds
        #: The form of its messages.
        self.codec = ItemCodec(self._plan)
        _check_budget(self._plan, self.codec)
        self._processors = context.processors or Processors.unlimited(len(context.ids))
        self._peers = [self._new(row) for row in range(len(context.ids))]
        self._begun, self._awake = np.zeros((2, len(context.ids)), np.bool_)
        self._clock = -1
        self._iteration = -1

    @property
    def plan(self) -> JobPlan:
        """What all robots know before the run."""
        return self._plan

    @property
    def longest(self) -> int:
        """The bytes of the shortest message in which everything that has to be said can be said at some time."""
        return HEADER.size + self.codec.size(_largest(self._plan, self.codec))

    @property
    def needs(self) -> NDArray[np.float64]:
        """The bytes (rows,) that each robot needs for its pieces at the start and for its share of the copies."""
        pieces = range(len(self._plan.pieces))
        mine = [
            sum(self._plan.need(one) for one in pieces if self._plan.first_holder(one) == robot)
            for robot in self._context.ids.tolist()
        ]
        return np.array(mine, np.float64) + self._plan.share()

    def _new(self, row: int) -> Peer:
        share = OwnProcessor(self._processors, row, self._plan.keys.name)
        return Peer(self._plan, int(self._context.ids[row]), self._rounds, share)

    def say(self, senses: Senses) -> Broadcast[Items]:
        """Every robot's part in one exchange."""
        self._tick(senses)
        found, sizes = list[list[Item]](), np.zeros(len(self._peers), np.int32)
        for row, peer in enumerate(self._peers):
            items = []
            if senses.alive[row]:
                self._rouse(row, senses.iteration)
                items = peer.say(senses.iteration, self._clock, senses.pose[row, :2], self.codec)
            self._awake[row] = senses.alive[row]
            sizes[row] = HEADER.size + sum(map(self.codec.size, items)) if items else 0
            found.append(items)
        ends = np.cumsum([len(items) for items in found], dtype=np.int64)
        return Broadcast(Items.of([item for items in found for item in items]), ends, sizes)

    def _tick(self, senses: Senses) -> None:
        """Count exchanges."""
        new = senses.iteration != self._iteration
        self._clock = senses.iteration * self._rounds if new else self._clock + 1
        self._iteration = senses.iteration

    def _rouse(self, row: int, now: int) -> None:
        """A robot that was not there begins with the states that it alone knows, or finds all others silent so far."""
        peer, robot = self._peers[row], int(self._context.ids[row])
        if not self._awake[row]:
            peer.wake(now)
        if not self._begun[row]:
            self._begun[row] = True
            pieces = range(robot, len(self._plan.pieces), self._plan.robots)
            peer.begin(((piece, self._start(piece)) for piece in pieces), self._clock)

    def _start(self, piece: int) -> Values:
        """A piece's state before its first step."""
        its, field = self._plan.pieces[piece], self._context.scalar_field
        sensed = np.zeros(len(its.cells))
        if field is not None:
            sensed = field.value(0.0, self._context.lattice.centres(its.cells))
        return self._plan.job.start(its, sensed)

    def hear(self, senses: Senses, inbox: Inbox[Items]) -> Parcel:
        """Every robot's part of the answer after an exchange."""
        items = inbox.content.rows()
        ends = np.searchsorted(inbox.receivers, np.arange(len(self._peers) + 1))
        for row, peer in enumerate(self._peers):
            if senses.alive[row] and self._begun[row]:
                mine = items[ends[row] : ends[row + 1]]
                peer.hear(mine, senses.iteration, self._clock, senses.pose[row, :2])
        return self._parcel(senses.iteration)

    def _parcel(self, now: int) -> Parcel:
        peers, shape = self._peers, (len(self._peers), len(self._plan.pieces))
        step, kept = np.full((2, *shape), UNKNOWN, np.int32)
        for row, peer in enumerate(peers):
            for piece, thread in peer.worker.threads.items():
                step[row, piece] = thread.step
            for piece in peer.worker.copies.pieces():
                kept[row, piece] = peer.worker.copies.newest(piece)
        silent = np.array([peer.silent(now) for peer in peers], np.int32)
        counts = np.array([astuple(peer.worker.counts) for peer in peers], np.float64).reshape(-1, 5)
        for array in (step, kept, silent, counts):
            array.setflags(write=False)
        states = tuple(
            {piece: (thread.step, thread.state) for piece, thread in peer.worker.threads.items()} for peer in peers
        )
        return Parcel(self._plan, states, tuple(peer.ended() for peer in peers), step, kept, silent, counts)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase all that these rows (r,) have of the job; states that they alone knew are lost with it."""
        for row in robots.tolist():
            self._peers[row] = self._new(row)
            self._awake[row] = False

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Give these rows (r,) the values and copies that the row `source` has, but none of its pieces."""
        for row in robots.tolist():
            self._peers[row].learn(self._peers[source])


def _largest(plan: JobPlan, codec: ItemCodec) -> Item:
    """The largest thing that has to be said in one piece."""
    states = [Item(STATE, piece, 0, values=np.empty(shape)) for piece, shape in enumerate(plan.state)]
    shows = [
        Item(SHOW, piece, 0, values=np.empty(shape), aims=np.zeros(len(plan.readers[piece]), np.uint8))
        for piece, shape in enumerate(plan.shown)
    ]
    return max([*states, *shows] if plan.keys.copies else shows, key=codec.size)


def _check_budget(plan: JobPlan, codec: ItemCodec) -> None:
    """Raise InputError for a budget in which the largest item finds no place beside the signs of life."""
    if plan.keys.budget is None:
        return
    largest = _largest(plan, codec)
    copies = 0 if plan.keys.copies == 0 else plan.robots if plan.keys.copies == "all" else plan.keys.copies
    signs = len(plan.pieces) * (FORMS[CLAIM].size + copies * FORMS[KEEP].size)
    least = HEADER.size + signs + codec.size(largest)
    if plan.keys.budget < least:
        raise InputError(
            f"budget: {plan.keys.budget} bytes a message; the signs of life of {len(plan.pieces)} pieces take {signs}, "
            f"and what piece {largest.piece} says {codec.size(largest)}; expected {least} or more"
        )
