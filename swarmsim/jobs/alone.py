"""A job in pieces done by one computer, in sequence: what a swarm's answer is compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarmsim.core.jobs import Piece, PieceJob, Values
from swarmsim.jobs.pieces import joined, joints


def on_air(values: Values, size: int) -> Values:
    """The numbers as they are after being sent in `size` bytes each: 4 or 8."""
    return values.astype(np.float32).astype(np.float64) if size == 4 else values


def alone(
    job: PieceJob,
    pieces: Sequence[Piece],
    sensed: Sequence[Values] | None = None,
    steps: int | None = None,
    value: int = 8,
) -> list[Values]:
    """The states of all pieces after `steps` steps, all by default.

    `sensed` is what each piece's holder knows at the start, (c,) for each; zeros by default. What pieces show each
    other is rounded to numbers of `value` bytes, as on the air.
    """
    its = joints(pieces)
    first = [np.zeros(len(one.cells)) for one in pieces] if sensed is None else sensed
    states = [job.start(one, values) for one, values in zip(pieces, first, strict=True)]
    for step in range(job.steps if steps is None else steps):
        shown = [on_air(job.shows(one, state, step), value) for one, state in zip(pieces, states, strict=True)]
        states = [
            job.step(one, state, joined(one, mine, [shown[joint.piece] for joint in mine]), step)
            for one, state, mine in zip(pieces, states, its, strict=True)
        ]
    return states
