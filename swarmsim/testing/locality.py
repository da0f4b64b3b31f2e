"""Checks that robot i acts only on its own readings and inbox, whatever its number and the other robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.bundle import Bundle, whole
from swarmsim.core.context import BuildContext
from swarmsim.core.messages import Broadcast, Codec, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, AnyStrategy, Parts
from swarmsim.core.scenario import registry
from swarmsim.core.state import Intents, Senses
from swarmsim.engine import minds
from swarmsim.engine.build import BuiltRun
from swarmsim.engine.jobs import bundled
from swarmsim.testing.broken import BrokenError, breaking
from swarmsim.testing.runs import ITERATIONS, limited, opened
from swarmsim.testing.witness import Heard, Witness, WitnessedJobs, chosen


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A run, with all inputs and outputs of its minds before any fault changed them."""

    run: BuiltRun
    heard: Sequence[Heard]  # in each iteration
    codec: Codec[Any]


def _followed(scenario: Path | str, overrides: Sequence[str], iterations: int, allow_code: bool) -> Followed:
    witnesses: list[Witness] = []

    def watch(parts: Parts) -> Parts:
        witnesses.append(Witness(parts.computation, parts.strategy))
        jobs = None if parts.jobs is None else WitnessedJobs(parts.jobs, witnesses[0])
        return replace(parts, computation=witnesses[0], strategy=witnesses[0].strategy, jobs=jobs)

    run = opened(scenario, limited(overrides, iterations), False, allow_code, watch)
    run.simulation.run()
    return Followed(run, witnesses[0].heard, witnesses[0].codec)


Mind = tuple[AnyComputation, AnyStrategy]


def _mind(run: BuiltRun, context: BuildContext) -> Mind:
    """A new mind, as built for a run."""
    computation, strategy = minds.together(minds.built_for(run.scenario, context), run.scenario)
    return bundled(computation, run.scenario, context)[0], strategy


def _repeated(
    mind: Mind,
    speaks: Senses,
    hears: tuple[Senses, Inbox[MessageBatch]],
    decides: tuple[Senses, Inbox[MessageBatch]],
    more: Sequence[tuple[Senses, Inbox[MessageBatch]]],
    where: str,
) -> tuple[list[Broadcast[MessageBatch]], Intents]:
    """What is said in each exchange, and decided."""
    computation, strategy = mind
    with breaking("computation", where):
        said = [computation.say(speaks)]
        known = computation.hear(*hears)
    for senses, inbox in more:
        assert isinstance(computation, Bundle)  # nobody else has further exchanges
        with breaking("job", where):
            said.append(computation.say_more(senses))
            computation.hear_more(senses, inbox)
    with breaking("strategy", where):
        return said, strategy.step(*decides, known)


def check_one_robot(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """A mind built for one robot says and does exactly what this robot does in the swarm, to the last bit.

    The first, a middle and the last robot are tried, each with its row and inbox from a run. All message columns,
    bytes and decisions are compared. A robot that a fault gives another one's knowledge is followed no further.
    """
    swarm = _followed(scenario, overrides, iterations, allow_code)
    count = swarm.run.context.swarm
    for robot in sorted({0, count // 2, count - 1}):
        _check_rows(f"{scenario}", "when it is built alone", swarm, np.array([robot]), allow_code)


def check_permutation(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """A mind with reordered rows says and does the same, to the last bit: each robot keeps its number."""
    swarm = _followed(scenario, overrides, iterations, allow_code)
    order = np.random.default_rng(swarm.run.scenario.seed).permutation(swarm.run.context.swarm)
    rows = np.empty_like(order)
    rows[order] = np.roll(order, 1)  # one cycle through all robots: none keeps its row
    _check_rows(f"{scenario}", "when rows are in another order", swarm, rows, allow_code)


def _check_rows(scenario: str, when: str, swarm: Followed, ids: NDArray[np.int64], allow_code: bool) -> None:
    """Compare a mind built for these robots (rows,) with what they said and did in the swarm."""
    with registry.own_code(allow_code):
        mind = _mind(swarm.run, swarm.run.context.serving(ids))
    codec = mind[0].codec  # available before anything is sent
    followed, count = np.ones(len(ids), np.bool_), swarm.run.context.swarm
    pace = np.ones(len(ids))
    if isinstance(mind[0], Bundle):
        mind[0].processors.slow(np.ones(len(ids), np.bool_), pace)
    for heard in swarm.heard:
        pace[:] = 1.0 if heard.pace is None else heard.pace[ids]
        for robots, source in heard.changes:
            mine = np.flatnonzero(np.isin(ids, robots))
            if source is None:
                mind[0].reset(mine)
            elif source in ids:
                mind[0].copy_from(mine, int(np.flatnonzero(ids == source)[0]))
            else:  # the source's knowledge is not available here
                followed[mine] = False
        speaks = chosen(heard.speaks, ids)
        hears, decides = (
            (chosen(senses, ids), _received(inbox, ids, count)) for senses, inbox in (heard.hears, heard.decides)
        )
        more = [(chosen(senses, ids), _received(inbox, ids, count)) for senses, _, inbox in heard.more]
        where = f"{scenario}, iteration {speaks.iteration}, {when}"
        said, intents = _repeated(mind, speaks, hears, decides, more, where)
        for row in np.flatnonzero(speaks.alive & followed).tolist():
            robot, now = int(ids[row]), speaks.iteration
            where = f"{scenario}, iteration {now}, robot {robot}"
            exchanges = [heard.said, *(one for _, one, _ in heard.more)]
            for exchange, (here, there) in enumerate(zip(said, exchanges, strict=True), now * len(said)):
                _check_said(here, row, there, robot, f"{where}: {{}} {when}")
                if there.sizes[robot] > 0 and codec.pack(robot, exchange, whole(here, row)) != swarm.codec.pack(
                    robot, exchange, whole(there, robot)
                ):
                    raise BrokenError(f"{where}: sends other bytes {when}", "computation")
            if decides[0].alive[row] and _done(intents, row) != _done(heard.intents, robot):
                raise BrokenError(f"{where}: does something else {when}", "strategy")


def _check_said(
    mine: Broadcast[MessageBatch], row: int, first: Broadcast[MessageBatch], robot: int, wrong: str
) -> None:
    """Compare a row's message with the robot's in the swarm; `wrong` has a slot for the difference."""
    here, there = (int(said.sizes[i]) for said, i in ((mine, row), (first, robot)))
    if here != there:
        raise BrokenError(wrong.format(f"says {here} bytes, not {there},"), "computation")
    content, theirs = whole(mine, row), whole(first, robot)
    names, columns = type(theirs).__match_args__, (content.arrays(), theirs.arrays())
    if type(content).__match_args__ != names or len(columns[0]) != len(columns[1]):
        raise BrokenError(wrong.format("says other columns"), "computation")
    for number, (one, other) in enumerate(zip(*columns, strict=True)):
        name = names[number] if len(names) == len(columns[0]) else "items"  # several kinds have no names
        if (one.dtype, one.shape, one.tobytes()) != (other.dtype, other.shape, other.tobytes()):
            raise BrokenError(wrong.format(f"says other {name}"), "computation")


def _received(inbox: Inbox[MessageBatch], ids: NDArray[np.int64], count: int) -> Inbox[MessageBatch]:
    """The inbox of these robots (rows,), in row order."""
    row = np.full(count, -1, np.int32)
    row[ids] = np.arange(len(ids))
    beside = tuple(_received(one, ids, count) for one in inbox.beside)
    moved = replace(inbox, receivers=row[inbox.receivers], beside=beside)
    order = np.lexsort((moved.sent, moved.senders, moved.receivers))
    return moved.take(order[moved.receivers[order] >= 0])


def check_locality(
    scenario: Path | str, overrides: Sequence[str] = (), iterations: int = ITERATIONS, allow_code: bool = False
) -> None:
    """What robot i neither sensed nor heard changes nothing it says or does, to the last bit.

    A new mind gets a run's inputs, but with other poses and readings, and no messages, for all robots except i.
    """
    swarm = _followed(scenario, overrides, iterations, allow_code)
    run, count = swarm.run, swarm.run.context.swarm
    for robot in sorted({0, count // 2, count - 1}):
        with registry.own_code(allow_code):
            mind = _mind(run, run.context)
        for heard in swarm.heard:
            hears, decides = (
                (_scrambled(senses, robot), _only(inbox, robot)) for senses, inbox in (heard.hears, heard.decides)
            )
            more = [(_scrambled(senses, robot), _only(inbox, robot)) for senses, _, inbox in heard.more]
            where = f"{scenario}, iteration {heard.speaks.iteration}, robot {robot}"
            when = "when others sense and hear something else"
            said, intents = _repeated(mind, _scrambled(heard.speaks, robot), hears, decides, more, f"{where}, {when}")
            for mine, first in zip(said, [heard.said, *(one for _, one, _ in heard.more)], strict=True):
                if heard.speaks.alive[robot]:
                    _check_said(mine, robot, first, robot, f"{where}: {{}} {when}")
            if heard.decides[0].alive[robot] and _done(intents, robot) != _done(heard.intents, robot):
                raise BrokenError(f"{where}: does something else {when}", "strategy")


def _only(inbox: Inbox[MessageBatch], robot: int) -> Inbox[MessageBatch]:
    """What one robot heard."""
    beside = tuple(_only(one, robot) for one in inbox.beside)
    return replace(inbox.take(np.flatnonzero(inbox.receivers == robot)), beside=beside)


def _done(intents: Intents, robot: int) -> tuple[object, ...]:
    """One robot's decision, in a comparable form."""
    way = intents.waypoints[robot, : intents.counts[robot]]
    twist = None if intents.twists is None else intents.twists[robot]
    velocity = None if twist is None or np.isnan(twist).all() else twist.tobytes()  # NaN means following the path
    commands = {name: column[robot].tobytes() for name, column in intents.commands.items()}
    return intents.goals[robot].tobytes(), way.tobytes(), bool(intents.planned[robot]), velocity, commands


def _scrambled(senses: Senses, robot: int) -> Senses:
    """The same for one robot only: all others take the next one's place, facing the other way."""
    count = len(senses.alive)
    rows = np.roll(np.arange(count), 1)
    rows[robot] = robot
    other = chosen(senses, rows)
    turned = other.pose.copy()
    turned[np.arange(count) != robot, 2] += 1.0
    return replace(other, pose=turned)
