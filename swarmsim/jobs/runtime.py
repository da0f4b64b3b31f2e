"""A job in pieces as a swarm does it: fixed pieces, in lockstep by data.

What a piece is after a step is a function of the piece and the step alone. So loss, delay, repetition and two robots
with one piece do no harm: whoever computes a value, and whenever, it has the same bits. This is message logging with
uncoordinated checkpoints (Johnson and Zwaenepoel 1987), over a network in which messages are relayed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import PieceJob, Shared, Values
from swarmsim.core.messages import HEADER
from swarmsim.core.probes import Row
from swarmsim.core.processors import OwnProcessor, Processors
from swarmsim.core.state import Record, Senses
from swarmsim.jobs.facts.tellers import JobStanding, SharedJob
from swarmsim.jobs.facts.wire import Fact, FactCodec
from swarmsim.jobs.letters import PieceLaw
from swarmsim.jobs.peer import SIZES, Peer
from swarmsim.jobs.plan import STATE_NUMBER, JobPlan, packed
from swarmsim.jobs.reports import AFAR, FARTHEST, SHOW, STATE, PieceClaim, Report
from swarmsim.jobs.sighted import Sighted

UNKNOWN = -1  #: the step of a piece that a robot does not have


@dataclass(frozen=True, slots=True, eq=False)
class Parcel(JobStanding):
    """What robots have of a job in pieces; all arrays are read-only."""

    plan: JobPlan
    states: tuple[dict[int, tuple[int, Values]], ...]  # of each robot: the step and state of each piece it computes
    last: tuple[dict[int, Values], ...]  # of each robot: last states, of pieces computed or kept
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

    def share(self, alive: NDArray[np.bool_]) -> float:
        """The share of all pieces' steps that living robots have done."""
        return float((np.maximum(self.progress(alive), 0) / self.plan.steps).mean())

    def ended(self, alive: NDArray[np.bool_]) -> bool:
        """Whether they have done all."""
        return self.share(alive) == 1.0

    def numbers(self, alive: NDArray[np.bool_]) -> dict[str, float]:
        """How many pieces none of them has."""
        return {"pieces_lost": float(np.count_nonzero(self.progress(alive) == UNKNOWN))}

    def answers(self, alive: NDArray[np.bool_]) -> dict[int, Values]:
        """The answers (c,) of the pieces whose last state a living robot has."""
        found: dict[int, Values] = {}
        for robot in np.flatnonzero(alive).tolist():
            for piece, state in self.last[robot].items():
                if piece not in found:
                    found[piece] = self.plan.job.answer(self.plan.pieces[piece], state)
        return found


class Lockstep(SharedJob[Peer, Parcel]):
    """A job in pieces, for some robots or all: the peers of a network that share it."""

    def __init__(self, job: PieceJob, keys: Shared, context: BuildContext) -> None:
        """Raises InputError for a job that cannot be done."""
        self._plan, self._context = JobPlan.of(job, keys, context), context
        self._largest = _largest(self._plan)
        _check_budget(self._plan, self._largest)
        self._processors = context.processors or Processors.unlimited(len(context.ids))
        self._rows = {robot: row for row, robot in enumerate(context.ids.tolist())}
        self._begun = set[int]()
        codec = FactCodec(compact=True, check=PieceLaw(self._plan))
        super().__init__(context, self._peer, self._parcel, type(job), _place, knowledge_type=Parcel, codec=codec)

    @property
    def plan(self) -> JobPlan:
        """What all robots know before the run."""
        return self._plan

    @property
    def longest(self) -> int:
        """The bytes of the shortest message in which everything that has to be said can be said at some time."""
        return HEADER.size + SIZES.size(self._largest)

    @property
    def needs(self) -> NDArray[np.float64]:
        """The bytes (rows,) that each robot needs for its pieces at the start and for its share of the copies."""
        pieces = range(len(self._plan.pieces))
        mine = [
            sum(self._plan.need(one) for one in pieces if self._plan.first_holder(one) == robot) for robot in self._rows
        ]
        return np.array(mine, np.float64) + self._plan.share()

    def _peer(self, robot: int) -> Peer:
        share = OwnProcessor(self._processors, self._rows[robot], self._plan.keys.name)
        return Peer(self._plan, robot, self._context.rounds, share, self._starts)

    def _starts(self, robot: int) -> Iterator[tuple[int, Values]]:
        """The pieces and states that a robot begins with, once; who loses them does not get them back."""
        if robot not in self._begun:
            self._begun.add(robot)
            for piece in range(robot, len(self._plan.pieces), self._plan.robots):
                yield piece, self._start(piece)

    def _start(self, piece: int) -> Values:
        """A piece's state before its first step."""
        its, field = self._plan.pieces[piece], self._context.scalar_field
        sensed = np.zeros(len(its.cells))
        if field is not None:
            sensed = field.value(0.0, self._context.lattice.centres(its.cells))
        return self._plan.job.start(its, sensed)

    def _parcel(self, parts: Sequence[Peer], now: int) -> Parcel:
        step, kept = np.full((2, len(parts), len(self._plan.pieces)), UNKNOWN, np.int32)
        for row, peer in enumerate(parts):
            for piece, thread in peer.worker.threads.items():
                step[row, piece] = thread.step
            for piece in peer.worker.copies.pieces():
                kept[row, piece] = peer.worker.copies.newest(piece)
        silent = np.array([peer.silent(now) for peer in parts], np.int32)
        counts = np.array([astuple(peer.worker.counts) for peer in parts], np.float64).reshape(-1, 5)
        for array in (step, kept, silent, counts):
            array.setflags(write=False)
        states = tuple(
            {piece: (thread.step, thread.state) for piece, thread in peer.worker.threads.items()} for peer in parts
        )
        return Parcel(self._plan, states, tuple(peer.ended() for peer in parts), step, kept, silent, counts)


def _place(peers: Sequence[Peer], senses: Senses) -> None:
    """Tell all where they are."""
    for row, peer in enumerate(peers):
        peer.place = senses.pose[row, :2]


def _largest(plan: JobPlan) -> Fact:
    """The largest thing that has to be said in one piece, as pieces are at the start."""
    states = [
        Fact(STATE, piece, plan.steps, 0, packed(np.zeros(one), STATE_NUMBER)) for piece, one in enumerate(plan.state)
    ]
    shows = [
        Fact(SHOW, piece, plan.steps, (1 << len(its)) - 1, bytes(len(its)) + packed(np.zeros(shape), plan.number))
        for piece, (its, shape) in enumerate(zip(plan.readers, plan.shown, strict=True))
    ]
    return max([*states, *shows] if plan.keys.copies else shows, key=SIZES.size)


def _check_budget(plan: JobPlan, largest: Fact) -> None:
    """Raise InputError for a budget in which the largest fact finds no place beside reports of all robots."""
    if plan.keys.budget is None:
        return
    copies = 0 if plan.keys.copies == 0 else plan.robots - 1 if plan.keys.copies == "all" else plan.keys.copies
    signs = sum(
        SIZES.size(
            Report(1 << 20, {one: PieceClaim(plan.steps, FARTHEST, (1 << len(its)) - 1)}, {}).fact(plan.robots, AFAR)
        )
        + copies * (SIZES.size(Report(1 << 20, {}, {one: plan.steps}).fact(plan.robots, AFAR)) - 8)
        for one, its in enumerate(plan.joints)
    )
    least = HEADER.size + signs + SIZES.size(largest)
    if plan.keys.budget < least:
        raise InputError(
            f"budget: {plan.keys.budget} bytes a message; the signs of life of {len(plan.pieces)} pieces take {signs}, "
            f"and what piece {largest.key} says {SIZES.size(largest)}; expected {least} or more"
        )
