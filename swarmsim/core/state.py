"""The arrays that describe a swarm at one moment; row i is robot i in every one of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNKNOWN = 0  #: tile and map value of a cell that nobody observed
FREE = 1  #: tile and map value of a cell observed to be empty
OCCUPIED = 2  #: tile and map value of a cell in which a beam ended


@dataclass(frozen=True, slots=True)
class State:
    """Bodies at the start of an iteration."""

    iteration: int
    pose: NDArray[np.float64]  # (n, 3): x, y in m, yaw in rad, counter-clockwise
    velocity: NDArray[np.float64]  # (n, 3): m/s, m/s, rad/s, in the world frame
    wheels: NDArray[np.float64]  # (n, 2): rim speed of the left and right wheel, m/s
    alive: NDArray[np.bool_]  # (n,)

    @property
    def robots(self) -> int:
        """Number of rows, dead robots included."""
        return len(self.alive)


@dataclass(frozen=True, slots=True)
class Tiles:
    """What every robot senses now: a small window of cells around it, aligned with the lattice."""

    values: NDArray[np.uint8]  # (n, rows, columns): UNKNOWN, FREE or OCCUPIED
    origins: NDArray[np.int32]  # (n, 2): row and column of each tile's lower-left cell


@dataclass(frozen=True, slots=True)
class Said:
    """What every robot says in one iteration: one message each, of any number of tiles."""

    values: NDArray[np.uint8]  # (t, rows, columns)
    origins: NDArray[np.int32]  # (t, 2)
    sources: NDArray[np.int32]  # (t,): the robot that sensed each tile; -1 for a piece of somebody's map
    sensed: NDArray[np.int32]  # (t,): the iteration in which it was sensed
    ends: NDArray[np.int64]  # (n,): robot i says the tiles ends[i - 1] to ends[i]
    sizes: NDArray[np.int32]  # (n,): bytes of each robot's message
    one_each: bool = False  # whether tile i is all that robot i says, which is faster to look up


Letters = NDArray[np.int32]  # (m, 4): receiver, sender, the iteration in which it was sent, bytes


@dataclass(frozen=True, slots=True)
class Delivery:
    """What became, in one iteration, of messages: some are heard, some lost, and others still under way."""

    heard: Letters  # sorted by receiver, sender, iteration sent
    lost: tuple[tuple[str, Letters], ...]  # by reason
    oldest: int  # no message still under way was sent before this iteration


@dataclass(frozen=True, slots=True)
class Inbox:
    """The tiles heard in one iteration, sorted by receiver, then by sender."""

    receivers: NDArray[np.int32]  # (t,)
    senders: NDArray[np.int32]  # (t,): who said it
    values: NDArray[np.uint8]  # (t, rows, columns)
    origins: NDArray[np.int32]  # (t, 2)
    sources: NDArray[np.int32]  # (t,): who sensed it; -1 for a piece of the sender's map
    sensed: NDArray[np.int32]  # (t,): when


@dataclass(frozen=True, slots=True)
class Observations:
    """All that a behaviour may know in one iteration; robot i may use row i and its inbox alone."""

    iteration: int
    pose: NDArray[np.float64]  # (n, 3): each robot's estimate of its own pose
    alive: NDArray[np.bool_]  # (n,)
    tiles: Tiles
    inbox: Inbox


@dataclass(frozen=True, slots=True)
class Intents:
    """What every robot has decided to do until the next iteration."""

    goals: NDArray[np.int32]  # (n, 2): row and column of the goal cell; -1, -1 for none
    waypoints: NDArray[np.float64]  # (n, longest, 2): x, y in m, the way still ahead of each robot
    counts: NDArray[np.int32]  # (n,): how many of its waypoints each robot uses
    planned: NDArray[np.bool_]  # (n,): whether the path is new in this iteration


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much of the coverage domain is mapped, in cells."""

    union: int  # cells that some robot's map holds
    each: NDArray[np.int64]  # (n,): cells in each robot's own map
    domain: int  # cells there are

    @property
    def share(self) -> float:
        """The union's part of the domain, 0 to 1."""
        return self.union / self.domain


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth a mark in the film and a line in the summary."""

    iteration: int
    robot: int  # -1 for the whole run
    kind: str
    cause: str


@dataclass(frozen=True, slots=True)
class Moment:
    """Everything that happened in one iteration, as probes see it: measured, never fed back."""

    state: State  # at the start of the iteration, when everybody sensed
    tiles: Tiles  # where the robots believe them to be
    links: NDArray[np.int32]  # (m, 2): receiver, sender
    delivery: Delivery
    inbox: Inbox
    intents: Intents
    coverage: Coverage  # after mapping
    events: tuple[Event, ...]
