"""Jobs: heavy computations that a swarm shares, piece by piece.

A job is a rule for pieces. What a piece is after a step is a function of what it and the pieces around it were before,
and of nothing else; so it is the same whoever computes it, when, and how often. The runtime decides who does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.lattice import Lattice
from swarmsim.core.messages import Broadcast, C, Codec, Inbox
from swarmsim.core.state import Knowledge, Senses

Values = NDArray[np.float64]


class SwarmJob(Protocol[C]):
    """What a swarm computes beside its robots' minds, over the same network.

    It may be built for some of the swarm's robots, with a row for each; see `BuildContext`. A class with the verbs of
    `PieceJob` is one too: pieces, start, shows, step, work, answer.
    """

    @property
    def codec(self) -> Codec[C]:
        """Its part of messages on the wire; available from the start."""
        ...

    def say(self, senses: Senses) -> Broadcast[C]:
        """Every robot's part in one exchange; a network may have several in an iteration."""
        ...

    def hear(self, senses: Senses, inbox: Inbox[C]) -> Knowledge:
        """Every robot's part of the answer after an exchange, as read-only views.

        Row i depends only on row i of the senses and on what row i received. `inbox.sent` counts exchanges. A robot
        whose mind takes nothing in at present counts as dead in these senses.
        """
        ...

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase all that these rows (r,) have of it."""
        ...

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy what the row `source` has of it to these rows (r,)."""
        ...


#: Any job; whether its messages are those that it unpacks is its own affair.
AnyJob = SwarmJob[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A fixed part of a domain, with the cells around it that its steps read."""

    number: int
    cells: NDArray[np.int32]  # (c, 2): row, column; by row, then column
    halo: NDArray[np.int32]  # (h, 2): cells of other pieces that a step reads, by row, then column
    owners: NDArray[np.int32]  # (h,): the pieces that these cells belong to
    rim: NDArray[np.int64]  # (r,): indices of its own cells that other pieces' halos hold, which it shows


@dataclass(frozen=True, slots=True, eq=False)
class Domain:
    """Cells to compute on."""

    lattice: Lattice
    free: NDArray[np.bool_]  # (rows, columns)


class PieceJob(Protocol):
    """A job in pieces: one instance serves all robots and keeps no state, so equal arguments give equal bits."""

    @property
    def halo(self) -> int:
        """How many cells beyond its own a step of a piece reads; 0 for independent pieces."""
        ...

    @property
    def level(self) -> int:
        """Steps of a level; states are copied to other robots at its start."""
        ...

    @property
    def steps(self) -> int:
        """Steps in all, a whole number of levels."""
        ...

    def pieces(self, domain: Domain) -> Sequence[Piece]:
        """The pieces, numbered from 0."""
        ...

    def start(self, piece: Piece, sensed: Values) -> Values:
        """The state before step 0; `sensed` (c,) is what its first holder alone knows.

        States are arrays of any shape, which may change from step to step. Memory is checked by those at the start.
        """
        ...

    def shows(self, piece: Piece, state: Values, step: int) -> Values:
        """The values (r, ...) of its rim that other pieces' step reads; the rest of the shape is that of all pieces."""
        ...

    def step(self, piece: Piece, state: Values, around: Values, step: int) -> Values:
        """The state after a step, from the values (h, ...) of its halo."""
        ...

    def work(self, piece: Piece) -> float:
        """Floating-point operations of a step."""
        ...

    def answer(self, piece: Piece, state: Values) -> Values:
        """The values (c,) of its cells, for tasks and films."""
        ...


class Shared(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Keys of every job in pieces: how a swarm shares it.

    The robot that computed a piece last, its holder, goes on with it. `copies` other robots, or all that hear of them,
    keep each piece's state from the start of a level. Once a piece has been silent for `patience` iterations, and one
    more for each length of the piece between them, a robot with a copy goes on with it, and copies are made anew.

    With `fence = "data"` a step waits for what it reads, however long, so the answer is the same on every network.
    With `fence = "clock"` a step is done in each exchange, with the newest values there are.

    Pieces stay with their holders while these live. With `migrate`, a robot that keeps the state from the start of the
    present level, and is nearer to the piece than its holder by more than that, goes on with it from there.

    A message has at most `budget` bytes of the job, if that is given, and numbers of `value` bytes.
    """

    name: Annotated[str, Meta(pattern="^([a-z][a-z0-9_]*)?$")] = ""  # in recordings; default: the part's
    copies: Annotated[int, Meta(ge=0, le=10**9)] | Literal["all"] = 2  # robots that keep each state, besides its holder
    patience: Annotated[int, Meta(ge=1, le=1_000_000_000)] = 12  # iterations
    budget: Annotated[int, Meta(ge=1, le=1_000_000_000)] | None = None  # bytes a message
    fence: Literal["data", "clock"] = "data"
    value: Literal[4, 8] = 8  # bytes
    migrate: Annotated[float, Meta(ge=0.0, le=1e6)] | None = None  # m; none: pieces stay
