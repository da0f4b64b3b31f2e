"""Estimates how long work takes before it starts, and refuses more than a scenario allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Final, TypeVar

from swarmsim.core.errors import InputError

T = TypeVar("T")

BUDGET: Final = 3600.0  # s, for each piece of work unless the scenario says otherwise
SURVEYING: Final = 20  # cost of finding a beam's end, in cells crossed

# Measured in seconds on one core of a laptop; other machines may need a third or three times as much.
_CROSSED: Final = 2e-9  # a beam through one cell
_NOTED: Final = 2e-9  # one cell of a tile
_CELL: Final = 1e-6  # per cell: is it free, reachable, in the spawn area
_POINT: Final = 5e-5  # one segment of a drawing's path
_CHARACTER: Final = 1e-6  # one of a TOML file
_ROBOT: Final = 4e-5  # one iteration of a mapping robot, without its beams


@dataclass(frozen=True, slots=True)
class Work:
    """A piece of work that may take long."""

    doing: str  # the work, with the numbers that make it long
    seconds: float  # about, on one core
    key: str  # key of the scenario, or file, that causes it
    less: str  # how to make it shorter
    told: float = 10.0  # s, above which it is announced


def reading(characters: int) -> Work:
    """Reading a TOML text."""
    return Work(f"reading {characters} characters", characters * _CHARACTER, "text", "numbers in CSV files")


def drawing(segments: int, name: str) -> Work:
    """Making walls of a drawing's paths with this many segments; `name` is the file's."""
    return Work(f"reading {segments} segments of paths", segments * _POINT, name, "a simpler drawing")


def opening(cells: int) -> Work:
    """Finding which cells of a lattice are free and reachable."""
    return Work(f"looking for floor in {cells} cells", cells * _CELL, "grid.cell", "larger cells")


def survey(places: int, beams: int, length: float, tile: int) -> Work:
    """Looking from `places` along `beams`, each up to `length` cells long, into a tile of this many cells."""
    each = beams * (length + SURVEYING) * _CROSSED + tile * _NOTED
    return Work(f"looking from {places} places along {beams} beams", places * each, "grid.cell",
                "larger cells, fewer sensor.beams or a smaller sensor.tile")  # fmt: skip


def running(robots: int, iterations: int, beams: int, length: float) -> Work:
    """Simulating robots, each with beams up to `length` cells long, until the limit of iterations."""
    each = _ROBOT + beams * (length + SURVEYING) * _CROSSED
    return Work(f"simulating {robots} robots for up to {iterations} iterations",
                robots * iterations * each, "stop.iterations", "fewer iterations or robots", 60.0)  # fmt: skip


Listener = Callable[[Work, float], None]  # called before work begins, then with the share done

_ALLOWED: ContextVar[float] = ContextVar("seconds allowed", default=BUDGET)
_LISTENER: ContextVar[Listener | None] = ContextVar("listener to work", default=None)


@contextmanager
def of(seconds: float) -> Iterator[None]:
    """Within this context, every piece of work may take this many seconds."""
    token = _ALLOWED.set(seconds)
    try:
        yield
    finally:
        _ALLOWED.reset(token)


@contextmanager
def told_to(listener: Listener | None) -> Iterator[None]:
    """Within this context, a listener, or None, is told of all work."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def begin(work: Work) -> None:
    """Announce work. Raises InputError, with the number of seconds, if it takes longer than allowed."""
    allowed = _ALLOWED.get()
    if work.seconds > allowed:
        raise InputError(
            f"{work.key}: {work.doing} takes about {lasting(work.seconds)}, more than a budget of {allowed:g} s; "
            f"expected {work.less}, or budget = {_round(work.seconds)} in the scenario to allow it"
        )
    _tell(work, 0.0)


def pieces(work: Work, all_: Sequence[T]) -> Iterator[T]:
    """The pieces of some work, announced before the first and after each. Raises InputError as `begin` does."""
    begin(work)
    for number, piece in enumerate(all_, 1):
        yield piece
        _tell(work, number / len(all_))


def lasting(seconds: float) -> str:
    """A time in words, to two digits: `12 s`, `3 min`, `5 h`, `2 days`."""
    for unit, name in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * unit:
            return f"{_round(seconds / unit)} {name}"
    return f"{_round(seconds)} s"


def _round(number: float) -> int:
    """A number of at least 1, rounded up to two digits."""
    step = 10.0 ** max(0, len(str(int(number))) - 2)
    return max(1, math.ceil(number / step) * int(step))


def _tell(work: Work, share: float) -> None:
    listener = _LISTENER.get()
    if listener is not None:
        listener(work, share)
