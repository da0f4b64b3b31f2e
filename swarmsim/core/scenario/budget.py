"""About how long work takes, told before it is done, and refused if it is more than a scenario allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Final, TypeVar

from swarmsim.core.errors import InputError

T = TypeVar("T")

BUDGET: Final = 3600.0  # s, which every piece of work may take unless the scenario says otherwise
SURVEYING: Final = 20  # cells that a beam crosses in as much time as looking for its end takes besides

# Seconds on one core of a laptop, as measured; another machine may need a third or three times as much.
_CROSSED: Final = 2e-9  # a beam through one cell
_NOTED: Final = 2e-9  # one cell of a tile
_CELL: Final = 1e-6  # what is free, reachable and within the spawn area, for each cell
_POINT: Final = 5e-5  # one segment of a drawing's path
_CHARACTER: Final = 1e-6  # one of a TOML file
_ROBOT: Final = 4e-5  # an iteration of one robot that maps, but for its beams


@dataclass(frozen=True, slots=True)
class Work:
    """A piece of work that takes long if a scenario asks for much."""

    doing: str  # what, with the numbers that make it long
    seconds: float  # about, on one core
    key: str  # what in the scenario, or in which file, asks for it
    less: str  # what would make it less
    told: float = 10.0  # s, from which on people want to know


def reading(characters: int) -> Work:
    """To read a TOML text."""
    return Work(f"reading {characters} characters", characters * _CHARACTER, "text", "numbers in CSV files")


def drawing(segments: int, name: str) -> Work:
    """To make walls of a drawing's paths with so many segments in all; `name` is the file's."""
    return Work(f"reading {segments} segments of paths", segments * _POINT, name, "a simpler drawing")


def opening(cells: int) -> Work:
    """To find out which cells of a lattice are free and can be reached."""
    return Work(f"looking for floor in {cells} cells", cells * _CELL, "grid.cell", "larger cells")


def survey(places: int, beams: int, length: float, tile: int) -> Work:
    """To look from so many places along so many beams, each up to `length` cells long, into a tile of so many cells."""
    each = beams * (length + SURVEYING) * _CROSSED + tile * _NOTED
    return Work(f"looking from {places} places along {beams} beams", places * each, "grid.cell",
                "larger cells, fewer sensor.beams or a smaller sensor.tile")  # fmt: skip


def running(robots: int, iterations: int, beams: int, length: float) -> Work:
    """To simulate so many robots, each with so many beams up to `length` cells long, until the limit of iterations."""
    each = _ROBOT + beams * (length + SURVEYING) * _CROSSED
    return Work(f"simulating {robots} robots for up to {iterations} iterations",
                robots * iterations * each, "stop.iterations", "fewer iterations or robots", 60.0)  # fmt: skip


Listener = Callable[[Work, float], None]  # is told of work before it begins, and then which share of it is done

_ALLOWED: ContextVar[float] = ContextVar("seconds allowed", default=BUDGET)
_LISTENER: ContextVar[Listener | None] = ContextVar("listener to work", default=None)


@contextmanager
def of(seconds: float) -> Iterator[None]:
    """Within this context, every piece of work may take so many seconds."""
    token = _ALLOWED.set(seconds)
    try:
        yield
    finally:
        _ALLOWED.reset(token)


@contextmanager
def told_to(listener: Listener | None) -> Iterator[None]:
    """Within this context, a listener is told of all work, or nobody is."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def begin(work: Work) -> None:
    """Tell that work begins. Raises InputError if it takes longer than is allowed, with the number of seconds."""
    allowed = _ALLOWED.get()
    if work.seconds > allowed:
        raise InputError(
            f"{work.key}: {work.doing} takes about {lasting(work.seconds)}, more than a budget of {allowed:g} s; "
            f"expected {work.less}, or budget = {_round(work.seconds)} in the scenario if it is to be so long"
        )
    _tell(work, 0.0)


def pieces(work: Work, all_: Sequence[T]) -> Iterator[T]:
    """The pieces of some work, which is told of before the first and after each. Raises InputError as `begin` does."""
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
    """A number from 1 on, rounded up to two digits."""
    step = 10.0 ** max(0, len(str(int(number))) - 2)
    return max(1, math.ceil(number / step) * int(step))


def _tell(work: Work, share: float) -> None:
    listener = _LISTENER.get()
    if listener is not None:
        listener(work, share)
