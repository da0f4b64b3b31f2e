"""Checks that robot i does what it does by what robot i senses and hears, whatever its number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core import registry
from swarmsim.core.messages import Inbox, Said
from swarmsim.core.parts import Computation, Strategy
from swarmsim.core.scenario import tables
from swarmsim.core.state import Intents, Knowledge, Senses
from swarmsim.core.streams import Streams
from swarmsim.engine.build import Run
from swarmsim.engine.foreign import built
from swarmsim.testing.runs import ITERATIONS, limited, opened


@dataclass(frozen=True, slots=True)
class Heard:
    """What a mind was given in one iteration, and what it did with that."""

    senses: Senses
    inbox: Inbox[Any]
    said: Said[Any]
    intents: Intents


def _followed(run: Run) -> list[Heard]:
    """Everything that the minds of a run were given, in its order."""
    parts, heard = run.simulation.parts, []
    spoken: list[tuple[Senses, Said[Any]]] = []
    say, step = parts.computation.say, parts.strategy.step

    def saying(senses: Senses) -> Said[Any]:
        said = say(senses)
        spoken.append((_chosen(senses, np.arange(len(senses.alive))), said))
        return said

    def stepping(senses: Senses, inbox: Inbox[Any], knowledge: Knowledge) -> Intents:
        intents = step(senses, inbox, knowledge)
        heard.append(Heard(spoken[-1][0], inbox, spoken[-1][1], intents))
        return intents

    parts.computation.say, parts.strategy.step = saying, stepping  # type: ignore[method-assign]
    run.simulation.run()
    return heard


def _chosen(senses: Senses, rows: NDArray[np.int64]) -> Senses:
    """The same with the rows of arrays in this order."""
    decided = senses.decided
    if decided is not None:
        columns = {one.name: getattr(decided, one.name) for one in fields(decided)}
        decided = replace(decided, **{name: column[rows] for name, column in columns.items() if column is not None})
    return replace(
        senses, pose=senses.pose[rows], velocity=senses.velocity[rows], alive=senses.alive[rows],
        readings=senses.readings.take(rows), decided=decided,
    )  # fmt: skip


def _mind(run: Run, streams: Streams | None = None) -> tuple[Computation[Any, Knowledge], Strategy[Any]]:
    """A new mind, as built for a run."""
    setting = run.setting if streams is None else replace(run.setting, streams=streams)
    parts = tables(run.scenario)
    return built("computation", parts["computation"], setting), built("strategy", parts["strategy"], setting)


def _repeated(
    mind: tuple[Computation[Any, Knowledge], Strategy[Any]], senses: Senses, inbox: Inbox[Any]
) -> tuple[Said[Any], Intents]:
    computation, strategy = mind
    said = computation.say(senses)
    return said, strategy.step(senses, inbox, computation.hear(senses, inbox))


def check_locality(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """What robot i neither sensed nor heard changes nothing that it says and does, to the last bit.

    A new mind is given all that the minds of a run were given, but for everybody except robot i something else: other
    poses and readings, and no messages.
    """
    run = opened(scenario, limited(overrides, iterations), False, allow_code)
    followed, count = _followed(run), run.scenario.robots.count
    for robot in sorted({0, count // 2, count - 1}):
        with registry.own_code(allow_code):
            mind = _mind(run)
        for heard in followed:
            hears = np.flatnonzero(heard.inbox.receivers == robot)
            said, intents = _repeated(mind, _scrambled(heard.senses, robot), heard.inbox.take(hears))
            where = f"{scenario}, iteration {heard.senses.iteration}, robot {robot}"
            if not heard.senses.alive[robot]:
                continue
            for mine, first in zip(said.of(robot).arrays(), heard.said.of(robot).arrays(), strict=True):
                assert np.array_equal(mine, first, equal_nan=mine.dtype.kind == "f"), (
                    f"{where}: says something else when others sense and hear something else"
                )
            assert _done(intents, robot) == _done(heard.intents, robot), (
                f"{where}: does something else when others sense and hear something else"
            )


def _done(intents: Intents, robot: int) -> tuple[Any, ...]:
    """What one robot does, as something to compare."""
    way = intents.waypoints[robot, : intents.counts[robot]]
    twist = None if intents.twists is None else intents.twists[robot].tobytes()
    return tuple(intents.goals[robot].tolist()), way.tobytes(), bool(intents.planned[robot]), twist


def _scrambled(senses: Senses, robot: int) -> Senses:
    """The same for one robot alone: all others are where the next one was, facing about."""
    count = len(senses.alive)
    rows = np.roll(np.arange(count), 1)
    rows[robot] = robot
    other = _chosen(senses, rows)
    turned = other.pose.copy()
    turned[np.arange(count) != robot, 2] += 1.0
    return replace(other, pose=turned)


@dataclass(frozen=True, slots=True)
class Renamed(Streams):
    """Streams in which robots go by other numbers."""

    names: tuple[int, ...]  # (n,): the number under which each robot draws

    def open(self, purpose: str, robot: int = -1) -> np.random.Generator:
        """The stream of the robot of another number."""
        return Streams.open(self, purpose, robot if robot < 0 else self.names[robot])


def check_permutation(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """Robots with other numbers say and do the same, but for the rounding of sums in another order.

    Random streams go with the robots. Minds whose keys name robots, or that hash their numbers, need not pass.
    """
    run = opened(scenario, limited(overrides, iterations), False, allow_code)
    followed, count = _followed(run), run.scenario.robots.count
    rows = np.random.default_rng(run.scenario.seed).permutation(count)  # robot i is now the one that was rows[i]
    with registry.own_code(allow_code):
        mind = _mind(run, Renamed(run.scenario.seed, tuple(rows.tolist())))
    for heard in followed:
        senses = _chosen(heard.senses, rows)
        said, intents = _repeated(mind, senses, _renamed(heard.inbox, rows))
        where = f"{scenario}, iteration {heard.senses.iteration}"
        for robot in np.flatnonzero(senses.alive).tolist():
            pairs = zip(said.of(robot).arrays(), heard.said.of(int(rows[robot])).arrays(), strict=True)
            assert all(_close(mine, first) for mine, first in pairs), f"{where}: robot {robot} says something else"
        for name in ("goals", "counts", "planned"):
            mine, first = getattr(intents, name), getattr(heard.intents, name)[rows]
            assert np.array_equal(mine[senses.alive], first[senses.alive]), f"{where}: other {name}"
        if intents.twists is not None and heard.intents.twists is not None:
            assert _close(intents.twists, heard.intents.twists[rows]), f"{where}: other twists"


def _close(mine: NDArray[Any], first: NDArray[Any]) -> bool:
    return bool(np.allclose(mine, first, rtol=1e-9, atol=1e-9, equal_nan=mine.dtype.kind == "f"))


def _renamed(inbox: Inbox[Any], rows: NDArray[np.int64]) -> Inbox[Any]:
    """The inbox of robots with other numbers, in the order of those."""
    names = np.argsort(rows).astype(np.int32)
    renamed = replace(inbox, receivers=names[inbox.receivers], senders=names[inbox.senders])
    return renamed.take(np.lexsort((renamed.sent, renamed.senders, renamed.receivers)))
