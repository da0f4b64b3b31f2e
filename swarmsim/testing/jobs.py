"""Checks of a job in pieces, without a swarm: that its values depend on nothing but what they may depend on."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.jobs import Domain, Piece, PieceJob, Values
from swarmsim.core.lattice import Lattice
from swarmsim.jobs.alone import alone
from swarmsim.jobs.pieces import joints, pieces_of
from swarmsim.testing.broken import BrokenError

ROOM = np.pad(np.ones((10, 14), np.bool_), 1)
ROOM[6, 4:11] = False


def check_job(
    job: PieceJob, free: NDArray[np.bool_] = ROOM, cell: float = 0.15, steps: int | None = None,
    whole: float | None = 1e-12,
) -> None:  # fmt: skip
    """A job's values follow from the piece and the step alone, whoever computes them, when and how often.

    Its pieces cover the `free` cells (rows, columns) of a domain once. Each verb gives the same bits twice, and leaves
    what it is given as it is. A step reads its own piece and halo: NaN in another piece does not reach it. States and
    what is shown survive packing. The answer is that of the whole domain as one piece, to the tolerance `whole`
    relative to the largest value; None for jobs whose answer depends on the pieces. Raises BrokenError.
    """
    domain = Domain(Lattice(0.0, 0.0, cell, *free.shape), free)
    pieces, steps = tuple(job.pieces(domain)), min(job.steps, 2 * job.level) if steps is None else steps
    _check_cover(pieces, free)
    dice = np.random.default_rng(1)
    sensed = [dice.uniform(0.5, 1.5, len(one.cells)) for one in pieces]
    for one, values in zip(pieces, sensed, strict=True):
        _check_pure(job, one, values)
    _check_reading(job, pieces, sensed)
    if whole is not None and not all(len(one.halo) == 0 for one in pieces):
        _check_whole(job, domain, pieces, sensed, steps, whole)


def _check_cover(pieces: Sequence[Piece], free: NDArray[np.bool_]) -> None:
    count = np.zeros(free.shape, np.int64)
    for number, one in enumerate(pieces):
        if one.number != number:
            raise BrokenError(f"pieces: number {one.number} at place {number}; expected them in order", "job")
        np.add.at(count, tuple(one.cells.T), 1)
    wrong = np.argwhere(count != free)
    if len(wrong):
        row, column = wrong[0].tolist()
        raise BrokenError(
            f"pieces: cell {[row, column]} is in {count[row, column]}; expected each free cell once", "job"
        )
    joints(pieces)


def _twice(what: str, verb: Callable[..., Values], piece: Piece, *given: object) -> Values:
    """The result, which is the same twice, of arguments that it cannot change. Raises BrokenError."""
    for one in given:
        if isinstance(one, np.ndarray):
            one.setflags(write=False)
    try:
        first, second = (np.array(verb(piece, *given)) for _ in range(2))
    except ValueError as problem:
        raise BrokenError(f"{what}: piece {piece.number}: {problem}; it may not change what it is given", "job") from (
            problem
        )
    if first.dtype != np.float64:
        raise BrokenError(f"{what}: {first.dtype}; expected float64, since copies are sent so", "job")
    if first.tobytes() != second.tobytes():
        raise BrokenError(f"{what}: piece {piece.number} gives other bits the second time", "job")
    return first


def _check_pure(job: PieceJob, piece: Piece, sensed: Values) -> None:
    state = _twice("start", job.start, piece, sensed)
    shown = _twice("shows", job.shows, piece, state, 0)
    if len(shown) != len(piece.rim):
        raise BrokenError(
            f"shows: {len(shown)} rows of piece {piece.number}; expected its rim's {len(piece.rim)}", "job"
        )
    around = np.ones((len(piece.halo), *shown.shape[1:]))
    after = _twice("step", job.step, piece, state, around, 0)
    for at, values in enumerate((state, after)):
        packed = np.frombuffer(values.astype(">f8").tobytes(), ">f8").astype(np.float64).reshape(values.shape)
        if (
            _twice("step", job.step, piece, packed, around, at).tobytes()
            != _twice("step", job.step, piece, values, around, at).tobytes()
        ):
            raise BrokenError(f"step: piece {piece.number} goes on differently from a copy that was sent", "job")
    answer = _twice("answer", job.answer, piece, after)
    if answer.shape[:1] != piece.cells.shape[:1]:
        raise BrokenError(f"answer: shape {answer.shape}; expected a row for each of {len(piece.cells)} cells", "job")
    if not job.work(piece) >= 0.0:
        raise BrokenError(f"work: {job.work(piece)}; expected a number of operations", "job")


def _check_reading(job: PieceJob, pieces: Sequence[Piece], sensed: Sequence[Values]) -> None:
    """A step of a piece reads its joints alone."""
    clean = alone(job, pieces, sensed, 1)
    for poisoned in pieces:
        given = [np.full_like(v, np.nan) if n == poisoned.number else v for n, v in enumerate(sensed)]
        found = alone(job, pieces, given, 1)
        for one, joint in zip(pieces, joints(pieces), strict=True):
            reads = {poisoned.number} & {one.number, *(other.piece for other in joint)}
            if not reads and found[one.number].tobytes() != clean[one.number].tobytes():
                raise BrokenError(f"step: piece {one.number} reads piece {poisoned.number} beyond its halo", "job")


def _check_whole(
    job: PieceJob, domain: Domain, pieces: Sequence[Piece], sensed: Sequence[Values], steps: int, most: float
) -> None:
    of = np.where(domain.free, 0, -1).astype(np.int32)
    (one,) = pieces_of(domain, of, job.halo)
    many, grids = alone(job, pieces, sensed, steps), np.full((2, *domain.free.shape), np.nan)
    field = np.zeros(domain.free.shape)
    for piece, values, state in zip(pieces, sensed, many, strict=True):
        field[tuple(piece.cells.T)] = values
        grids[0][tuple(piece.cells.T)] = job.answer(piece, state).reshape(len(piece.cells), -1)[:, 0]
    (state,) = alone(job, [one], [field[tuple(one.cells.T)]], steps)
    grids[1][tuple(one.cells.T)] = job.answer(one, state).reshape(len(one.cells), -1)[:, 0]
    apart = float(np.nanmax(np.abs(grids[0] - grids[1])))
    if not apart <= most * max(1.0, float(np.nanmax(np.abs(grids[1])))):
        raise BrokenError(f"step: {len(pieces)} pieces and one differ by {apart:g} after {steps} steps", "job")
