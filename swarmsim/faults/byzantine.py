"""Byzantine robots: members of the swarm that say what is not so (Lamport, Shostak and Pease 1982)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Protocol

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.parts import Parts, Setting, Sharing
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Delivery, Inbox, Letters, Said, State, Tiles
from swarmsim.faults.effect import Lasting, TimedFault
from swarmsim.faults.timeline import Timed, Timeline, described

Cells = Annotated[int, Meta(ge=-10_000, le=10_000)]
KEYS = {"offset": "origin", "age": "replay", "id": "spoof"}  # which failure has which key
SWAPPED = np.array([UNKNOWN, OCCUPIED, FREE], np.uint8)  # what a tile's values turn into


class Byzantine(Timed, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Robots lie in every tile of every message; what they sense, map and do themselves stays right.

    `inverted`: free is said to be occupied, and occupied free. `free`, `occupied`: so is every cell, whether seen or
    not. `origin`: each tile lies `offset` cells from where it was sensed. `replay`: each tile is the one said `age`
    iterations ago, or at first the oldest there is, as if sensed now. `spoof`: what is heard directly of a liar seems
    to come from another robot; under its false name, its own tile as well. A relay that passes it on tells the truth.
    """

    failure: Literal["inverted", "free", "occupied", "origin", "replay", "spoof"]
    offset: tuple[Cells, Cells] | None = None  # for origin: rows (up) and columns (right)
    age: Annotated[int, Meta(ge=1, le=100_000)] | None = None  # for replay: iterations
    id: Annotated[int, Meta(ge=0)] | None = None  # for spoof: whom it pretends to be; default: anybody, anew each time

    def build(self, setting: Setting, number: int) -> TimedFault:
        """The fault; raises InputError for a key that its failure does not have, or lacks."""
        for key, failure in KEYS.items():
            if getattr(self, key) is not None and self.failure != failure:
                raise InputError(f"{key}: a lie of kind {self.failure!r} has none; expected failure = {failure!r}")
        others = setting.robots.count - 1
        if self.id is not None and self.id > others:
            raise InputError(f"id: there is no robot {self.id}; expected one from 0 to {others}")
        if self.failure == "spoof" and others == 0:
            raise InputError(
                "failure: a robot alone has nobody to pass itself off as; expected robots.count = 2 or more"
            )
        effect = Lying(f"byzantine {self.failure}", self._lie(), self._names(setting, number))
        return TimedFault(Timeline(self, setting, number), effect, described(self, "byzantine"))

    def _lie(self) -> Lie | None:
        """What happens to tiles, if anything does."""
        if self.failure == "inverted":
            return Inverted()
        if self.failure in ("free", "occupied"):
            return Uniform(FREE if self.failure == "free" else OCCUPIED)
        if self.failure == "origin":
            if self.offset is None:
                raise InputError("offset: required key is missing; expected [rows, columns] for failure = 'origin'")
            return Displaced(np.array(self.offset, np.int32))
        if self.failure == "replay":
            if self.age is None:
                raise InputError("age: required key is missing; expected iterations for failure = 'replay'")
            return Replayed(self.age)
        return None

    def _names(self, setting: Setting, number: int) -> FalseNames | None:
        """Whom liars pretend to be, if they do."""
        return FalseNames(setting, self.id, f"fault byzantine {number}") if self.failure == "spoof" else None


class Lie(Protocol):
    """Turns the truth into something else."""

    def tell(self, said: Said, rows: NDArray[np.bool_]) -> None:
        """Overwrite values and origins of some tiles, `rows` (t,), of what all robots are about to say.

        It is asked in every iteration, whether or not anybody lies.
        """
        ...


class Inverted:
    """Says free of what is occupied, and occupied of what is free."""

    def tell(self, said: Said, rows: NDArray[np.bool_]) -> None:
        """Swap the two."""
        said.values[rows] = SWAPPED[said.values[rows]]


@dataclass(frozen=True, slots=True)
class Uniform:
    """Says the same of every cell, seen or not."""

    value: int

    def tell(self, said: Said, rows: NDArray[np.bool_]) -> None:
        """Write it everywhere."""
        said.values[rows] = self.value


@dataclass(frozen=True, slots=True, eq=False)
class Displaced:
    """Says that tiles lie elsewhere."""

    offset: NDArray[np.int32]  # (2,): rows, columns

    def tell(self, said: Said, rows: NDArray[np.bool_]) -> None:
        """Move them."""
        said.origins[rows] += self.offset


class Replayed:
    """Says what was true some iterations ago: the first tile of that message for the first of this, and so on."""

    def __init__(self, age: int) -> None:
        self._past: deque[tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.int64]]] = deque(maxlen=age + 1)

    def tell(self, said: Said, rows: NDArray[np.bool_]) -> None:
        """Put old tiles in the place of new ones; where the old message had fewer, nothing is known."""
        self._past.append((said.values.copy(), said.origins.copy(), said.ends))
        values, origins, ends = self._past[0]
        starts, old_starts = _starts(said.ends), _starts(ends)
        owners = np.repeat(np.arange(len(ends)), said.ends - starts)
        old = old_starts[owners] + np.arange(len(owners)) - starts[owners]
        there = rows & (old < ends[owners])
        said.values[rows] = UNKNOWN
        said.values[there], said.origins[there] = values[old[there]], origins[old[there]]


class FalseNames:
    """Under whose name each liar's message goes, remembered while messages are under way."""

    def __init__(self, setting: Setting, name: int | None, purpose: str) -> None:
        """`name` is the one robot that all pass themselves off as; without it they draw from streams of `purpose`."""
        robots = setting.robots.count
        self._name, self._ids = name, np.arange(robots, dtype=np.int32)
        self._streams = [setting.streams.open(purpose, robot) for robot in range(robots)]
        self._given: dict[int, NDArray[np.int32]] = {}  # (n,) by iteration

    def give(self, iteration: int, liars: NDArray[np.bool_]) -> None:
        """Name the messages of an iteration: anybody but the liar, each as likely."""
        names = self._ids.copy()
        for robot in np.flatnonzero(liars):
            if self._name is None:
                drawn = int(self._streams[robot].integers(len(names) - 1))
                names[robot] = drawn + (drawn >= robot)
            else:
                names[robot] = self._name
        self._given[iteration] = names

    def signed(self, inbox: Inbox, delivery: Delivery) -> Inbox:
        """The inbox as its receivers believe it to be.

        Of two messages from one robot to another that arrive together, both go by the later one's name.
        """
        names = self._for(inbox, delivery.heard)
        for iteration in [t for t in self._given if t < delivery.oldest]:
            del self._given[iteration]
        if (names == inbox.senders).all():
            return inbox
        sources = np.where(inbox.sources == inbox.senders, names, inbox.sources)
        order = np.lexsort([names, inbox.receivers])
        believed = replace(inbox, senders=names, sources=sources)
        return Inbox(*(getattr(believed, field)[order] for field in Inbox.__slots__))

    def _for(self, inbox: Inbox, heard: Letters) -> NDArray[np.int32]:
        """The name (t,) under which each tile was said."""
        robots = len(self._ids)
        letters = heard[:, 0].astype(np.int64) * robots + heard[:, 1]  # rising, since letters are sorted
        tiles = inbox.receivers.astype(np.int64) * robots + inbox.senders
        sent = heard[np.searchsorted(letters, tiles, side="right") - 1, 2]
        names = inbox.senders.copy()
        for iteration in np.unique(sent):
            rows = sent == iteration
            names[rows] = self._given[int(iteration)][names[rows]]
        return names


class Lying(Lasting):
    """Wraps the sharing."""

    def __init__(self, word: str, lie: Lie | None, names: FalseNames | None) -> None:
        self.words = (word, f"{word} over")
        self._lie, self._names = lie, names

    def wrap(self, parts: Parts, active: NDArray[np.bool_]) -> Parts:
        """The parts with the sharing wrapped."""
        return replace(parts, sharing=LyingSharing(parts.sharing, active, self._lie, self._names))


class LyingSharing:
    """Sharing in which some robots do not say what they sensed, or not who they are."""

    def __init__(self, inner: Sharing, active: NDArray[np.bool_], lie: Lie | None, names: FalseNames | None) -> None:
        self._inner, self._active, self._lie, self._names = inner, active, lie, names

    def say(self, state: State, tiles: Tiles) -> Said:
        """The message of every robot, with lies in those of the liars."""
        # The policy keeps what it gives until it is heard, so the lie is written there: into copies of the tiles,
        # for the liar maps its own as they are.
        said = self._inner.say(state, Tiles(tiles.values.copy(), tiles.origins.copy()))
        if self._lie is not None:
            self._lie.tell(said, np.repeat(self._active, said.ends - _starts(said.ends)))
        if self._names is not None:
            self._names.give(state.iteration, self._active & state.alive)
        return said

    def hear(self, delivery: Delivery) -> Inbox:
        """The tiles in the messages delivered, by those who seem to have said them."""
        inbox = self._inner.hear(delivery)
        return inbox if self._names is None else self._names.signed(inbox, delivery)


def _starts(ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where each robot's tiles begin (n,), given where they end."""
    return np.concatenate([np.zeros(1, np.int64), ends[:-1]])
