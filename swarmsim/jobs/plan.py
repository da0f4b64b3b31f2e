"""What all robots know of a job in pieces before it begins."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.jobs import Piece, PieceJob, Shared, Values
from swarmsim.core.messages import LATEST, FrameError
from swarmsim.jobs.alone import on_air
from swarmsim.jobs.facts.wire import short, short_at
from swarmsim.jobs.log import KEPT
from swarmsim.jobs.pieces import Joint, assembled, given, joints

Shape = tuple[int, ...]
Rows = NDArray[np.int64]
STATE_NUMBER = np.dtype(">f8")
MOST_AXES: Final = 32


def packed(values: Values, number: np.dtype[np.float64]) -> bytes:
    """Values of any shape on the wire: their axes, the lengths of these, and numbers of a type."""
    return short([values.ndim, *values.shape]) + values.astype(number).tobytes()


def unpacked(data: bytes, number: np.dtype[np.float64]) -> Values:
    """Values that were packed. Raises FrameError for bytes that `packed` cannot have made."""
    shape, at = shape_of(data, number)
    return np.frombuffer(data, number, offset=at).astype(np.float64).reshape(shape)


def shape_of(data: bytes, number: np.dtype[np.float64]) -> tuple[Shape, int]:
    """The shape of values that were packed, and where their numbers begin. Raises FrameError for another length."""
    axes, at = short_at(data, 0)
    shape = list[int]()
    for _ in range(axes if axes <= MOST_AXES else 0):
        length, at = short_at(data, at)
        shape.append(length)
    size = math.prod(shape) * number.itemsize
    if axes > MOST_AXES or len(data) - at != size or math.prod(max(1, one) for one in shape) > LATEST:
        raise FrameError(f"{axes} axes of {shape}, and {len(data) - at} bytes; expected {size}")
    return tuple(shape), at


@dataclass(frozen=True, slots=True, eq=False)
class JobPlan:
    """A job's rule, its pieces, and how they are shared."""

    job: PieceJob
    keys: Shared
    robots: int  # of the whole swarm
    pieces: tuple[Piece, ...]
    joints: tuple[tuple[Joint, ...], ...]  # of each piece
    readers: tuple[tuple[int, ...], ...]  # of each piece: the pieces that read what it shows
    shown: tuple[Shape, ...]  # of what each piece shows at the start
    state: tuple[Shape, ...]  # of each piece's state at the start
    most: tuple[int, ...]  # numbers of each piece's state at the start or after a step, whichever has more
    centres: NDArray[np.float64]  # (p, 2): x, y in m
    reach: NDArray[np.float64]  # (p,): m, about the side of each piece
    cell: float  # m
    work: tuple[float, ...]  # of each piece: floating-point operations of a step
    _rows: dict[tuple[int, int], tuple[int, list[Rows]]] = field(default_factory=dict)  # see `rows`

    @classmethod
    def of(cls, job: PieceJob, keys: Shared, context: BuildContext) -> Self:
        """The plan of a run. Raises InputError for a job that cannot be done."""
        level, steps = int(job.level), int(job.steps)
        if level < 1 or steps < 1 or steps % level:
            raise InputError(f"steps: {steps} in levels of {level}; expected a whole number of levels, at least one")
        if keys.migrate is not None and keys.fence == "clock":
            raise InputError(
                'migrate: with a clock pieces stay with their holders; expected fence = "data", or no such key'
            )
        domain = given(context)
        pieces = tuple(job.pieces(domain))
        if not 1 <= len(pieces) <= 1 << 16:
            raise InputError(f"pieces: {len(pieces)}; expected 1 to {1 << 16}")
        its = tuple(joints(pieces))
        readers = tuple(
            tuple(one.number for one in pieces if any(joint.piece == other.number for joint in its[one.number]))
            for other in pieces
        )
        states = [job.start(one, np.zeros(len(one.cells))) for one in pieces]
        shown = tuple(job.shows(one, state, 0).shape for one, state in zip(pieces, states, strict=True))
        most = tuple(_most(job, *of) for of in zip(pieces, states, shown, strict=True))
        cell = domain.lattice.cell
        centres = np.array([domain.lattice.centres(one.cells).mean(axis=0) for one in pieces])
        reach = np.array([cell * math.sqrt(len(one.cells)) for one in pieces])
        return cls(
            job, keys, context.swarm, pieces, its, readers, shown, tuple(one.shape for one in states), most, centres,
            reach, cell, tuple(_work(job, one) for one in pieces),
        )  # fmt: skip

    @property
    def steps(self) -> int:
        """Steps in all."""
        return self.job.steps

    def need(self, piece: int) -> int:
        """The bytes of who computes a piece: states, and two levels of what it shows and reads; 8 for each number."""
        near = [piece, *(joint.piece for joint in self.joints[piece])]
        steps = min(KEPT * self.job.level + 1, self.steps) if self.keys.fence == "data" else 1
        values = steps * sum(math.prod(self.shown[one]) for one in near)
        return 8 * (self.most[piece] + KEPT * math.prod(self.state[piece]) + values)

    def share(self) -> int:
        """The bytes of one robot's share of the copies; 0 for `copies = "all"`, of which it keeps what fits."""
        copies = 0 if self.keys.copies == "all" else min(self.keys.copies, self.robots - 1)
        largest = max(map(math.prod, self.state))
        return 8 * KEPT * largest * math.ceil(copies * len(self.pieces) / self.robots)

    @property
    def ahead(self) -> int:
        """By how many steps a holder is ahead of another: a level's if pieces migrate, as comers begin with it."""
        return 1 if self.keys.migrate is None else self.job.level

    def level_of(self, step: int) -> int:
        """The step at which the level of a step begins."""
        return step // self.job.level * self.job.level

    def first_holder(self, piece: int) -> int:
        """The robot that has a piece at the start."""
        return piece % self.robots

    @property
    def number(self) -> np.dtype[np.float64]:
        """The type of numbers that pieces show, on the wire."""
        return np.dtype(f">f{self.keys.value}")

    def named(self, piece: int, mask: int) -> tuple[int, ...]:
        """Those readers of a piece whose bits are in a mask."""
        return tuple(reader for bit, reader in enumerate(self.readers[piece]) if mask >> bit & 1)

    def rows(self, piece: int, mask: int) -> tuple[int, list[Rows]]:
        """How many of the values that a piece shows some readers read together, and which of these each one reads."""
        if (piece, mask) not in self._rows:
            parts = [self.read(piece, reader) for reader in self.named(piece, mask)]
            every = np.unique(np.concatenate([np.empty(0, np.int64), *parts]))
            self._rows[piece, mask] = len(every), [np.searchsorted(every, part) for part in parts]
        return self._rows[piece, mask]

    def bit(self, reader: int, piece: int) -> int:
        """Which of a reader's joints is with a piece."""
        return next(number for number, joint in enumerate(self.joints[reader]) if joint.piece == piece)

    def read(self, piece: int, reader: int) -> Rows:
        """Which of the values that a piece shows a reader reads."""
        return self.joints[reader][self.bit(reader, piece)].shown

    def shows(self, piece: int, state: Values, step: int) -> Values:
        """What a piece shows, as it is on the air. Raises ValueError for another number of rows than its rim has."""
        found, rim = on_air(self.job.shows(self.pieces[piece], state, step), self.keys.value), self.pieces[piece].rim
        if found.shape[:1] != rim.shape:
            raise ValueError(
                f"shows: piece {piece} at step {step} gives shape {found.shape}; expected a row for each of {len(rim)}"
            )
        return found

    def stepped(self, piece: int, state: Values, parts: list[Values], step: int) -> Values:
        """The state after a step, from what is read of each joint. Raises InputError for what is not finite."""
        around = assembled(self.pieces[piece], self.joints[piece], parts)
        with np.errstate(over="ignore", invalid="ignore"):  # told below
            found = self.job.step(self.pieces[piece], state, around, step)
        if not np.isfinite(found).all():
            raise InputError(
                f"jobs: {self.keys.name!r} is not finite in piece {piece} after step {step}; expected a stable step"
            )
        found.setflags(write=False)
        return found


def _most(job: PieceJob, piece: Piece, state: Values, shown: Shape) -> int:
    """The numbers of a piece's state before its first step or after it, whichever has more."""
    with np.errstate(all="ignore"):
        try:
            after = job.step(piece, state, np.zeros((len(piece.halo), *shown[1:])), 0)
        except Exception:
            return state.size
    return max(state.size, after.size)


def _work(job: PieceJob, piece: Piece) -> float:
    """The operations of a piece's step. Raises InputError unless they are a number."""
    found = float(job.work(piece))
    if not 0.0 <= found < math.inf:
        raise InputError(f"work: a step of piece {piece.number} takes {found:g} operations; expected 0 or more")
    return found
